"""The witness of the sampled loop mode by mode, as it stands in a design file."""

from functools import partial
from typing import Any

from lockstep.check.continuous.modes import Segment
from lockstep.check.json_text import Reader, among, each, made, matrix, number, record, vector
from lockstep.check.sampled.modes import NUMBERS, SampledModalWitness


def segments(size: int | None = None) -> Reader:
    """Return the reader of segments with a symmetric P each, of a size or of any."""
    one = made(Segment, {"upper": number, "P": matrix(size, size, symmetric=True)})
    return partial(each, read=one, name="segment")


def modal_witness_of(value: Any, where: str) -> SampledModalWitness:
    """Read a witness of the sampled loop mode by mode."""
    readers: dict[str, Reader] = {
        "kind": among("modal"),
        "segments": segments(),
        "P_mean": matrix(symmetric=True),
        "t": vector(4),
        **dict.fromkeys(NUMBERS, number),
    }
    return SampledModalWitness(*record(value, where, readers)[1:])
