"""What a campaign is: the loop, how its runs are drawn, and what they are held against.

    int |z|^2 <= V(x_d(0)) + rho^2 int |xi_d|^2                                          (the certificate)

so the ratio of a run, |z| / (V(x_d(0)) + rho^2 |xi_d|^2)^1/2, is at most 1 if the certificate is true and covers the
run. From agreement V is zero, and the ratio is the measured L2 gain over the certified rho.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.layout import Features
from lockstep.campaign.compiled.source import CampaignSource, continuous_source, sampled_source
from lockstep.campaign.frequency_response import Response, continuous_response, sampled_response
from lockstep.campaign.guarantee import Controllers, Guarantee, guarantee_of
from lockstep.campaign.peaks import Peak, peaks
from lockstep.check.continuous.inequality import LETTERS, Performance
from lockstep.check.errors import ProblemError, demand
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.document import Stored
from lockstep.model.agents.state_sizes import random_range
from lockstep.model.network import Network
from lockstep.model.simulation.from_problem import rate_of

FORMAT = "lockstep-campaign/1"
CHUNK = 256
"""Runs that are computed, kept and sent as one: about a second's work."""

POINTS = 12
PARTS, TURN = 5, 0.1
"""Steps of the integration in a period at least; and what agents by themselves, and a linear loop of continuous controllers,
turn by in one at most, in rad: Runge-Kutta's error is some 1e-7 of a turn then."""

Deltas = tuple[tuple[str, float, tuple[int, int]], ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """A campaign, complete: a run is fixed by it and by the run's index alone.

    source: the loop's C;  seed: of all draws;  horizon: of each run, in s;  starts: the least and the largest of random
    initial states;  deltas: per letter the bound (11) and the shape of one agent's block, in the order of the C's parameters;
    peaks: where to disturb;  driven: (n,), 1 for a state that rho is a gain from, 0 for one that nothing drives;
    guarantee: what the runs are held against;  title, controllers: for people;  clipped_radius: from disagreements up to
    it, undisturbed, the runs are held to converge with their inputs clipped.
    """

    source: CampaignSource
    seed: int
    horizon: float
    starts: Float[np.ndarray, "2 n"]
    deltas: Deltas
    peaks: tuple[Peak, ...]
    driven: Float[np.ndarray, " n"]
    guarantee: Guarantee
    title: str = ""
    controllers: Controllers = "sampled"
    clipped_radius: float | None = None

    @property
    def identity(self) -> str:
        """SHA-256 of everything a run depends on: what is kept under another identity is another campaign's."""
        digest = hashlib.sha256(f"{FORMAT} {CHUNK} {self.source.fingerprint}".encode())
        for name in ("seed", "horizon", "starts", "deltas", "peaks", "guarantee"):
            digest.update(repr(_plain(getattr(self, name))).encode())
        if self.clipped_radius is not None:
            digest.update(repr(self.clipped_radius).encode())
        if not self.driven.all():
            digest.update(repr(_plain(self.driven)).encode())
        return digest.hexdigest()


def plan_of(
    stored: Stored,
    files: Mapping[str, str] | None,
    *,
    controllers: Controllers | None = None,
    seed: int = 0,
    horizon: float | None = None,
    step: float | None = None,
    guarantee: Guarantee | None = None,
) -> Plan:
    """Return the campaign of a design; its certificate is proved here.

    Args:
        stored: the design, with what is proved of its sampled controllers.
        files: the emitted folder, relative path -> text; needed for sampled controllers.
        controllers: "sampled", the C that ships, or "continuous", the gains (9) with Delta at the bound of (11). By
            default the ones that the design's fragility is about: continuous if there is one.
        seed: of all draws.
        horizon: in s, of each run; by default the problem's.
        step: the longest of the integration, in s; by default as `PARTS` and `TURN` say.
        guarantee: what the runs are held against, if it is to be something else than what is proved here.

    Raises:
        NotCertified: there is no proof of a rho to hold the runs against.
        ProblemError: a horizon that is not above 0.
    """
    problem = stored.problem
    about, reach = random_range(problem.agent(), problem.simulation.spread)
    time = problem.simulation.horizon if horizon is None else horizon
    demand(time > 0, f"the horizon is {horizon!r}", "campaign", "seconds above 0")
    kind = controllers or ("continuous" if any(stored.claims.fragility.values()) else "sampled")
    network = Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)
    weights, longest = problem.performance, _step(stored, network, kind) if step is None else step
    made = _sampled(stored, network, weights, files, longest) if kind == "sampled" else None
    source, response, deltas = made or _continuous(stored, network, weights, longest)
    held_to = guarantee or guarantee_of(stored, files, kind)
    return Plan(
        source,
        seed,
        float(time),
        np.stack([about - reach, about + reach]),
        deltas,
        peaks(network, response, weights, count=POINTS, seed=seed),
        np.sign(weights.states) if len(weights.states) else np.ones(network.agent.n),
        held_to,
        problem.title,
        kind,
        _clipped_radius(stored) if kind == "sampled" else None,
    )


