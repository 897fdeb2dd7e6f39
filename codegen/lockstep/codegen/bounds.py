"""What the header bounds on each core: stack and flash (`budget`), and the instructions of a step."""

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.budget import flash_budgets, stack_budgets
from lockstep.codegen.cores import CORES
from lockstep.codegen.spec import Optimize

# Tenths of instructions: at all, for each term, row, message entry, neighbour, output, limit, offset, and neighbour of a
# mask of 64 bits. 1.15 times what bounds measurements at -O2 and -Os, zig's clang and GCC: dense gains, orders 0 to 8, 1 to 3
# outputs, 0 to 3 neighbours and 33, 1 to 4 inputs, fed subnormals, huge and non-finite values, gains that are subnormal too.
_INSTRUCTIONS: dict[tuple[str, str, Optimize], tuple[int, ...]] = {
    ("cortex-m0", "float32", "speed"): (0, 3776, 0, 6484, 379, 0, 806, 0, 1393),
    ("cortex-m0", "float32", "size"): (196, 3785, 2080, 8454, 218, 0, 0, 0, 0),
    ("cortex-m4f", "float32", "speed"): (17, 32, 119, 349, 238, 89, 194, 107, 361),
    ("cortex-m4f", "float32", "size"): (0, 102, 348, 304, 199, 101, 118, 105, 356),
    ("rv32imac", "float32", "speed"): (0, 3065, 0, 4881, 295, 604, 0, 0, 0),
    ("rv32imac", "float32", "size"): (0, 2896, 1858, 7249, 1032, 251, 955, 0, 0),
    ("rv32imafc", "float32", "speed"): (112, 85, 81, 331, 172, 0, 102, 104, 357),
    ("rv32imafc", "float32", "size"): (0, 69, 566, 393, 23, 15, 0, 124, 280),
    ("cortex-m0", "float64", "speed"): (0, 9511, 0, 12472, 0, 0, 0, 0, 703),
    ("cortex-m0", "float64", "size"): (0, 9549, 0, 16156, 6197, 0, 514, 0, 0),
    ("cortex-m4f", "float64", "speed"): (0, 3582, 0, 8804, 0, 616, 0, 0, 0),
    ("cortex-m4f", "float64", "size"): (0, 3591, 1610, 9650, 0, 274, 1081, 0, 0),
    ("rv32imac", "float64", "speed"): (0, 4969, 0, 7412, 325, 280, 0, 0, 0),
    ("rv32imac", "float64", "size"): (0, 4758, 1798, 10225, 2369, 0, 1334, 0, 0),
    ("rv32imafc", "float64", "speed"): (0, 4969, 0, 7412, 325, 280, 0, 0, 0),
    ("rv32imafc", "float64", "size"): (0, 4758, 1798, 10225, 2369, 0, 1334, 0, 0),
}
_ALIKE = {"cortex-m7": "cortex-m4f"}


def instruction_budgets(
    shape: Shape, real: RealType, *, optimize: Optimize, limited: bool = False, shifted: bool = False
) -> dict[str, int]:
    """An upper bound for the instructions of a step on each core, faults and soft arithmetic included.

    Without a library the code's form bounds them; soft arithmetic takes more or fewer with its operands.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> instruction_budgets(Shape(2, 2, 1, 1), RealType("float32"), optimize="speed")["cortex-m4f"]
    0
    """
    nn, q = shape.neighbours, shape.outputs
    each = [1, shape.terms, shape.order + shape.inputs, nn * q, nn, q]
    each += [limited * shape.inputs, (shifted and nn > 0) * (1 + nn) * q, (nn > 32) * nn]
    found = {group: _INSTRUCTIONS[_ALIKE.get(group, group), real.name, optimize] for group in CORES}
    return {
        group: -(-sum(a * b for a, b in zip(tenths, each, strict=True)) // 10)
        for group, tenths in found.items()
    }


def bounds(
    shape: Shape, real: RealType, *, optimize: Optimize, limited: bool, shifted: bool
) -> dict[str, dict[str, int]]:
    """Upper bounds of `stack` and `flash` in bytes and of the `instructions` of a step, per core.

    limited: whether u is clipped;  shifted: whether there are offsets.
    """
    most = instruction_budgets(shape, real, optimize=optimize, limited=limited, shifted=shifted)
    flash = flash_budgets(shape, real, limited=limited, shifted=shifted)
    return {"stack": stack_budgets(shape, real, shifted=shifted), "flash": flash, "instructions": most}
