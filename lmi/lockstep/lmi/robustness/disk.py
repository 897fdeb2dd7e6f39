"""Disk margins: how much gain and phase may change at once, in one channel or in all of them (Seiler, Packard, Gahinet 2020).

A factor f of a channel of L ranges over the disk

    f = (2 + delta (1 - skew)) / (2 - delta (1 + skew)),   |delta| < alpha,

and the loop stays stable for all of them if and only if alpha mu(S + (skew - 1)/2 I) <= 1 at every frequency, S = (I + L)^-1;
with one channel mu is the absolute value, with several that of diagonal complex perturbations. skew = 1 is about S, -1
about T.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Complex

from lockstep.check.errors import ProblemError, demand
from lockstep.lmi.robustness.peak import peak


@dataclass(frozen=True, eq=False)
class DiskMargin:
    """The disk margin of the channels of one loop, perturbed at once.

    alpha: computed from the upper bound of mu, at the frequencies that were looked at;  above: no more than this, from the
    perturbation that was found;  frequency: of the smallest margin, in rad/s;  skew: of the disk;  factors: the f_i that make
    the loop singular there, of size `above`;  proved: an alpha that is proved at every frequency, if it was asked for.
    """

    alpha: float
    above: float
    frequency: float
    skew: float
    factors: Complex[np.ndarray, " n"]
    proved: float | None = None

    @property
    def gain(self) -> tuple[float, float]:
        """The gains that each channel may have, phase unchanged: (least, largest)."""
        return _gains(self.alpha, self.skew)

    @property
    def phase(self) -> float:
        """The phase in degrees by which each channel may be off, gain unchanged."""
        return _phase(self.alpha, self.skew)

    @property
    def delay(self) -> float:
        """The delay in s that has this phase at the frequency of the smallest margin: for comparison, no margin itself."""
        return float(np.radians(self.phase) / self.frequency) if 0 < self.frequency < np.inf else float("inf")

    def document(self) -> dict[str, Any]:
        """Return the figures."""
        low, high = self.gain
        return {
            "alpha": self.alpha,
            "alpha_above": self.above,
            "proved": self.proved,
            "frequency": self.frequency,
            "gain": [low, high],
            "phase": self.phase,
            "skew": self.skew,
        }


def disk_margin(L: Any, skew: float = 0.0, *, prove: bool = False) -> DiskMargin:
    """Return the disk margin of a loop whose channels are all perturbed at once.

    Args:
        L: the open loop, closed by negative feedback: a `control.ss` or a transfer function, square, continuous or with a dt.
        skew: sigma of the paper; 0 takes the same factor up and down.
        prove: also look for an alpha that is proved at every frequency (`every_frequency`).

    Raises:
        ProblemError: a loop that is not square, or not stable when closed.

    >>> import control
    >>> found = disk_margin(control.tf(25, [1, 10, 10, 10]))            # Seiler, Packard, Gahinet 2020: 0.46 at 1.94 rad/s
    >>> round(found.alpha, 2), round(found.frequency, 2), [round(g, 2) for g in found.gain]
    (0.46, 1.96, [0.63, 1.59])
    """
    from lockstep.lmi.robustness.every_frequency import proved_gain

    M = _shifted(_sensitivity(L), skew)
    found = _margin(M, skew)
    if not prove:
        return found
    gamma = proved_gain(M)
    return replace(found, proved=None if gamma is None else 1 / gamma)


def loops_at_a_time(L: Any, skew: float = 0.0) -> list[DiskMargin]:
    """Return the disk margin of each channel of a loop, the others closed and as they are."""
    import control

    S = _sensitivity(L)
    found = []
    for k in range(S.ninputs):
        one = control.ss(S.A, S.B[:, [k]], S.C[[k]], S.D[[k]][:, [k]], S.dt)
        found.append(_margin(_shifted(one, skew), skew))
    return found


def both_sides(P: Any, K: Any) -> Any:
    """Return the loop of P and K opened at the inputs and the outputs of P at once: u = -K y, y = P u."""
    import control

    P, K = control.ss(P), control.ss(K)
    found = f"P is {P.noutputs} x {P.ninputs}, K {K.noutputs} x {K.ninputs}"
    demand((P.noutputs, P.ninputs) == (K.ninputs, K.noutputs), found, "both sides", "K as P transposed")
    both = control.append(K, P)
    m, p = P.ninputs, P.noutputs
    # append has the inputs (y, u) and the outputs (u, y): swap the inputs, and y = P u enters with the other sign.
    order = [*range(p, p + m), *range(p)]
    signs = np.diag([1.0] * m + [-1.0] * p)
    return control.ss(both.A, both.B[:, order], signs @ both.C, signs @ both.D[:, order], both.dt)


def _margin(M: Any, skew: float) -> DiskMargin:
    """Return the margin from M = S + (skew - 1)/2 I."""
    found = peak(M)
    upper, lower = found.value.upper, found.value.lower
    delta = np.diag(found.value.Delta)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = (2 + delta * (1 - skew)) / (2 - delta * (1 + skew))
    return DiskMargin(
        1 / upper if upper else float("inf"),
        1 / lower if lower else float("inf"),
        found.frequency,
        skew,
        factors,
    )


def _shifted(S: Any, skew: float) -> Any:
    import control

    return control.ss(S.A, S.B, S.C, S.D + (skew - 1) / 2 * np.eye(S.ninputs), S.dt)


def _sensitivity(L: Any) -> Any:
    """Return (I + L)^-1 with the matrices of L: A - B R C, -B R... for R = (I + D)^-1."""
    import control

    L = control.ss(L)
    demand(L.ninputs == L.noutputs, f"a loop of {L.noutputs} x {L.ninputs}", "disk margin", "a square one")
    through = np.eye(L.ninputs) + L.D
    if np.linalg.cond(through) > 1e12:
        raise ProblemError("I + D of the loop is singular", where="disk margin", expected="a well-posed loop")
    R = np.linalg.inv(through)
    return control.ss(L.A - L.B @ R @ L.C, L.B @ R, -R @ L.C, R, L.dt)


def _gains(alpha: float, skew: float) -> tuple[float, float]:
    ends = []
    for delta in (-alpha, alpha):
        above, below = 2 + delta * (1 - skew), 2 - delta * (1 + skew)
        ends.append(float("inf") if below <= 0 else max(above / below, 0.0))
    return ends[0], ends[1]


def _phase(alpha: float, skew: float) -> float:
    """Return the angle at which the unit circle leaves the disk of f (Seiler, Packard, Gahinet 2020, (10))."""
    low = (2 - alpha * (1 - skew)) / (2 + alpha * (1 + skew))
    below = 2 - alpha * (1 + skew)
    if below <= 0:
        # A half plane, or the outside of a disk: through low on the real axis.
        cosine = (
            low
            if below == 0
            else (1 + low * (2 + alpha * (1 - skew)) / below) / (low + (2 + alpha * (1 - skew)) / below)
        )
    else:
        high = (2 + alpha * (1 - skew)) / below
        cosine = (1 + low * high) / (low + high)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
