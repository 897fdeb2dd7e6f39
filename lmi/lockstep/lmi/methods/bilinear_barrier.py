"""A barrier for matrices that are bilinear in the unknowns, and Newton's method on it: small programs, gains and P together.

    minimise  log x_goal / mu - sum_b log det M_b(x),     M_b(x) = M_0 + sum_k x_k M_k + sum_ij x_i x_j M_ij,

with i in one range of unknowns and j in another. The curvature of -log det M is a square, tr(S dM S dM) with S = M^-1, less
tr(S d^2M), which has no sign: as in `search.barrier`, each step adds enough of it to make the whole positive definite.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.lmi.search.barrier import SETTLED, line_search, newton_step
from lockstep.lmi.shapes import Vector


class Bilinear(NamedTuple):
    """sum_ij x_i x_j M_ij: i in `left`, j in `right`, M (i, j, n, n)."""

    left: slice
    right: slice
    M: Float[np.ndarray, "i j n n"]


@dataclass(frozen=True)
class BilinearCondition:
    """M(x) > 0: M_0 (n, n), the M_k (x, n, n), and what is bilinear, if anything is."""

    constant: Float[np.ndarray, "n n"]
    linear: Float[np.ndarray, "x n n"]
    bilinear: Bilinear | None = None

    def at(self, x: Vector) -> Float[np.ndarray, "n n"]:
        """Return M(x)."""
        M = self.constant + np.tensordot(x, self.linear, 1)
        if self.bilinear is not None:
            left, right, T = self.bilinear
            M = M + np.tensordot(x[right], np.tensordot(x[left], T, 1), 1)
        return np.asarray(M)

    def slopes(self, x: Vector) -> Float[np.ndarray, "x n n"]:
        """Return dM / dx_k."""
        if self.bilinear is None:
            return self.linear
        left, right, T = self.bilinear
        found = self.linear.copy()
        found[left] += np.tensordot(T, x[right], ([1], [0]))
        found[right] += np.tensordot(x[left], T, 1)
        return found


@dataclass(frozen=True)
class BilinearProgram:
    """Conditions, and the unknown whose logarithm is lowered."""

    conditions: Sequence[BilinearCondition]
    goal: int

    def value(self, x: Vector, mu: float) -> float:
        """Return what is minimised; infinite outside."""
        if x[self.goal] <= 0:
            return np.inf
        total = float(np.log(x[self.goal])) / mu
        try:
            for one in self.conditions:
                total -= 2 * float(np.log(np.diag(np.linalg.cholesky(one.at(x)))).sum())
        except np.linalg.LinAlgError:
            return np.inf
        return total if np.isfinite(total) else np.inf

    def improved(self, x: Vector, mu: float, steps: int) -> Vector:
        """Take Newton steps from a point inside until the decrement is small; at most so many."""
        here, shift = self.value(x, mu), 0.0
        for _ in range(steps if np.isfinite(here) else 0):
            slope, square, rest = self._curvature(x)
            slope[self.goal] += 1 / (mu * x[self.goal])
            rest[self.goal, self.goal] -= 1 / (mu * x[self.goal] ** 2)
            move, decrement, shift = newton_step(slope, square, rest, shift)
            if decrement < SETTLED:
                break
            length, here = line_search(lambda at: self.value(at, mu), x, move, here, decrement)
            if length == 0.0:
                break
            x = x + length * move
        return x

    def _curvature(self, x: Vector) -> tuple[Vector, Float[np.ndarray, "x x"], Float[np.ndarray, "x x"]]:
        """Return the slope of -sum log det M, and its curvature in two parts: tr(S dM S dM), and -tr(S d^2M)."""
        k = len(x)
        slope, square, rest = np.zeros(k), np.zeros((k, k)), np.zeros((k, k))
        for one in self.conditions:
            W = np.linalg.inv(np.linalg.cholesky(one.at(x)))
            V = (W @ one.slopes(x) @ W.T).reshape(k, -1)
            slope -= V[:, :: len(W) + 1].sum(axis=1)
            square += V @ V.T
            if one.bilinear is not None:
                left, right, T = one.bilinear
                coupling = np.tensordot(T, W.T @ W, 2)
                rest[left, right] -= coupling
                rest[right, left] -= coupling.T
        return slope, square, rest
