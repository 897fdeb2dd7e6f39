"""What can be claimed of a design's controllers in integers: formats from the ranges of the problem, and witnesses."""

import math
from dataclasses import replace

import numpy as np

from lockstep.check.design_file.fixed_point import FixedClaims, FixedWitness
from lockstep.check.errors import NotCertified, ProblemError, demand
from lockstep.check.fixed_point import rho_rounding
from lockstep.check.sampled.certificate import decide_sampled
from lockstep.check.sampled.discretise import clipped_at
from lockstep.check.sampled.fixed_point import LARGEST_R, LARGEST_X, integers_of
from lockstep.check.sampled.inequality import Witness
from lockstep.codegen.sampled_design import sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import fixed_point
from lockstep.lmi.sampled.l2_gain import SampledRho

MARGIN = 2.0
"""Room in the states' formats above what is computed for them."""


def exponent_of(largest: float, count: int) -> int:
    """Return the largest e with `largest` 2^e <= count.

    >>> exponent_of(10.0, 32767), 10.0 * 2**11 <= 32767 < 10.0 * 2**12
    (11, True)
    """
    e = math.frexp(count / largest)[1]
    return next(k for k in range(e, e - 3, -1) if largest * 2.0**k <= count)


def without_fixed(stored: Stored) -> Stored:
    """Return a design that claims nothing of integers."""
    return replace(
        stored, claims=replace(stored.claims, fixed=None), proofs=replace(stored.proofs, fixed=None)
    )


def with_fixed(stored: Stored) -> Stored:
    """Return a design with what is proved of its controllers in integers, and the witnesses.

    Raises:
        ProblemError: a range that is missing, or a problem whose controllers have no form in integers.
        NotCertified: agreement is not proved of them.
    """
    if stored.claims.fixed is not None and stored.proofs.fixed is not None:
        return stored
    if stored.problem.spectrum is not None or not isinstance(stored.proofs.sampled, Witness):
        raise ProblemError(
            "no certificate of the sampled loop of all agents",
            where="--fixed",
            expected="one: method `certified`, one graph",
        )
    given, expected = (
        "[network] offsets is given",
        "agents that are to agree: the C in integers takes no offset from what it reads",
    )
    demand(stored.problem.offsets is None, given, "--fixed", expected)
    ranges = _ranges(stored)
    network, held = sampled_network(stored), sampled_controllers(stored, stored.problem.controller.period)
    reaches = fixed_point.state_bounds(network, held, ranges)
    if reaches is None:
        raise NotCertified("--fixed: no level set was found to choose the states' formats from")
    q = held[0].outputs
    outputs, inputs = (tuple(exponent_of(v, LARGEST_R) for v in part) for part in (ranges[:q], ranges[q:]))
    states = tuple(tuple(exponent_of(MARGIN * v, LARGEST_X) for v in row) for row in reaches.tolist())
    sides = clipped_at(stored.problem.controller.real, stored.problem.sides)
    integers = tuple(
        integers_of(one.table, (own, outputs, inputs), sides, one.weights)
        for one, own in zip(held, states, strict=True)
    )
    mine = tuple(one.held(own.sources) for one, own in zip(integers, held, strict=True))
    known = stored.proofs.sampled_rho
    rho, guess = None, stored.proofs.sampled.m
    if isinstance(known, Witness) and stored.claims.sampled.rho is not None:
        guess = known.m
        rho = fixed_point.rho_witness(
            network, mine, stored.problem.performance, SampledRho(stored.claims.sampled.rho, known)
        )
    agreement = fixed_point.agreement_witness(network, mine, guess)
    if agreement is None:
        raise NotCertified("--fixed: agreement is not proved of the controllers in integers")
    verdict = decide_sampled(network, mine, [agreement])
    radius = fixed_point.radius_witness(network, mine, integers)
    claims = FixedClaims(
        verdict.decay,
        verdict.residual_per_message_error,
        verdict.residual_from_underflow,
        None if rho is None else rho.rho,
        None if rho is None else rho_rounding(rho.witness, mine, network.period),
        None if radius is None else radius[0],
        outputs,
        inputs,
        states,
    )
    of_rho, of_radius = None if rho is None else rho.witness, None if radius is None else radius[1]
    witness = FixedWitness(agreement, of_rho, of_radius)
    return replace(
        stored, claims=replace(stored.claims, fixed=claims), proofs=replace(stored.proofs, fixed=witness)
    )


def _ranges(stored: Stored) -> np.ndarray:
    """Return the largest size of each output and each input: [agent.output_range] and [agent.limits]."""
    problem, found = stored.problem, []
    for name in problem.agent().outputs:
        ends = problem.output_range.get(name, (None, None))
        expected = "its lowest and its highest value: counts of 16 bits are chosen from them"
        demand(None not in ends, f"no range of `{name}`", "--fixed, [agent.output_range]", expected)
        found.append(max(abs(end) for end in ends if end is not None))
    sizes = np.abs(problem.sides).max(axis=1)
    expected = "its lowest and its highest value: counts of 16 bits are chosen from them"
    demand(np.isfinite(sizes).all(), "an input without limits", "--fixed, [agent.limits]", expected)
    return np.array([*found, *sizes])
