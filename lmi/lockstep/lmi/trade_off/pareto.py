"""What rho costs: gains around those of a design, each with four proved figures, and other gains beside them.

    rho      the L2 gain from xi_d to x_cl, weighed by R and Q
    effort   the L2 gain from xi_d to u
    noise    the L2 gain from noise on the outputs (of the design's scales, or 1 each) to x_cl, weighed so
    decay    sigma in 1/s: every disagreement decays at least as e^(-sigma t)

each by a certificate of its own, decided exactly, for every phi within the bound. The gains of the design are moved by
the nonlinear program under another gain limit, weight of u, noise or decay held, one step after the other; the points are
what it came to: a larger search may find better ones.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.stability import is_stable
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.document import Stored
from lockstep.lmi.guarantees import fastest_decay
from lockstep.lmi.methods.certified import rate_of_controllers
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.search.barrier import BarrierPoint
from lockstep.lmi.search.local_search import as_outcome, polished
from lockstep.lmi.search.random_start import GainSearch
from lockstep.lmi.shapes import GainBlocks, GainLimit
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.model.assembly import network_of
from lockstep.model.network import Network
from lockstep.model.problem import Problem

LIMITS = (2.0, 4.0, 8.0)
"""Multiples of the gain limit, which buy rho with effort."""

INPUTS, NOISES = (10.0, 100.0, 1000.0), (10.0, 100.0)
"""Multiples of the weight of u and of the noise; where there is none, of a ten-thousandth of R and of a hundredth."""

DECAYS = (0.4, 0.7, 0.9)
"""Parts of the decay proved of the design's gains that are held with the P of rho, where a smaller one was."""

INSIDE = 0.98
"""The part of a new gain limit that gains are brought within."""

SLOWER = 0.9
"""The part of the rate of given controllers that is asked of those moved from them."""

MOSTLY, ROUNDS = 100.0, 3
"""u is weighed until it counts that many times as much as x_cl: the rest is half a percent; and how often that is tried."""


class Figures(NamedTuple):
    """Of gains, proved."""

    rho: float
    effort: float
    noise: float
    decay: float


@dataclass(frozen=True, eq=False)
class ParetoPoint:
    """family: what was varied, "design" for the design itself, "given" for other gains;  name: for people;  stable: whether
    each controller is stable by itself."""

    family: str
    name: str
    gains: Gains
    figures: Figures
    stable: bool

    def document(self) -> dict[str, Any]:
        """Return the point as plain JSON types."""
        gains = [
            {letter: getattr(self.gains, letter)[i].tolist() for letter in "ABCD"}
            for i in range(self.gains.N)
        ]
        said = {"family": self.family, "name": self.name, "controllers_stable": self.stable}
        return {**said, **self.figures._asdict(), "gains": gains}


def pareto(
    stored: Stored, others: Mapping[str, Gains], tell: Callable[[float], None] = lambda _part: None
) -> tuple[ParetoPoint, ...]:
    """Return the design, other gains for its agents, and gains around its own, as far as each was proved.

    Args:
        stored: a design of method "certified".
        others: gains by name, of any order.
        tell: called with the part that is done.

    Raises:
        ProblemError: another method, gain errors, or gains of other agents.
    """
    problem = stored.problem
    if problem.design.method != "certified" or any(problem.fragility.values()):
        raise ProblemError(
            f'method "{problem.design.method}"'
            + (", with [design.fragility]" if any(problem.fragility.values()) else ""),
            where="the trade-off",
            expected='a design of method "certified" without gain errors',
        )
    with one_thread():
        network, claim = network_of(problem, reproved_bound(stored)), stored.claim
        own = figures_of(network, stored.gains, claim)
        found = [ParetoPoint("design", problem.title, stored.gains, own, _stable(stored.gains))]
        for name, gains in others.items():
            known = _of_other_gains(problem, network, claim, name, gains)
            found.append(ParetoPoint("given", name, gains, known, _stable(gains)))
        steps = list(_steps(problem, claim, own.decay))
        for k, family in enumerate(steps):
            tell(k / len(steps))
            found += _walked(problem, network, claim, stored.gains, family)
    return tuple(found)


def figures_of(network: Network, gains: Gains, claim: Claim) -> Figures:
    """Prove the four figures of gains.

    Args:
        network: the agents and their graph.
        gains: the controllers.
        claim: R and Q; what it says of u is not used, and of noise only the scales.

    Raises:
        NotCertified: no certificate was found for one of them.
    """
    nothing = np.zeros((0, 0))
    alone = replace(claim, W=nothing, states=np.zeros(0), outputs=np.zeros(0))
    rho = prove(network, gains, alone).rho
    q = network.agent.q
    scales = claim.outputs if claim.outputs.any() else np.ones(q)
    noise = prove(network, gains, replace(alone, states=np.zeros(network.agent.n), outputs=scales)).rho
    decay = fastest_decay(network, gains, alone, modal=False)
    return Figures(rho, _effort(network, gains, alone, rho), noise, 0.0 if decay is None else decay[0])


