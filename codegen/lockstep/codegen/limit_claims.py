"""What can be claimed of the limits of a design's inputs, with its witnesses."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.inputs.input_limits import proves_gain, proves_radius
from lockstep.check.sampled.inputs.saturation import ClippedWitness, proves_clipped_radius
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.codegen.sampled_design import known_rho, sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers, splits
from lockstep.lmi.analysis.covered_start import Away
from lockstep.lmi.analysis.decimals import round_up
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.half_axes import half_axes, largest_multiple
from lockstep.lmi.sampled.input_limits import largest_gain, largest_radius
from lockstep.lmi.sampled.saturation import largest_clipped_radius
from lockstep.lmi.shapes import Vector
from lockstep.model.checks.plausibility import initial_deviations

MOST_STATES = 100
"""Of a sampled loop that is assembled for what is proved of limits, which is not proved mode by mode."""

T = TypeVar("T", Witness, ClippedWitness)


def with_limits(made: Stored, stated: Stored | None = None) -> Stored:
    """Return a design file with what is proved of its inputs' limits, where there are any: it takes its time, so at last.

    radius of disagreements from which no input meets its limit;  gain, the root of the energy of a disturbance under which
    none does;  clipped, radius of disagreements from which the clipped loop comes to agree;  half-axes, where they add to a
    radius. No radius is claimed beyond what agents in their domain can be apart.

    Args:
        made: with what is proved of its sampled controllers.
        stated: a file of the same gains, whose witnesses are tried first.
    """
    problem, witness, rho = made.problem, made.proofs.sampled, known_rho(made)
    if not made.claims.sampled.certified or not np.isfinite(problem.limits).any():
        return made
    states = problem.sizes.N * (problem.sizes.n + problem.sizes.n_C)
    if rho is None and splits(made) and (problem.spectrum is not None or states > MOST_STATES):
        return made
    network, controllers = sampled_network(made), sampled_controllers(made, problem.controller.period)
    limits, weights, away = problem.limits, problem.performance, initial_deviations(problem)
    plain, noisy = sampled_loop(network, controllers), sampled_loop(network, controllers, weights.outputs)
    guess = witness.m if isinstance(witness, Witness) else np.ones(len(network.d.pairs()))
    claims, proofs, sizes = (stated or made).claims.sampled, (stated or made).proofs, _sizes(weights)
    calm = _known(claims.radius, proofs.radius, lambda w, r: proves_radius(plain, w, limits, r))
    calm = calm or _of_ball(plain, limits, largest_radius(network, controllers, limits, guess, sizes))
    gain = None
    if rho is not None:
        known = claims.limits_gain, proofs.limits_gain
        gain = _known(*known, lambda w, energy: proves_gain(noisy, w, limits, weights, energy))
        gain = gain or largest_gain(network, controllers, limits, weights, rho.witness.m / rho.rho**2)
    before = claims.clipped_radius, proofs.clipped
    clipped = _known(*before, lambda w, r: proves_clipped_radius(plain, w, limits, r))
    if clipped is None:
        sized = calm and (largest_multiple(plain, calm[1], limits, sizes)[0], calm[1])
        clipped = _of_ball(plain, limits, largest_clipped_radius(network, controllers, limits, sized, sizes))
    most = _most_apart(made)
    radius, axes = _claimed(plain, limits, calm, most, away)
    clipped_radius, clipped_axes = _claimed(plain, limits, clipped, most, away)
    found = replace(
        made.claims.sampled,
        radius=radius,
        limits_gain=gain and gain[0],
        clipped_radius=clipped_radius,
        half_axes=axes,
        clipped_half_axes=clipped_axes,
    )
    kept = replace(
        made.proofs,
        radius=calm and calm[1],
        limits_gain=gain and gain[1],
        clipped=clipped and clipped[1],
    )
    return replace(made, claims=replace(made.claims, sampled=found), proofs=kept)


def _most_apart(made: Stored) -> float:
    """Return a |x_d(0)| that no agents in their domain exceed, infinite where the certificate is of all states.

    sum_i |x_i - mean|^2 <= N/4 |w|^2 for states in ranges of widths w: half of the agents at either end.
    """
    if made.claims.scope == "global":
        return np.inf
    low, high = made.problem.agent().box.T
    most = np.sqrt(made.problem.sizes.N) / 2 * np.linalg.norm(high - low)
    return round_up(most) if np.isfinite(most) else np.inf


def _claimed(
    loop: SampledLoop,
    limits: Vector,
    found: tuple[float, Witness | ClippedWitness] | None,
    most: float,
    away: Away,
) -> tuple[float | None, tuple[float, ...] | None]:
    """Return the radius and the half-axes that are claimed of a witness: of all in the domain where its ball holds them."""
    if found is None:
        return None, None
    radius, w = found
    return (most, None) if radius >= most else (radius, half_axes(loop, w, limits, radius, away))


def _of_ball(loop: SampledLoop, limits: Vector, found: tuple[float, T] | None) -> tuple[float, T] | None:
    """Return the radius of the largest ball that a witness proves, with it."""
    radius = 0.0 if found is None else largest_multiple(loop, found[1], limits)[0]
    return (radius, found[1]) if found and radius else None


def _sizes(weights: Performance) -> Vector:
    """Return the sizes of the states that R weighs alike, the smallest 1."""
    R = np.diag(weights.R)
    return np.asarray((R.max() / R) ** 0.5)


def _known(
    claimed: float | None, witness: T | None, proves: Callable[[T, float], bool]
) -> tuple[float, T] | None:
    """Return what a file states, and its witness, if it proves that; else None."""
    return (claimed, witness) if claimed and witness is not None and proves(witness, claimed) else None
