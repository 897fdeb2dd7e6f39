"""From a problem to gains with a proved certificate.

    bound      |phi(a, t) - phi(b, t)| <= alpha |a - b|, proved by `model.bound_search`
    network    the loop in disagreement coordinates, G and H scaled as the bound was proved
    gains      found by `search` (certified), read from the file (given), or recovered as printed (theorem1,
               corollary1)
    proof      `rounding.prove`: a certificate in short decimals, decided exactly

Whatever the method, gains count as certified only by the last step.
"""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import Infeasible, NotCertified, OutOfTime, demand
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.analysis.margins import largest_fraction
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.defaults import FAR, MUCH, VERY_FAR, Wishes, keeping, named, wishes
from lockstep.lmi.guarantees import Guarantees, guarantees
from lockstep.lmi.initial_set import InitialStates, Unavailable
from lockstep.lmi.initial_set_design import largest_initial_states
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.sampled.synthesis.gains_for_period import StartingGains
from lockstep.lmi.scope import Scope, scope_of
from lockstep.lmi.search.stopping import NothingYet, Stop
from lockstep.model.assembly import bound_of, network_of
from lockstep.model.bound_search import Bound
from lockstep.model.network import Network
from lockstep.model.problem import Problem

Progress = Callable[[str, float], None]
"""Called with what is being done and the part of it that is done, from 0 to 1."""


@dataclass(frozen=True)
class Proposal:
    """Gains, what is claimed of the loop with them, and the certificate, if one was proved.

    figures: what else is known: abscissa, gain norms, the history of the search, the audit of a
    theorem;  floor: a rho below which no controllers can certify, with its proof, where it was looked for and found;
    others: other gains that the search came to, from which a design for the period may start;  guarantees: the decay, and
    whether controllers are stable by themselves.
    """

    problem: Problem
    network: Network
    bound: Bound
    claim: Claim
    gains: Gains
    certificate: Certificate | ModalCertificate | None
    figures: dict[str, Any] = field(default_factory=dict)
    floor: FloorWitness | None = None
    others: tuple[StartingGains, ...] = ()
    guarantees: Guarantees = field(default_factory=Guarantees)

    @property
    def certified(self) -> bool:
        """Whether a certificate was proved exactly."""
        return self.certificate is not None

    @cached_property
    def scope(self) -> Scope | None:
        """Where the certificate holds: "global", or "local" where its bound was proved on [agent.domain] only."""
        return scope_of(self.network.agent, self.bound) if self.certified else None

    @property
    def initial(self) -> InitialStates | Unavailable | None:
        """Where the certificate is local: states from which the agents stay in their domain, or why none can be given."""
        return self.initial_and_proof[0]

    @cached_property
    def initial_and_proof(self) -> tuple[InitialStates | Unavailable | None, Certificate | None]:
        """These, and the certificate of their own that proves them, where that of rho does not."""
        if self.certificate is None or self.scope != "local":
            return None, None
        with one_thread():
            given = self.network, self.gains, self.claim, self.certificate
            return largest_initial_states(*given, self.problem.leader)


def design(
    problem: Problem,
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
    time_limit: float | None = None,
    stop: Stop | None = None,
) -> Proposal:
    """Design or take the gains of a problem and prove them.

    Args:
        problem: checked by `problem.validate()` first.
        jobs: processes to search with; by default one per core.
        progress: told what is going on.
        time_limit: seconds for the search of method "certified", the proof afterwards not counted; where it cuts the
            search, the design depends on the machine, and `figures["time_limit"]` says so.
        stop: ends the search of method "certified", and what is not needed after it; the best gains so far are kept, and
            `figures["interrupted"]` says so.

    Raises:
        ProblemError: the problem cannot be posed (no spanning tree, no finite bound, a method not built yet).
        BoundNotProved: `[design] alpha` is below a slope the nonlinearity reaches.
        Infeasible: no gains were found; the figures say how far the search came.
        OutOfTime: the time limit was over before any gains were certified.
        NotCertified: the gains are there but not certified; the figures carry them and the audit.
    """
    with one_thread():
        return _designed(problem, jobs, progress or (lambda _what, _part: None), time_limit, stop or Stop())


