"""What the header promises of RAM, stack and flash, by formula; `verify` measures all three against it."""

from dataclasses import dataclass

from lockstep.check.c_source.kernel import Shape
from lockstep.check.c_source.reader import ANSWERS
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cores import CORES

_WIDE_MASK = 128
_ALONE = 200
"""Bytes of flash: without messages clang unrolls the loop of the self-check that it leaves alone elsewhere."""
_CLIP = {"float32": (180, 215), "float64": (120, 350)}
"""Bytes of flash that clip u and take an applied one, at all and for each input: clang unrolls up to eight of them."""
_FURTHER = {"float32": 30, "float64": 60}
"""Bytes of flash for each input but the first: copies and the self-check of u, unrolled."""
_SHIFT = 400
"""Bytes of code that take offsets from outputs, with soft arithmetic."""
_FRAME = 64
"""Bytes of stack of the function that does, beside what it keeps."""


@dataclass(frozen=True)
class _Stack:
    base: int
    per_row: int
    per_output: int
    per_term: int = 0

    def bytes(self, shape: Shape, state: int) -> int:
        rows = shape.order + shape.inputs
        used = self.per_row * rows + self.per_output * shape.outputs + self.per_term * shape.terms
        # The self-check steps a state of its own; a mask of 64 bits takes more registers than there are.
        used += state + _WIDE_MASK * (shape.neighbours > 32)
        return 8 * -(-(self.base + used) // 8)


@dataclass(frozen=True)
class _Flash:
    base: int
    network: int
    per_term: int
    per_message: int

    def bytes(self, shape: Shape, real: int) -> int:
        known = (ANSWERS + shape.neighbours) * shape.outputs + ANSWERS * (shape.order + shape.inputs)
        messages = self.per_message * shape.neighbours * shape.outputs
        network = self.network * (shape.neighbours > 0) * (1 + (shape.neighbours > 32))
        network += _ALONE * (shape.neighbours == 0)
        return self.base + network + self.per_term * shape.terms + messages + real * known


# Upper bounds fitted to measurements at -O2 and -Os, zig's clang and GCC, both variants: orders 0 to 12, 1 to 4
# outputs, 0 to 3 neighbours, 1 to 12 inputs. On RV32IMAFC clang keeps the literals of a long row on the stack.
_STACKS = {
    ("cortex-m0", "float32"): _Stack(224, 8, 24),
    ("cortex-m4f", "float32"): _Stack(152, 8, 4),
    ("cortex-m7", "float32"): _Stack(152, 8, 4),
    ("rv32imac", "float32"): _Stack(192, 8, 24),
    ("rv32imafc", "float32"): _Stack(120, 0, 0, 4),
    ("cortex-m0", "float64"): _Stack(312, 16, 48),
    ("cortex-m4f", "float64"): _Stack(344, 16, 64),
    ("cortex-m7", "float64"): _Stack(344, 16, 64),
    ("rv32imac", "float64"): _Stack(232, 16, 40),
    ("rv32imafc", "float64"): _Stack(232, 16, 40),
}
_FLASHES = {
    ("cortex-m0", "float32"): _Flash(544, 264, 30, 96),
    ("cortex-m4f", "float32"): _Flash(560, 408, 25, 84),
    ("cortex-m7", "float32"): _Flash(560, 408, 25, 84),
    ("rv32imac", "float32"): _Flash(872, 320, 43, 132),
    ("rv32imafc", "float32"): _Flash(688, 296, 36, 84),
    ("cortex-m0", "float64"): _Flash(600, 424, 48, 132),
    ("cortex-m4f", "float64"): _Flash(776, 480, 54, 132),
    ("cortex-m7", "float64"): _Flash(776, 480, 54, 132),
    ("rv32imac", "float64"): _Flash(944, 544, 70, 180),
    ("rv32imafc", "float64"): _Flash(872, 544, 70, 180),
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


def stack_budgets(shape: Shape, real: RealType, *, shifted: bool = False) -> dict[str, int]:
    """An upper bound for the stack of `init` and `step` on each core, in bytes: soft arithmetic included, interrupts not.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> stack_budgets(Shape(2, 2, 1, 1), RealType("float32"))["cortex-m4f"]
    224
    """
    kept = real.bytes * (1 + shape.neighbours) * shape.outputs
    shift = 8 * -(-(_FRAME + kept) // 8) * (shifted and shape.neighbours > 0)
    return {
        group: _STACKS[group, real.name].bytes(shape, state_bytes(shape, real)) + shift for group in CORES
    }


def flash_budgets(
    shape: Shape, real: RealType, *, limited: bool = False, shifted: bool = False
) -> dict[str, int]:
    """An upper bound for code and constants on each core, in bytes; a soft-arithmetic library is not in it.

    limited: whether u is clipped;  shifted: whether there are offsets.
    """
    base, each = _CLIP[real.name]
    more = (base + each * shape.inputs) * limited + _FURTHER[real.name] * (shape.inputs - 1)
    more += (_SHIFT + real.bytes * (1 + shape.neighbours) * shape.outputs) * (
        shifted and shape.neighbours > 0
    )
    return {group: _FLASHES[group, real.name].bytes(shape, real.bytes) + more for group in CORES}
