"""The kernel (x, r) -> (x+, u) as a straight line of C statements, from CasADi's instruction list.

CasADi builds and simplifies the expression; its own C printer is not used, because it writes double literals
and double library calls whatever `casadi_real` is, and may be called with an output over an input. Here every
instruction becomes one assignment to a fresh constant of the target type, so the order of every rounding is
on paper:

    row i of (x+, u)  =  ((M_i0 z_0 + M_i1 z_1) + M_i2 z_2) + ...,   z = (x, r),  M = [A B; C D]

with zero terms skipped. The simplifications CasADi makes here are exact in IEEE arithmetic: 1 z = z,
-1 z = -z, 2 z = z + z, a + (-b) = a - b.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.codegen.arithmetic import RealType


@dataclass(frozen=True)
class Kernel:
    """C statements of the kernel and their count, by kind."""

    statements: tuple[str, ...]
    multiplications: int
    additions: int


def kernel_function(M: Float[np.ndarray, "rows cols"], order: int) -> ca.Function:
    """The kernel as a CasADi function of (x, r), outputs (x+, u), each sum built from left to right."""
    x, r = ca.SX.sym("x", order), ca.SX.sym("r", M.shape[1] - order)
    z = ca.vertsplit(ca.vertcat(x, r))
    rows = [_row(coefficients, z) for coefficients in M]
    return ca.Function("kernel", [x, r], [ca.vertcat(*rows[:order]), ca.vertcat(*rows[order:])])


def _row(coefficients: np.ndarray, z: list[ca.SX]) -> ca.SX:
    terms = [float(a) * v for a, v in zip(coefficients, z, strict=True) if a != 0]
    return reduce(add, terms) if terms else ca.SX(0)


_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*"}


class _Printer:
    """Walks the instruction list; `work` maps CasADi's work slots to the C expression they hold now."""

    def __init__(self, function: ca.Function, real: RealType) -> None:
        self.function, self.real = function, real
        self.work: dict[int, str] = {}
        self.statements: list[str] = []
        self.inputs: dict[str, str] = {}
        self.counts = {"*": 0, "+": 0}

    def define(self, prefix: str, expression: str) -> str:
        name = f"{prefix}{len(self.statements)}" if prefix == "t" else prefix
        self.statements.append(f"const {self.real.c_name} {name} = {expression};")
        return name

    def load(self, vector: int, index: int) -> str:
        """Read an input once: `x0` is x[0]. So an output written later can never change it."""
        letter = "xr"[vector]
        name = f"{letter}{index}"
        if name not in self.inputs:
            self.inputs[name] = self.define(name, f"{letter}[{index}]")
        return name

    def instruction(self, k: int) -> None:
        operation = self.function.instruction_id(k)
        taken = self.function.instruction_input(k)
        given = self.function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            target = ("x_next", "u_next")[given[0]]
            self.statements.append(f"{target}[{given[1]}] = {self.work[taken[0]]};")
        elif operation == ca.OP_INPUT:
            self.work[given[0]] = self.load(taken[0], taken[1])
        elif operation == ca.OP_CONST:
            self.work[given[0]] = self.real.literal(self.function.instruction_constant(k))
        else:
            self.work[given[0]] = self.define("t", self.expression(operation, [self.work[i] for i in taken]))

    def expression(self, operation: int, arguments: list[str]) -> str:
        if operation == ca.OP_NEG:
            return f"-{arguments[0]}"
        if operation == ca.OP_TWICE:
            self.counts["+"] += 1
            return f"{arguments[0]} + {arguments[0]}"
        if operation not in _BINARY:
            raise NotImplementedError(f"a linear kernel holds CasADi operation {operation}")
        sign = _BINARY[operation]
        self.counts["*" if sign == "*" else "+"] += 1
        return f"{arguments[0]} {sign} {arguments[1]}"


def straight_line(M: Float[np.ndarray, "rows cols"], order: int, real: RealType) -> Kernel:
    """Print the kernel for coefficients already rounded to `real`: `x_next` and `u_next` from `x` and `r`.

    >>> import numpy as np
    >>> M = np.array([[0.5, 2.0], [0.0, -1.0]])
    >>> print(*straight_line(M, 1, RealType("float32")).statements, sep=chr(10))
    const float x0 = x[0];
    const float t1 = 0.5f * x0;
    const float r0 = r[0];
    const float t3 = r0 + r0;
    const float t4 = t1 + t3;
    x_next[0] = t4;
    const float t6 = -r0;
    u_next[0] = t6;
    """
    printer = _Printer(kernel_function(M, order), real)
    function: Any = printer.function
    for k in range(function.n_instructions()):
        printer.instruction(k)
    return Kernel(tuple(printer.statements), printer.counts["*"], printer.counts["+"])
