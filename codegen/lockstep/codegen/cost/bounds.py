"""What the header bounds on each core: stack and flash (`budget`), and the instructions of a step.

A step is at most so many instructions of its own, and as many operations of soft arithmetic as its C has, each at its
worst operands:

    instructions <= own + sum over kinds (operations of the kind) * (most instructions of one)

The first term: no loop runs longer than its constant bound, so the longest path through a step depends on which messages
arrived or were heard before, on limits and on faults; measurements walk these paths (`benchmarks/cores/bounds.py`), and the
coefficients are 1.3 times what bounds them. With the arithmetic in hardware that is all. The second term: operations are
counted from the C, as on the longest path, and the routines of compiler-rt (zig) and libgcc were searched for the operands
that take the most: subnormal ones above all, sums that cancel, NaN. It is 1.1 times what was found, and it is for any
data, so that ordinary data takes a half of it or less; a library of another vendor may take more.
"""

from collections.abc import Mapping
from typing import Any

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import INTEGERS, OWN, ROUTINES, Optimize
from lockstep.codegen.cost.budget import SOFT_ALIKE, Extent, Part, flash_budgets, linear, stack_budgets
from lockstep.codegen.cost.cores import CORES

OWN_PARTS: tuple[Part, ...] = (
    lambda _: 1,
    lambda f: f.shape.terms,
    lambda f: f.rows,
    lambda f: f.entries,
    lambda f: f.shape.neighbours,
    lambda f: f.shape.outputs,
    lambda f: f.shape.inputs * f.limited,
    lambda f: f.offsets,
    lambda f: f.shape.neighbours * (f.shape.neighbours > 32),
)
INTEGER_PARTS: tuple[Part, ...] = (
    lambda _: 1,
    lambda f: f.rows * (2 * f.shape.order + f.shape.outputs),  # each state is two halves
    lambda f: f.rows,
    lambda f: f.entries,
    lambda f: f.shape.neighbours,
    lambda f: f.shape.outputs,
    lambda f: f.shape.order,
    lambda f: f.shape.neighbours * (f.shape.neighbours > 32),
)


def operations(extent: Extent) -> tuple[int, int, int, int, int]:
    """Floating-point operations of the longest path, by what their operands may be.

    Sums and differences of any numbers; v - v of what is checked to be finite; sums of zeros and NaN; products;
    comparisons. A check of n values is n differences v - v, and as many sums.

    >>> operations(Extent(Shape(2, 2, 1, 1)))  # the kernel: 12 products; the relative outputs: 2 products, 4 sums
    (16, 7, 10, 14, 4)
    """
    shape, checked = extent.shape, extent.rows + extent.shape.outputs + extent.entries
    sums = shape.terms + 2 * extent.entries + extent.offsets
    # comparisons: of the kernel's check, of that of own outputs, and of that of each neighbour, which clang may make twice
    return (
        sums,
        checked,
        checked + 2 + shape.neighbours,
        shape.terms + extent.entries,
        2 + 2 * shape.neighbours + 2 * shape.inputs * extent.limited,
    )


def listening(shape: Shape) -> Shape:
    """Return the shape, with a neighbour where there is none: such agents do less, and few of them were measured."""
    return shape._replace(neighbours=max(1, shape.neighbours))


def instruction_budgets(extent: Extent, real: RealType, optimize: Optimize) -> dict[str, int]:
    """Instructions of a step at the most on each core, faults and soft arithmetic included."""
    extent = extent._replace(shape=listening(extent.shape))
    own = linear(OWN, OWN_PARTS, extent, real, optimize)
    soft = {group: ROUTINES[group, real.name] for group in CORES if real.name not in CORES[group].hardware}
    for group, most in soft.items():
        own[group] += -(-11 * sum(a * b for a, b in zip(most, operations(extent), strict=True)) // 10)
    return own


def integer_budgets(shape: Shape) -> dict[str, int]:
    """Instructions of a step in integers (`fixed/`) at the most on each core: data changes only what saturates."""
    numbers = [part(Extent(listening(shape))) for part in INTEGER_PARTS]
    return {
        group: -(
            -sum(a * b for a, b in zip(INTEGERS[SOFT_ALIKE.get(group, group)], numbers, strict=True)) // 10
        )
        for group in CORES
    }


def bounds(extent: Extent, real: RealType, optimize: Optimize) -> dict[str, dict[str, int]]:
    """Bounds of `stack` and `flash` in bytes and of the `instructions` of a step, per core."""
    return {
        "stack": stack_budgets(extent, real, optimize),
        "flash": flash_budgets(extent, real, optimize),
        "instructions": instruction_budgets(extent, real, optimize),
    }


def by_core(budgets: Mapping[str, int]) -> list[dict[str, Any]]:
    """Cores with the same bound together: one line each in the header, in the order of `CORES`."""
    titles: dict[int, list[str]] = {}
    for group, most in budgets.items():
        titles.setdefault(most, []).append(CORES[group].title)
    return [{"most": most, "cores": ", ".join(names)} for most, names in titles.items()]
