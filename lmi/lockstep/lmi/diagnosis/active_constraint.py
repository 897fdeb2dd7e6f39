"""What stands in the way of a design: quick searches for an easier problem, one thing relaxed at a time.

Where a search ends with nothing, the same is asked again without the decay, with gains that need not be off, and with more
gain. What then has a proved certificate, after one short climb and no descent, names the cause. Where no loop is stable, the
modes of the graph are looked at one by one: with the same controller for all agents, the loop is stable if and only if
A + lambda B K C, with the controller's states, is for every eigenvalue lambda of L but the simple 0.

What these searches do not find may still exist, and the messages say no more than what was found.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.search.common_gains import loops_at
from lockstep.lmi.search.random_start import GainSearch, homotopy, run_start
from lockstep.lmi.search.stabilise import stabilise_mode
from lockstep.lmi.shapes import GainLimit
from lockstep.model.network import Network
from lockstep.model.problem import Problem

STARTS = 2
"""Starts of each quick search."""

FACTORS = (10.0, 100.0, 1e3, 1e4, 1e6)
"""Multiples of the gain limit that are tried, smallest first."""

PARTS = (0.5, 0.2, 0.05, 0.01)
"""Parts of delta that are tried, largest first, once it is known that none at all would do."""

Hint = tuple[str, dict[str, Any]]
"""What stands in the way, as words that continue a message, and as figures."""


def hint(problem: Problem, network: Network, claim: Claim) -> Hint:
    """Return what stands in the way of a design: the decay, delta, the gain limit, or nothing that a quick search shows."""
    with one_thread():
        decaying = network.decaying(problem.design.decay or 0.0)
        asked = _decay(problem, network, claim) or _delta(problem, decaying, claim)
        return asked or _gain_limit(problem, decaying, claim) or ("", {})


def hint_of_stability(problem: Problem, network: Network, claim: Claim) -> Hint:
    """Return what stands in the way of a stable loop: the decay, or a mode of the graph and whether more gain would help."""
    with one_thread():
        if (slower := _decay(problem, network, claim)) is not None:
            return slower
        said, figures = _modes(problem, network)
        decaying = network.decaying(problem.design.decay or 0.0)
        more, found = _gain_limit(problem, decaying, claim) or ("", {})
    return said + more, figures | found


def is_designed(problem: Problem, network: Network, claim: Claim, gain_limit: GainLimit) -> bool:
    """Tell whether a short search finds gains for the whole claim and their certificate is proved."""
    search = GainSearch.of(network.loop(problem.order), claim, gain_limit)
    for index in range(STARTS):
        start = run_start(search, None, problem.design.seed, index)
        reached = homotopy(search, start.at) if start.abscissa < 0 else None
        if reached is None or reached.certified < 1:
            continue
        gains = Gains.from_blocks(short_gains(reached.point.K, gain_limit), problem.order)
        try:
            prove(network, gains, claim)
        except NotCertified:
            continue
        return True
    return False


def _decay(problem: Problem, network: Network, claim: Claim) -> Hint | None:
    key = "decay" if problem.design.decay else "search_decay"
    if not getattr(problem.design, key) or not is_designed(problem, network, claim, problem.gain_limit):
        return None
    said = f"; [design] {key} is what blocks: without it gains were found; lower {key}, or raise gain_limit or starts"
    return said, {"cause": key}


def _delta(problem: Problem, network: Network, claim: Claim) -> Hint | None:
    def with_part(part: float) -> bool:
        return is_designed(problem, network, replace(claim, delta=part * claim.delta), problem.gain_limit)

    if not claim.delta.any() or not with_part(0.0):
        return None
    part = _first(PARTS, with_part) or 0.0
    reach = f"with {part:g} of it there is one too" if part else f"{PARTS[-1]:g} of it is too much already"
    return (
        "; [design.fragility] delta is what blocks: without it there is a certified design, and"
        f" {reach}; lower delta",
        {"cause": "fragility", "reachable_delta": (part * claim.delta[0]).tolist()},
    )


def _gain_limit(problem: Problem, network: Network, claim: Claim) -> Hint | None:
    limit = problem.design.gain_limit
    enough = _first(FACTORS, lambda factor: is_designed(problem, network, claim, factor * problem.gain_limit))
    if enough is None:
        return None
    smaller = ", or make [agent.domain] smaller, which asks for less" if problem.agent().domain else ""
    return (
        f"; [design] gain_limit = {limit:g} is what blocks: with {enough * limit:g} there is a certified design;"
        f" raise gain_limit{smaller}",
        {"cause": "gain_limit", "sufficient_gain_limit": enough * limit},
    )


def _modes(problem: Problem, network: Network) -> Hint:
    """Name the eigenvalues of L whose mode no gains within the limit were found to stabilise, each looked at alone."""
    plant, limit = network.plant, problem.design.gain_limit
    if any(not np.array_equal(B, plant.B[0]) for B in plant.B[1:]):
        return "", {}
    eigenvalues = sorted(np.linalg.eigvals(np.asarray(network.graph.laplacian, dtype=float)), key=abs)[1:]
    blocking = []
    for value in eigenvalues:
        if value.imag < 0:
            continue
        mode = loops_at(Modes(plant, problem.order), np.array([value]))[0]
        worst = stabilise_mode(mode, problem.gain_limit, seed=problem.design.seed, starts=STARTS)
        if worst >= 0:
            blocking.append((complex(value), worst))
    if not blocking:
        return "", {}
    shown = ", ".join(_written(value) for value, _ in blocking)
    few = len(blocking) < sum(value.imag >= 0 for value in eigenvalues)
    which, remedy = f"every eigenvalue of L ({shown})", ""
    if few:
        which = f"the eigenvalue{'s' if len(blocking) > 1 else ''} {shown} of L"
        remedy = "; a larger weight on the links of the graph, or more of them, moves it away from 0"
    return (
        f"; looked at one by one, no gains within gain_limit = {limit:g} were found that stabilise the modes"
        f" A + lambda B K C of {which}{remedy}",
        {"blocking_eigenvalues": [[value.real, value.imag] for value, _ in blocking]},
    )


def _written(value: complex) -> str:
    return f"{value.real:.4g}" + ("" if abs(value.imag) < 1e-9 * abs(value) else f" +- {value.imag:.4g}i")


def _first(values: tuple[float, ...], holds: Callable[[float], bool]) -> float | None:
    return next((value for value in values if holds(value)), None)
