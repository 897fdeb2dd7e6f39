"""Modes that no controller moves for some slopes of phi that a certificate has to cover: no faster decay can be certified.

A certificate is one for every phi within its bounds, and so for each constant matrix of slopes S, phi(v) = S v + constant.
A mode of A + G S H that no input moves, or no output shows, stays as it is in every loop, whatever its controllers: the
disagreement is N - 1 copies of one agent.
"""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.model.agents.arguments import arguments_text
from lockstep.model.control.pbh import lost_modes
from lockstep.model.network import Network

TOGETHER = 3
"""Slopes that are looked at in all combinations of their ends: of more, where all are flat."""


class LostMode(NamedTuple):
    """decay: in 1/s, of a mode that no controller moves;  said: where the slopes of phi are such, and why."""

    decay: float
    said: str


def slowest_lost_mode(network: Network, claim: Claim) -> LostMode | None:
    """Return the slowest mode that constant slopes within the claim hide from every controller, in doubles; or None."""
    plant, found = network.plant, list[LostMode]()
    for S in _constant_slopes(network, claim):
        A = plant.A + plant.G @ S @ plant.H
        ways = [("no input moves", A, B) for B in {B.tobytes(): B for B in plant.B}.values()]
        for why, *pair in (*ways, ("no output shows", A.T, plant.C.T)):
            modes = ((mode, f"{mode:.4g}".removesuffix("+0j")) for mode in lost_modes(*pair))
            found += (
                LostMode(-s.real, f"{_where(network, S)}{why} the mode at {shown} 1/s") for s, shown in modes
            )
    return min(found, key=lambda mode: mode.decay, default=None)


def _constant_slopes(network: Network, claim: Claim) -> Iterator[Float[np.ndarray, "r v"]]:
    """Yield slopes of phi within the claim, in the units of its bound: 0, the ends of each, where phi as written is flat."""
    flat = -network.agent.centring.matrix(*_units(network).shape) / _units(network)
    ends = {(one.component, one.argument): one.bound for one in claim.entries}
    ends = ends or dict.fromkeys(np.ndindex(flat.shape), claim.alpha)
    few = len(ends) <= TOGETHER
    values = [(0.0, flat[at], *((-end, end) if few else ())) for at, end in ends.items()]
    for chosen in product(*values) if few else zip(*values, strict=True):
        S = np.zeros_like(flat)
        for at, value in zip(ends, chosen, strict=True):
            S[at] = value
        if (np.abs(chosen) <= list(ends.values())).all() and np.linalg.svd(S)[1].max(
            initial=0.0
        ) <= claim.alpha:
            yield S


def _units(network: Network) -> Float[np.ndarray, "r v"]:
    """Return D_w / D_v: phi's slopes are those of the bound times these."""
    plant = network.plant
    D_w, D_v = network.scales or (np.ones(plant.G.shape[1]), np.ones(len(plant.H)))
    return np.outer(D_w, 1 / np.asarray(D_v))


def _where(network: Network, S: Float[np.ndarray, "r v"]) -> str:
    """Say what slopes S is of phi as the file writes it."""
    slopes = S * _units(network) + network.agent.centring.matrix(*S.shape)
    each = (
        f"phi{k + 1} has the slope {slope:.3g} along v{l + 1}" for (k, l), slope in np.ndenumerate(slopes)
    )
    return f"where {' and '.join(each)} ({arguments_text(network.agent)}) " if slopes.size else ""
