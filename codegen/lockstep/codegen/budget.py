"""What the header promises of RAM and stack, by formula; `verify` measures both against it."""

from lockstep.codegen.arithmetic import RealType


def state_bytes(order: int, outputs: int, inputs: int, neighbours: int, real: RealType) -> int:
    """`sizeof` of the state with natural alignment: x, u, held, then the mask and two counters per neighbour.

    >>> from lockstep.codegen.arithmetic import RealType
    >>> state_bytes(2, 2, 1, 1, RealType("float32"))
    32
    """
    mask = 0 if neighbours == 0 else 4 if neighbours <= 32 else 8
    reals = real.bytes * (order + inputs + neighbours * outputs)
    alignment = max(real.bytes, mask)
    start = -(-reals // mask) * mask if mask else reals
    return -(-(start + mask + 8 * neighbours) // alignment) * alignment


def stack_budget(order: int, outputs: int, inputs: int, real: RealType) -> int:
    """An upper bound for the stack of `step` on Cortex-M4F (zig's clang, -O2 and -Os), in bytes.

    The local vectors x, x+, u and r, saved registers and pointers, and for float64, which that core does in
    software, the frames of the arithmetic routines. Fitted to measurements over orders 0 to 12 (float64: to
    8); each `verify` checks it.
    """
    registers = 96 if real.name == "float32" else 400
    return 8 * -(-(registers + real.bytes * (2 * order + outputs + inputs)) // 8)