def _designed(
    problem: Problem, jobs: int | None, tell: Progress, time_limit: float | None, stop: Stop
) -> Proposal:
    problem.validate()
    where, expected = "--time-limit", "a number of seconds above 0"
    demand(time_limit is None or time_limit > 0, f"{time_limit} s", where, expected)
    given, remedy = 'a time limit is given for method "modal"', "lower [design] starts instead"
    expected = 'method = "certified", whose search can be cut'
    demand(time_limit is None or problem.design.method != "modal", given, where, expected, remedy)
    tell("proving the bound of the nonlinearity", 0.0)
    bound = proved_bound(problem)
    tried = list(wishes(problem, network_of(problem, bound), claim_of(problem, bound)))
    deadline, best = None if time_limit is None else time.monotonic() + time_limit, None
    for number, wish in enumerate(tried, start=1):
        left, last = time_limit, wish is tried[-1]
        if deadline is not None and wish is not tried[0]:
            left = max(deadline - time.monotonic(), 1e-3)
        nth = f"attempt {number} of at most {len(tried)}: " * (len(tried) > 1)

        def counted(what: str, part: float, nth: str = nth) -> None:
            tell(nth + what, part)

        try:
            found = _proposed(wish.problem, bound, _Attempt(jobs, counted, left, stop, last))
        except (Infeasible, NotCertified, OutOfTime, NothingYet):
            if best is not None:
                break
            if last or stop.asked or (deadline is not None and time.monotonic() >= deadline):
                raise
            continue
        if best is None or _over_floor(found, best) < MUCH * _over_floor(best, best):
            best = found if wish.problem is problem else _with_remark(found, wish)
        elif best is not None:
            break
        far = best.floor is not None and _over_floor(best, best) > (VERY_FAR if wish.enough else FAR)
        if stop.asked or not far or eliminates_P(best.network.loop(problem.order)):
            break  # of many agents with gains of their own, another search takes many minutes
    assert best is not None
    return best


def _over_floor(found: Proposal, other: Proposal) -> float:
    """Return rho over its floor, or over that of another one: wishes that differ in weights are told apart by that."""
    floor = found.floor or other.floor
    rho = np.inf if found.certificate is None else found.certificate.rho
    return rho / floor.rho if floor else rho


def _with_remark(found: Proposal, wish: Wishes) -> Proposal:
    """Return a proposal that says what was asked for by default, and the decay that a design for the period keeps to."""
    problem, given_up = wish.problem, {"given_up": wish.given_up} if wish.given_up else {}
    if wish.enough and found.guarantees.decay is not None:
        problem = keeping(problem, found.guarantees.decay[0])
    figures = found.figures | {"defaults": {**named(problem), **given_up}}
    return replace(found, problem=problem, figures=figures)


class _Attempt(NamedTuple):
    """What `design` is given beside the problem, and whether to look for what is in the way where no gains are found."""

    jobs: int | None
    tell: Progress
    time_limit: float | None
    stop: Stop
    explain: bool


def _proposed(problem: Problem, bound: Bound, attempt: _Attempt) -> Proposal:
    """Design what a problem asks for, and prove it.

    Args:
        problem: that names all it asks for.
        bound: of its nonlinearity.
        attempt: processes, progress, time and what ends the search.

    Raises:
        Infeasible, NotCertified, OutOfTime: see `design`.
    """
    network, claim, tell = network_of(problem, bound), claim_of(problem, bound), attempt.tell
    match problem.design.method:
        case "certified":
            found = _searched(problem, network, bound, claim, attempt)
        case "given":
            found = _given(problem, network, bound, claim, tell)
        case "theorem1" | "corollary1":
            found = _as_printed(problem, network, bound, claim, tell)
        case "lipschitz":
            found = _protocol(problem, network, bound, claim, tell)
        case "modal":
            found = _modal(problem, network, bound, claim, tell)
    tell("proving the decay", 0.0)
    modal = isinstance(found.certificate, ModalCertificate)
    return replace(found, guarantees=guarantees(problem, network, found.gains, found.claim, modal=modal))


def proved_bound(problem: Problem) -> Bound:
    """Prove the smallest bound, or the `alpha` the problem gives.

    Raises:
        BoundNotProved: the given alpha is refuted, with a witness, or undecided.
    """
    return bound_of(problem.agent(), alpha=problem.design.alpha).or_raise()


