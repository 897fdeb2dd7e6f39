"""Gains that make the linear loop stable: descent on the spectral abscissa from a random start.

The abscissa max Re lambda(A_cl(K)) is not smooth: see `lockstep.lmi.quasi_newton`.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float, Shaped

from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.shapes import GainBlocks, GainLimit, Vector

OutputFeedback = tuple[Float[np.ndarray, "_ _"], Float[np.ndarray, "_ _"], Shaped[np.ndarray, "_ _"]]
"""A_0, U and Y of A_0 + U K Y; Y is complex for the mode of an eigenvalue that is."""

GAIN_WEIGHT = 1e-3
"""Weight of the mean square of the gains: without it the abscissa of a controllable loop has no minimum."""

EXCESS_WEIGHT = 1e3
"""Weight of what the gains' norms exceed the limit by, relative to it: more than any abscissa is worth."""

DEFECTIVE = 1e-8
"""The least |l'r| of unit vectors l, r that is told from 0: about the root of the machine's precision."""


def stabilise(
    loop: Loop,
    K: GainBlocks,
    limit: GainLimit = np.inf,
    iterations: int = 100,
    *,
    units: Float[np.ndarray, "k l"] | float = 1.0,
    rate: float | None = None,
    time: float = 1.0,
) -> tuple[GainBlocks, float]:
    """Return gains with a smaller abscissa than K's and gains of about `limit` at most, and that abscissa.

    Args:
        loop: in doubles.
        K: where the descent starts.
        limit: of each agent's gains.
        iterations: of the quasi-Newton method.
        units: the size of an entry of the gains: the descent moves K / units.
        rate: that each A_Ci is to have by itself, in 1/s; None to ask nothing of them.
        time: s, the unit of time of the loop; the gains are in those of the file.
    """

    def objective(flat: Vector) -> tuple[float, Vector]:
        blocks = flat.reshape(K.shape) * units
        value, slope = abscissa(loop, blocks, rate=rate, time=time)
        excess, pull = _excess(blocks, limit)
        value += GAIN_WEIGHT * float(np.mean(flat**2)) + EXCESS_WEIGHT * excess
        total = (slope + EXCESS_WEIGHT * pull) * units
        return value, total.ravel() + 2 * GAIN_WEIGHT * flat / flat.size

    found = descend(objective, (K / units).ravel(), iterations).reshape(K.shape) * units
    return found, abscissa(loop, found, rate=rate, time=time)[0]


def _excess(K: GainBlocks, limit: GainLimit) -> tuple[float, GainBlocks]:
    """Return sum_i max(0, |K_i / limit| - 1) and its slope in K."""
    left, sizes, right = np.linalg.svd(K / limit, full_matrices=False)
    over = np.maximum(sizes[:, 0] - 1, 0.0)
    slope = np.where(over[:, None, None] > 0, left[:, :, :1] @ right[:, :1], 0.0) / limit
    return float(over.sum()), slope


def abscissa(
    loop: Loop, K: GainBlocks, *, rate: float | None = None, time: float = 1.0
) -> tuple[float, GainBlocks]:
    """Return max Re lambda(A_cl) and its slope in K: for a simple eigenvalue with vectors l, r, Re(U_i' l r' Y_i' / l'r).

    With a rate, the largest of it and of those of all A_Ci + rate I, in the loop's unit of time: `time` s.
    """
    value, slope = real_part(loop.A_cl(K), loop.U, loop.Y)
    n_C = 0 if rate is None else loop.order
    for i in range(len(K) if n_C else 0):
        unit = np.eye(n_C, K.shape[1]), np.eye(K.shape[2], n_C)
        own, turn = real_part(K[i, :n_C, :n_C] + (rate or 0.0) * np.eye(n_C), [unit[0]], [unit[1]])
        if time * own > value:
            value, slope = time * own, np.zeros_like(K)
            slope[i] = time * turn[0]
    return value, slope


def real_part(
    A: Float[np.ndarray, "n n"] | Complex[np.ndarray, "n n"],
    left_of: Sequence[Float[np.ndarray, "n k"]],
    right_of: Sequence[Float[np.ndarray, "l n"] | Complex[np.ndarray, "l n"]],
) -> tuple[float, GainBlocks]:
    """Return max Re lambda(A) and its slope in the K_i that enter A as sum_i U_i K_i Y_i."""
    from scipy.linalg import eig

    values, left, right = eig(A, left=True, right=True)
    worst = int(np.argmax(values.real))
    l, r = left[:, worst].conj(), right[:, worst]
    # At a defective eigenvalue l'r = 0 and the slope is infinite: a long step in its direction is what the descent gets.
    product = l @ r if abs(l @ r) > DEFECTIVE else DEFECTIVE
    slope = np.stack(
        [np.real(np.outer(U.T @ l, Y @ r) / product) for U, Y in zip(left_of, right_of, strict=True)]
    )
    return float(values[worst].real), slope


def stabilise_mode(mode: OutputFeedback, limit: GainLimit, *, seed: int, starts: int) -> float:
    """Return the least abscissa found of one mode of the graph with the same controller for all agents.

    Args:
        mode: its A_0, U and Y (`modes.loops_at`).
        limit: of the controller's gains.
        seed, starts: of the random starts.
    """
    A_0, U, Y = mode
    shape = (1, U.shape[1], len(Y))

    def objective(flat: Vector) -> tuple[float, Vector]:
        K = flat.reshape(shape)
        value, slope = real_part(A_0 + U @ K[0] @ Y, [U], [Y])
        excess, pull = _excess(K, limit)
        return value + EXCESS_WEIGHT * excess, (slope + EXCESS_WEIGHT * pull).ravel()

    least = np.inf
    for index in range(starts):
        first = np.random.default_rng([seed, index]).standard_normal(shape)
        first *= 0.5 * limit / max(float(np.linalg.norm(first[0], 2)), 1e-300)
        K = limited(descend(objective, first.ravel(), 100).reshape(shape), limit)
        least = min(least, real_part(A_0 + U @ K[0] @ Y, [U], [Y])[0])
    return least
