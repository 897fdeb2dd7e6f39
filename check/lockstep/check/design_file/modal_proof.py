"""The witness of the sampled loop mode by mode, as it stands in a design file."""

from functools import partial
from typing import Any

from lockstep.check.continuous.modes import Segment
from lockstep.check.design_file.json_text import Reader, each, matrix, number, one_of, record, vector
from lockstep.check.sampled.modes import NUMBERS, SampledModalWitness


def modal_witness_of(value: Any, where: str) -> SampledModalWitness:
    """Read a witness of the sampled loop mode by mode."""
    of_one = {"upper": number, "P": matrix(symmetric=True)}
    readers: dict[str, Reader] = {
        "kind": lambda one, place: one_of(one, ("modal",), place),
        "segments": partial(
            each, read=lambda one, place: Segment(*record(one, place, of_one)), name="segment"
        ),
        "P_mean": matrix(symmetric=True),
        "t": vector(4),
        **dict.fromkeys(NUMBERS, number),
    }
    return SampledModalWitness(*record(value, where, readers)[1:])
