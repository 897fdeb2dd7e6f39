"""Modes that no controller moves for some slopes of phi that a certificate has to cover: no faster decay can be certified,
and nothing at all where one does not decay.

A certificate is one for every phi within its bounds, and so for each constant matrix of slopes S, phi(v) = S v + constant.
A mode of A + G S H that no input moves, or no output shows, stays as it is in every loop, whatever its controllers: the
disagreement is N - 1 copies of one agent.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.slope_bounds import Entry
from lockstep.model.agents.arguments import arguments_text
from lockstep.model.assembly import claimed_slopes
from lockstep.model.bound_search import Bound
from lockstep.model.checks.report import CheckRow, Outcome
from lockstep.model.control.pbh import lost_modes
from lockstep.model.network import Network
from lockstep.model.problem import Problem

TOGETHER = 3
"""Slopes that are looked at in all combinations of their ends: of more, where all are flat."""

NAME = "modes out of reach"
ADVICE = "name an [agent.domain] that leaves out such slopes, or measure or actuate more"
REASON = f"no controller moves such a mode, and a certificate is of every phi within its bounds: {ADVICE}"

ALIKE = 1e-9
"""Of a mode: closer ones are one, of which rounding made two."""

ROUNDED = 1 + 1e-12
"""Times its bound, what rounding may leave of a slope at its end."""


class LostMode(NamedTuple):
    """A mode that no controller moves.

    decay: in 1/s;  said: where the slopes of phi are such, and why;  slowest: of all modes that the agent has there.
    """

    decay: float
    said: str
    slowest: bool = False

    def holds_back(self, decay: float | None) -> bool:
        """Return whether it is near a decay, in 1/s: less than twice as fast."""
        return decay is not None and self.decay < 2 * decay


def slowest_lost_mode(network: Network, alpha: float, entries: Sequence[Entry]) -> LostMode | None:
    """Return the slowest mode that constant slopes hide from every controller, in doubles; or None.

    Args:
        network: the agents, G and H scaled as the bound was proved.
        alpha, entries: the bounds of phi that are claimed, of all of it and of single slopes.
    """
    plant, found = network.plant, list[LostMode]()
    for S, where in _constant_slopes(network, alpha, entries):
        A = plant.A + plant.G @ S @ plant.H
        last = np.linalg.eigvals(A).real.max()
        ways = [("no input moves", A, B) for B in {B.tobytes(): B for B in plant.B}.values()]
        for why, *pair in (*ways, ("no output shows", A.T, plant.C.T)):
            for s in lost_modes(*pair):
                shown = f"{s:.4g}".removesuffix("+0j")
                slowest = s.real >= last - ALIKE * abs(last)
                found.append(LostMode(-s.real, f"{where}{why} the mode at {shown} 1/s", slowest))
    return min(found, key=lambda mode: mode.decay, default=None)


def check(problem: Problem, network: Network, bound: Bound) -> Iterator[CheckRow]:
    """Yield a row where such a mode forbids a certificate, or the decay asked for, or is all that agents do by themselves."""
    lost, asked = slowest_lost_mode(network, *claimed_slopes(problem, bound)), problem.design.decay or 0.0
    if problem.design.objective != "alpha" and lost and (lost.decay <= asked or lost.slowest):
        never = f"no decay beyond {lost.decay:.4g} 1/s is" if lost.decay > 0 else "no agreement is"
        verdict: Outcome = "fails" if lost.decay <= asked else "note"
        yield CheckRow(NAME, verdict, f"{lost.said}: {never} certified", REASON)


def _constant_slopes(
    network: Network, alpha: float, entries: Sequence[Entry]
) -> Iterator[tuple[Float[np.ndarray, "r v"], str]]:
    """Yield slopes of phi, in the units of its bound, and in words those of phi as written: 0, the middle, the ends."""
    plant = network.plant
    D_w, D_v = network.scales or (np.ones(plant.G.shape[1]), np.ones(len(plant.H)))
    units = np.outer(D_w, 1 / np.asarray(D_v))
    middle = network.agent.centring.matrix(*units.shape)
    ends = {(one.component, one.argument): one.bound for one in entries}
    ends = ends or dict.fromkeys(np.ndindex(units.shape), alpha)
    few = len(ends) <= TOGETHER
    slopes = [
        (0.0, *(middle[at] + part * end * units[at] for part in (0, -1, 1) if few))
        for at, end in ends.items()
    ]
    for chosen in product(*slopes):
        S, said = np.zeros_like(units), list[str]()
        for (k, l), slope in zip(ends, chosen, strict=True):
            S[k, l] = (slope - middle[k, l]) / units[k, l]
            said.append(f"phi{k + 1} has the slope {slope:.3g} along v{l + 1}")
        inside = all(abs(S[at]) <= end * ROUNDED for at, end in ends.items())
        if inside and np.linalg.svd(S)[1].max(initial=0.0) <= alpha * ROUNDED:
            where = " and ".join(said) if few else "all of phi is flat"
            yield S, f"where {where} ({arguments_text(network.agent)}) " * bool(said)