def claim_of(problem: Problem, bound: Bound) -> Claim:
    """Return what is to be certified: alpha as given or as proved, R, Q and delta of the problem.

    The bounds of single slopes count where alpha is the proved one of this phi. An alpha that is given, or to be raised,
    stands for every phi that has it.
    """
    alpha = problem.design.alpha if problem.design.alpha is not None else bound.alpha
    fragility = problem.fragility
    delta = np.tile([fragility[letter] for letter in "ABCD"], (problem.graph().N, 1))
    of_this_phi = problem.design.alpha is None and problem.design.objective != "alpha"
    return Claim.of(float(alpha), problem.performance, delta, bound.entries if of_this_phi else ())


def given_gains(problem: Problem) -> Gains:
    """Return the gains of method "given"."""
    given = problem.gains or ()
    return Gains(*(tuple(np.array(getattr(one, letter), dtype=float) for one in given) for letter in "ABCD"))


def _searched(problem: Problem, network: Network, bound: Bound, claim: Claim, attempt: _Attempt) -> Proposal:
    from lockstep.lmi.diagnosis.open_loop import rho_alone
    from lockstep.lmi.methods.certified import CertifiedGains, searched
    from lockstep.lmi.sampled.synthesis.score import SampledScore

    jobs, tell, time_limit, stop, explain = attempt
    score = SampledScore.of(problem, network, claim)

    def found_from(*, anew: bool) -> tuple[CertifiedGains, FloorWitness | None]:
        found = searched(
            problem,
            network,
            claim,
            jobs,
            tell,
            time_limit,
            score,
            stop,
            explain=explain and not anew,
            anew=anew,
        )
        rho = found.certificate.rho
        return found, stop.optional(lambda: _floor(problem, network, found.claim, rho, tell), otherwise=None)

    found, floor = found_from(anew=False)
    far = floor is not None and found.certificate.rho > VERY_FAR * floor.rho and not claim.delta.any()
    may = explain and time_limit is None and not stop.asked
    if far and may and not eliminates_P(network.loop(problem.order)):
        with contextlib.suppress(Infeasible, NotCertified, NothingYet):
            again = found_from(anew=True)
            if again[0].certificate.rho < MUCH * found.certificate.rho:
                found, floor = again
    alone = stop.optional(lambda: rho_alone(network, found.claim), otherwise=None)
    figures = found.figures | _figures(network, found.gains) | {"rho_alone": alone}
    return Proposal(
        problem, network, bound, found.claim, found.gains, found.certificate, figures, floor, found.others
    )


def _given(problem: Problem, network: Network, bound: Bound, claim: Claim, tell: Progress) -> Proposal:
    gains = given_gains(problem)
    tell("looking for a certificate of the given gains", 0.0)
    try:
        certificate = prove(network, gains, claim, rho=problem.design.rho)
    except NotCertified as error:
        if problem.design.rho is not None:
            raise
        tell("looking for how much of alpha the gains carry", 0.0)
        raise _not_carried(network, gains, claim, error) from None
    return Proposal(problem, network, bound, claim, gains, certificate, _figures(network, gains))


def _not_carried(network: Network, gains: Gains, claim: Claim, error: NotCertified) -> NotCertified:
    """Return what given gains do instead: their linear loop is unstable, or they carry a part of alpha only."""
    abscissa = float(error.figures.get("abscissa", 0.0))
    if abscissa >= 0:
        said = (
            f"the linear loop of the given gains is unstable, Re s = {abscissa:.3g}: with r = sum a_ij (y_i - y_j) negative"
            " feedback is u = -r"
        )
        return NotCertified(f"{error}: {said}", **error.figures)
    part = largest_fraction(network.loop(gains.order), gains.blocks, claim, 0.0)
    alpha = part * claim.alpha
    said = f"{part:.3g} of it is carried, alpha = {alpha:.6g}"
    return NotCertified(f"{error}; {said}", **error.figures, fraction=part, reachable_alpha=alpha)


