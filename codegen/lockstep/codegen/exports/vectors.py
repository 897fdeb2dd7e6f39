"""Test vectors that are the same to the bit on every machine: integers made by SHAKE-256, and no rounding but one.

A walk in small steps first, as in ordinary operation, its last fifth with lost messages; then values meant to break the
code: subnormal, huge, signed zeros, every exponent, NaN and infinities, with resets, overlapping buffers, and a state
that was never initialised. Where u is clipped, values are also said to be applied.
"""

import hashlib

import numpy as np
from jaxtyping import Float, UInt

from lockstep.codegen.emission.calls import Calls, Operation
from lockstep.codegen.manifest import AgentEntry, Manifest

ORDINARY, ADVERSARIAL = 100, 100
"""Calls of each kind: what fits into the flash of a small board."""

_KIND_LASTS = 14
"""Adversarial calls of one kind, so that a subnormal state lives among subnormals and a huge one overflows."""


def vectors(agent: AgentEntry, manifest: Manifest) -> Calls:
    """Return an agent's calls: `ORDINARY`, then `ADVERSARIAL` ones."""
    q, nn, dtype = len(agent.outputs), len(agent.neighbours), manifest.real_type.dtype
    S, width = ORDINARY + ADVERSARIAL, (2 + nn) * q
    name = agent.name.encode()
    values = np.concatenate([_walk(name, width, dtype), _hostile(name, width, dtype)])
    chance = _words(name + b" operation", S) % np.uint64(100)
    operation = np.select(
        [chance < 69, chance < 89, chance < 90],
        [Operation.STEP, Operation.STEP_RELATIVE, Operation.RESET],
        Operation.STEP_ALIASED,
    )
    operation[:ORDINARY] = Operation.STEP
    operation[ORDINARY::_KIND_LASTS] = Operation.RESET
    operation[ORDINARY + _KIND_LASTS // 2] = Operation.STEP_UNREADY
    if agent.limits is not None:
        operation[(operation == Operation.STEP_RELATIVE) & (np.arange(S) % 2 == 0)] = Operation.APPLIED
    arrived = _words(name + b" arrived", S, nn) % np.uint64(10) > 0
    arrived[: ORDINARY - ORDINARY // 5] = True
    arrived[ORDINARY:] &= (np.arange(ADVERSARIAL) // 7 % 3 > 0)[:, None]
    received = np.zeros(S, np.uint64)
    for j in range(nn):
        received |= arrived[:, j].astype(np.uint64) << np.uint64(j)
    y, others, r = (part.copy() for part in np.split(values, [q, q + nn * q], axis=1))
    return Calls(operation.astype(np.uint32), received, y, others.reshape(S, nn, q), r)


def _words(purpose: bytes, *shape: int) -> UInt[np.ndarray, "..."]:
    """64 bits each, for a purpose."""
    count = int(np.prod(shape))
    stream = hashlib.shake_256(b"lockstep vectors/1 " + purpose).digest(8 * count)
    return np.frombuffer(stream, "<u8").astype(np.uint64).reshape(shape)


def _walk(name: bytes, width: int, dtype: np.dtype) -> Float[np.ndarray, "S width"]:
    """Sums of steps of at most 1/16, multiples of 2^-27: exact in float64, then rounded once."""
    steps = (_words(name + b" walk", ORDINARY, width) >> np.uint64(40)).astype(np.int64) - 2**23
    return (np.cumsum(steps, axis=0) * 2.0**-27).astype(dtype)


def _hostile(name: bytes, width: int, dtype: np.dtype) -> Float[np.ndarray, "S width"]:
    """Values put together of sign, exponent and fraction."""
    bits = 8 * dtype.itemsize
    fraction_bits = 23 if bits == 32 else 52
    top = (1 << (bits - 1 - fraction_bits)) - 1  # exponent of NaN and infinity
    words = _words(name + b" hostile", 3, ADVERSARIAL, width)
    sign, fraction = words[0] & np.uint64(1), words[1] & np.uint64((1 << fraction_bits) - 1)
    chance = words[2]
    near_one = np.uint64(top // 2 - 8) + chance % np.uint64(16)
    quiet = np.uint64(1 << (fraction_bits - 1))
    call, column = np.indices(sign.shape)
    odd = (call % 2 == 0) & (column == call // 2 % width)
    nan = np.where(call % 4 == 0, quiet, np.uint64(0))
    kinds = [
        (near_one, fraction),
        (0, fraction),  # subnormal
        (top - 1, fraction),  # huge: products overflow
        (chance % np.uint64(top), fraction),
        (0, 0),
        (
            np.where(odd, top, near_one),
            np.where(odd, nan, fraction),
        ),  # every other call has one NaN or infinity
        (0, fraction & np.uint64(3)),
    ]
    kind = np.arange(ADVERSARIAL)[:, None] // _KIND_LASTS % len(kinds)
    exponent, mantissa = (
        np.choose(kind, [np.broadcast_to(np.asarray(k[part], np.uint64), sign.shape) for k in kinds])
        for part in (0, 1)
    )
    whole = (sign << np.uint64(bits - 1)) | (exponent << np.uint64(fraction_bits)) | mantissa
    values: np.ndarray = whole.astype(np.dtype(f"u{dtype.itemsize}")).view(dtype)
    return values
