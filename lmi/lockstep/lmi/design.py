"""From a problem to gains with a proved certificate.

    bound      |phi(a, t) - phi(b, t)| <= alpha |a - b|, proved by `model.bound_search`
    network    the loop in disagreement coordinates, G and H scaled as the bound was proved
    gains      by the problem's method (`by_method`)
    proof      `rounding.prove`: a certificate in short decimals, decided exactly

Whatever the method, gains count as certified only by the last step.
"""

from dataclasses import replace

from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import demand
from lockstep.lmi import by_method
from lockstep.lmi.guarantees import guarantees
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.proposal import Posed, Proposal, proved_bound
from lockstep.lmi.search.stopping import Stop
from lockstep.lmi.specification.attempts import Attempt, Progress, first_near_its_floor
from lockstep.model.bound_search import Bound
from lockstep.model.problem import Problem


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
    attempt = Attempt(jobs, tell, time_limit, stop, explain=True)
    return first_near_its_floor(problem, bound, attempt, _proposed)


def _proposed(problem: Problem, bound: Bound, attempt: Attempt) -> Proposal:
    """Design what a problem asks for, and prove it.

    Args:
        problem: that names all it asks for.
        bound: of its nonlinearity.
        attempt: processes, progress, time and what ends the search.

    Raises:
        Infeasible, NotCertified, OutOfTime: see `design`.
    """
    posed, tell = Posed.of(problem, bound), attempt.tell
    match problem.design.method:
        case "certified":
            found = by_method.certified(posed, attempt)
        case "given":
            found = by_method.given(posed, tell)
        case "theorem1" | "corollary1":
            found = by_method.as_printed(posed, tell)
        case "lipschitz":
            found = by_method.protocol(posed, tell)
        case "modal":
            found = by_method.modal(posed, tell)
    tell("proving the decay", 0.0)
    modal = isinstance(found.certificate, ModalCertificate)
    return replace(
        found, guarantees=guarantees(problem, found.network, found.gains, found.claim, modal=modal)
    )