def _as_printed(problem: Problem, network: Network, bound: Bound, claim: Claim, tell: Progress) -> Proposal:
    from lockstep.lmi.methods.paper import solve_as_printed

    tell(f"solving {'(34)' if problem.design.method == 'corollary1' else '(19)'} as printed", 0.0)
    delta = None if problem.design.method == "corollary1" else claim.delta[0]
    audit = solve_as_printed(network, problem.order, claim.R, claim.Q, delta)
    figures = _figures(network, audit.gains) | {
        "audit": {
            "objective": audit.objective,
            "rho": audit.rho,
            "alpha": list(audit.alpha),
            "residual": audit.residual,
            "abscissa": audit.abscissa,
        }
    }
    try:
        certificate = prove(network, audit.gains, claim)
    except NotCertified as error:
        raise NotCertified(
            f"as printed, the recovered loop is not certified: (22) misses k_i by {audit.residual:.3g} of its"
            f" size, and the recovered loop has the abscissa {audit.abscissa:.3g}; {error}",
            residual=audit.residual,
            abscissa=audit.abscissa,
            design=Proposal(problem, network, bound, claim, audit.gains, None, figures),
        ) from None
    return Proposal(problem, network, bound, claim, audit.gains, certificate, figures)


def _protocol(problem: Problem, network: Network, bound: Bound, claim: Claim, tell: Progress) -> Proposal:
    from lockstep.lmi.methods.lipschitz import design_protocol, protocol_gains

    found = f"`order` is {problem.order}"
    demand(not problem.order, found, "[design]", 'order = 0: the protocol of method "lipschitz" is static')
    tell("solving step 1 of the protocol", 0.0)
    protocol = design_protocol(network, claim, problem.gain_limit)
    gains = protocol_gains(network, protocol)
    gains = Gains.from_blocks(short_gains(gains.blocks, problem.gain_limit), 0)
    certificate = prove(network, gains, claim)
    figures = _figures(network, gains) | {
        "protocol": {
            "tau": protocol.first.tau,
            "K": protocol.first.K.tolist(),
            "c": protocol.c,
            "connectivity": protocol.connectivity,
            "decay": protocol.decay,
        }
    }
    floor = _floor(problem, network, claim, certificate.rho, tell)
    return Proposal(problem, network, bound, claim, gains, certificate, figures, floor)


def _modal(problem: Problem, network: Network, bound: Bound, claim: Claim, tell: Progress) -> Proposal:
    from lockstep.lmi.analysis.decay import abscissa
    from lockstep.lmi.methods.certified import rate_of_controllers
    from lockstep.lmi.methods.modal import covered_graphs, design_modes, prove_modes

    table = problem.design
    decaying = network.decaying(max(table.decay or 0.0, table.search_decay or 0.0))
    gains = design_modes(
        decaying,
        claim,
        problem.order,
        problem.gain_limit,
        starts=table.starts,
        seed=table.seed,
        rate=rate_of_controllers(problem),
        tell=lambda part: tell("searching for gains", part),
    )
    tell("proving the certificate", 0.0)
    certificate = prove_modes(network, gains, claim)
    figures = {
        "abscissa": abscissa(network, gains, modal=True),
        "gain_norms": gains.norms,
        "modal": {
            "spectrum": [certificate.lower, certificate.ends[-1]],
            "segments": len(certificate.segments),
            "covers": covered_graphs(network, certificate),
        },
    }
    # A floor is one of a network with so many agents: of many graphs there is none.
    floor = None if network.spectrum is not None else _floor(problem, network, claim, certificate.rho, tell)
    return Proposal(problem, network, bound, claim, gains, certificate, figures, floor)


def _figures(network: Network, gains: Gains) -> dict[str, Any]:
    poles = np.linalg.eigvals(network.loop(gains.order).A_cl(gains.blocks))
    return {"abscissa": float(poles.real.max()), "gain_norms": gains.norms}


def _floor(
    problem: Problem, network: Network, claim: Claim, rho: float, tell: Progress
) -> FloorWitness | None:
    """Return the largest floor that is proved, in any coordinates and for any method; None where none is."""
    from lockstep.lmi.floor.bisection import largest_floor
    from lockstep.model.assembly import exact_network

    tell("proving a lower bound of rho", 0.0)
    return largest_floor(exact_network(problem, network), claim, certified=rho)
