"""Two traces, bit by bit."""

from dataclasses import dataclass, fields

import numpy as np

from lockstep.verification.messages.events import NodeTrace
from lockstep.verification.stimulus import Trace


@dataclass(frozen=True)
class Difference:
    """How a trace differs from the reference: how many calls, the first, the largest error in u and x."""

    calls: int
    first: str
    max_abs_error: float

    @property
    def bitwise(self) -> bool:
        """Whether every bit of every output and state is equal."""
        return self.calls == 0


def compare(found: Trace | NodeTrace, expected: Trace | NodeTrace) -> Difference:
    """Compare all parts as bytes: -0 is not 0, and the counters and statuses count too."""
    differs = np.zeros(len(expected.status), bool)
    earliest, first = len(differs), ""
    for part in fields(expected):
        ours, theirs = getattr(expected, part.name), getattr(found, part.name)
        rows = (_bytes(ours) != _bytes(theirs)).any(axis=1)
        differs |= rows
        k = int(rows.argmax()) if rows.any() else earliest
        if k < earliest:
            earliest = k
            first = f"call {k}: {part.name} is {theirs[k].tolist()}, the reference has {ours[k].tolist()}"
    return Difference(int(differs.sum()), first, _max_abs_error(found, expected))


def _bytes(array: np.ndarray) -> np.ndarray:
    flat = np.ascontiguousarray(array).reshape(len(array), -1)
    return flat.view(np.uint8) if flat.shape[1] else flat.astype(np.uint8)


def _max_abs_error(found: Trace | NodeTrace, expected: Trace | NodeTrace) -> float:
    """Largest |difference| in u and x, in float64; infinite if one side is not finite where the other is."""
    largest = 0.0
    for name in ("u", "x"):
        ours, theirs = (getattr(trace, name).astype(np.float64) for trace in (expected, found))
        if not np.array_equal(np.isfinite(ours), np.isfinite(theirs)):
            return float("inf")
        both = np.isfinite(ours)
        if both.any():
            with np.errstate(over="ignore"):
                largest = max(largest, float(np.abs(ours[both] - theirs[both]).max()))
    return largest
