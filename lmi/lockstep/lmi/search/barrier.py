"""Gains and certificate together by Newton's method on a barrier, from inside the feasible set: for the larger loops.

With x = (P, K, m, t, rho^2, f_a, f_d) of `logdet` and a goal g,

    minimise  g(x) / mu - log det(-F(x)) - sum_i log det [l I, K_i; K_i', l I] - sum log(m, t, rho^2, ...)

for a falling mu, l being the gain limit. Where controllers are to be stable by themselves,
- log det(-He(P_i (A_Ci + rate I))) is added for each, with He(P_i (A_Ci + rate I)) = -I where a run for one mu begins: not
all stable A_Ci are inside then, but P_i moves along. The curvature of F is indefinite, so each step adds to the square
part of it as much as makes the whole positive definite: steps are then long where the barrier is flat, whatever the
units of x are.

It replaces a smooth program with a factor for each semidefinite condition, which a general interior-point solver took to
the same rho on the arms (3.350 here, 3.343 there), but from other starts to gains without a certificate, under some linear
algebra kernels and not under others. Here every iterate is inside.

Nothing here is trusted: `rounding.prove` certifies the gains that come out, or does not.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.continuous.inequality import Certificate, Claim, gain_errors
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.search.logdet import BalancedF
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks, GainLimit, Vector

WEIGHTS = (6e-3, 2e-3, 5e-4)
"""mu, one after the other. F has a few dozen rows, and a goal of log rho^2 outweighs what -log det(-F) gains by scaling P
up only where mu is below one over their number."""

ROOMS = (0.1, 0.5, 2.0, 8.0, 32.0)
"""By how much, tried in this order, (P, m, t, rho^2) are scaled up to get inside: F is homogeneous in them and in (R, Q), so
that scaling all but R and Q leaves their multiple as room."""

LEAST_SHIFT, SHIFT_FACTOR, MOST_SHIFT = 3e-3, 2.5, 1e4
"""What is added to the curvature, as a multiple of its square part: tried from the first, or the last one used, upwards."""

ROUNDING_SHIFT, SHIFT_OF_UNITS = 1e-12, 1e-2
"""Added to the unit diagonal of the scaled curvature: always, and for each unit of the shift, for what the square part
does not see."""

SETTLED = 0.02
"""A Newton decrement below which mu is lowered: the barrier is then within about half of that of its least value."""

LONGEST, HALVINGS, ENOUGH = 64.0, 30, 1e-3
"""The longest step in Newton steps, halvings of one, and the part of the slope that a step has to gain."""

BEYOND = 1.05
"""The limit of f_a and f_d on the way to the claim: it is reached at 1, which must be inside."""

RHO_IN_CLAIM = 0.1
"""Weight of log rho^2 on the way to the claim, so that rho is not spent where it gains next to nothing."""

LEAST_MULTIPLIERS = (1e-3, 1e-5, 1e-7, 1e-9)
"""Multipliers start at this part of the largest one at least, the first that is allowed: at zero the barrier would be
infinite."""

Aim = Literal["rho", "alpha", "claim"]

Goal = Callable[[Vector], tuple[float, dict[int, float], dict[int, float]]]
"""The value of a goal, its slope and its second derivative, each by the place of the unknown."""

Storages = tuple[Float[np.ndarray, "n_C n_C"], ...]
"""P_i of each controller that is to be stable by itself."""


@dataclass(frozen=True)
class BarrierPoint:
    """Gains with the witnesses that go with them, and the fractions of alpha^2 and delta^2 they carry."""

    K: GainBlocks
    certificate: Certificate
    alpha_fraction: float = 1.0
    delta_fraction: float = 1.0


@dataclass(frozen=True)
class NewtonLimits:
    """How long a run may take (a count: the same input gives the same answer), the range of rho, and a deadline.

    deadline: where it cuts a run, the answer depends on the machine.
    """

    iterations: int = 150
    rho_most: float = 1e6
    deadline: Deadline = NEVER


class VariableBound(NamedTuple):
    """sign * (x[place] - limit) > 0."""

    place: int
    sign: float
    limit: float


@dataclass(frozen=True)
class Task:
    """What one run lowers, within which bounds, which unknowns may move, and when it is done early."""

    goal: Goal
    bounds: list[VariableBound]
    free: Int[np.ndarray, " free"]
    done: Callable[[Vector], bool]
    storages: Storages = ()


class InteriorProgram:
    """The barrier problem for one loop, claim and gain limit."""

    def __init__(self, loop: Loop, claim: Claim, gain_limit: GainLimit, *, rate: float | None = None) -> None:
        self.loop, self.claim, self.gain_limit = loop, claim, gain_limit
        self.rate, self.order_kept = rate or 0.0, loop.order if rate is not None else 0
        self.ways = gain_errors(loop, claim.delta)

    def improve(
        self, start: BarrierPoint, aim: Aim = "rho", limits: NewtonLimits | None = None
    ) -> BarrierPoint:
        """Return better gains with their witnesses; the start itself where it cannot be got inside.

        Args:
            start: gains and witnesses that satisfy F <= 0 at its fractions of alpha^2 and delta^2.
            aim: "rho" lowers rho; "claim" raises the fractions to 1; "alpha" raises that of alpha^2, rho at most the
                start's.
            limits: Newton steps for each mu, the largest rho of "claim", and a deadline.
        """
        limits = limits or NewtonLimits()
        try:
            F = BalancedF(self.loop, self.claim, np.linalg.cholesky(start.certificate.P))
        except np.linalg.LinAlgError:
            return start
        x = self._inside(F, start, aim)
        if x is None:
            return start
        task = self._task(F, x, aim, limits.rho_most)
        for mu in WEIGHTS:
            x = self._settled(F, x, replace(task, storages=self._storages(F.K(x))), mu, limits)
        f_a, f_d = (
            min(float(x[F.place[name].start]), np.inf if aim == "alpha" else 1.0) for name in ("f_a", "f_d")
        )
        return BarrierPoint(F.K(x).copy(), F.certificate(x), f_a, f_d)

    def _inside(self, F: BalancedF, start: BarrierPoint, aim: Aim) -> Vector | None:
        """Return x with F < 0 near the start."""
        K = limited(start.K, (1 - 1e-6) * self.gain_limit)
        f_a = start.alpha_fraction if self.loop.plant.G.shape[1] else 1.0
        x = F.pack(K, start.certificate, f_a, start.delta_fraction if self.ways else 1.0)
        if aim == "alpha":
            x[F.place["f_a"]] *= 0.9
        scaled = [F.place[name] for name in ("P", "m", "t", "r2") if aim != "alpha" or name != "r2"]
        for least in LEAST_MULTIPLIERS:
            for room in ROOMS if aim != "alpha" else (0.0, *ROOMS):
                trial = x.copy()
                for name in ("m", "t"):
                    part = trial[F.place[name]]
                    trial[F.place[name]] = np.maximum(part, least * part.max(initial=least))
                for place in scaled:
                    trial[place] *= 1 + room
                if np.isfinite(self._barrier(F, trial, [], self._storages(F.K(trial)))):
                    return trial
        return None

    def _task(self, F: BalancedF, x: Vector, aim: Aim, rho_most: float) -> Task:
        r2, f_a, f_d = (F.place[name].start for name in ("r2", "f_a", "f_d"))
        bounds = [VariableBound(i, 1.0, 0.0) for i in range(F.place["m"].start, r2 + 1)]
        moving = {"rho": [], "claim": [f_a, *([f_d] if self.ways else [])], "alpha": [f_a]}[aim]
        if not self.loop.plant.G.shape[1]:
            moving = [place for place in moving if place != f_a]
        bounds += [VariableBound(i, 1.0, 0.0) for i in moving]
        if aim == "claim":
            bounds += [VariableBound(i, -1.0, BEYOND) for i in moving]
            bounds.append(VariableBound(r2, -1.0, max(rho_most**2, 2 * x[r2])))
        weights = {"rho": {r2: 1.0}, "claim": {r2: RHO_IN_CLAIM}, "alpha": {}}[aim] | dict.fromkeys(
            moving, -1.0
        )
        fixed = [i for i in (f_a, f_d) if i not in moving] + ([r2] if aim == "alpha" else [])
        free = np.setdiff1d(np.arange(F.size), fixed)

        def done(x: Vector) -> bool:
            return aim == "claim" and all(x[i] >= 1.0 for i in (f_a, f_d))

        return Task(_logarithms(weights), bounds, free, done)

    def _storages(self, K: GainBlocks) -> Storages:
        """Return P_i with He(P_i (A_Ci + rate I)) = -I of each controller that is to be stable by itself."""
        from scipy.linalg import solve_continuous_lyapunov

        n_C = self.order_kept
        unit, blocks = np.eye(n_C), K[:, :n_C, :n_C] if n_C else ()
        found = [solve_continuous_lyapunov((A_C + self.rate * unit).T, -unit) for A_C in blocks]
        return tuple((P + P.T) / 2 for P in found)

    def _barrier(
        self, F: BalancedF, x: Vector, bounds: list[VariableBound], storages: Storages = ()
    ) -> float:
        """Return the barrier; infinite outside."""
        room = np.array([sign * (x[i] - limit) for i, sign, limit in bounds])
        if (room <= 0).any():
            return np.inf
        total = -float(np.log(room).sum())
        try:
            np.linalg.cholesky(F.P(x))  # implied by F < 0 along a path, not for a jump
            for P in storages:
                np.linalg.cholesky(P)
            own = [-self._dissipation(P, block) for P, block in zip(storages, F.K(x), strict=False)]
            for matrix in (-F.F(x), self._limits(F.K(x)), *own):
                total -= 2 * float(np.log(np.linalg.cholesky(matrix).diagonal(0, -2, -1)).sum())
        except np.linalg.LinAlgError:
            return np.inf
        return total

    def _dissipation(
        self, P: Float[np.ndarray, "n_C n_C"], K: Float[np.ndarray, "k l"]
    ) -> Float[np.ndarray, "n_C n_C"]:
        """Return He(P (A_C + rate I))."""
        half = P @ K[: len(P), : len(P)]
        return np.asarray(half + half.T + 2 * self.rate * P)

    def _add_own(
        self,
        slope: Vector,
        square: Float[np.ndarray, "x x"],
        place: Int[np.ndarray, " c"],
        P: Float[np.ndarray, "n_C n_C"],
        K: Float[np.ndarray, "k l"],
    ) -> None:
        """Add slope and curvature of -log det(-He(P (A_C + rate I))) in the entries of A_C, row by row."""
        row, column = (index.ravel() for index in np.indices(P.shape))
        S = np.linalg.inv(-self._dissipation(P, K))
        SP, PSP = S @ P, P @ S @ P
        across = SP[np.ix_(column, row)]
        slope[place] += 2 * SP[column, row]
        square[np.ix_(place, place)] += 2 * (
            across * across.T + PSP[np.ix_(row, row)] * S[np.ix_(column, column)]
        )

    def _limits(self, K: GainBlocks) -> Float[np.ndarray, "N s s"]:
        """Return [I, K_i / L; (K_i / L)', I] of each agent, positive definite where |K_i / L| < 1."""
        N, k, l = K.shape
        found = np.tile(np.eye(k + l), (N, 1, 1))
        found[:, :k, k:] = K / self.gain_limit
        found[:, k:, :k] = found[:, :k, k:].swapaxes(1, 2)
        return found

    def _settled(self, F: BalancedF, x: Vector, task: Task, mu: float, limits: NewtonLimits) -> Vector:
        """Take Newton steps until the decrement is small."""

        def value(point: Vector) -> float:
            barrier = self._barrier(F, point, task.bounds, task.storages)
            return barrier + task.goal(point)[0] / mu if np.isfinite(barrier) else np.inf

        here, shift = value(x), 0.0
        for _ in range(limits.iterations):
            if task.done(x) or limits.deadline.over:
                break
            slope, square, rest = self._slopes(F, x, task, mu)
            inside = np.ix_(task.free, task.free)
            step, decrement, shift = newton_step(slope[task.free], square[inside], rest[inside], shift)
            if decrement < SETTLED:
                break
            move = np.zeros(F.size)
            move[task.free] = step
            length, here = line_search(value, x, move, here, decrement)
            if length == 0.0:
                break
            x = x + length * move
        return x

    def _slopes(
        self, F: BalancedF, x: Vector, task: Task, mu: float
    ) -> tuple[Vector, Float[np.ndarray, "x x"], Float[np.ndarray, "x x"]]:
        slope, square, rest = F.slopes(x)
        _, k, l = F.shape_K
        row, column = (index.ravel() for index in np.indices((k, l)))
        column, part = column + k, 1 / np.broadcast_to(self.gain_limit, (k, l)).ravel()
        for i, S in enumerate(np.linalg.inv(self._limits(F.K(x)))):
            place = slice(F.place["K"].start + i * k * l, F.place["K"].start + (i + 1) * k * l)
            across = S[np.ix_(row, column)]
            slope[place] -= 2 * part * S[row, column]
            both = S[np.ix_(row, row)] * S[np.ix_(column, column)] + across * across.T
            square[place, place] += 2 * part[:, None] * both * part
        for i, P in enumerate(task.storages):
            place = F.place["K"].start + i * k * l + np.add.outer(l * np.arange(len(P)), np.arange(len(P)))
            self._add_own(slope, square, place.ravel(), P, F.K(x)[i])
        for i, sign, limit in task.bounds:
            room = sign * (x[i] - limit)
            slope[i] -= sign / room
            square[i, i] += (1 / room) ** 2  # room may be 1e200
        _, first, second = task.goal(x)
        for i in first:
            slope[i] += first[i] / mu
            rest[i, i] += second[i] / mu
        return slope, square, rest


def _logarithms(weights: dict[int, float]) -> Goal:
    """Return the goal sum_i w_i log x_i."""

    def goal(x: Vector) -> tuple[float, dict[int, float], dict[int, float]]:
        return (
            float(sum(w * np.log(x[i]) for i, w in weights.items())),
            {i: w / x[i] for i, w in weights.items()},
            {i: -w / x[i] ** 2 for i, w in weights.items()},
        )

    return goal


def newton_step(
    slope: Vector, square: Float[np.ndarray, "x x"], rest: Float[np.ndarray, "x x"], last: float
) -> tuple[Vector, float, float]:
    """Return the step for a curvature made positive definite, its decrement, and the shift that took."""
    from scipy.linalg import cho_factor, cho_solve

    d = 1 / np.sqrt(np.maximum(np.diag(square), 1e-300))
    square, rest, slope = square * np.outer(d, d), rest * np.outer(d, d), slope * d
    shift = 0.0 if last <= LEAST_SHIFT else last / SHIFT_FACTOR
    while shift <= MOST_SHIFT:
        whole = (1 + shift) * square + rest
        whole[np.diag_indices(len(d))] += ROUNDING_SHIFT + SHIFT_OF_UNITS * shift
        try:
            factor = cho_factor(whole, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            shift = max(LEAST_SHIFT, SHIFT_FACTOR * shift)
            continue
        step = -cho_solve(factor, slope, check_finite=False)
        return step * d, float(-slope @ step), shift
    return np.zeros_like(slope), 0.0, 0.0


def line_search(
    value: Callable[[Vector], float], x: Vector, move: Vector, here: float, decrement: float
) -> tuple[float, float]:
    """Halve a step until it gains enough, or double it while that gains more; (0, here) where no step gains."""
    length, found = 1.0, value(x + move)
    if found <= here - ENOUGH * decrement:
        while length < LONGEST:
            longer = value(x + 2 * length * move)
            if not longer < found:
                break
            length, found = 2 * length, longer
        return length, found
    for _ in range(HALVINGS):
        length /= 2
        found = value(x + length * move)
        if found <= here - ENOUGH * length * decrement:
            return length, found
    return 0.0, here
