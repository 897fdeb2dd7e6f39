"""Method "certified": gains by search, in short decimals, and why there are none where there are none."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import Modes, check_covered
from lockstep.check.errors import Infeasible, NotCertified, OutOfTime, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.analysis.fundamental_limits import (
    largest_alpha_of_any_controller,
    static_gains_cannot_stabilise,
)
from lockstep.lmi.analysis.margins import largest_fraction
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.diagnosis.active_constraint import hint, hint_of_stability
from lockstep.lmi.floor.bisection import proves_that_none_carries
from lockstep.lmi.initial_set_design import with_larger_set
from lockstep.lmi.methods.modal import segment_ends
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.sampled.synthesis.gains_for_period import StartingGains
from lockstep.lmi.search import GainSearch, Polished, Score, SearchResult, search_gains
from lockstep.lmi.search.common_gains import ModalSearch, representative_eigenvalues
from lockstep.lmi.search.fastest_decay import raised_decay
from lockstep.lmi.search.random_start import Homotopy, multipliers_only
from lockstep.lmi.search.search_time import estimated_time
from lockstep.lmi.search.stopping import Deadline, NothingYet, Stop
from lockstep.lmi.shapes import GainLimit
from lockstep.model.assembly import exact_network
from lockstep.model.checks.lost_modes import ADVICE, slowest_lost_mode
from lockstep.model.network import Network
from lockstep.model.problem import Problem

HELD = (0.4, 0.7, 1.0)
"""Parts of the decay asked for that the search holds with the P of rho, one after the other: with a P of its own the
decay of its gains is often twice as fast."""

DRAWN_ANEW = 1_000_003
"""Added to the seed where no start of the first ones led anywhere, or none near the floor: one of twenty each on three
quadrotors (order 0)."""

IDLE = 2.0
"""Over the period: how fast the state of an idle controller decays where the gain limit allows it; by Tustin's rule that is 0
after one period."""

FORGOTTEN = 100
"""Periods within which a controller that is to be stable by itself forgets all but 1/e of its state."""

NEARLY_ALL = 0.995
"""Of alpha: printed in three digits it would be all of it."""

REACHED = 0.5
"""Of the limit of A: the fastest that all eigenvalues of an A within it are asked to be."""


@dataclass(frozen=True)
class CertifiedGains:
    """Gains, the claim they were found for (alpha may have been raised), and its certificate.

    others: other gains that the search came to, from which a design for the period may start;  sampled: the larger of rho and
    that of the sampled loop in doubles, infinite where it has none.
    """

    gains: Gains
    claim: Claim
    certificate: Certificate
    figures: dict[str, Any]
    others: tuple[StartingGains, ...] = ()
    sampled: float = np.inf


def search_and_prove(
    problem: Problem,
    network: Network,
    claim: Claim,
    jobs: int | None,
    tell: Callable[[str, float], None],
    time_limit: float | None = None,
    score: Score | None = None,
    stop: Stop | None = None,
    *,
    explain: bool = True,
    anew: bool = False,
) -> CertifiedGains:
    """Search, round, prove.

    Args:
        problem, network, claim: what is asked.
        jobs: processes to search with.
        tell: told what is going on.
        time_limit: seconds for the search; then the best gains so far are taken.
        score: rho of the sampled loop for gains, by which starts are ranked; None to rank by rho.
        stop: ends the search, too.
        explain: whether to look for what is in the way where nothing is found.
        anew: whether to begin with other starts than the seed's.

    Raises:
        Infeasible: no gains exist, which some problems show without a search, or no start led to gains for the claim;
            the figures say what is reachable.
        OutOfTime: the time limit was over before any start had gains for the claim.
        NotCertified: gains were found, and their certificate did not survive the exact check.
    """
    stop = stop or Stop()
    deadline = Deadline.after(time_limit, stop.flag)
    table = problem.design
    rho = table.rho if table.objective == "alpha" else None
    tell("looking for limits of any controller", 0.0)
    refuse_the_impossible(problem, network, claim)
    lag = 0.0 if score is None else (0.5 + problem.controller.delay) * problem.controller.period
    rate, refused = rate_of_controllers(problem), NotCertified("no gains were found")
    for held in decays_held(problem):
        decaying = network.decaying(held)
        search = gain_search(problem, decaying, claim, lag, rate)
        of = f"{table.gain_limit:g}{' in [design.gain_units]' if table.gain_units else ''}"
        told = partial(_tell_search, tell, of, estimated_time(search, table.starts, jobs))
        run = partial(search_gains, search, score=score, rho=rho, jobs=jobs, deadline=deadline, last=explain)
        with stop.searching():
            found = run(starts=table.starts, seed=table.seed + anew * DRAWN_ANEW, tell=told)
            if explain and not anew and not found.outcomes and not found.cut:
                # Before it is said that there are none: as many starts again, drawn anew.
                found = run(starts=table.starts, seed=table.seed + DRAWN_ANEW, tell=told)
        if not found.outcomes:
            if stop.asked:
                raise NothingYet("interrupted before any gains were certified; nothing was written")
            if found.cut and time_limit is not None:
                raise _out_of_time(time_limit, claim, found)
            tell("estimating what is reachable", 1.0)
            raise _nothing(problem, network, claim, found, held, explain=explain)
        stop.found = True
        tell("proving the certificate", 0.0)
        cut: dict[str, Any] = {} if time_limit is None or stop.asked else {"time_limit": time_limit}
        for one in found.outcomes:
            try:
                proved = _proved(problem, network, claim, one, search, cut if found.cut else {})
                if table.objective in ("decay", "initial_set"):
                    tell(f'raising what objective = "{table.objective}" asks for', 0.0)
                    with stop.searching():
                        proved = _improved(problem, network, proved, search, score, deadline)
                    if deadline.over and not found.cut:
                        proved = replace(proved, figures={**proved.figures, **cut})
                refuse_a_slow_one(problem, network, proved)
            except NotCertified as error:
                refused = error
            else:
                return replace(proved, others=starts_for_period(found, one, search), sampled=one.sampled)
    stop.found = False
    if stop.asked:
        raise NothingYet("interrupted before any gains were certified; nothing was written")
    if not explain:
        raise refused
    tell("looking for what is in the way", 1.0)
    said, why = hint(problem, network, claim)
    said = said or "; name other weights, or a decay, or take units in which states and gains are near one"
    raise NotCertified(f"{refused}{said}", **refused.figures, **why)


def _tell_search(tell: Callable[[str, float], None], limit: str, likely: str, part: float) -> None:
    """Tell of a search how long it is likely to take, until a part of it is done, which says more."""
    tell(f"searching for gains up to {limit}{f', this search likely {likely}' * (part == 0)}", part)


def gain_search(
    problem: Problem, network: Network, claim: Claim, lag: float, rate: float | None, fewer: int = 0
) -> GainSearch:
    """Return the search for the gains of a problem, or of controllers with so many states fewer; with that for one
    fewer, unless its multipliers are not as many (errors of A, B and C), none can be stable, or each start takes minutes."""
    order, L = problem.order - fewer, problem.gain_limit
    limit, lower, loop = L if np.ndim(L) == 0 else np.asarray(L)[fewer:, fewer:], None, network.loop(order)
    futile = order == 1 and static_gains_cannot_stabilise(network)
    if order > claim.delta.any() and not futile and not eliminates_P(loop):
        lower = gain_search(problem, network, replace(claim, Q=claim.Q[1:, 1:]), lag, rate, fewer + 1)
    modes = equal_gains(network, claim, order, limit, rate)
    return GainSearch.of(loop, claim, limit, lag, rate, modes, lower)


def equal_gains(
    network: Network, claim: Claim, order: int, limit: GainLimit, rate: float | None
) -> ModalSearch | None:
    """Return the search for gains that are equal for all agents; None where the agents differ."""
    plant = network.plant
    if any((plant.B[0] != B).any() for B in plant.B):
        return None
    try:
        ends = segment_ends(network, check_covered(network.matrices, claim))
    except ProblemError:
        ends = representative_eigenvalues(np.linalg.eigvals(network.graph.laplacian))
    return ModalSearch.of(Modes(plant, order, network.decay), claim, ends, limit, rate)


def decays_held(problem: Problem) -> tuple[float, ...]:
    """Return the decays, in 1/s, that the search holds with the P of rho, in the order in which they are tried."""
    asked, sought = problem.design.decay, problem.design.search_decay or 0.0
    return (sought,) if asked is None else tuple(sorted({max(sought, part * asked) for part in HELD}))


def refuse_a_slow_one(problem: Problem, network: Network, found: CertifiedGains) -> None:
    """Prove the decay that is asked for, with a P of its own.

    Raises:
        NotCertified: it was not proved.
    """
    asked = problem.design.decay
    if asked is None:
        return
    try:
        prove(network.decaying(asked), found.gains, found.claim)
    except NotCertified as error:
        raise NotCertified(
            f"[design] decay asks for {asked:g} 1/s, which is not proved of any gains found: {error}",
            **error.figures,
        ) from None


def rate_of_controllers(problem: Problem) -> float | None:
    """Return the rate, in 1/s, that each controller is to forget with by itself; None where nothing is asked of them.

    Stable is what is asked and proved. In the search 1/e within `FORGOTTEN` periods is: a controller that hardly decays is
    stable for a proof and not for whoever commissions it. A limit that is small against the period leaves room for less.
    """
    if not problem.design.stable_controllers:
        return None
    of_A = float(np.ravel(problem.gain_limit)[0])
    soon = min(1 / (FORGOTTEN * problem.controller.period), REACHED * of_A)
    return max(soon, problem.design.decay or 0.0)


def _improved(
    problem: Problem,
    network: Network,
    found: CertifiedGains,
    search: GainSearch,
    score: Score | None,
    deadline: Deadline,
) -> CertifiedGains:
    """Return gains with a larger decay or initial set than those found, rho within the one given if one is; or those found.

    Raises:
        NotCertified: the rho given is not reached, or there is no initial set.
    """
    table, claim, gains, c = problem.design, found.claim, found.gains, found.certificate
    rho = np.inf if table.rho is None else table.rho
    if c.rho > rho:
        raise NotCertified(f"rho = {rho:g} was not reached: {c.rho:g} was", rho=rho, reachable_rho=c.rho)

    def at(decay: float) -> GainSearch:
        loop = network.decaying(decay).loop(problem.order)
        return GainSearch.of(loop, claim, problem.gain_limit, search.lag, search.rate)

    if table.objective == "decay":
        K = raised_decay(at, gains.blocks, rho=rho, score=score, deadline=deadline)
    else:
        limits: dict[str, Any] = {"rate": search.rate, "score": score, "deadline": deadline}
        K = with_larger_set(problem, network, gains, claim, c, **limits)
    gains = Gains.from_blocks(short_gains(K, problem.gain_limit), problem.order)
    if np.array_equal(gains.blocks, found.gains.blocks):
        return found
    try:
        certificate = prove(network, gains, claim)
        if certificate.rho > rho:
            certificate = prove(network, gains, claim, rho=rho)
    except NotCertified:
        return found
    return replace(found, gains=gains, certificate=certificate)


def starts_for_period(found: SearchResult, taken: Polished, search: GainSearch) -> tuple[StartingGains, ...]:
    """Return where else than from the outcome taken a design for the period starts, the likeliest first.

    Gains made for the lag of the period come before other outcomes, and in place of those that the period spoils.
    """
    late = ((one.at.K, multipliers_only(search, one.at)) for one in found.late)
    others = (
        (one.K, one.certificate)
        for one in found.outcomes
        if one is not taken and (not found.late or np.isfinite(one.sampled))
    )
    ends = ((K, search.units.certificate(certificate)) for K, certificate in (*late, *others))
    return tuple(StartingGains(K, certificate.m, certificate.rho) for K, certificate in ends)


def _proved(
    problem: Problem, network: Network, claim: Claim, one: Polished, search: GainSearch, limit: dict[str, Any]
) -> CertifiedGains:
    """Round the gains of an outcome, and prove them.

    Raises:
        NotCertified: the certificate did not survive the exact check.
    """
    table = problem.design
    rho = table.rho if table.objective == "alpha" else None
    if rho is not None:
        # 0.01 % is left to rounding; the proved alpha of the agent itself stays below.
        claim = replace(claim, alpha=max(claim.alpha, float(f"{claim.alpha * one.alpha * (1 - 1e-4):.6g}")))
    gains = Gains.from_blocks(short_gains(one.K, problem.gain_limit), problem.order)
    figures: dict[str, Any] = {"history": list(one.history), **limit}
    near = search.units.certificate(one.certificate)
    fastest = float(f"{0.99 * min(np.ravel(problem.gain_limit)[0], IDLE / problem.controller.period):.3g}")
    muted = without_idle_parts(gains, network, fastest)
    if muted is not gains:
        try:
            return CertifiedGains(muted, claim, prove(network, muted, claim, rho=rho, near=near), figures)
        except NotCertified:
            pass
    return CertifiedGains(gains, claim, prove(network, gains, claim, rho=rho, near=near), figures)


def without_idle_parts(gains: Gains, network: Network, fastest: float) -> Gains:
    """Return gains with idle states of controllers set to x_C' = -fastest x_C, and u = 0 of agents without incoming edges.

    The r of such an agent is 0 for ever: whatever the search left in its controller is noise; with B_C = 0 or C_C = 0 a
    controller's state is. It decays as fast as it may, or would be the slowest mode: the decay proved is that of all states.

    Args:
        gains, network: of the design.
        fastest: 1/s, within the gain limit.
    """
    blocks, n_C = gains.blocks.copy(), gains.order
    blocks[network.graph.in_degrees == 0] = 0.0
    for K in blocks:
        if not (K[:n_C, n_C:].any() and K[n_C:, :n_C].any()):
            K[:n_C] = K[:, :n_C] = 0.0
            K[:n_C, :n_C] = -fastest * np.eye(n_C)
    return gains if np.array_equal(blocks, gains.blocks) else Gains.from_blocks(blocks, gains.order)


def refuse_the_impossible(problem: Problem, network: Network, claim: Claim) -> None:
    """Refuse what no gains can do, before any search.

    Raises:
        Infeasible: a static gain that cannot stabilise, a decay that slopes of phi hide from every controller, or an alpha
            that is proved to be beyond any controller, where the entries of phi do not say more than alpha.
    """
    if problem.order == 0 and static_gains_cannot_stabilise(network):
        bound = float(np.trace(network.plant.A)) / network.agent.n
        raise Infeasible(
            "no stabilising gains of order 0 exist: C B = 0, so none of them moves the mean of the modes from Re s ="
            f" {bound:.3g}; raise [design] order to 1 or more, or measure more",
            abscissa=bound,
        )
    if not claim.entries and proves_that_none_carries(exact_network(problem, network), claim):
        most = largest_alpha_of_any_controller(network)
        near = f" and {most:.6g} is about the most that any can (computed)" if np.isfinite(most) else ""
        raise Infeasible(
            f"no controllers of any order, however connected, can certify alpha = {claim.alpha:.6g}: this is proved{near};"
            " lower alpha (a smaller domain, centred slopes), or measure or actuate more",
            alpha=claim.alpha,
            reachable_alpha=most,
        )
    decay = problem.design.decay or problem.design.search_decay or 0.0
    lost = slowest_lost_mode(network, claim.alpha, claim.entries)
    if lost and lost.decay <= decay and (decay or problem.design.objective != "alpha"):
        what = f"a [design] decay of {decay:g} 1/s" if decay else "that agents agree"
        less = "ask for less, or " * bool(decay) + ADVICE
        said = f"no controllers of any order can certify {what}: {lost.said} (computed); {less}"
        raise Infeasible(said, decay=lost.decay)


def _out_of_time(time_limit: float, claim: Claim, found: SearchResult) -> OutOfTime:
    part = max(found.nearest.certified, found.nearest.claimed) if found.nearest else 0.0
    came = (
        f"the best start came to {part:.3g} of alpha = {claim.alpha:.6g}" if part else "no start had come far"
    )
    return OutOfTime(
        f"the time limit was over before any gains were certified ({came}, in {time_limit:.3g} s); allow more time, or ask"
        " for less: fewer starts, a lower order, a smaller alpha or fragility",
        time_limit=time_limit,
        fraction=part,
        alpha=claim.alpha,
    )


def _nothing(
    problem: Problem, network: Network, claim: Claim, found: SearchResult, held: float, *, explain: bool
) -> Infeasible:
    """Say what stands in the way, and what to relax; held: the decay that was searched with."""
    table = problem.design
    asked = f"order {problem.order}, gain_limit {table.gain_limit:g}, {table.starts} starts"
    asked += ", each controller stable by itself" if table.stable_controllers else ""
    asked += f", decay {table.decay:g} 1/s" if table.decay else ""
    if not explain:
        came = (
            {"fraction": found.nearest.certified}
            if found.nearest
            else {"abscissa": found.abscissa, "decay": held - found.abscissa}
        )
        return Infeasible(f"no gains were found ({asked})", **came)
    if found.nearest is None:
        return _nothing_at_all(problem, network, asked, claim, found.abscissa)
    if found.nearest.certified < 1:
        return _part_only(problem, network, asked, claim, found.nearest)
    return Infeasible(
        f"rho = {table.rho:g} was not reached ({asked}): {found.least_rho:.6g} was; raise rho, order, gain_limit or starts",
        rho=table.rho,
        reachable_rho=found.least_rho,
    )


def _nothing_at_all(
    problem: Problem, network: Network, asked: str, claim: Claim, abscissa: float
) -> Infeasible:
    if abscissa >= 0:
        said, why = hint_of_stability(problem, network, claim)
        return Infeasible(
            f"no stabilising gains were found ({asked}): the slowest mode of the best loop is {abscissa:.3g} 1/s too slow"
            f"{said or '; raise [design] order or gain_limit, or measure more'}",
            abscissa=abscissa,
            **why,
        )
    said, why = hint(problem, network, claim)
    return Infeasible(
        f"stable gains were found ({asked}) but none with a certificate, even for a thousandth of alpha ="
        f" {claim.alpha:.6g}{said or '; raise [design] order, gain_limit or starts'}",
        abscissa=abscissa,
        alpha=claim.alpha,
        **why,
    )


def _part_only(problem: Problem, network: Network, asked: str, claim: Claim, nearest: Homotopy) -> Infeasible:
    """Certify how far the nearest gains carry."""
    with one_thread():
        part = largest_fraction(network.loop(problem.order), nearest.point.K, claim, nearest.certified)
    said, why = hint(problem, network, claim)
    delta = " and delta" if claim.delta.any() else ""
    reached = "nearly all" if part > NEARLY_ALL else f"{part:.3g}"
    relax = said or "; lower alpha (a smaller domain, centred slopes), or raise order, gain_limit or starts"
    return Infeasible(
        f"no gains were found ({asked}) that carry alpha = {claim.alpha:.6g}; {reached} of it{delta} was reached:"
        f" alpha = {part * claim.alpha:.6g}{relax}",
        **{"alpha": claim.alpha, "fraction": part, "reachable_alpha": part * claim.alpha}
        | {"reachable_delta": (part * claim.delta[0]).tolist()}
        | why,
    )
