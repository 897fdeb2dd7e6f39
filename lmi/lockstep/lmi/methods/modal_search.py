"""Identical gains for all modes: the bilinear matrix inequality, once for each end of each segment, with one K.

Unknown are K, a P for each segment, mu, sigma and the fraction f of alpha^2 that is carried. With the rows of xi
eliminated,

    F_r(lambda) = [ He(P A(lambda)) + diag(R, Q) + f mu alpha^2 diag(H'H, 0) + P E E'P / sigma   P E_G ]
                  [                                  *                                          -mu I  ]  < 0,

He(A_C) < 0 in a metric of its own for the mean of the controllers, and each semidefinite condition made smooth by a
factor. What comes out is a set of gains; `modal.prove_modes` certifies them or does not.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.inequality import Claim
from lockstep.check.modes import Modes
from lockstep.lmi.methods.factored import (
    FACTOR_FLOOR,
    diagonal,
    factor,
    factor_residual,
    ipopt,
    symmetric,
    triangle,
    unit_diagonal,
)
from lockstep.lmi.methods.modal_witness import Witness, witness
from lockstep.lmi.search.stabilise import descend

FRACTIONS = (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3)
"""Parts of alpha tried for the first witness of gains that are merely stable."""

SHIFTS, CLIMBS, DESCENTS = 6, 6, 4
"""At most so many runs towards a stable loop, so many towards the full alpha, and so many that lower sigma."""

SHIFT_LADDER = (1e-3, 1e-2, 0.1, 1.0)
"""Shifts tried beyond the abscissa, relative to the norm of the loop: with the last one P = I nearly does."""

WORTHWHILE = 0.02
"""A run that lowers sigma by less than this part of it is the last."""

GAIN_WEIGHTS = (1e-3, 1e-5, 0.0)
"""Weights of the mean square of the gains while the abscissa is lowered, tried until the loop is stable. Small gains
make the better starts; a long path, whose slowest mode needs all the gain there is, is only stabilised without."""


Aim = Literal["shift", "claim", "rho"]


@dataclass(frozen=True)
class Point:
    """Gains with a witness for the fraction f of alpha^2 and a shift of the loop to the left."""

    K: Float[np.ndarray, "a b"]
    witness: Witness
    f: float = 1.0
    shift: float = 0.0


@dataclass(frozen=True)
class Found:
    """Gains with a witness for the full alpha, or None and the part of alpha that was reached."""

    K: Float[np.ndarray, "a b"] | None
    witness: Witness | None
    fraction: float

    @property
    def sigma(self) -> float:
        """The sigma reached; infinite without a witness."""
        return np.inf if self.witness is None else self.witness.sigma


class ModalProgram:
    """The nonlinear program for one problem; built once, solved from many starts."""

    def __init__(self, modes: Modes, claim: Claim, ends: Float[np.ndarray, " s"], gain_limit: float) -> None:
        self.modes, self.claim, self.ends, self.gain_limit = modes, claim, ends, gain_limit
        m, q = modes.plant.B[0].shape[1], modes.plant.C.shape[0]
        self.shape = (modes.order + m, modes.order + q)
        self.count = len(ends) - 1
        self.phi = int(modes.inequality(claim, ends[0]).channels[1].E.shape[1])
        k, n_C = modes.size, modes.order
        sizes = {
            "P": self.count * triangle(k),
            "P_mean": triangle(n_C),
            "K": self.shape[0] * self.shape[1],
            "mu": 1 + len(claim.entries),
            "sigma": 1,
            "f": 1,
            "shift": 1,
            "L_F": 2 * self.count * triangle(k + self.phi),
            "L_P": self.count * triangle(k),
            "L_m": 2 * triangle(n_C),
            "L_K": triangle(min(self.shape)),
        }
        self.s = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        marks = np.cumsum([0, *sizes.values()])
        self.place = {
            name: slice(int(a), int(b)) for name, a, b in zip(sizes, marks[:-1], marks[1:], strict=True)
        }
        self._solvers: dict[tuple[Aim, int], Any] = {}

    def improve(self, point: "Point", aim: Aim, iterations: int) -> "Point":
        """Run IPOPT and return the gains where it stops, with the fraction of alpha^2 and the shift it claims there.

        Args:
            point: gains with a witness for a fraction of alpha^2 and a shift.
            aim: "shift" lowers the shift to 0, "claim" raises the fraction to 1, "rho" lowers sigma.
            iterations: at most so many.
        """
        guess, scales = self._guess(point)
        lower, upper = self._bounds(point, aim)
        solution = self._solver(aim, iterations)(
            x0=np.clip(guess, lower, upper), lbx=lower, ubx=upper, lbg=0, ubg=0, p=scales
        )
        x = np.array(solution["x"]).ravel()
        f, shift = float(x[self.place["f"]][0]), float(x[self.place["shift"]][0])
        K = x[self.place["K"]].reshape(self.shape)
        # Where IPOPT stops short, the limit need not hold.
        K = K * min(1.0, self.gain_limit / max(float(np.linalg.norm(K, 2)), 1e-300))
        return Point(K, point.witness, f, shift)

    @cached_property
    def _K(self) -> ca.SX:
        return ca.reshape(self.s["K"], self.shape[1], self.shape[0]).T

    @cached_property
    def _Ps(self) -> list[ca.SX]:
        size = triangle(self.modes.size)
        return [symmetric(self.s["P"][i * size : (i + 1) * size], self.modes.size) for i in range(self.count)]

    @cached_property
    def _conditions(self) -> list[ca.SX]:
        """All that is to be positive definite: -F_r by vertex, P by segment, P_mean and its decay, the limit."""
        modes, claim, s = self.modes, self.claim, self.s
        stated = modes.inequality(claim, self.ends[0])  # the channels are the same for every lambda
        E, E_G = (ca.DM(channel.E) for channel in stated.channels)
        slopes, k, inner = stated.slopes(np.zeros((1, *self.shape)))[1:], modes.size, modes.size + E.shape[1]
        found = []
        for P, pair in zip(self._Ps, zip(self.ends[:-1], self.ends[1:], strict=True), strict=True):
            for value in pair:
                U, Y = ca.sparsify(ca.DM(modes.U)), ca.sparsify(ca.DM(modes.Y(value)))
                half = P @ (
                    ca.DM(modes.A_0) - s["shift"] * ca.DM.eye(modes.size) + ca.mtimes([U, self._K, Y])
                )
                top = half + half.T + ca.DM(modes.weight(claim)) + ca.mtimes([P, E, E.T, P]) / s["sigma"]
                if self.phi:
                    signals = ca.SX(self.phi, self.phi)
                    for c, form in enumerate(slopes):
                        top = top + s["f"] * s["mu"][c] * ca.sparsify(ca.DM(form[:k, :k]))
                        signals = signals - s["mu"][c] * ca.sparsify(ca.DM(form[inner:, inner:]))
                    top = ca.blockcat([[top, P @ E_G], [(P @ E_G).T, -signals]])
                found.append(-top)
        found += self._Ps
        if modes.order:
            P = symmetric(s["P_mean"], modes.order)
            A_C = self._K[: modes.order, : modes.order] - s["shift"] * ca.DM.eye(modes.order)
            found += [P, -(P @ A_C + A_C.T @ P + ca.DM(claim.Q))]
        square = self._K @ self._K.T if self.shape[0] <= self.shape[1] else self._K.T @ self._K
        return [*found, ca.DM.eye(min(self.shape)) - square / self.gain_limit**2]

    @cached_property
    def _values(self) -> ca.Function:
        names = ("P", "P_mean", "K", "mu", "sigma", "f", "shift")
        return ca.Function("conditions", [self.s[name] for name in names], self._conditions)

    def _solver(self, aim: Aim, iterations: int) -> Any:
        if (aim, iterations) not in self._solvers:
            factors, scale = ca.vertcat(*[self.s[name] for name in ("L_F", "L_P", "L_m", "L_K")]), []
            residuals, place = [], 0
            for M in self._conditions:
                D, size = ca.SX.sym("D", M.shape[0]), triangle(M.shape[0])
                residuals.append(factor_residual(factors[place : place + size], ca.diag(D) @ M @ ca.diag(D)))
                scale.append(D)
                place += size
            goals = {"rho": ca.log(self.s["sigma"]), "claim": -ca.log(self.s["f"]), "shift": self.s["shift"]}
            program = {
                "x": ca.vertcat(*self.s.values()),
                "f": goals[aim],
                "g": ca.vertcat(*residuals),
                "p": ca.vertcat(*scale),
            }
            self._solvers[aim, iterations] = ipopt("modal", program, iterations)
        return self._solvers[aim, iterations]

    def _guess(self, point: "Point") -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " D"]]:
        K, start = point.K, point.witness
        upper = np.triu_indices(self.modes.size)
        P = np.concatenate([one[upper] for one in start.P])
        P_mean = start.P_mean[np.triu_indices(self.modes.order)]
        mu, scalars = np.maximum(start.mu, 1e-8), [1.1 * start.sigma, point.f, point.shift]
        values = [np.array(M) for M in _listed(self._values(P, P_mean, K.ravel(), mu, *scalars))]
        scales = [unit_diagonal(M) for M in values]
        factors = [factor(M * np.outer(D, D)) for M, D in zip(values, scales, strict=True)]
        return np.concatenate([P, P_mean, K.ravel(), mu, scalars, *factors]), np.concatenate(scales)

    def _bounds(self, point: "Point", aim: Aim) -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " x"]]:
        total = self.place["L_K"].stop
        lower, upper = np.full(total, -np.inf), np.full(total, np.inf)
        lower[self.place["mu"]] = lower[self.place["sigma"]] = 1e-8
        lower[self.place["f"]] = 0.5 * point.f if aim == "claim" else point.f
        upper[self.place["f"]] = 1.0 if aim == "claim" else point.f
        lower[self.place["shift"]] = 0.0 if aim == "shift" else point.shift
        upper[self.place["shift"]] = point.shift
        if aim != "rho":
            upper[self.place["sigma"]] = 100.0 * point.witness.sigma
        place = self.place["L_F"].start
        for k, M in enumerate(self._conditions):
            lower[place + np.array(diagonal(M.shape[0]), dtype=int)] = (
                FACTOR_FLOOR if k < 2 * self.count else 1e-4
            )
            place += triangle(M.shape[0])
        return lower, upper


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def stabilised(
    modes: Modes, K: Float[np.ndarray, "a b"], values: Float[np.ndarray, " v"], gain_limit: float
) -> Float[np.ndarray, "a b"]:
    """Lower the largest abscissa over the ends of the segments, and over A_C, within the gain limit.

    The gains are gain_limit Z / sqrt(1 + |Z|^2), so that every Z is allowed.
    """
    ways = _ways(modes, values)
    for weight in GAIN_WEIGHTS:
        K = _lowered(ways, K * min(1.0, 0.9 * gain_limit / float(np.linalg.norm(K))), gain_limit, weight)
        if _worst(ways, K)[0] < 0:
            break
    return K


def _lowered(
    ways: list[tuple[Any, Any, Any]], K: Float[np.ndarray, "a b"], gain_limit: float, weight: float
) -> Float[np.ndarray, "a b"]:
    def objective(flat: Float[np.ndarray, " x"]) -> tuple[float, Float[np.ndarray, " x"]]:
        root = float(np.sqrt(1 + flat @ flat))
        gains = gain_limit * flat / root
        worst, slope = _worst(ways, gains.reshape(K.shape))
        total = slope.ravel() + 2 * weight * gains / flat.size
        return worst + weight * float(np.mean(gains**2)), gain_limit / root * (
            total - flat * (flat @ total) / root**2
        )

    Z = descend(objective, K.ravel() / np.sqrt(gain_limit**2 - float(np.sum(K**2))), 100)
    return np.asarray(gain_limit * Z / np.sqrt(1 + Z @ Z)).reshape(K.shape)


def _ways(modes: Modes, values: Float[np.ndarray, " v"]) -> list[tuple[Any, Any, Any]]:
    """Return (A_0, U, Y) of the loop at each lambda, and of A_C."""
    ways = [(modes.A_0, modes.U, modes.Y(value)) for value in values]
    n_C, (rows, columns) = modes.order, (modes.U.shape[1], modes.Y(1.0).shape[0])
    return [*ways, (np.zeros((n_C, n_C)), np.eye(n_C, rows), np.eye(columns, n_C))] if n_C else ways


def _worst(
    ways: list[tuple[Any, Any, Any]], K: Float[np.ndarray, "a b"]
) -> tuple[float, Float[np.ndarray, "a b"]]:
    """Return the largest abscissa of A_0 + U K Y and its slope in K: Re(U' l r' Y' / l'r) for a simple eigenvalue."""
    from scipy.linalg import eig

    worst, slope = -np.inf, np.zeros(K.shape)
    for A_0, U, Y in ways:
        eigenvalues, left, right = eig(A_0 + U @ K @ Y, left=True, right=True)
        i = int(np.argmax(eigenvalues.real))
        if eigenvalues[i].real > worst:
            l, r = left[:, i].conj(), right[:, i]
            worst, slope = float(eigenvalues[i].real), np.real(np.outer(U.T @ l, Y @ r) / (l @ r))
    return worst, slope


def from_start(program: ModalProgram, seed: int, index: int) -> Found:
    """Run one start: stabilise, climb to the full alpha, then lower sigma; the same arguments, the same outcome."""
    modes, ends = program.modes, program.ends
    generator = np.random.default_rng([seed, index])
    size = generator.choice([0.5, 1.0, 2.0]) / np.sqrt(ends[0] * ends[-1]) ** 0.5
    K = stabilised(modes, size * generator.standard_normal(program.shape), ends, program.gain_limit)
    K = K * min(1.0, 0.9 * program.gain_limit / max(float(np.linalg.norm(K, 2)), 1e-300))
    point = _first_point(program, K)
    return Found(None, None, 0.0) if point is None else _descend(program, _climb(program, point))


def _first_point(program: ModalProgram, K: Float[np.ndarray, "a b"]) -> Point | None:
    """Return gains with a witness for some part of alpha: those given, or, where they are not stable, better ones."""
    modes, easiest = program.modes, FRACTIONS[-1] ** 2
    for _ in range(SHIFTS):
        for fraction in FRACTIONS:
            found = witness(modes, K, _at(program.claim, fraction**2), program.ends)
            if found is not None:
                return Point(K, found, fraction**2)
        shifted = _shifted(program, K, easiest)
        if shifted is None:
            return None
        K = program.improve(shifted, "shift", 150).K
    return None


def _shifted(program: ModalProgram, K: Float[np.ndarray, "a b"], f: float) -> Point | None:
    """Return gains that are not good enough with the least shift of `SHIFT_LADDER` that gives them a witness."""
    modes = program.modes
    worst = max(_worst(_ways(modes, program.ends), K)[0], 0.0)
    unit = float(np.linalg.norm(modes.A_0 + modes.U @ K @ modes.Y(program.ends[-1]), 2))
    for step in SHIFT_LADDER:
        shift = 1.1 * worst + step * unit
        found = witness(replace(modes, shift=shift), K, _at(program.claim, f), program.ends)
        if found is not None:
            return Point(K, found, f, shift)
    return None


def _at(claim: Claim, f: float) -> Claim:
    return claim.at(alpha=f**0.5 * claim.alpha)


def _climb(program: ModalProgram, point: Point) -> Point:
    """Raise the fraction of alpha^2 towards 1; return where certificates reached."""
    for _ in range(CLIMBS):
        if point.f == 1.0:
            return point
        trial = program.improve(point, "claim", 150)
        for f in (1.0, 0.95 * trial.f, 0.5 * (point.f + trial.f)):
            found = (
                witness(program.modes, trial.K, _at(program.claim, f), program.ends) if f > point.f else None
            )
            if found is not None:
                point = Point(trial.K, found, f)
                break
        else:
            return point
    return point


def _descend(program: ModalProgram, point: Point) -> Found:
    """Lower sigma until a run gains little."""
    if point.f < 1:
        return Found(None, None, point.f**0.5)
    for _ in range(DESCENTS):
        trial = program.improve(point, "rho", 300).K
        found = witness(program.modes, trial, program.claim, program.ends)
        if found is None or found.sigma >= point.witness.sigma:
            break
        gained = found.sigma < (1 - WORTHWHILE) * point.witness.sigma
        point = Point(trial, found)
        if not gained:
            break
    return Found(point.K, point.witness, 1.0)
