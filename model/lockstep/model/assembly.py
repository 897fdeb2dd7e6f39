"""From a problem to the network that is designed for: the proved bound, and G and H scaled as it was proved.

The bound |D_w^-1 (phi(a, t) - phi(b, t))| <= alpha |D_v^-1 (a - b)| makes G D_w and D_v^-1 H take the places
of G and H. D_v holds powers of two and D_w numbers so short that the entries of both products are doubles,
exactly: the certificate is then about the agent itself and not about a rounded one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.decide import MOST_BOXES, Budget, decide_entries
from lockstep.check.bound.slopes import SlopeProblem
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import BoundNotProved
from lockstep.check.numbers import is_double
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.unbounded_slope import no_bound
from lockstep.model.bound_search import (
    BOXES,
    UNFINISHED,
    Bound,
    Entry,
    SearchState,
    confirmed_bound,
    prove_bound,
    search_bound,
    with_entries,
)
from lockstep.model.loop_transformation.lure import Lure
from lockstep.model.loop_transformation.natural_units import natural_units
from lockstep.model.network import Network
from lockstep.model.problem import Problem

ALLOWED_GAP = 1.02
"""Scales rounded to exact ones may cost this factor of alpha before a smaller one is looked for."""

TIGHTENINGS = 12
"""Alphas tried for that: each halves the gap, or ends the search."""

Report = Callable[[SearchState], None]


def bound_of(
    agent: Agent, *, boxes: int = BOXES, alpha: float | None = None, progress: Report | None = None
) -> Bound:
    """Return the proved bound of an agent's nonlinearity on its domain, with scales exact for G and H.

    Args:
        agent: the agent; its box is mapped through H.
        boxes: the budget of each branch and bound search, a count.
        alpha: a bound to prove instead of the smallest one; with more than one component in phi it refers to
            the scales of the smallest one. Every phi with that bound is then meant, so no slope has one of its own.
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
    if alpha is not None and phi.size1_out(0) <= 1:
        # One component is not scaled, so alpha means the same whatever the smallest bound is.
        return _decided(prove_bound(agent.exact.phi, box, alpha, boxes=boxes, progress=progress), alpha)
    problem = SlopeProblem.of(agent.exact.phi, box)
    found = search_bound(problem, boxes=boxes, progress=progress)
    if not math.isfinite(found.alpha):
        if found.reason == UNFINISHED:
            raise _undecided(found)
        raise no_bound(found, agent)
    exact = _with_exact_scales(_in_natural_units(found, agent, problem.places), agent.lure)
    if exact.alpha > ALLOWED_GAP * exact.lower:
        exact = _tightened(exact, agent, boxes)
    if alpha is not None:
        return _decided(_with_scales_of(exact, agent, alpha, boxes, progress), alpha)
    exact = confirmed_bound(problem, exact)
    if not exact.proved:
        raise _undecided(exact)
    return with_entries(problem, exact, boxes)


def claimed_slopes(problem: Problem, bound: Bound) -> tuple[float, tuple[Entry, ...]]:
    """Return alpha, as given or as proved, and the bounds of single slopes that a certificate may use besides.

    They count where alpha is the proved one of this phi. An alpha that is given, or to be raised, stands for every phi that
    has it.
    """
    given, of_this_phi = problem.design.alpha, problem.design.objective != "alpha"
    return (bound.alpha, bound.entries if of_this_phi else ()) if given is None else (given, ())


def bound_with_scales(
    agent: Agent, alpha: float, scales: tuple[Sequence[float], Sequence[float]], entries: Sequence[Entry] = ()
) -> Bound:
    """Return alpha as a proved bound with given scales (D_w, D_v), those of a bound that was proved before.

    With entries, these are proved as well: the bounds of single slopes in the same scales.

    The scales of `bound_of` follow from the enclosures that its search came to; a later version may come to others, and a
    certificate is about G D_w and D_v^-1 H.

    Raises:
        ProblemError: scales that do not fit phi.
        BoundNotProved: alpha or an entry is too small with these scales, an entry is missing, or the budget was spent
            without an answer.

    >>> pair = Agent.from_expressions("pair", states=["a", "b"], inputs=["f"], outputs={"y1": "a"},
    ...                               dynamics={"a": "sin(a) + f", "b": "3*sin(b) + a"})
    >>> bound = bound_of(pair)
    >>> bound_with_scales(pair, bound.alpha, (bound.output_scale, bound.input_scale)).proved
    True
    """
    (D_w, D_v), phi, box = scales, agent.exact.phi, agent.argument_box
    proved = _decided(prove_bound(phi, box, alpha, input_scale=D_v, output_scale=D_w), alpha)
    if not entries:
        return proved
    budget = Budget(min(BOXES, MOST_BOXES))
    problem = SlopeProblem.of(phi, box).scaled(D_w, D_v)
    verdict = decide_entries(problem, entries, budget)
    if not verdict.proved:
        raise BoundNotProved(
            f"the bounds of the single slopes could not be proved: {verdict.reason}",
            alpha=alpha,
            entries=[one.bound for one in entries],
        )
    return replace(proved, entries=tuple(entries), replay=proved.replay + budget.used)


