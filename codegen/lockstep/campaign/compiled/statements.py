"""CasADi functions as C statements that act on several runs side by side (`campaign-lanes.h`).

`lockstep.codegen.emission.kernel` prints the controllers, which are linear, in the target's arithmetic. An agent's dynamics
hold whatever its author wrote, so here every elementary function of CasADi has its C, in doubles. The order of operations is
CasADi's instruction list, each operation rounded once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from lockstep.check.errors import ProblemError
from lockstep.codegen.arithmetic import RealType

DOUBLE = RealType("float64")

BY_LANE_1 = (
    *("exp", "log", "sqrt", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("floor", "ceil", "erf", "log1p", "expm1", "sign_of"),
)
"""Functions of one argument that are called lane by lane; sin and cos are computed for all lanes at once."""

BY_LANE_2 = ("pow", "fmod", "atan2", "hypot", "copysign", "smaller", "larger")

_INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
_COMPARED = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
_FORMS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_INV: "C(1.0) / {0}",
    ca.OP_FABS: "MAGNITUDE({0})",
    ca.OP_NOT: "ONE_IF({0} == C(0.0))",
    ca.OP_AND: "ONE_IF(({0} != C(0.0)) & ({1} != C(0.0)))",
    ca.OP_OR: "ONE_IF(({0} != C(0.0)) | ({1} != C(0.0)))",
    ca.OP_IF_ELSE_ZERO: "SELECT({0} != C(0.0), {1}, C(0.0))",
}
_CALLED = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_SQRT: "sqrt",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_ERF: "erf",
    ca.OP_LOG1P: "log1p",
    ca.OP_EXPM1: "expm1",
    ca.OP_SIGN: "sign_of",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_FMOD: "fmod",
    ca.OP_ATAN2: "atan2",
    ca.OP_HYPOT: "hypot",
    ca.OP_COPYSIGN: "copysign",
    ca.OP_FMIN: "smaller",
    ca.OP_FMAX: "larger",
}


@dataclass(frozen=True)
class LaneFunction:
    """A C function on lanes: its name, its parameters and its body."""

    name: str
    signature: str
    lines: tuple[str, ...]


def lane_function(name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX], names: str) -> LaneFunction:
    """Print expressions as a C function of arrays of lanes, inputs first; outputs must overlap no input.

    Args:
        name: of the C function.
        inputs: columns of symbols;  outputs: columns of expressions in them.
        names: of the C parameters, separated by spaces, inputs first.

    Raises:
        ProblemError: an elementary function that has no C here.

    >>> x = ca.SX.sym("x")
    >>> print(*lane_function("f", [x], [ca.sin(x) - 2.5 * x], "x dx").lines, sep=chr(10))
    v t0;
    lanes_sin(&t0, &x[0]);
    const v t1 = C(2.5) * x[0];
    const v t2 = t0 - t1;
    dx[0] = t2;
    """
    letters = names.split()
    signature = ", ".join(
        [f"const v *{letter}" for letter in letters[: len(inputs)]]
        + [f"v *restrict {letter}" for letter in letters[len(inputs) :]]
    )
    function = ca.Function(name, list(inputs), ca.cse([ca.densify(one) for one in outputs]))
    return LaneFunction(name, signature, tuple(_statements(function, letters)))


def _statements(function: Any, letters: Sequence[str]) -> list[str]:
    given = letters[: function.n_in()]
    written = letters[function.n_in() :]
    work: dict[int, str] = {}
    lines: list[str] = []
    count = 0
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        taken, made = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"{written[made[0]]}[{made[1]}] = {work[taken[0]]};")
        elif operation == ca.OP_INPUT:
            work[made[0]] = f"{given[taken[0]]}[{taken[1]}]"
        elif operation == ca.OP_CONST:
            work[made[0]] = _constant(function.instruction_constant(k))
        else:
            lines += _defined(f"t{count}", operation, [work[i] for i in taken])
            work[made[0]] = f"t{count}"
            count += 1
    unread = [f"(void){letter};" for letter in given if not any(f"{letter}[" in line for line in lines)]
    return lines + unread


def _constant(value: float) -> str:
    if math.isnan(value):
        return "C(NAN)"
    if math.isinf(value):
        return "C(INFINITY)" if value > 0 else "C(-INFINITY)"
    return f"C({DOUBLE.literal(value)})"


def _defined(name: str, operation: int, arguments: list[str]) -> list[str]:
    if operation in _INFIX:
        return [f"const v {name} = {arguments[0]} {_INFIX[operation]} {arguments[1]};"]
    if operation in _COMPARED:
        return [f"const v {name} = ONE_IF({arguments[0]} {_COMPARED[operation]} {arguments[1]});"]
    if operation in _FORMS:
        return [f"const v {name} = {_FORMS[operation].format(*arguments)};"]
    if operation in _CALLED:
        passed, before = [], [f"v {name};"]
        for place, argument in enumerate(arguments):
            # The address of a constant is the address of a copy.
            if argument.startswith("C("):
                before.append(f"const v {name}_{place} = {argument};")
                argument = f"{name}_{place}"
            passed.append(f"&{argument}")
        return [*before, f"lanes_{_CALLED[operation]}(&{name}, {', '.join(passed)});"]
    raise ProblemError(
        f"the dynamics hold CasADi's operation {operation}",
        where="campaign",
        expected="the functions that a problem file may hold",
    )
