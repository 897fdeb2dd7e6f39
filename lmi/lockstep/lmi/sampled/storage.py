"""The dissipation inequality as a Riccati inequality in P alone, and the two ends of its solutions, in doubles.

With everything but P given, and all errors e eliminated as inputs that have a price, Omega > 0 is

    decay P > A' (P^-1 - S)^-1 A + Q.

Its solutions form a convex set between the available storage, which `smallest_storage` finds, and the required
supply. With X = P^-1 it reads

    X > A (decay X^-1 - Q)^-1 A' + S,

the same equation with A' for A and with S and Q in each other's place: the smallest X is the inverse of the largest P.
The smallest P has the least cost to go: with it the least rho is found. The largest is the one to bound the state
by, since what the noise can reach is all that {x_cl' P x_cl <= V} then holds.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.inequality import Witness, metric, step_matrix, stored_matrix
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.sampled.riccati import smallest_storage

PRICE_OF_ROUNDING = 1e6
"""t in multiples of what the error's direction weighs in P: a millionth is lost per step, and a loop forgets in
thousands. What t adds on the other side is as much less as delta^2 is small."""


UNREACHED = 1e-13
"""An eigenvalue of X, scaled to a unit diagonal, that may be rounding alone: some hundred units in the last place."""


@dataclass(frozen=True, eq=False)
class StorageProblem:
    """A, S and Q of the inequality."""

    A: Float[np.ndarray, "n_x n_x"]
    S: Float[np.ndarray, "n_x n_x"]
    Q: Float[np.ndarray, "n_x n_x"]

    def reaching(self, room: float) -> "StorageProblem":
        """Return the problem with S + room I: what solves it solves this one too, and strictly where room > 0."""
        return replace(self, S=self.S + room * np.eye(len(self.S))) if room else self

    def smallest(self, decay: float) -> Float[np.ndarray, "n_x n_x"] | None:
        """Return the smallest P, or None."""
        return smallest_storage(self.A / np.sqrt(decay), self.S, self.Q / decay)

    def largest(self, decay: float) -> Float[np.ndarray, "n_x n_x"] | None:
        """Return the largest P, or None: also where some direction cannot be reached, so that P has no end."""
        X = smallest_storage(self.A.T / np.sqrt(decay), self.Q / decay, self.S)
        if X is None:
            return None
        # Scaled: what underflow alone can reach is many orders of magnitude below what the messages can.
        scale = 1 / np.sqrt(np.diag(X))
        unit = X * np.outer(scale, scale)
        if np.linalg.eigvalsh(unit)[0] <= UNREACHED:
            return None
        P = np.linalg.inv(unit) * np.outer(scale, scale)
        return np.asarray((P + P.T) / 2)


def storage_problem(
    loop: SampledLoop, lifted: Lifted, prices: Witness, running: Float[np.ndarray, "n_z n_z"] | None = None
) -> StorageProblem | None:
    """Eliminate the errors e; None where they do more within a period than their prices allow.

    Args:
        loop: in doubles;  lifted: its period;  running: a cost of z at each sampling instant.
        prices: t, kappa, kappa_mu and weight; its P and decay do not count.
    """
    n, N = loop.n_x, step_matrix(loop, lifted)
    form = (
        stored_matrix(loop, without_storage(loop, prices), running) - loop.start.T @ lifted.CC_d @ loop.start
    )
    R = form[n:, n:]
    if len(R) and not _is_definite(R):
        return None
    # Completing the square in e, scaled to a unit diagonal: the prices differ by many orders of magnitude.
    scale = 1 / np.sqrt(np.diag(R))
    back = np.linalg.solve(
        R * np.outer(scale, scale), np.hstack([-form[n:, :n], N[:, n:].T]) * scale[:, None]
    )
    enter = N[:, n:] * scale
    A = N[:, :n] + enter @ back[:, :n]
    S = on_disagreement(loop, lifted.BB_d) + enter @ back[:, n:]
    Q = -form[:n, :n] - (form[:n, n:] * scale) @ back[:, :n]
    return StorageProblem(A, (S + S.T) / 2, (Q + Q.T) / 2)


def without_storage(loop: SampledLoop, prices: Witness) -> Witness:
    """Return the same prices with P = 0, so that only what they add is assembled."""
    zero = np.zeros((loop.n_x, loop.n_x))
    return Witness(zero, prices.m, prices.t, 0.0, prices.kappa, prices.weight, 0.0, prices.kappa_mu)


def rounding_prices(
    loop: SampledLoop, lifted: Lifted, P: Float[np.ndarray, "n_x n_x"], factor: float = PRICE_OF_ROUNDING
) -> Float[np.ndarray, " ways"]:
    """Return t for a P that is about right."""
    N = step_matrix(loop, lifted)
    weighed = [float(np.linalg.norm(E.T @ P @ E, 2)) for E in (N[:, way.place] for way in loop.ways)]
    return np.array([factor * (w or 1.0) for w in weighed])


def in_exact_arithmetic(loop: SampledLoop) -> SampledLoop:
    """Return the loop with coefficients that are not off: any t does."""
    return replace(loop, ways=tuple(way._replace(delta=0.0) for way in loop.ways))


def no_prices(loop: SampledLoop) -> Float[np.ndarray, " ways"]:
    """Return t for the loop in exact arithmetic: so dear that errors are as good as none."""
    return np.full(len(loop.ways), 1e30)


def holds_in_doubles(Omega: Float[np.ndarray, "w w"]) -> bool:
    """Tell whether Omega is positive definite as far as doubles show, scaled to a unit diagonal."""
    return _is_definite((Omega + Omega.T) / 2)


def metric_of(loop: SampledLoop) -> Float[np.ndarray, "n_x n_x"]:
    """Return the squared distance of the states from consensus as a form on x_cl."""
    return on_disagreement(loop, metric(loop))


def on_disagreement(loop: SampledLoop, S: Float[np.ndarray, "n_d n_d"]) -> Float[np.ndarray, "n_x n_x"]:
    """Return S on x_d, zero elsewhere."""
    return np.pad(S, (0, loop.n_x - loop.n_d))


def distance_ratio(loop: SampledLoop, P: Float[np.ndarray, "n_x n_x"]) -> float:
    """Return c with x_d' ((T T')^-1 (x) I) x_d <= c V, a little above the least, as far as doubles show P to be definite."""
    root = np.sqrt(np.maximum(np.diag(P), 1e-300))[:, None]
    values, turned = np.linalg.eigh(P / root / root.T)
    half = turned / np.sqrt(np.maximum(values, 1e-16)) / root
    return float(1.001 * np.linalg.eigvalsh(half.T @ metric_of(loop) @ half)[-1])


def _is_definite(matrix: Float[np.ndarray, "n n"]) -> bool:
    diagonal = np.diag(matrix)
    if not np.isfinite(matrix).all() or not (diagonal > 0).all():
        return False
    return bool(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(diagonal, diagonal)))[0] > 0)
