"""Send on change: an agent sends at first, and then only where some output differs from the one last sent by more than c.

A listener that takes its own readings of now is thus off by at most c in each entry of a message, as long as what is
sent arrives. What is proved of errors of messages is proved of that: the residual is kappa e + mu (`cost`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lockstep.model.simulation.results.trajectory import Trajectory


class Senders:
    """All agents' senders: `sends` is asked once a period; `sent` and `saved` count the messages of all links.

    change: c; None where every period is sent.
    """

    def __init__(self, sources: tuple[tuple[int, ...], ...], change: float | None) -> None:
        self._links = np.array([j for heard in sources for j in heard], dtype=int)
        self._change = change
        self._last: np.ndarray | None = None
        self.sent = self.saved = 0

    def sends(self, y: Float[np.ndarray, "N q"]) -> Bool[np.ndarray, " N"]:
        """Return which agents send outputs y.

        >>> senders = Senders(((1,), (0,)), 0.1)
        >>> [senders.sends(np.array([[1.0], [y]])).tolist() for y in (1.0, 1.05, 1.2)]
        [[True, True], [False, False], [False, True]]
        >>> senders.sent, senders.saved
        (3, 3)
        """
        now = np.ones(len(y), dtype=bool)
        if self._change is not None and self._last is not None:
            now = (np.abs(y.astype(float) - self._last.astype(float)) > self._change).any(axis=1)
        self._last = y if self._last is None else np.where(now[:, None], y, self._last)
        count = int(now[self._links].sum())
        self.sent, self.saved = self.sent + count, self.saved + len(self._links) - count
        return now


@dataclass(frozen=True)
class SendOnChange:
    """change: c, the threshold;  residual: kappa and mu that are proved, per unit of error and of underflow, or nothing."""

    change: float
    residual: tuple[float, float] | None = None

    def cost(self, trajectory: Trajectory, real: str) -> dict[str, Any]:
        """Return what a run saved, and the ultimate distance from agreement that is proved.

        That is kappa e + mu with e = c + u |y|, the largest error of an entry of a message or of an own reading: the
        threshold, and the rounding of the largest output.
        """
        error = self.change + float(np.finfo(real).eps) / 2 * float(np.abs(trajectory.y).max())
        offered = trajectory.sent + trajectory.saved
        return {
            "threshold": self.change,
            "sent": trajectory.sent,
            "saved": trajectory.saved / offered,
            "residual": self.residual and self.residual[0] * error + self.residual[1],
        }