def network_of(problem: Problem, bound: Bound) -> Network:
    """Return the network of a problem: each agent's own B, the coordinates asked for, G and H scaled.

    Raises:
        ProblemError: scales with which G D_w or D_v^-1 H would be rounded: take a bound of `bound_of`.
    """
    spectrum = problem.spectrum
    return Network(
        problem.agent(),
        problem.graph(),
        problem.agents_B(),
        problem.design.coordinates,
        (bound.output_scale, bound.input_scale),
        spectrum=None if spectrum is None else (spectrum.lower, spectrum.upper),
    )


def exact_network(problem: Problem, network: Network) -> ExactNetwork:
    """Return the network of a problem in rationals, as the checker reads it from the problem's text."""
    return ProblemTables(problem.document()).network(network.agent.moves, network.scales)[0]


def _in_natural_units(bound: Bound, agent: Agent, places: Sequence[tuple[int, int]]) -> Bound:
    """Scale each block of phi, which shares no argument with another, to arguments of size one in natural units.

    Nothing else says how m/s of one block compare with Pa of another, and a common factor of its D_w and D_v leaves every
    slope as it is.
    """
    from scipy.sparse.csgraph import connected_components

    lure, (D_w, D_v) = agent.lure, (np.array(bound.output_scale), np.array(bound.input_scale))
    joined = np.zeros((len(D_w) + len(D_v),) * 2)
    for k, l in places:
        joined[k, len(D_w) + l] = 1
    _, block_of = connected_components(joined, directed=False)
    blocks = np.unique(block_of[len(D_w) :])
    if len(blocks) < 2:
        return bound
    linear = Plant(lure.A, (lure.B,), lure.C, lure.G[:, :0], lure.H[:0])
    sizes = np.abs(lure.H) @ (1 / natural_units(linear, 0.0, np.eye(len(lure.A)))[0])
    for block in blocks:
        w, v = block_of[: len(D_w)] == block, block_of[len(D_w) :] == block
        factor = 2.0 ** np.round(np.log2(sizes[v] / D_v[v]).mean())
        D_v[v] *= factor
        D_w[w] *= factor
    return replace(bound, input_scale=tuple(D_v.tolist()), output_scale=tuple(D_w.tolist()))


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


def _tightened(bound: Bound, agent: Agent, boxes: int) -> Bound:
    """Look for a smaller alpha with the scales as they are, by halving the gap."""
    best, low = bound, bound.lower
    for _ in range(TIGHTENINGS):
        if best.alpha <= ALLOWED_GAP * low:
            break
        alpha = math.sqrt(best.alpha * max(low, best.alpha / 4))
        tried = _with_scales_of(bound, agent, alpha, boxes)
        low = max(low, tried.lower)
        if tried.proved:
            best = replace(tried, asked=None, tolerance=bound.tolerance)
        elif not tried.refuted:
            break
        best = replace(best, lower=max(best.lower, tried.lower), witness=tried.witness or best.witness)
    converged = best.alpha <= ALLOWED_GAP * best.lower
    return replace(best, converged=bound.converged and converged)


def _with_scales_of(
    bound: Bound, agent: Agent, alpha: float, boxes: int, progress: Report | None = None
) -> Bound:
    """Decide another alpha with the scales of a bound."""
    return prove_bound(
        agent.exact.phi,
        agent.argument_box,
        alpha,
        input_scale=bound.input_scale,
        output_scale=bound.output_scale,
        boxes=boxes,
        progress=progress,
    )


def _decided(bound: Bound, alpha: float) -> Bound:
    """Return the bound that was asked for as it was asked, or say why it is none."""
    if bound.proved:
        return replace(bound, alpha=alpha)
    figures: dict[str, Any] = {"alpha": alpha, "lower": bound.lower, "boxes": bound.boxes}
    if bound.witness is not None:
        figures |= {"witness": list(bound.witness.v), "time": bound.witness.t}
    what = "does not bound" if bound.refuted else "could not be proved to bound"
    said = f"[design] alpha = {alpha:g} {what} the nonlinearity: {bound.reason}"
    raise BoundNotProved(f"{said}; it is of the slopes as they are written", **figures)


def _undecided(bound: Bound) -> BoundNotProved:
    return BoundNotProved(
        f"no bound of the nonlinearity was found: {bound.reason or 'the proof with exact scales does not come to an end'}",
        lower=bound.lower,
        boxes=bound.boxes,
    )
