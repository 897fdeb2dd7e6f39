"""What the header bounds on each core: stack and flash (`budget`), and the instructions of a step."""

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.budget import flash_budgets, stack_budgets
from lockstep.codegen.cores import CORES
from lockstep.codegen.spec import Optimize

# Tenths of instructions: at all, for each term, row, message entry, neighbour, output, limit, offset, and neighbour of a
# mask of 64 bits. 1.3 times what bounds measurements at -O2 and -Os, zig's clang and GCC: dense gains, orders 0 to 8, 1 to 3
# outputs, 0 to 3 neighbours and 33 to 64, 1 to 4 inputs, fed subnormals, huge and non-finite values; subnormal gains too.
_INSTRUCTIONS: dict[tuple[str, str, Optimize], tuple[int, ...]] = {
    ("cortex-m0", "float32", "speed"): (0, 4268, 0, 7330, 428, 0, 911, 0, 1575),
    ("cortex-m0", "float32", "size"): (222, 4279, 2352, 9556, 247, 0, 0, 0, 0),
    ("cortex-m4f", "float32", "speed"): (19, 36, 135, 394, 269, 101, 219, 121, 408),
    ("cortex-m4f", "float32", "size"): (0, 115, 394, 343, 225, 114, 133, 119, 403),
    ("rv32imac", "float32", "speed"): (0, 3465, 0, 5518, 333, 683, 0, 0, 0),
    ("rv32imac", "float32", "size"): (0, 3273, 2100, 8194, 1167, 283, 1079, 0, 0),
    ("rv32imafc", "float32", "speed"): (127, 95, 91, 375, 194, 0, 115, 117, 404),
    ("rv32imafc", "float32", "size"): (0, 78, 640, 444, 26, 17, 0, 140, 316),
    ("cortex-m0", "float64", "speed"): (0, 10751, 0, 14099, 0, 0, 0, 0, 795),
    ("cortex-m0", "float64", "size"): (0, 10795, 0, 18263, 7005, 0, 581, 0, 0),
    ("cortex-m4f", "float64", "speed"): (0, 4049, 0, 9953, 0, 697, 0, 0, 0),
    ("cortex-m4f", "float64", "size"): (0, 4059, 1820, 10909, 0, 310, 1222, 0, 0),
    ("rv32imac", "float64", "speed"): (0, 5617, 0, 8378, 367, 316, 0, 0, 0),
    ("rv32imac", "float64", "size"): (0, 5378, 2033, 11559, 2677, 0, 1508, 0, 0),
    ("rv32imafc", "float64", "speed"): (0, 5617, 0, 8378, 367, 316, 0, 0, 0),
    ("rv32imafc", "float64", "size"): (0, 5378, 2033, 11559, 2677, 0, 1508, 0, 0),
}
_ALIKE = {"cortex-m7": "cortex-m4f"}


def instruction_budgets(
    shape: Shape, real: RealType, *, optimize: Optimize, limited: bool = False, shifted: bool = False
) -> dict[str, int]:
    """An upper bound for the instructions of a step on each core, faults and soft arithmetic included.

    Without a library the code's form bounds them; soft arithmetic takes more or fewer with its operands.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> instruction_budgets(Shape(2, 2, 1, 1), RealType("float32"), optimize="speed")["cortex-m4f"]
    212
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
