"""One K and one P for all lambda of an interval: what a certificate for every graph with its spectrum there needs.

For given K the least sigma is that of a semidefinite program in (P, mu, sigma) with the matrix of a mode at both ends
(`lockstep.check.continuous.modes`); its multipliers Z_a, Z_b give the slope in K, dsigma = sum_e <Z_e, dF_e>.
First a P is looked for that carries the nonlinearity at both ends at all,

    minimise s:    F_xphi(lambda) <= s I,   P >= I (and P <= 1000 I),

F_xphi being the matrix of a mode without disturbance and weights, until s < 0, by BFGS with a small barrier at the gain
limit. Then sigma is lowered in K and P together (`modal_newton`), since sigma(K) has kinks where BFGS stops. What comes
out is a set of gains; `modal.prove_modes` certifies them or does not.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.channels import Inequality
from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.lmi.analysis.gain_limit import limit_barrier, limited
from lockstep.lmi.analysis.semidefinite import Block, SdpSolution, minimise, symmetric_basis
from lockstep.lmi.methods.modal_newton import Together
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.shapes import GainLimit, Vector

Gain = Float[np.ndarray, "a b"]
Valued = tuple[float, Gain]

ENOUGH = -0.02
"""A slack below this, in the coordinates of a base, ends the first phase."""

LARGEST = 1e3
"""P <= LARGEST I in the first phase: where there is one P, it could be scaled up without end."""

BARRIER = 3e-3
"""Of that of the gain limit, beside log sigma."""

STEPS_INSIDE, STEPS_DOWN = 150, 400
"""Steps of BFGS for either phase: the second where no barrier can be put up."""

WEIGHTS, NEWTON_STEPS, ROUNDS, WORTHWHILE = (6e-3, 2e-3, 5e-4), 150, 40, 3e-3
"""Of the barrier beside log sigma, and of its rounds: Newton steps, how many, and the part of sigma that one has to gain."""


@dataclass(frozen=True)
class CommonSearch:
    """The modes at both ends of an interval, and what is claimed of them; A_C + rate I is to be stable."""

    modes: Modes
    claim: Claim
    ends: tuple[float, float]
    gain_limit: GainLimit
    rate: float = 0.0

    def improved(self, K: Gain, rounds: int = ROUNDS) -> tuple[float, Gain]:
        """Return sigma and gains with one P for both ends, from gains that may have none; infinite where none are found.

        Args:
            K: where to start.
            rounds: of Newton's method on the barrier, at most.
        """
        base = self._base(K)
        if base is None:
            return np.inf, K
        if self.sigma(K)[0] == np.inf:
            K = self._inside(K, base)
        if self.sigma(K)[0] == np.inf:
            return np.inf, K
        K = self._together(K, rounds)
        return self.sigma(K)[0], K

    def _together(self, K: Gain, rounds: int) -> Gain:
        """Lower sigma in K and P together, while a round gains enough."""
        found = self._solved(K)
        if found is None:
            return K
        shapes, solved, unit = found
        p = len(shapes.P_basis)
        P = np.tensordot(solved.x[:p], shapes.P_basis, 1)
        rate = max(self.rate, self.modes.decay)
        at = Together(
            self.modes, self.claim, self.ends, self.gain_limit, rate, (K.shape[0], K.shape[1]),
            shapes.base @ np.linalg.cholesky(P + 1e-9 * float(np.trace(P)) * np.eye(len(P))),
        )  # fmt: skip
        x = at.pack(K, unit * solved.x[p:-1], unit * float(solved.x[-1]))
        if x is None:
            return self._descended(self._log_sigma, K, STEPS_DOWN)
        goal = at.program.goal
        for weight in (*WEIGHTS[:-1], *[WEIGHTS[-1]] * rounds):
            before = x[goal]
            at, x = at.rebased(at.program.improved(x, weight, NEWTON_STEPS))
            if weight == WEIGHTS[-1] and x[goal] > (1 - WORTHWHILE) * before:
                break
        return at.K(x)

    def has_one_P(self, K: Gain) -> bool:
        """Tell whether gains with one P for both ends are found from these."""
        base = self._base(K)
        if base is None:
            return False
        return self.sigma(K)[0] < np.inf or self._slack(self._inside(K, base), base)[0] < 0

    def _inside(self, K: Gain, base: Float[np.ndarray, "k k"]) -> Gain:
        return self._descended(lambda gains: self._slack(gains, base), K, STEPS_INSIDE)

    def _log_sigma(self, K: Gain) -> Valued:
        value, slope = self.sigma(K)
        return (float(np.log(value)), slope / value) if 0 < value < np.inf else (np.inf, slope)

    def sigma(self, K: Gain) -> Valued:
        """Return the least sigma with one P, and its slope in K; infinite where there is none."""
        found = self._solved(K)
        if found is None:
            return np.inf, np.zeros(K.shape)
        shapes, solved, unit = found
        return solved.value * unit, unit * self._slope(K, shapes, solved)

    def _solved(self, K: Gain) -> tuple["_Shapes", SdpSolution, float] | None:
        base = self._base(K)
        if base is None:
            return None
        unit = float(np.linalg.norm(base, 2)) ** 2
        shapes = _Shapes(self, K, base, unit)
        blocks = [shapes.block(value) for value in self.ends]
        solved = minimise(np.eye(shapes.unknowns)[-1], [*blocks, *shapes.signs])
        return None if solved is None or not solved.value > 0 else (shapes, solved, unit)

    def _slack(self, K: Gain, base: Float[np.ndarray, "k k"]) -> Valued:
        """Return the least s with F_xphi <= s I and P >= I, in the coordinates of a base, and its slope in K."""
        shapes = _Shapes(self, K, base, 1.0, bare=True)
        solved = minimise(np.eye(shapes.unknowns)[-1], [*(shapes.block(v) for v in self.ends), *shapes.signs])
        if solved is None or not self._mean_is_stable(K):
            return np.inf, np.zeros(K.shape)
        if solved.value < ENOUGH:
            return solved.value, np.zeros(K.shape)
        return solved.value, self._slope(K, shapes, solved)

    def _slope(self, K: Gain, shapes: "_Shapes", solved: SdpSolution) -> Gain:
        """Return sum_e <Z_e, dF_e / dK>: 2 U' P Z [Y, Y_c, ...]', and the slope of what u weighs, if it does."""
        P = shapes.base @ np.tensordot(solved.x[: len(shapes.P_basis)], shapes.P_basis, 1) @ shapes.base.T
        slope, n = np.zeros(K.shape), len(P)
        for value, Z in zip(self.ends, solved.duals[:2], strict=True):
            stated = self.modes.inequality(self.claim, value)
            S = shapes.unscaled(Z, stated.size)
            others = [
                one.Y[0] if one.Y else np.zeros((K.shape[1], one.E.shape[1])) for one in stated.channels
            ]
            given = np.hstack([*stated.Y, *others])
            slope += 2 * stated.U[0].T @ P @ S[:n] @ given.T
            if len(self.claim.W) and not shapes.bare:
                slope += _slope_of_constant(stated, K, S)
        return slope

    def _descended(self, objective: Callable[[Gain], Valued], K: Gain, steps: int) -> Gain:
        """Lower an objective, the norm of K being held below the limit by a small barrier."""

        def of_flat(flat: Vector) -> tuple[float, Vector]:
            gains = flat.reshape(K.shape)
            room = limit_barrier(gains[None], self.gain_limit)
            if room is None:
                return np.inf, flat
            value, slope = objective(gains)
            return value + BARRIER * room[0], (slope + BARRIER * room[1][0]).ravel()

        return descend(of_flat, limited(K[None], 0.95 * self.gain_limit).ravel(), steps).reshape(K.shape)

    def _mean_is_stable(self, K: Gain) -> bool:
        n_C = self.modes.order
        rate = max(self.modes.decay, self.rate)
        return not n_C or float(np.linalg.eigvals(K[:n_C, :n_C]).real.max()) < -rate

    def _base(self, K: Gain) -> Float[np.ndarray, "k k"] | None:
        """Return the Cholesky factor of P with He(P A(lambda)) = -diag(R, Q) in the middle, where the loop is stable."""
        from lockstep.lmi.methods.modal_witness import storage_factor

        if not self._mean_is_stable(K):
            return None
        return storage_factor(self.modes, K, self.claim, float(np.sqrt(self.ends[0] * self.ends[1])))


@dataclass(frozen=True)
class _Shapes:
    """-F of a mode as M_0 + sum_k x_k M_k in x = (P, mu, sigma), P in units of a base; `bare`: (P, mu, s), -F_xphi + s I."""

    search: CommonSearch
    K: Gain
    base: Float[np.ndarray, "k k"]
    unit: float
    bare: bool = False

    @cached_property
    def P_basis(self) -> Float[np.ndarray, "p k k"]:
        return symmetric_basis(len(self.base))

    @property
    def sectors(self) -> int:
        return len(self.search.modes.inequality(self.search.claim, self.search.ends[0]).channels[1].cone)

    @property
    def unknowns(self) -> int:
        return len(self.P_basis) + self.sectors + 1

    def parts(self, K: Gain, value: float) -> tuple[Float[np.ndarray, "f f"], Float[np.ndarray, "x f f"]]:
        """Return F_0 and F_k, F = F_0 + sum_k x_k F_k."""
        stated = self.search.modes.inequality(self.search.claim, value)
        n = len(self.base)
        D = np.eye(stated.size) / self.unit**0.5
        D[:n, :n] = np.linalg.inv(self.base)
        Z = self.base.T @ stated.flow(K[None]) @ D.T
        half = np.zeros((len(self.P_basis), stated.size, stated.size))
        half[:, :n] = self.P_basis @ Z
        sigma, *sectors = self.unit * (D @ stated.slopes(K[None]) @ D.T)
        constant = D @ stated.constant(K[None]) @ D.T
        first = stated.channels[0].E.shape[1]
        keep = np.r_[0:n, n + first : stated.size] if self.bare else np.arange(stated.size)
        last = -np.eye(stated.size) if self.bare else sigma
        slopes = np.concatenate([half + half.transpose(0, 2, 1), *[one[None] for one in (*sectors, last)]])
        constant = 0 * constant if self.bare else constant
        return constant[np.ix_(keep, keep)], slopes[:, keep][:, :, keep]

    def block(self, value: float) -> Block:
        """Return -F."""
        constant, slopes = self.parts(self.K, value)
        return -constant, -slopes

    def unscaled(self, Z: Float[np.ndarray, "f f"], size: int) -> Float[np.ndarray, "f f"]:
        """Return D'Z D: <Z, D F D'> = <D'Z D, F>."""
        n = len(self.base)
        whole, first = np.zeros((size, size)), size - len(Z)
        keep = np.r_[0:n, n + first : size]
        whole[np.ix_(keep, keep)] = Z
        D = np.eye(size) / self.unit**0.5
        D[:n, :n] = np.linalg.inv(self.base)
        return np.asarray(D.T @ whole @ D)

    @property
    def signs(self) -> list[Block]:
        """P >= 0 (P >= I where bare), and mu >= 0."""
        n, k, p = len(self.base), self.unknowns, len(self.P_basis)
        P = np.zeros((k, n, n))
        P[:p] = self.P_basis
        blocks: list[Block] = [(-np.eye(n) if self.bare else np.zeros((n, n)), P)]
        if self.bare:
            blocks.append((LARGEST * np.eye(n), -P))
        return [
            *blocks,
            *((np.zeros((1, 1)), np.eye(k)[p + c].reshape(k, 1, 1)) for c in range(self.sectors)),
        ]


def _slope_of_constant(stated: Inequality, K: Gain, S: Float[np.ndarray, "f f"]) -> Gain:
    """Return the slope of <S, F_0>, a polynomial of degree two in K, so that central differences are exact."""
    slope, h = np.zeros(K.shape), 1e-3 * max(1.0, float(np.abs(K).max()))
    for index in np.ndindex(K.shape):
        step = np.zeros(K.shape)
        step[index] = h
        change = stated.constant((K + step)[None]) - stated.constant((K - step)[None])
        slope[index] = float(np.sum(S * change)) / (2 * h)
    return slope