def _step(stored: Stored, network: Network, kind: Controllers) -> float:
    """Return the longest step of the integration in s."""
    period, rates = stored.problem.controller.period, [rate_of(stored.problem)]
    if kind == "continuous":
        A_cl = network.loop(stored.gains.order).A_cl(stored.gains.blocks)
        rates.append(float(np.abs(np.linalg.eigvals(A_cl)).max()))
    turned = max((one for one in rates if np.isfinite(one)), default=0.0) * period
    return period / max(PARTS, int(np.ceil(turned / TURN)))


def _clipped_radius(stored: Stored) -> float | None:
    """Return how far apart runs that clip may begin: as far as is claimed, within the domain that the claim is of."""
    radius, box = stored.claims.sampled.clipped_radius, stored.problem.agent().box
    return None if radius is None else min(radius, float(np.ptp(box, axis=1).min()) / 2)


def _sampled(
    stored: Stored, network: Network, weights: Performance, files: Mapping[str, str] | None, step: float
) -> tuple[CampaignSource, Response, Deltas]:
    """The loop with the C that ships, and its linear response."""
    if files is None:
        raise ProblemError(
            "no emitted C", where="campaign", expected="that of the design, for sampled controllers"
        )
    period, delay = stored.problem.controller.period, stored.problem.controller.delay
    features = Features(waves=True, noise=True, drops=True)
    source = sampled_source(network, files, weights, step=step, delay=delay, features=features)
    held = sampled_controllers(stored, period)
    return source, sampled_response(network, held, weights, period, delay), ()


def _continuous(
    stored: Stored, network: Network, weights: Performance, step: float
) -> tuple[CampaignSource, Response, Deltas]:
    """The loop with the continuous controllers and Delta of (11), and its linear response."""
    gains, fragility = stored.gains, stored.claims.fragility
    letters = [k for k in LETTERS if fragility[k] > 0 and getattr(gains, k)[0].size]
    deltas = tuple((k, float(fragility[k]), getattr(gains, k)[0].shape) for k in letters)
    source = continuous_source(
        network,
        gains,
        weights,
        period=stored.problem.controller.period,
        step=step,
        fragility=fragility,
        features=Features(waves=True, noise=True, uncertain=bool(deltas)),
    )
    return source, continuous_response(network, gains, weights), deltas


def _plain(value: Any) -> Any:
    """A value as nested tuples of its exact numbers."""
    if isinstance(value, np.ndarray):
        return (value.shape, value.tobytes().hex())
    if is_dataclass(value) and not isinstance(value, type):
        return tuple(_plain(getattr(value, one.name)) for one in fields(value))
    if isinstance(value, tuple | list):
        return tuple(_plain(item) for item in value)
    return value
