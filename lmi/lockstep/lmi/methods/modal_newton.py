"""One K and one P for an interval, moved together: the matrix of a mode at both ends as conditions of `bilinear_barrier`.

In x = (K, P, mu, sigma, P_m), P in coordinates of a base in which it is I, with T = [C_1 K Y, ...] the rows of W^(1/2) u,

    [ -He([I; 0] P flow(K)) - F_0 - sum mu_k F_k    T' ]
    [                     T                         I  ] > 0   at lambda = a and b,      P > 0,   mu > 0,
    -He(P_m (A_C + rate I)) > 0,   0 < P_m < I,   [ l I, K; K', l I ] > 0:

all bilinear in (K, P) and (K, P_m). A descent in K alone, with a semidefinite program for each of its values, takes longer
and stops at its kinks.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.analysis.semidefinite import symmetric_basis
from lockstep.lmi.methods.bilinear_barrier import Bilinear, BilinearCondition, BilinearProgram
from lockstep.lmi.shapes import GainLimit, Vector

Gain = Float[np.ndarray, "a b"]
Square = Float[np.ndarray, "k k"]

ROOMS = (0.03, 0.1, 0.5, 2.0, 8.0)
"""By how much a witness on the edge is scaled up, tried in this order, to get inside: all but R and Q is homogeneous."""


@dataclass(frozen=True)
class Together:
    """The program around gains and a P, which is I in the coordinates of `base`, P = base base'."""

    modes: Modes
    claim: Claim
    ends: tuple[float, float]
    gain_limit: GainLimit
    rate: float
    shape: tuple[int, int]
    base: Square

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each unknown is."""
        k, n_C = len(self.base), self.modes.order
        sizes = {
            "K": self.shape[0] * self.shape[1],
            "P": k * (k + 1) // 2,
            "mu": len(self.modes.inequality(self.claim, self.ends[0]).channels[1].cone),
            "sigma": 1,
            "P_m": n_C * (n_C + 1) // 2,
        }
        found, at = {}, 0
        for name, size in sizes.items():
            found[name], at = slice(at, at + size), at + size
        return found

    @property
    def size(self) -> int:
        """Unknowns."""
        return int(self.places["P_m"].stop)

    def pack(self, K: Gain, mu: Float[np.ndarray, " s"], sigma: float) -> Vector | None:
        """Return x inside, or None: K, a P that is the base's, and its mu and sigma, all but K scaled up."""
        from scipy.linalg import solve_continuous_lyapunov

        x, at, n_C = np.zeros(self.size), self.places, self.modes.order
        x[at["K"]] = limited(K[None], (1 - 1e-6) * self.gain_limit).ravel()
        x[at["P"]] = _entries(np.eye(len(self.base)))
        x[at["mu"]] = np.maximum(mu, 1e-6 * max(float(mu.max(initial=0.0)), 1e-12 * sigma))
        x[at["sigma"]] = sigma
        if n_C:
            A_C = K[:n_C, :n_C] + self.rate * np.eye(n_C)
            P_m = solve_continuous_lyapunov(A_C.T, -np.eye(n_C))
            x[at["P_m"]] = _entries(P_m / (2 * float(np.linalg.norm(P_m, 2))))
        for room in ROOMS:
            trial = x.copy()
            trial[at["P"].start : at["sigma"].stop] *= 1 + room
            if np.isfinite(self.program.value(trial, 1.0)):
                return trial
        return None

    def K(self, x: Vector) -> Gain:
        """Return the gains."""
        return x[self.places["K"]].reshape(self.shape)

    def rebased(self, x: Vector) -> tuple["Together", Vector]:
        """Return the program in coordinates in which P is I again, and the same point there."""
        k = len(self.base)
        P = np.tensordot(x[self.places["P"]], symmetric_basis(k), 1)
        new = Together(
            self.modes, self.claim, self.ends, self.gain_limit, self.rate, self.shape,
            self.base @ np.linalg.cholesky(P),
        )  # fmt: skip
        x = x.copy()
        x[self.places["P"]] = _entries(np.eye(k))
        return new, x

    @cached_property
    def program(self) -> BilinearProgram:
        """Its conditions, and log sigma to be lowered."""
        k, n_C, at = len(self.base), self.modes.order, self.places
        P = BilinearCondition(np.zeros((k, k)), self._linear(k, P=symmetric_basis(k)))
        signs = [
            BilinearCondition(np.zeros((1, 1)), np.eye(self.size)[i].reshape(-1, 1, 1))
            for i in range(at["mu"].start, at["mu"].stop)
        ]
        a, b = self.shape
        norm = np.zeros((a * b, a + b, a + b))
        norm[:, :a, a:] = np.eye(a * b).reshape(-1, a, b) / self.gain_limit
        limit = BilinearCondition(np.eye(a + b), self._linear(a + b, K=norm + norm.transpose(0, 2, 1)))
        found = [*(self._mode(value) for value in self.ends), P, *signs, limit]
        if n_C:
            basis = symmetric_basis(n_C)
            half = np.einsum("pab,kbc->kpac", basis, np.eye(a * b).reshape(-1, a, b)[:, :n_C, :n_C])
            own = Bilinear(at["K"], at["P_m"], -(half + half.transpose(0, 1, 3, 2)))
            nothing = np.zeros((n_C, n_C))
            found += [
                BilinearCondition(nothing, self._linear(n_C, P_m=-2 * self.rate * basis), own),
                BilinearCondition(nothing, self._linear(n_C, P_m=basis)),
                BilinearCondition(np.eye(n_C), self._linear(n_C, P_m=-basis)),
            ]
        return BilinearProgram(found, at["sigma"].start)

    def _linear(self, size: int, **parts: Float[np.ndarray, "i n n"]) -> Float[np.ndarray, "x n n"]:
        found = np.zeros((self.size, size, size))
        for name, part in parts.items():
            found[self.places[name]] = part
        return found

    def _mode(self, value: float) -> BilinearCondition:
        """Return the condition at one lambda; the signals in units of the base."""
        stated, (a, b), n_C = self.modes.inequality(self.claim, value), self.shape, self.modes.order
        n, f, m = len(self.base), stated.size, len(self.claim.W)
        D, basis = np.eye(f), symmetric_basis(n)
        D[:n, :n] = np.linalg.inv(self.base)
        given = np.zeros((b, f))
        for rows, at in ((stated.Y[0], 0), *((one.Y[0], n) for one in stated.channels[:1] if one.Y)):
            given[:, at : at + rows.shape[1]] = rows
        units, none = np.eye(a * b).reshape(-1, a, b), np.zeros((1, a, b))
        half = np.zeros((len(basis), f + m, f + m))
        half[:, :n, :f] = basis @ (self.base.T @ stated.flow(none) @ D.T)
        sigma, *sectors = (_wider(D @ one @ D.T, m) for one in stated.slopes(none))
        linear = self._linear(
            f + m,
            P=-(half + half.transpose(0, 2, 1)),
            sigma=-sigma[None],
            mu=-np.array(sectors).reshape(-1, f + m, f + m),
        )
        constant = -_wider(D @ stated.constant(none) @ D.T, m)
        if m:
            constant[f:, f:] = np.eye(m)
            linear[self.places["K"], f:, :f] = (
                np.linalg.cholesky(self.claim.W).T @ units[:, n_C:] @ given @ D.T
            )
            linear[self.places["K"], :f, f:] = linear[self.places["K"], f:, :f].transpose(0, 2, 1)
        moved = np.zeros((a * b, len(basis), f + m, f + m))
        moved[:, :, :n, :f] = np.einsum(
            "pij,kjf->kpif", basis, self.base.T @ stated.U[0] @ units @ given @ D.T
        )
        both = Bilinear(self.places["K"], self.places["P"], -(moved + moved.transpose(0, 1, 3, 2)))
        return BilinearCondition(constant, linear, both)


def _entries(P: Square) -> Float[np.ndarray, " p"]:
    j, i = np.tril_indices(len(P))
    return np.asarray(P[i, j])


def _wider(M: Square, m: int) -> Square:
    return np.pad(M, ((0, m), (0, m)))
