"""From a problem to gains with a proved certificate.

    bound      |phi(a, t) - phi(b, t)| <= alpha |a - b|, proved by `model.bound_search`
    network    the loop in disagreement coordinates, G and H scaled as the bound was proved
    gains      by the problem's method (`by_method`)
    proof      `rounding.prove`: a certificate in short decimals, decided exactly

Whatever the method, gains count as certified only by the last step.
"""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import ClaimError, Infeasible, NotCertified, OutOfTime, demand
from lockstep.lmi import by_method
from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.by_method import Attempt, Progress
from lockstep.lmi.defaults import FAR, MUCH, VERY_FAR, Specification, defaults_of, keeping, specifications
from lockstep.lmi.guarantees import guarantees
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.proposal import Posed, Proposal, claim_of, proved_bound
from lockstep.lmi.search.stopping import NothingYet, Stop
from lockstep.model.assembly import network_of
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
    tried = list(specifications(problem, network_of(problem, bound), claim_of(problem, bound)))
    deadline = None if time_limit is None else time.monotonic() + time_limit
    best, first, before = None, "", list[str]()
    for number, spec in enumerate(tried, start=1):
        left, last = time_limit, spec is tried[-1]
        stop.found = best is not None and problem.design.method == "certified"
        if deadline is not None and spec is not tried[0]:
            left = max(deadline - time.monotonic(), 1e-3)
        so_far = f" ({before[-1]})" if before else ""
        nth = f"attempt {number} of at most {len(tried)}{so_far}: " * (len(tried) > 1)

        def counted(what: str, part: float, nth: str = nth) -> None:
            tell(nth + what, part)

        try:
            found = _proposed(spec.problem, bound, Attempt(jobs, counted, left, stop, last))
        except KeyboardInterrupt as error:  # a second one keeps nothing, nor does one that nobody is to take
            taken = isinstance(error, NothingYet) or (stop.flag and not stop.asked)
            if best is None or not taken:
                raise
            stop.asked = True
            break
        except (Infeasible, NotCertified, OutOfTime) as error:
            if best is not None:
                break
            first = first or str(error)  # what no controller can is said in the same words each time
            if last and isinstance(error, Infeasible | NotCertified) and str(error) != first:
                said = f"{error}; before that, by default, {_given_up(before, spec)}"
                raise type(error)(said, **error.figures) from None
            if last or stop.asked or (deadline is not None and time.monotonic() >= deadline):
                raise
            before.append(spec.with_limit(_came_to(error, problem.design.decay)))
            continue
        if best is None or _over_floor(found, best) < MUCH * _over_floor(best, best):
            best = found if spec.problem is problem else _with_remark(found, spec, _given_up(before, spec))
        elif best is not None:
            break
        times, near = _over_floor(best, best), VERY_FAR if spec.enough else FAR
        # Of many graphs there is no floor.
        far = times > near if best.floor else best.network.spectrum is None
        before.append(spec.with_limit(f"rho was {times:.3g}{' times its lower bound' * bool(best.floor)}"))
        over = stop.asked or (deadline is not None and time.monotonic() >= deadline)
        if over or not far or eliminates_P(best.network.loop(problem.order)):
            break  # of many agents with gains of their own, another search takes many minutes
    assert best is not None
    return replace(best, figures=best.figures | {"interrupted": True}) if stop.asked else best


def _given_up(before: Sequence[str], spec: Specification) -> str:
    return "; ".join(filter(None, (*before, spec.not_asked)))


def _came_to(error: ClaimError, decay: float | None) -> str:
    """Return how far an attempt without gains came, in a few words."""
    figures = error.figures
    if "fraction" in figures:
        return f"{int(100 * figures['fraction']) / 100 or 'nothing'} of what is asked was carried"
    if isinstance(error, NotCertified):
        return f"gains were found, but not proved ({error})"
    if figures.get("abscissa", -1.0) < 0:
        return "none had a certificate" + ", even for a thousandth of alpha" * ("abscissa" in figures)
    if not decay:
        return "no loop was as stable as is searched for"
    came = figures.get("decay", 0.0)
    return f"no loop decayed at {decay:g} 1/s{f' ({came:.2g} 1/s at most)' if came > 0 else ''}"


def _over_floor(found: Proposal, other: Proposal) -> float:
    """Return rho over its floor, or over that of another one, by which specifications with other weights are compared."""
    floor = found.floor or other.floor
    rho = np.inf if found.certificate is None else found.certificate.rho
    return rho / floor.rho if floor else rho


def _with_remark(found: Proposal, spec: Specification, said: str) -> Proposal:
    """Return a proposal that says what was asked for by default, and the decay that a design for the period keeps to."""
    problem, given_up = spec.problem, {"given_up": said} if said else {}
    if spec.enough and found.guarantees.decay is not None:
        problem = keeping(problem, found.guarantees.decay[0])
    figures = found.figures | {"defaults": {**defaults_of(problem), **given_up}}
    return replace(found, problem=problem, figures=figures)


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
