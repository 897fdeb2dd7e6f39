"""A nonlinearity with slopes around zero: the middle of its slope range goes into A.

For any matrix S, A x + G phi(H x, t) = (A + G S H) x + G (phi(H x, t) - S H x): the same agent. With S in the
middle of the slopes of phi the bound of phi - S v is smaller: tanh has slopes in [0, 1], tanh(v) - v/2 in
[-1/2, 1/2]. This is the loop transformation of Lur'e problems (Khalil, Nonlinear Systems, section 7.1).

S is a choice, made from sampled slopes and the same on every run; what is claimed about phi - S v is proved
afterwards, of the sum in rationals.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import frexp, ldexp

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from lockstep.model.bound_search import Box
from lockstep.model.loop_transformation.lure import Lure
from lockstep.model.loop_transformation.shift import moved_exactly

LEAST_GAIN = 0.02
"""A bound that shrinks by less than 2 % is not worth another A than the one written down."""

CLOSE = 1e-3
"""S may miss the middle by this part of half the range: it costs as much of the bound, and S stays short."""

NO_SLOPES = "no finite range of slopes was seen"
GROWING = "the slopes keep growing with the distance from the origin"

MOST_SAMPLES = 4000
FAR, FARTHEST = 1e6, 1e12
"""Slopes that still change between these distances, along arguments without a domain, have no range that samples can show."""


@dataclass(frozen=True)
class CentringMove:
    """S_kj, taken from phi and given to A: `component` k and `argument` j count from 0."""

    component: int
    argument: int
    lowest: float
    """The least and greatest slope d phi_k / d v_j seen in samples."""
    highest: float
    amount: Fraction
    """S_kj, exactly."""


@dataclass(frozen=True)
class Centring:
    """What was moved from phi into A, and why nothing was if nothing was."""

    moves: tuple[CentringMove, ...] = ()
    reason: str = ""

    def matrix(self, r: int, v: int) -> Float[np.ndarray, "r v"]:
        """Return S, each entry the nearest double."""
        S = np.zeros((r, v))
        for move in self.moves:
            S[move.component, move.argument] = float(move.amount)
        return S


def centred(lure: Lure, box: Box) -> tuple[Lure, Centring]:
    """Return the same agent with the slopes of phi around zero, as far as that shrinks their bound.

    Args:
        lure: the agent.
        box: the domain of v = H x.

    >>> from lockstep.model.agents.agent import Agent
    >>> cart = Agent.from_expressions("cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p"},
    ...                               dynamics={"p": "v", "v": "f - tanh(v)"})
    >>> moved, what = centred(cart.lure, Box.everywhere(1))
    >>> moved.A[1, 1], what.moves[0].amount
    (np.float64(-0.5), Fraction(-1, 2))
    """
    if lure.is_linear or not box.size:
        return lure, Centring(reason="there is no nonlinearity")
    slopes, far = _slopes(lure, box)
    # Sums of four of them are taken below.
    if not len(slopes) or not (np.abs(slopes) < np.finfo(float).max / 4).all():
        return lure, Centring(reason=NO_SLOPES)
    lowest, highest = slopes.min(axis=0), slopes.max(axis=0)
    if not far.all() and not _settled(slopes[~far], lowest, highest):
        return lure, Centring(reason=GROWING)
    # |middle| below 2 % of the largest slope: centring that entry gains less than 2 %.
    twice = np.abs(lowest + highest)
    wanted = np.argwhere(twice > LEAST_GAIN * (highest - lowest + twice))
    if not len(wanted):
        return lure, Centring(reason="the slopes are around zero already")
    result, moves = lure, list[CentringMove]()
    for k, j in wanted.tolist():
        result, move = _move(result, k, j, float(lowest[k, j]), float(highest[k, j]))
        moves.append(move)
    found = Centring(tuple(moves))
    units = _units(slopes)
    if _size((slopes - found.matrix(*lowest.shape)) / units) > (1 - LEAST_GAIN) * _size(slopes / units):
        return lure, Centring(reason="moving the middle of the slopes into A would not shrink their bound")
    return result, found


def _slopes(lure: Lure, box: Box) -> tuple[Float[np.ndarray, "samples r v"], Bool[np.ndarray, " samples"]]:
    """Return d phi / d v at sampled points that have it, and which of them are far out."""
    v, t = ca.SX.sym("v", box.size), ca.SX.sym("t")
    J = ca.densify(ca.jacobian(lure.phi(v, t), v))
    points = _points(box)
    # t takes values that are in no simple ratio to the periods of phi; 0 comes first.
    times = 10.0 * np.sin(np.arange(points.shape[1]) * np.sqrt(2.0))
    values = np.asarray(ca.Function("slopes", [v, t], [J])(points, times[None, :]))
    stacked = values.reshape(J.shape[0], points.shape[1], box.size).transpose(1, 0, 2)
    known = ~np.isnan(stacked).any(axis=(1, 2))
    # A box in Pa has no far end, however large its numbers are.
    endless = np.isinf([box.lower, box.upper]).any(axis=0)
    return stacked[known], (np.abs(points[endless]).max(axis=0, initial=0.0) > FAR)[known]


def _points(box: Box) -> Float[np.ndarray, "v samples"]:
    """Return points of the box, the same on every run: a grid on one axis, else corners and random picks."""
    axes = [_axis(low, high) for low, high in zip(box.lower, box.upper, strict=True)]
    if len(axes) == 1:
        return axes[0][None, :]
    generator = np.random.default_rng(0)
    picks = np.stack([generator.choice(axis, MOST_SAMPLES) for axis in axes])
    # A slope that is a polynomial of few terms is largest at the sides of a box.
    at_sides = generator.uniform(size=picks.shape) < 0.25
    sides = np.stack([generator.choice(axis[[0, -1]], MOST_SAMPLES) for axis in axes])
    corners = np.array(list(product(*([a[0], a[-1]] for a in axes)))).T if len(axes) <= 8 else picks[:, :0]
    return np.hstack([corners, np.where(at_sides, sides, picks)])


def _axis(low: float, high: float) -> Float[np.ndarray, " samples"]:
    """Return increasing points of [low, high]: even where it is finite, in all sizes where it is not."""
    if np.isfinite(low) and np.isfinite(high):
        return np.linspace(low, high, 401)
    sizes = np.concatenate([[0.0], np.geomspace(1e-6, FARTHEST, 163), np.linspace(0.05, 10.0, 200)])
    start = low if np.isfinite(low) else high if np.isfinite(high) else 0.0
    up = start + sizes if high == np.inf else np.array([start])
    down = start - sizes if low == -np.inf else np.array([start])
    return np.unique(np.concatenate([down, up]))


def _settled(near: Float[np.ndarray, "samples r v"], lowest: np.ndarray, highest: np.ndarray) -> bool:
    """Whether the slopes near the origin already span the range of all of them, to 1 %."""
    if not len(near):
        return False
    missed = np.maximum(near.min(axis=0) - lowest, highest - near.max(axis=0))
    return bool((missed <= 0.01 * (highest - lowest)).all())


def _units(slopes: Float[np.ndarray, "samples r v"]) -> Float[np.ndarray, "r v"]:
    """Return D_w D_v^-1 in which the largest slope of each component, then by each argument, is one: a bound has scales too.

    Of a^2 beside a^3, or of m/s beside Pa, the larger number is not the larger nonlinearity.
    """
    largest = np.abs(slopes).max(axis=0)
    rows = np.where(largest.any(axis=1), largest.max(axis=1), 1.0)[:, None]
    return np.asarray(rows * np.where(largest.any(axis=0), (largest / rows).max(axis=0), 1.0))


def _size(slopes: Float[np.ndarray, "samples r v"]) -> float:
    return float(np.linalg.norm(slopes, ord=2, axis=(1, 2)).max())


def _move(lure: Lure, k: int, j: int, lowest: float, highest: float) -> tuple[Lure, CentringMove]:
    """Move the middle of one slope range: exactly, by a number next to it with which A stays in doubles, or rounded."""
    middle, half = (lowest + highest) / 2, (highest - lowest) / 2
    centre, room = Fraction(middle), Fraction(LEAST_GAIN * half)
    found, amount = moved_exactly(
        lure, k, j, _short(middle, half), lambda amount: abs(amount - centre) <= room
    )
    return found, CentringMove(k, j, lowest, highest, amount)


def _short(middle: float, half: float) -> Iterator[Fraction]:
    """Yield numbers of few bits near the middle, first the shortest that is close, then shorter ones."""
    mantissa, exponent = frexp(middle)
    rounded = [ldexp(round(ldexp(mantissa, bits)), exponent - bits) for bits in range(1, 54)]
    close = next(bits for bits, x in enumerate(rounded) if abs(x - middle) <= CLOSE * half or bits == 52)
    for x in reversed(rounded[: close + 1]):
        yield Fraction(x)
