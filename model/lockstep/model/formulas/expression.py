"""Expressions of a problem file as CasADi SX, operation by operation as they are written.

The text is read by `lockstep.check.expression.text`, as the checker reads it; only what the operations build differs.
`mistakes` looks first for what people usually get wrong.
"""

import math
from collections.abc import Callable, Mapping

import casadi as ca

from lockstep.check.expression.text import parse
from lockstep.model.formulas.mistakes import check_text

_OPERATIONS: Mapping[str, Callable[..., ca.SX]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": lambda a, b: a**b,
    "neg": lambda a: -a,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
}


class _Symbolic:
    """The algebra of CasADi's scalar expressions."""

    def number(self, value: float) -> ca.SX:
        return ca.SX(float(value))

    def apply(self, operation: str, *values: ca.SX) -> ca.SX:
        return (_OPERATIONS.get(operation) or getattr(ca, operation))(*values)

    def size(self, value: ca.SX) -> float | None:
        return float(value) if value.is_constant() else None

    def worst_constant(self, value: ca.SX) -> float:
        """Find an overflow that CasADi's folding hides inside: (1e308*x)*10 becomes inf*x."""
        graph = ca.Function("expression", ca.symvar(value), [value])
        places = [k for k in range(graph.n_instructions()) if graph.instruction_id(k) == ca.OP_CONST]
        constants = (float(graph.instruction_constant(k)) for k in places)
        return next((c for c in constants if not math.isfinite(c)), 0.0)


def parse_expression(text: str, symbols: Mapping[str, ca.SX | float], *, where: str = "") -> ca.SX:
    """Parse `text` into a scalar CasADi expression in `symbols`: see `lockstep.check.expression.text.parse`.

    >>> x = ca.SX.sym("x")
    >>> parse_expression("-gravity*sin(x) + if_else(x < 0, 0, x**2)", {"x": x, "gravity": 2.0})
    SX(((-2*sin(x))+((!(x<0))?sq(x):0)))
    >>> parse_expression("2*y", {"x": x})
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: unknown symbol `y` at column 3 of `2*y`; expected x, t, pi or a
    function ...
    """
    check_text(text, where)
    return parse(text, symbols, _Symbolic(), where=where)
