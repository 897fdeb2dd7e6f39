"""From a problem to the network that is designed for: the proved bound, and G and H scaled as it was proved.

The bound |D_w^-1 (phi(a, t) - phi(b, t))| <= alpha |D_v^-1 (a - b)| makes G D_w and D_v^-1 H take the places
of G and H. D_v holds powers of two and D_w numbers so short that the entries of both products are doubles,
exactly: the certificate is then about the agent itself and not about a rounded one.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.model.agent import Agent
from lockstep.model.bound import Bound, Box, Progress, prove_bound, smallest_bound
from lockstep.model.coefficients import is_double
from lockstep.model.errors import BoundNotProved
from lockstep.model.lure import Lure
from lockstep.model.network import Network
from lockstep.model.problem import Problem
from lockstep.model.unbounded import no_bound

BUDGET = 20.0
"""Seconds for the proof of a bound: a six-variable box takes ten."""

ALLOWED_GAP = 1.02
"""Scales rounded to exact ones may cost this factor of alpha before a smaller one is looked for."""

Report = Callable[[Progress], None]


ROOMS = (0.0, 1e-15, 1e-14, 1e-12, 1e-9, 1e-6)
"""By which part alpha is raised, tried in this order, until its proof with the final scales succeeds."""


def bound_of(
    agent: Agent, *, budget: float = BUDGET, alpha: float | None = None, progress: Report | None = None
) -> Bound:
    """Return the proved bound of an agent's nonlinearity on its domain, with scales exact for G and H.

    Args:
        agent: the agent; its box is mapped through H.
        budget: seconds for the proof.
        alpha: a bound to prove instead of the smallest one; with more than one component in phi it refers to
            the scales of the smallest one.
        progress: called with the state of the search now and then.

    Raises:
        ProblemError: no finite bound on this domain.
        BoundNotProved: `alpha` is too small, with a witness; or the budget was spent without an answer.

    >>> from lockstep.model.problem import load_problem
    >>> cart = Agent.from_expressions("cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p"},
    ...                               dynamics={"p": "v", "v": "f - 2*sin(p)"})
    >>> bound_of(cart).alpha, bound_of(cart, alpha=3.0).alpha
    (2.0, 3.0)
    """
    phi, box = agent.lure.phi, agent.argument_box
    start = time.monotonic()
    if alpha is not None and phi.size1_out(0) <= 1:
        # One component is not scaled, so alpha means the same whatever the smallest bound is.
        return _decided(prove_bound(phi, box, alpha, seconds=budget, progress=progress), alpha)
    found = smallest_bound(phi, box, seconds=budget, progress=progress)
    if not math.isfinite(found.alpha):
        if time.monotonic() - start >= budget:
            raise _out_of_time(found)
        raise no_bound(found, agent)
    exact = _with_exact_scales(found, agent.lure)
    if exact.alpha > ALLOWED_GAP * exact.lower:
        exact = _tightened(exact, agent.lure, box, budget - (time.monotonic() - start))
    if phi.size1_out(0) > 1:
        exact = _confirmed(exact, agent.lure, box, budget)
    if alpha is None:
        return exact
    return _decided(_asked(exact, agent.lure, box, alpha, budget, progress), alpha)


def bound_with_scales(
    agent: Agent,
    alpha: float,
    scales: tuple[Sequence[float], Sequence[float]],
    *,
    budget: float = BUDGET,
    progress: Report | None = None,
) -> Bound:
    """Return alpha as a proved bound with given scales (D_w, D_v), those of a bound that was proved before.

    The scales of `bound_of` follow from the enclosures it had when its time was up; a slower machine may come to
    others, and a certificate is about G D_w and D_v^-1 H.

    Raises:
        ProblemError: scales that do not fit phi.
        BoundNotProved: alpha is too small with these scales, or the budget was spent without an answer.

    >>> pair = Agent.from_expressions("pair", states=["a", "b"], inputs=["f"], outputs={"y1": "a"},
    ...                               dynamics={"a": "sin(a) + f", "b": "3*sin(b) + a"})
    >>> bound = bound_of(pair)
    >>> bound_with_scales(pair, bound.alpha, (bound.output_scale, bound.input_scale)).proved
    True
    """
    D_w, D_v = scales
    found = prove_bound(
        agent.lure.phi,
        agent.argument_box,
        alpha,
        input_scale=D_v,
        output_scale=D_w,
        seconds=budget,
        progress=progress,
    )
    return _decided(found, alpha)


def network_of(problem: Problem, bound: Bound) -> Network:
    """Return the network of a problem: each agent's own B, the coordinates asked for, G and H scaled.

    Raises:
        ProblemError: scales with which G D_w or D_v^-1 H would be rounded: take a bound of `bound_of`.
    """
    return Network(
        problem.agent(),
        problem.graph(),
        problem.agents_B(),
        problem.design.coordinates,
        (bound.output_scale, bound.input_scale),
    )


def _with_exact_scales(bound: Bound, lure: Lure) -> Bound:
    """Round D_w up and D_v down: the scaled slope only shrinks, so alpha stays proved."""
    D_v = tuple(math.ldexp(0.5, math.frexp(d)[1]) for d in bound.input_scale)
    D_w = tuple(_short_above(d, lure.G[:, k]) for k, d in enumerate(bound.output_scale))
    if (D_v, D_w) == (bound.input_scale, bound.output_scale):
        return bound
    # The other way round, a slope that was reached shrinks by no more than the largest factors.
    shrunk = Fraction(bound.lower) / (
        _largest_ratio(D_w, bound.output_scale) * _largest_ratio(bound.input_scale, D_v)
    )
    lower = float(shrunk) if Fraction(float(shrunk)) <= shrunk else math.nextafter(float(shrunk), 0.0)
    return replace(bound, lower=lower, witness=None, input_scale=D_v, output_scale=D_w)


def _largest_ratio(above: tuple[float, ...], below: tuple[float, ...]) -> Fraction:
    return max((Fraction(a) / Fraction(b) for a, b in zip(above, below, strict=True)), default=Fraction(1))


def _short_above(scale: float, column: Float[np.ndarray, " n"]) -> float:
    """Return the least number from `scale` up, of as many bits as leave column * number exact."""
    mantissa, exponent = math.frexp(scale)
    for bits in range(53, 0, -1):
        short = math.ldexp(math.ceil(math.ldexp(mantissa, bits)), exponent - bits)
        if all(is_double(Fraction(float(g)) * Fraction(short)) for g in column):
            return short
    return math.ldexp(1.0, exponent)


def _tightened(bound: Bound, lure: Lure, box: Box, seconds: float) -> Bound:
    """Look for a smaller alpha with the scales as they are, by halving the gap."""
    best, end = bound, time.monotonic() + max(seconds, 0.0)
    low = bound.lower
    while best.alpha > ALLOWED_GAP * low and (left := end - time.monotonic()) > 0:
        alpha = math.sqrt(best.alpha * max(low, best.alpha / 4))
        tried = _with_scales_of(bound, lure, box, alpha, left / 2)
        low = max(low, tried.lower)
        if tried.proved:
            best = replace(tried, asked=None, tolerance=bound.tolerance)
        elif not tried.refuted:
            break
        best = replace(best, lower=max(best.lower, tried.lower), witness=tried.witness or best.witness)
    converged = best.alpha <= ALLOWED_GAP * best.lower
    return replace(best, converged=bound.converged and converged)


def _confirmed(bound: Bound, lure: Lure, box: Box, seconds: float) -> Bound:
    """Return the bound with the least of a few alphas that the checker's own proof, with these scales, arrives at.

    Several independent components share alpha by their scales, with equality: their slopes, scaled, are enclosed a few
    units in the last place above it.
    """
    for room in ROOMS:
        alpha = bound.alpha * (1 + room)
        if _with_scales_of(bound, lure, box, alpha, seconds).proved:
            return replace(bound, alpha=alpha)
    raise _out_of_time(bound)


def _asked(bound: Bound, lure: Lure, box: Box, alpha: float, budget: float, progress: Report | None) -> Bound:
    if bound.alpha <= alpha:
        return replace(bound, asked=alpha)
    return _with_scales_of(bound, lure, box, alpha, budget, progress)


def _with_scales_of(
    bound: Bound, lure: Lure, box: Box, alpha: float, seconds: float, progress: Report | None = None
) -> Bound:
    """Decide another alpha with the scales of a bound."""
    return prove_bound(
        lure.phi,
        box,
        alpha,
        input_scale=bound.input_scale,
        output_scale=bound.output_scale,
        seconds=seconds,
        progress=progress,
    )


def _decided(bound: Bound, alpha: float) -> Bound:
    """Return the bound that was asked for as it was asked, or say why it is none."""
    if bound.proved:
        return replace(bound, alpha=alpha)
    figures: dict[str, Any] = {"alpha": alpha, "lower": bound.lower, "boxes": bound.boxes}
    if bound.witness is not None:
        figures |= {"witness": list(bound.witness.v), "time": bound.witness.t}
    what = (
        "does not bound the nonlinearity"
        if bound.refuted
        else "could not be proved to bound the nonlinearity"
    )
    raise BoundNotProved(f"[design] alpha = {alpha:g} {what}: {bound.reason}", **figures)


def _out_of_time(bound: Bound) -> BoundNotProved:
    return BoundNotProved(
        f"no bound of the nonlinearity was found in the time given: {bound.reason}",
        lower=bound.lower,
        boxes=bound.boxes,
    )
