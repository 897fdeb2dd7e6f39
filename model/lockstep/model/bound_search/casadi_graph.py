"""The SX graph of a CasADi function as exact expressions, with the conditions under which it is defined.

Every operation of an SX graph is supported or refused by name. Numbers are IEEE doubles taken exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite

import casadi as ca

from lockstep.check.bound.phi import ExactPhi
from lockstep.check.errors import ProblemError, demand
from lockstep.check.expression.condition import Condition
from lockstep.check.expression.exact import Exact, Value
from lockstep.check.expression.node import ONE, ZERO, Node, Undefined, constant, function, variable
from lockstep.check.expression.operations import as_number
from lockstep.check.expression.switches import FALSE, TRUE, both, either
from lockstep.model.bound_search.casadi_operations import INSTEAD, RULES, as_condition

NAMES = {getattr(ca, key): key[3:].lower() for key in dir(ca) if key.startswith("OP_")}
"""The name of each operation of CasADi, by which the checker knows it."""

_TWO = (
    "add sub mul div pow constpow atan2 hypot fmin fmax copysign lt le eq ne and or if_else_zero printme lift"
)
_BINARY = frozenset(_TWO.split())


@dataclass(frozen=True)
class _Step:
    """One instruction in single-assignment form: its operation and the steps it reads."""

    op: int
    reads: tuple[int, ...]
    value: float = 0.0


def read_value(expression: ca.SX, variables: ca.SX, time: ca.SX, algebra: Exact) -> Value:
    """Return a scalar expression as an exact node, the variables being numbered in order and the time after them.

    Raises:
        ProblemError: an operation without a meaning here, or a part that has no value, such as a constant over 0.

    >>> x, t = ca.SX.sym("x"), ca.SX.sym("t")
    >>> value = read_value((x + 3 * x) / 2 - ca.log(t), x, t, Exact(1, RULES))
    >>> value.node.data, [c.text for c in value.conditions]
    ((Fraction(0, 1), (Fraction(2, 1), Fraction(-1, 1))), ['`log` needs a positive argument, which is not proved'])
    """
    function = ca.Function("expression", [variables, time], [ca.densify(expression)])
    steps, results = _single_assignment(function)
    values: list[Node] = []
    found: list[tuple[int, Condition]] = []
    for step in steps:
        own = _value(step, values, algebra)
        values.append(own.node)
        found += [(len(values) - 1, c) for c in own.conditions]
    own = algebra.apply("number", Value(values[results[0]]))
    guards = _guards(steps, results, values)
    conditions = dict.fromkeys([*(c.under(guards.get(i, FALSE)) for i, c in found), *own.conditions])
    return Value(own.node, tuple(c for c in conditions if c.guard is not FALSE))


def _value(step: _Step, values: Sequence[Node], algebra: Exact) -> Value:
    if step.op == ca.OP_INPUT:
        return Value(variable(int(step.value)))
    if step.op == ca.OP_CONST:
        demand(isfinite(step.value), f"a coefficient of an expression is {step.value}", "", "a finite number")
        return algebra.number(step.value)
    try:
        name, given = NAMES[step.op], tuple(Value(values[i]) for i in step.reads)
        return algebra.apply("div", Value(ONE), *given) if name == "inv" else algebra.apply(name, *given)
    except Undefined as error:
        wrong = f"`{NAMES[step.op]}` of constants is {error}"
        raise ProblemError(wrong, expected="a finite number") from None


def read(phi: ca.Function) -> ExactPhi:
    """Return the expressions of phi(v, t).

    Raises `ProblemError` if phi does not map (v, scalar t) to one vector, or uses an operation that has no
    meaning here.
    """
    phi = _as_sx(phi)
    steps, results = _single_assignment(phi)
    reader = _Reader(phi.size1_in(0))
    for step in steps:
        reader.take(step)
    outputs = tuple(as_number(reader, reader.values[i]) if i >= 0 else ZERO for i in results)
    guards = _guards(steps, results, reader.values) if any(s.op == ca.OP_IF_ELSE_ZERO for s in steps) else {}
    conditions = {c.under(guards.get(i, TRUE)): None for i, c in reader.conditions}
    return ExactPhi(outputs, tuple(c for c in conditions if c.guard is not FALSE), phi.size1_in(0))


def _as_sx(phi: ca.Function) -> ca.Function:
    given = [phi.size_in(i) for i in range(phi.n_in())]
    made = [phi.size_out(i) for i in range(phi.n_out())]
    columns = len(given) == 2 and len(made) == 1 and given[0][1] <= 1 and made[0][1] <= 1
    expected = "a function of a column v and a scalar t with one column as output"
    found = f"`{phi.name()}` maps {given} to {made}"
    demand(columns and given[1] == (1, 1), found, "the nonlinearity phi", expected)
    dense = phi.sparsity_in(0).is_dense() and phi.sparsity_in(1).is_dense()
    remedy = "leave the unused entries out of v"
    demand(dense, "an input has structural zeros", "the nonlinearity phi", "dense inputs", remedy)
    try:
        return phi if phi.is_a("SXFunction") else phi.expand()
    except RuntimeError as error:
        raise ProblemError(
            f"`{phi.name()}` cannot be written as an SX graph",
            where="the nonlinearity phi",
            expected="a CasADi function built from SX",
        ) from error


def _single_assignment(phi: ca.Function) -> tuple[list[_Step], list[int]]:
    """Return the steps, and for each output entry the step that gives it (-1: a structural zero)."""
    work: dict[int, int] = {}
    steps: list[_Step] = []
    rows = phi.sparsity_out(0).row()
    results = [-1] * int(phi.size1_out(0))
    for k in range(phi.n_instructions()):
        op, reads, writes = phi.instruction_id(k), phi.instruction_input(k), phi.instruction_output(k)
        if op == ca.OP_OUTPUT:
            results[rows[writes[1]]] = work[reads[0]]
            continue
        if op == ca.OP_INPUT:
            step = _Step(op, (), float(reads[1] if reads[0] == 0 else phi.size1_in(0)))
        elif op == ca.OP_CONST:
            step = _Step(op, (), phi.instruction_constant(k))
        elif NAMES[op] in RULES:
            step = _Step(op, tuple(work[i] for i in reads[: 2 if NAMES[op] in _BINARY else 1]))
        else:
            raise ProblemError(
                f"the operation `{NAMES[op]}` has no bound here",
                where="the nonlinearity phi",
                expected="one that a formula in a problem file has",
                remedy=INSTEAD.get(op, ""),
            )
        work[writes[0]] = len(steps)
        steps.append(step)
    return steps, results


class _Reader:
    """Turns steps into expressions, noting the conditions on the way."""

    def __init__(self, inputs: int) -> None:
        self.inputs = inputs
        self.values: list[Node] = []
        self.conditions: list[tuple[int, Condition]] = []

    def take(self, step: _Step) -> None:
        """Add the expression of one more step."""
        if step.op == ca.OP_INPUT:
            node = variable(int(step.value))
        elif step.op == ca.OP_CONST:
            found = f"the constant {step.value} is not a number"
            demand(isfinite(step.value), found, "the nonlinearity phi", "finite constants")
            node = constant(Fraction(step.value))
        else:
            args = [self.values[i] for i in step.reads]
            try:
                node = RULES[NAMES[step.op]](self, *args)
            except Undefined as error:
                raise ProblemError(
                    f"`{NAMES[step.op]}` of a constant is not defined: {error}",
                    where="the nonlinearity phi",
                    expected="operations that have a value",
                ) from error
        self.values.append(node)

    def make(self, op: str, x: Node) -> Node:
        """Return a function of x in its one form, so that sin(x) + sin(-x) is 0."""
        return function(op, x)

    def need(self, kind: str, name: str, *args: Node) -> None:
        """Note what the current operation needs."""
        if kind in ("decided", "constant") and all(a.variables <= {self.inputs} for a in args):
            return  # a jump in t alone leaves phi(., t) continuous for every t
        self.conditions.append((len(self.values), Condition(kind, args, name)))


def _guards(steps: list[_Step], results: list[int], values: list[Node]) -> dict[int, Node]:
    """Return under which condition each step's value can reach an output."""
    guards: dict[int, Node] = {i: TRUE for i in results if i >= 0}
    for i in reversed(range(len(steps))):
        own = guards.get(i, FALSE)
        for place, source in enumerate(steps[i].reads):
            gate = own
            if steps[i].op == ca.OP_IF_ELSE_ZERO and place == 1:
                gate = both(own, as_condition(values[steps[i].reads[0]]))
            guards[source] = either(guards.get(source, FALSE), gate)
    return guards
