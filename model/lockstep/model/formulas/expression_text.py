"""CasADi expressions as text: what `expression` reads, written.

CasADi folds what it builds: x*x is sq(x), x + x is twice(x), if_else is a sum of two `if_else_zero`. Reading the
text makes it fold the same parts again. So the text is read back and written once more before it is returned:
the same text both times means the same operations on the same operands, and the same bits in every value.

One rewriting comes first, of what cannot be read as it stands. A comparison used as a number, (x < 1)*y, becomes
if_else(x < 1, 1, 0), and CasADi moves a factor of that into the branch: if_else(x < 1, y, 0). The values are the
same, up to the sign of a zero. The square and the double of a branch become the branch of the square and the double.

The language has no names for parts, so a part that is used twice is written twice.
"""

from collections.abc import Mapping, Sequence
from math import isfinite

import casadi as ca

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import shorten
from lockstep.model.bound_search.casadi_graph import NAMES
from lockstep.model.bound_search.casadi_operations import INSTEAD
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.formulas.expression_writer import ARITY, COMPARISONS, REPEATED, Step, write

_TRUTHS = frozenset({*COMPARISONS, ca.OP_NOT})


def expression_text(value: ca.SX, symbols: Mapping[str, ca.SX], *, where: str = "") -> str:
    """Return the text that `parse_expression` reads as `value`.

    Args:
        value: a scalar expression.
        symbols: the symbol behind each name.
        where: the place in the problem file, for messages.

    Raises:
        ProblemError: a symbol without a name, an operation the language lacks, a constant that is not finite, a
            text too long or too deep for the language, or an expression that CasADi would build differently
            (made with its simplifications turned off).

    >>> x, v = ca.SX.sym("x"), ca.SX.sym("v")
    >>> expression_text(v * (1 - x**2) - ca.fmin(2 * x, 1.5) + ca.if_else(x > 0, -v, 0.1), {"x": x, "v": v})
    'v*(1 - x**2) - min(2*x, 1.5) + if_else(0 < x, -v, 0.1)'
    >>> expression_text(ca.erf(x), {"x": x})
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: the operation `erf` of CasADi; expected one that a formula in a problem
    file has
    """
    steps = _steps(_checked(value, symbols, where), symbols, where)
    if _truths_as_numbers(steps) or any(_moves_inside(steps, step) for step in steps):
        steps = _steps(_rebuilt(steps, symbols), symbols, where)
    text = write(steps, where=where)
    try:
        again = parse_expression(text, symbols, where=where)
    except ProblemError as error:
        raise ProblemError(
            f"as text, {error.found}", where=where, expected=error.expected, remedy=REPEATED
        ) from None
    text_again = write(_steps(again, symbols, where), where=where)
    found = f"CasADi builds `{shorten(text)}` as `{shorten(text_again)}`"
    demand(text_again == text, found, where, "an expression made with CasADi's simplifications on")
    return text


def _checked(value: ca.SX, symbols: Mapping[str, ca.SX], where: str) -> ca.SX:
    value = ca.densify(ca.SX(value))
    demand(value.shape == (1, 1), f"an expression of {value.shape[0]} x {value.shape[1]}", where, "a scalar")
    named = {symbol.element_hash() for symbol in symbols.values()}
    for symbol in ca.symvar(value):
        found = f"the symbol `{shorten(str(symbol))}` has no name here"
        remedy = "substitute a number for it, or declare it"
        demand(symbol.element_hash() in named, found, where, shorten(", ".join(symbols), 120), remedy)
    return value


def _steps(value: ca.SX, symbols: Mapping[str, ca.SX], where: str) -> list[Step]:
    """Return the instructions in single-assignment form; the last one gives the value."""
    names = list(symbols)
    graph = ca.Function("expression", [symbols[name] for name in names], [value])
    work: dict[int, int] = {}
    steps: list[Step] = []
    for k in range(graph.n_instructions()):
        op, reads = graph.instruction_id(k), graph.instruction_input(k)
        if op == ca.OP_OUTPUT:
            continue
        if op == ca.OP_INPUT:
            step = Step(op, name=names[reads[0]])
        elif op == ca.OP_CONST:
            step = Step(op, number=_finite(graph.instruction_constant(k), where))
        elif op in ARITY:
            step = Step(op, tuple(work[slot] for slot in reads[: ARITY[op]]))
        else:
            raise ProblemError(
                f"the operation `{NAMES.get(op, op)}` of CasADi",
                where=where,
                expected="one that a formula in a problem file has",
                remedy=INSTEAD.get(op, ""),
            )
        work[graph.instruction_output(k)[0]] = len(steps)
        steps.append(step)
    return steps


def _finite(number: float, where: str) -> float:
    demand(isfinite(number), f"the constant {number}", where, "finite numbers")
    return number


def _truths_as_numbers(steps: Sequence[Step]) -> bool:
    """Whether a comparison stands where the language has numbers only."""
    used = [k for step in steps for place, k in enumerate(step.operands) if _is_number(step, place)]
    return any(steps[k].op in _TRUTHS for k in [*used, -1])


def _is_number(step: Step, place: int) -> bool:
    """Whether an operation takes a number in this place, and not a condition."""
    return not (step.op == ca.OP_NOT or (step.op == ca.OP_IF_ELSE_ZERO and place == 0))


def _moves_inside(steps: Sequence[Step], step: Step) -> bool:
    """Whether this is sq or twice of one branch: CasADi reads x**2 and 2*x as products, and moves these inside."""
    return step.op in (ca.OP_SQ, ca.OP_TWICE) and steps[step.operands[0]].op == ca.OP_IF_ELSE_ZERO


def _rebuilt(steps: Sequence[Step], symbols: Mapping[str, ca.SX]) -> ca.SX:
    """Return the expression again, in operations that a text can lead to."""
    values: list[ca.SX] = []

    def operand(step: Step, place: int) -> ca.SX:
        k = step.operands[place]
        return _as_number(values[k]) if _is_number(step, place) else values[k]

    for step in steps:
        if step.op == ca.OP_INPUT:
            values.append(symbols[step.name])
        elif step.op == ca.OP_CONST:
            values.append(ca.SX(step.number))
        else:
            values.append(_applied(step.op, [operand(step, place) for place in range(len(step.operands))]))
    return _as_number(values[-1])


def _as_number(value: ca.SX) -> ca.SX:
    return ca.if_else(value, 1, 0) if value.op() in _TRUTHS else value


def _applied(op: int, operands: list[ca.SX]) -> ca.SX:
    if op in (ca.OP_SQ, ca.OP_TWICE) and operands[0].op() == ca.OP_IF_ELSE_ZERO:
        condition, value = operands[0].dep(0), operands[0].dep(1)
        return ca.SX.binary(ca.OP_IF_ELSE_ZERO, condition, _applied(op, [value]))
    return ca.SX.unary(op, *operands) if len(operands) == 1 else ca.SX.binary(op, *operands)
