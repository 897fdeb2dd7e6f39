"""What the header bounds of RAM, stack and flash, by formula; `verify` measures all three against it.

What the C declares is counted exactly (`state_bytes`, `fixed_stack`, `fixed_flash`). What a compiler adds, frames and
spilled values, code and literals, is bounded by a linear form in the dimensions with coefficients >= 0
(`bound_coefficients`), fitted above measurements of many shapes by `benchmarks/cores/bounds_fit.py`:

- each row of [A B; C D] is a sum that lives until all are known to be finite; where the rows are unrolled, their literals
  and the entries of x and r that they share are kept too (terms);
- clang unrolls loops over the neighbours, in whole or in parts of up to eight, so that code grows with them up to a
  number, and addresses and bits of those unrolled are spilled; beyond it the loops are loops;
- a mask of 64 bits takes more registers than a core with 32 bits has.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from lockstep.check.c_source.kernel import Shape
from lockstep.check.c_source.reader import ANSWERS
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import FLASH, STACK, Optimize, Table
from lockstep.codegen.cost.cores import CORES

ALIKE = {"cortex-m7": "cortex-m4f"}
SOFT_ALIKE = {**ALIKE, "rv32imafc": "rv32imac"}
"""In float64 the unit for single precision is not used."""


class Extent(NamedTuple):
    """What the C of an agent is, beside its gains: its dimensions, whether u is clipped, whether there are offsets."""

    shape: Shape
    limited: bool = False
    shifted: bool = False

    @property
    def rows(self) -> int:
        """Of [A B; C D]."""
        return self.shape.order + self.shape.inputs

    @property
    def entries(self) -> int:
        """Of all messages."""
        return self.shape.neighbours * self.shape.outputs

    @property
    def offsets(self) -> int:
        """That are taken from own and others' outputs."""
        return (1 + self.shape.neighbours) * self.shape.outputs * (self.shifted and self.shape.neighbours > 0)


Part = Callable[[Extent], int]
"""Of what there are so many in the C."""

STACK_PARTS: tuple[Part, ...] = (
    lambda _: 1,
    lambda f: f.rows,
    lambda f: f.shape.outputs,
    lambda f: f.shape.terms,
    lambda f: f.shape.neighbours > 0,
    lambda f: f.shape.outputs * min(f.shape.neighbours, 8),
    lambda f: min(f.shape.neighbours, 16),
    lambda f: f.shape.neighbours > 32,
    lambda f: f.offsets > 0,
)
FLASH_PARTS: tuple[Part, ...] = (
    *STACK_PARTS,
    lambda f: f.shape.neighbours == 0,
    lambda f: f.shape.outputs * min(f.shape.neighbours, 16),
    lambda f: f.limited,
    lambda f: f.limited * f.shape.inputs,
    lambda f: (f.offsets > 0) * f.shape.outputs * min(f.shape.neighbours, 16),
)


def linear(
    table: Table, parts: Sequence[Part], extent: Extent, real: RealType, optimize: Optimize
) -> dict[str, int]:
    """Sum of coefficient times number, on each core, rounded up; the table's coefficients are tenths."""
    alike = ALIKE if real.name == "float32" else SOFT_ALIKE
    numbers = [part(extent) for part in parts]
    found = {group: table[alike.get(group, group), real.name, optimize] for group in CORES}
    return {
        group: -(-sum(a * b for a, b in zip(tenths, numbers, strict=True)) // 10)
        for group, tenths in found.items()
    }


def state_bytes(shape: Shape, real: RealType) -> int:
    """`sizeof` of the state with natural alignment: x, u, held, the mask, two counters per neighbour, and the mark.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> state_bytes(Shape(2, 2, 1, 1), RealType("float32"))
    36
    """
    neighbours = shape.neighbours
    mask = 0 if neighbours == 0 else 4 if neighbours <= 32 else 8
    reals = real.bytes * (shape.order + shape.inputs + neighbours * shape.outputs)
    alignment = max(real.bytes, mask, 4)
    start = -(-reals // mask) * mask if mask else reals
    return -(-(start + mask + 8 * neighbours + 4) // alignment) * alignment


def fixed_stack(extent: Extent, real: RealType) -> int:
    """Bytes that the C declares: the state that the self-check steps, what it tries as NaN, outputs less their offsets."""
    tried = 1 + (extent.entries or extent.shape.outputs)
    return state_bytes(extent.shape, real) + real.bytes * (tried + extent.offsets)


def fixed_flash(extent: Extent, real: RealType, optimize: Optimize) -> int:
    """Bytes of constants that the C declares: known answers, weights, limits, offsets, and gains where they are a table."""
    shape = extent.shape
    known = (ANSWERS + shape.neighbours) * shape.outputs + ANSWERS * extent.rows
    tables = shape.neighbours + 2 * shape.inputs * extent.limited + extent.offsets
    return real.bytes * (known + tables + shape.terms * (optimize == "size"))


def stack_budgets(extent: Extent, real: RealType, optimize: Optimize) -> dict[str, int]:
    """Bytes of stack of `init` and `step` at the most on each core: soft arithmetic included, interrupts not.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> found = stack_budgets(Extent(Shape(2, 2, 1, 1)), RealType("float32"), "speed")["cortex-m4f"]
    >>> 152 < found < 304  # what one arm takes, and twice that
    True
    """
    declared = fixed_stack(extent, real)
    added = linear(STACK, STACK_PARTS, extent, real, optimize)
    return {group: 8 * -(-(declared + one) // 8) for group, one in added.items()}


def flash_budgets(extent: Extent, real: RealType, optimize: Optimize) -> dict[str, int]:
    """Bytes of code and constants at the most on each core; a soft-arithmetic library is not in it."""
    declared = fixed_flash(extent, real, optimize)
    added = linear(FLASH, FLASH_PARTS, extent, real, optimize)
    return {group: 4 * -(-(declared + one) // 4) for group, one in added.items()}
