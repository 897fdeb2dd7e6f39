"""Design for the period: a design file whose gains are made for the sampled controllers that ship.

The gains of the file stay continuous ones, and what ships stays what they are sampled to by Tustin's rule: the discrete
controllers are what is designed, and these gains are their image under the inverse rule. So nothing else changes: the
continuous certificate is that of the new gains, and `certify` and `generate` read the file as any other.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.codegen.sampled_design import FOR_PERIOD, prove_design, sampled_controllers, sampled_network
from lockstep.lmi.document import Stored
from lockstep.lmi.inequality import Certificate
from lockstep.lmi.sampled import HeldController, Weights
from lockstep.lmi.sampled.certify import plant_in_doubles
from lockstep.model.errors import ClaimError, Infeasible
from lockstep.model.loop import Gains, build_loop
from lockstep.model.problem import Problem

MOST_STATES = 40
"""Of the sampled loop: the nonlinear program grows with the fourth power of their number."""

Tell = Callable[[float], None]


def is_asked(problem: Problem) -> bool:
    """Tell whether the problem asks for it: `[design] for_period = true`."""
    return problem.design.for_period


def obstacle(stored: Stored) -> str | None:
    """Say why a design cannot be made for its period, or None."""
    problem = stored.problem
    if problem.design.method != "certified":
        return f'the gains of method "{problem.design.method}" are not designed for a period'
    if not isinstance(stored.certificate, Certificate):
        return "there is no continuous certificate to start from"
    if any(problem.fragility.values()):
        return "[design.fragility] is about continuous gains"
    if problem.controller.discretization != "tustin":
        return f'discretization is "{problem.controller.discretization}", not "tustin"'
    states = problem.agent().n * (stored.gains.N - 1) + stored.gains.order * stored.gains.N
    return f"the loop has {states} states, more than {MOST_STATES}" if states > MOST_STATES else None


def designed_for_period(content: Mapping[str, Any], stored: Stored, tell: Tell) -> dict[str, Any]:
    """Return the design file with gains made for its period, both certificates proved anew.

    Raises:
        Infeasible: no gains survive the period, or none with both certificates, or none that are better.
    """
    found, m = _searched(stored, tell)
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


def _searched(stored: Stored, tell: Tell) -> tuple[Gains, Float[np.ndarray, " pairs"]]:
    from lockstep.lmi.rounding import short_gains
    from lockstep.lmi.sampled.direct import design_for_period
    from lockstep.lmi.sampled.program import Direct

    problem, c, order = stored.problem, stored.certificate, stored.gains.order
    if not isinstance(c, Certificate):
        raise Infeasible("there is no continuous certificate to start from")

    def controllers_of(K: Float[np.ndarray, "N k l"], period: float) -> tuple[HeldController, ...]:
        return sampled_controllers(replace(stored, gains=Gains.from_blocks(K, order)), period)

    weights = Weights(problem.state_weight(problem.agent().n), problem.controller_weight(order))
    limit = problem.design.gain_limit
    found = design_for_period(
        sampled_network(stored, problem.controller.period),
        controllers_of,
        weights,
        Direct(stored.gains.blocks, c.m, c.rho, c),
        limit,
        rho_most=problem.design.rho,
        tell=tell,
    )
    return Gains.from_blocks(short_gains(found.K, limit), order), found.m


def _continuous(stored: Stored, gains: Gains) -> Certificate:
    """Prove the new gains in continuous time."""
    from lockstep.lmi.design import claim_of
    from lockstep.lmi.rounding import prove
    from lockstep.lmi.stored_bound import bound_again
    from lockstep.model.assembly import network_of

    problem = stored.problem
    bound = bound_again(stored).or_raise()
    claim = replace(claim_of(problem, bound), alpha=stored.alpha)
    try:
        return prove(network_of(problem, bound), gains, claim, rho=problem.design.rho)
    except ClaimError as error:
        raise Infeasible(
            f"gains were found for the period, but not certified in continuous time: {error}"
        ) from None


def _rewritten(content: Mapping[str, Any], proved: Stored, sampled: dict[str, Any]) -> dict[str, Any]:
    """Return the file with the new gains and what is proved of them; the old ones' figures are kept under `replaced`."""
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