def _effort(network: Network, gains: Gains, claim: Claim, rho: float) -> float:
    """Prove a gain to u, by a gain to (x_cl, w^(1/2) u): w grows until u is next to all of it."""
    loop, unit, weight, least = network.loop(gains.order), np.eye(network.agent.m), 1.0, np.inf
    for _ in range(ROUNDS):
        found = least_rho(loop, gains.blocks, replace(claim, W=weight * unit))
        if found is None:
            break
        least = min(least, found.rho / weight**0.5)
        weight = float(f"{MOSTLY * (rho / least) ** 2:.3g}")
    proved = prove(network, gains, replace(claim, W=weight * unit)).rho / weight**0.5
    return float(f"{proved * (1 + 5e-5):.5g}")


class _Step(NamedTuple):
    """What is asked of the next gains of a family."""

    name: str
    claim: Claim
    gain_limit: GainLimit
    decay: float


def _steps(problem: Problem, claim: Claim, decay: float) -> Iterator[tuple[str, list[_Step]]]:
    table = problem.design
    limit, held = problem.gain_limit, max(table.search_decay or 0.0, 0.4 * (table.decay or 0.0))
    number = table.gain_limit
    yield "gain limit", [_Step(f"gain_limit {k * number:g}", claim, k * limit, held) for k in LIMITS]
    W = (
        claim.W
        if len(claim.W)
        else 1e-4 * float(np.diag(claim.R).max()) * np.eye(len(problem.file.agent.inputs))
    )
    yield (
        "weight of u",
        [_Step(f"weight of u times {k:g}", replace(claim, W=k * W), limit, held) for k in INPUTS],
    )
    noise = claim.outputs if claim.outputs.any() else np.full(len(problem.file.agent.outputs), 1e-2)
    noisy = [_Step(f"noise times {k:g}", replace(claim, outputs=k * noise), limit, held) for k in NOISES]
    yield "noise", noisy
    held_more = [float(f"{part * decay:.3g}") for part in DECAYS if part * decay > held]
    yield "decay", [_Step(f"decay {sigma:g} 1/s held", claim, limit, sigma) for sigma in held_more]


def _walked(
    problem: Problem, network: Network, claim: Claim, gains: Gains, family: tuple[str, list[_Step]]
) -> Iterator[ParetoPoint]:
    """Yield what the nonlinear program comes to, each step from the gains of the one before."""
    name, steps = family
    K = gains.blocks
    for step in steps:
        moved = _moved(problem, network, K, step)
        if moved is None:
            return
        K = moved
        found = Gains.from_blocks(short_gains(K, step.gain_limit), gains.order)
        stable = _stable(found)
        if problem.design.stable_controllers and not stable:
            continue
        try:
            yield ParetoPoint(name, step.name, found, figures_of(network, found, claim), stable)
        except NotCertified:
            continue


def _moved(problem: Problem, network: Network, K: GainBlocks, step: _Step) -> GainBlocks | None:
    K = limited(K, INSIDE * step.gain_limit)
    rate = _rate(problem, K)
    search = GainSearch.of(
        network.decaying(step.decay).loop(problem.order), step.claim, step.gain_limit, rate=rate
    )
    start = least_rho(search.loop, K, search.claim)
    if start is None:
        return None
    return polished(search, as_outcome(search, 0, BarrierPoint(K, start), None)).K


def _rate(problem: Problem, K: GainBlocks) -> float | None:
    """Return the rate that each controller is to forget with, below that of K: the program begins inside."""
    asked, n_C = rate_of_controllers(problem), problem.order
    if asked is None or n_C == 0:
        return None
    own = -max(float(np.linalg.eigvals(block[:n_C, :n_C]).real.max()) for block in K)
    return min(asked, SLOWER * own)


def _of_other_gains(problem: Problem, network: Network, claim: Claim, name: str, gains: Gains) -> Figures:
    m, q = network.agent.m, network.agent.q
    D = gains.D[0].shape
    if gains.N != network.N or (m, q) != D:
        raise ProblemError(
            f"{gains.N} controllers from {D[1]} outputs to {D[0]} inputs",
            where=name,
            expected=f"{network.N}, from {q} to {m}",
        )
    try:
        return figures_of(network, gains, replace(claim, Q=problem.controller_weight(gains.order)))
    except NotCertified as error:
        raise ProblemError(
            str(error), where=name, expected="gains with a certificate for these agents"
        ) from None


def _stable(gains: Gains) -> bool:
    return all(is_stable(A_C) for A_C in gains.A)


def pareto_front(points: tuple[ParetoPoint, ...], figure: str) -> tuple[ParetoPoint, ...]:
    """Return the points that no other beats in rho and in one of the other figures, by falling rho.

    Args:
        points: any.
        figure: "effort", "noise" or "decay", of which more is better.
    """
    sign = -1.0 if figure == "decay" else 1.0
    best, kept = np.inf, []
    for one in sorted(points, key=lambda one: (one.figures.rho, sign * getattr(one.figures, figure))):
        value = sign * getattr(one.figures, figure)
        if value < best:
            best = value
            kept.append(one)
    return tuple(reversed(kept))


def pareto_csv(points: tuple[ParetoPoint, ...]) -> str:
    """Return the points as CSV, one line each."""
    lines = ["family,name,rho,effort,noise,decay,controllers_stable"]
    for one in points:
        name = one.name.replace('"', "'")
        values = ",".join(f"{value:.6g}" for value in one.figures)
        lines.append(f'{one.family},"{name}",{values},{str(one.stable).lower()}')
    return "\n".join([*lines, ""])
