"""Design for the period: a design file whose gains are made for the sampled controllers that ship.

The gains of the file stay continuous ones, and what ships stays what they are sampled to by Tustin's rule: the discrete
controllers are what is designed, and these gains are their image under the inverse rule. So nothing else changes: the
continuous certificate is that of the new gains, and `certify` and `generate` read the file as any other.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.errors import ClaimError, Infeasible, NotCertified
from lockstep.check.inequality import Certificate
from lockstep.check.loop import Gains, build_loop
from lockstep.codegen.sampled_design import (
    FOR_PERIOD,
    NOT_FOR_PERIOD,
    PairWeights,
    pair_weights,
    prove_design,
    sampled_network,
    weights_of,
    with_sampled,
)
from lockstep.lmi.certify import certify
from lockstep.lmi.document import Stored, parse
from lockstep.lmi.sampled.certify import plant_in_doubles
from lockstep.lmi.sampled.improve import Start
from lockstep.lmi.threads import one_thread
from lockstep.model.problem import Problem

NEAR = 1.05
"""A sampled loop whose rho is above the continuous one by more is designed for its period."""

MOST_STATES = 80
"""Of the sampled loop: a step of the descent grows with the third power of their number, its unknowns with it too."""

Tell = Callable[[float], None]


def as_shipped(
    content: Mapping[str, Any],
    tell: Callable[[str, float], None] = lambda _what, _part: None,
    others: Sequence[Start] = (),
) -> dict[str, Any]:
    """Return a design file with what is proved of its controllers sampled and rounded, as a reader of the file sees it.

    Where the period is too long for the continuous design, or costs more than 5 % of the least rho known, or the
    problem asks for it, gains are designed for the sampled loop; where that fails, the continuous design is kept and
    `sampled` says why.

    Args:
        content: the design file, made of JSON types only.
        tell: called with what is being done and the part of it that is done.
        others: gains to start a design for the period from, besides those of the file.

    Raises:
        NotCertified: the file says that the design is certified, and the checker refuses it.
    """
    with one_thread():
        stored = parse(content, "the design")
        verdict = certify(stored)
        if content["certified"] and not verdict.certified:
            raise NotCertified(f"the checker refuses the design: {verdict.reason}", **verdict.figures)
        tell("proving the sampled controllers", 0.95)
        content = with_sampled(content, prove_design(stored, content))
        asked = is_asked(stored.problem) or not content["sampled"]["certified"]
        enough = NEAR * min([content["rho"] or np.inf, *(one.rho for one in others)])
        if not asked and (content["sampled"].get("rho") or np.inf) <= enough:
            return content
        found = obstacle(stored)
        if found is None:
            try:
                return designed_for_period(
                    content, stored, lambda part: tell("designing for the period", part), others
                )
            except Infeasible as error:
                found = str(error)
        if not asked:
            return content
        return {**content, "sampled": {**content["sampled"], NOT_FOR_PERIOD: found}}


def is_asked(problem: Problem) -> bool:
    """Tell whether the problem asks for it: `[design] for_period = true`."""
    return problem.design.for_period


def obstacle(stored: Stored) -> str | None:
    """Say why a design cannot be made for its period, or None."""
    problem = stored.problem
    if problem.design.method != "certified":
        return f'the gains of method "{problem.design.method}" are not designed for a period'
    if not isinstance(stored.proofs.certificate, Certificate):
        return "there is no continuous certificate to start from"
    if any(problem.fragility.values()):
        return "[design.fragility] is about continuous gains"
    if problem.controller.discretization != "tustin":
        return f'discretization is "{problem.controller.discretization}", not "tustin"'
    states = problem.agent().n * (stored.gains.N - 1) + stored.gains.order * stored.gains.N
    return f"the loop has {states} states, more than {MOST_STATES}" if states > MOST_STATES else None


def designed_for_period(
    content: Mapping[str, Any], stored: Stored, tell: Tell, others: Sequence[Start] = ()
) -> dict[str, Any]:
    """Return the design file with gains made for its period, both certificates proved anew.

    Args:
        content, stored: the design file, as JSON types and typed.
        tell: called with the part that is done.
        others: gains to start from besides those of the file.

    Raises:
        Infeasible: no gains survive the period, or none with both certificates, or none that are better.
    """
    found, m = _searched(stored, tell, others)
    proved = replace(stored, gains=found, certificate=_continuous(stored, found))
    sampled = prove_design(proved, {}, m)
    before = content["sampled"].get("rho")
    if not sampled.verdict.certified or sampled.rho is None:
        raise Infeasible(f"gains were found for the period, but not proved: {sampled.verdict.reason}")
    if before is not None and sampled.rho.rho >= before:
        raise Infeasible(
            f"no gains were found with a smaller rho of the sampled loop than {before:g}", rho=before
        )
    return _rewritten(content, proved, sampled.document())


def _searched(stored: Stored, tell: Tell, others: Sequence[Start]) -> tuple[Gains, PairWeights]:
    from lockstep.lmi.analysis.rounding import short_gains
    from lockstep.lmi.sampled.improve import AtPeriod, improved

    problem, c, order = stored.problem, stored.proofs.certificate, stored.gains.order
    m = pair_weights(stored)
    if not isinstance(c, Certificate) or m is None:
        raise Infeasible("there is no continuous certificate to start from")
    limit, period = problem.design.gain_limit, problem.controller.period
    at = AtPeriod(sampled_network(stored, period), problem.graph().edges, weights_of(stored), order, limit)
    starts = [Start(stored.gains.blocks, m, c.rho), *others]
    enough = NEAR * min(one.rho for one in starts)
    found = improved(at, starts, rho_most=problem.design.rho, enough=enough, tell=tell)
    if found is None:
        raise Infeasible(
            f"no gains were found whose sampled loop is certified at {period:g} s", period=period
        )
    return Gains.from_blocks(short_gains(found.K, limit), order), found.m


def _continuous(stored: Stored, gains: Gains) -> Certificate:
    """Prove the new gains in continuous time."""
    from lockstep.lmi.analysis.rounding import prove
    from lockstep.lmi.design import claim_of
    from lockstep.lmi.stored_bound import bound_again
    from lockstep.model.assembly import network_of

    problem = stored.problem
    bound = bound_again(stored).or_raise()
    claim = replace(claim_of(problem, bound), alpha=stored.claims.alpha)
    try:
        return prove(network_of(problem, bound), gains, claim, rho=problem.design.rho)
    except ClaimError as error:
        raise Infeasible(
            f"gains were found for the period, but not certified in continuous time: {error}"
        ) from None


def _rewritten(content: Mapping[str, Any], proved: Stored, sampled: dict[str, Any]) -> dict[str, Any]:
    """Return the file with the new gains and what is proved of them; the old ones' figures are kept under
    `replaced`."""
    c, gains = proved.certificate, proved.gains
    if not isinstance(c, Certificate):
        raise TypeError("proved without a certificate")
    replaced = {"rho": content["rho"], "sampled_rho": content["sampled"].get("rho")}
    replaced["sampled_max_period"] = content["sampled"].get("max_period")
    return {
        **content,
        "rho": c.rho,
        "gains": [{letter: getattr(gains, letter)[i].tolist() for letter in "ABCD"} for i in range(gains.N)],
        "certificate": {
            **content["certificate"],
            "P": c.P.tolist(),
            "m": c.m.tolist(),
            "t": c.t.tolist(),
            **({"m_entries": c.m_entries.tolist()} if len(c.m_entries) else {}),
        },
        "sampled": {**sampled, FOR_PERIOD: True},
        "figures": {
            **content["figures"],
            "abscissa": _abscissa(proved),
            "gain_norms": gains.norms,
            "replaced": replaced,
        },
    }


def _abscissa(proved: Stored) -> float:
    loop = build_loop(*plant_in_doubles(sampled_network(proved, 1.0)), proved.gains.order)
    return float(np.linalg.eigvals(loop.A_cl(proved.gains.blocks)).real.max())
