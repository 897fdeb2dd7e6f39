"""The largest disagreement from which the clipped loop converges is looked for here, in doubles, and put to the checker.

Without rounding, and for given tau, it is the program of `step_program` with a column for what is clipped off, in tau H, and

    [ P            k_l' - h_l' ]
    [ k_l - h_l    u_max,l^2   ]  >= 0,          gamma (T T')^-1 (x) diag(s)^-2 >= P_d,  gamma least:  half-axes gamma^-1/2 s.

One number tau for all inputs, each in units of its limit, is searched for: with it large nothing is clipped, and too small no
P is left. In tau and H together it is not convex. Of a large loop nothing is searched for: the
radius from which no input meets its limit is what comes out.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.inputs.saturation import (
    ClippedWitness,
    clipped,
    proves_clipped_radius,
    sector_cost,
)
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import SOME_STATES, is_large, priced_for_rounding
from lockstep.lmi.sampled.half_axes import ONE, Sizes, largest_multiple
from lockstep.lmi.sampled.input_limits import CLAIMED, inside
from lockstep.lmi.sampled.loop_gain import spectral_radius
from lockstep.lmi.sampled.step_program import step_program
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles

RATES = (0.02, 0.1)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
"""In the exponent of tau, a power of ten, from 0 on; the last two not for a loop whose programs take long (`SOME_STATES`)."""

MOST = 4.0
"""Of the exponent, either way."""

NEVER = 1e6
"""tau over |P| with which nothing is clipped."""

Found = tuple[float, ClippedWitness]


def largest_clipped_radius(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    limits: Float[np.ndarray, " m"],
    unclipped: tuple[float, Witness] | None = None,
    sizes: Sizes = ONE,
) -> Found | None:
    """Find and prove a large radius over the sizes of the states from which the clipped loop converges; None without one.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        limits: (m,) of each agent's inputs.
        unclipped: a radius from which no input meets its limit, and its witness: what is found is no less.
        sizes: (n,) or one for all; the half-axes are the radius times these.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    one = period_in_doubles(loop)
    if one is None or not np.isfinite(limits).any():
        return None
    spread, least = 1 - spectral_radius(loop, one) ** 2, 0.0 if unclipped is None else unclipped[0]
    exponent: float | None = None
    for rate in RATES if spread > 0 and not is_large(loop) else ():
        found, exponent = _scanned(loop, one, limits, sizes, 1 - rate * spread, exponent)
        for _, start in found:
            for candidate in _priced(loop, one, start):
                radius, a = largest_multiple(exact_loop, candidate, limits, sizes)
                if radius > least and proves_clipped_radius(exact_loop, candidate, limits, a):
                    return radius, candidate
    if unclipped is None:
        return None
    never = np.full(len(loop.computed), NEVER * float(np.linalg.norm(unclipped[1].P, 2)))
    same = ClippedWitness(unclipped[1], never, np.zeros((len(never), loop.n_x)))
    _, a = largest_multiple(exact_loop, same, limits, sizes)
    return (least, same) if proves_clipped_radius(exact_loop, same, limits, a) else None


def _scanned(
    loop: SampledLoop,
    one: Lifted,
    limits: Float[np.ndarray, " m"],
    sizes: Sizes,
    decay: float,
    near: float | None,
) -> tuple[list[Found], float]:
    """Return gamma and a witness for each tau tried, the least gamma first, and the exponent of its tau.

    near: the exponent that served another decay: only next to it is looked, if it serves this one.
    """
    tried: dict[float, Found | None] = {}

    def gamma(at: float) -> float:
        if abs(at) > MOST:
            return np.inf
        if at not in tried:
            tried[at] = _least(loop, one, limits, sizes, decay, 10**at)
        found = tried[at]
        return np.inf if found is None else found[0]

    steps: tuple[float, ...] = STEPS if loop.n_x <= SOME_STATES else STEPS[:-2]
    best = near or 0.0
    if not np.isfinite(gamma(best)):
        best = MOST
    elif near is not None:
        steps = steps[-1:]
    for step in steps:
        # Where one way lowers gamma the other does not: it falls with tau, until no P is left.
        for way in (-step, step):
            before = best
            while gamma(best + way) < gamma(best):
                best += way
            if best != before:
                break
    return sorted(filter(None, tried.values()), key=lambda one: one[0]), best


def _priced(loop: SampledLoop, one: Lifted, start: ClippedWitness) -> Iterator[ClippedWitness]:
    wide = clipped(loop)
    for witness in priced_for_rounding(
        wide, one, start.storage, CLAIMED, exact_messages=True, running=sector_cost(wide, start)
    ):
        yield ClippedWitness(witness, start.tau, start.h)


def _least(
    loop: SampledLoop, one: Lifted, limits: Float[np.ndarray, " m"], sizes: Sizes, decay: float, tau: float
) -> tuple[float, ClippedWitness] | None:
    """Return gamma and its witness without prices of the errors, or None; tau: of the nearest limit."""
    import cvxpy as cp

    wide, n, inputs = clipped(loop), loop.n_x, len(loop.computed)
    bounds = np.tile(limits, inputs // len(limits))
    bounded = np.isfinite(bounds)
    rows = loop.computed[:, :n] / np.where(bounded, bounds, 1.0)[:, None]
    each = tau * np.where(bounded, float(bounds.min()) / bounds, 1.0) ** 2
    program = step_program(wide, one, decay, rows[bounded].T @ rows[bounded], tau=each)
    if program is None or program.cross is None:
        return None
    ratio = np.sqrt(program.h / program.unit) / each
    gamma, inverse = cp.Variable(), np.linalg.inv(program.basis)
    h = cp.diag(ratio / np.where(bounded, bounds, 1.0)) @ program.cross
    k = rows @ inverse.T
    conditions, unit = inside(loop, gamma, program, sizes)
    for l in np.flatnonzero(bounded):
        side = k[l : l + 1] - h[l : l + 1]
        conditions.append(cp.bmat([[program.V, side.T], [side, np.eye(1)]]) >> 0)
    conditions += [program.cross[l] == 0 for l in np.flatnonzero(~bounded)]
    found = program.least(gamma, conditions)
    if found is None:
        return None
    H = (ratio[:, None] * program.cross.value) @ program.basis.T
    storage = replace(found[1], t=np.zeros(len(loop.ways)), kappa=0.0)
    return unit * found[0], ClippedWitness(storage, each * program.unit, H)
