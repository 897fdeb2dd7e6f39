"""Gains and certificate together: the bilinear matrix inequality as a smooth nonlinear program.

For gains that may move, F of `inequality` is bilinear in (P, K). With the rows of xi and of the gain errors
eliminated (Schur), F < 0 is the smaller

    F_r = [ He(P A_cl(K)) + diag(S (x) R, I (x) Q) + f_a alpha^2 M (x) H'H + f_d sum_j t_j delta_j^2 Y_j'Y_j
            + P (E (S (x) I)^-1 E' / rho^2 + sum_j X_j X_j' / t_j) P                          P E_G   ]
          [                                        *                                          -M (x) I ]  < 0,

(written for alpha alone: each entry of the claim adds its sector and signals as in `inequality`, its bound scaled alike)

and each semidefinite condition becomes smooth by a factor of its own:  -D F_r D = L_F L_F',  D_P P D_P = L_P
L_P', I - K_i K_i' / gain_limit^2 = L_K L_K', with lower triangular factors whose diagonals are bounded away
from 0. CasADi differentiates it and IPOPT's interior point solves it. An iterate may leave the feasible set
on its way, which is why it gets past the points where a sequence of convex inner approximations creeps. f_a
and f_d in (0, 1] scale alpha^2 and delta^2 for continuation: maximising them carries a start that is merely
stable to the full claim.

Nothing here is trusted: what comes out is a set of gains, and `rounding.prove` certifies them or does not.
"""

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.inequality import (
    Certificate,
    Claim,
    channels,
    entry_signals,
    performance_weight,
    sectors,
    split,
)
from lockstep.check.loop import Loop
from lockstep.lmi.factored import (
    FACTOR_FLOOR,
    diagonal,
    factor,
    factor_residual,
    ipopt,
    sparse,
    symmetric,
    triangle,
    unit_diagonal,
)

Aim = Literal["rho", "alpha", "claim"]


@dataclass(frozen=True)
class Point:
    """Gains with the witnesses that go with them, and the fractions of alpha^2 and delta^2 they carry."""

    K: Float[np.ndarray, "N k l"]
    certificate: Certificate
    alpha_fraction: float = 1.0
    delta_fraction: float = 1.0


@dataclass(frozen=True)
class Limits:
    """How long a run may take (a count: the same input gives the same answer), the range of rho, and a deadline.

    deadline: of `time.monotonic`, or None; where it cuts a run, the answer depends on the machine.
    """

    iterations: int = 400
    rho_most: float = 1e6
    deadline: float | None = None


class BilinearProgram:
    """The nonlinear program for one loop, claim and gain limit; built once, solved from many starts."""

    descent = 400
    """Iterations of a run that lowers rho."""

    def __init__(self, loop: Loop, claim: Claim, gain_limit: float) -> None:
        self.loop, self.claim, self.gain_limit = loop, claim, gain_limit
        self.ways = channels(loop, claim.delta)
        self.sectors = sectors(loop, claim)
        self.pairs = len(loop.d.pairs()) * len(self.sectors)
        self._symbols = self._variables()
        self._solvers: dict[tuple[Aim, int], Any] = {}
        self._programs: dict[Aim, dict[str, Any]] = {}

    @cached_property
    def shape_K(self) -> tuple[int, int, int]:
        """(N, n_C + m, n_C + q)."""
        return self.loop.d.N, self.loop.U[0].shape[1], self.loop.Y[0].shape[0]

    @cached_property
    def n_F(self) -> int:
        """Rows of F_r."""
        return self.loop.n_x + self._n_w

    @cached_property
    def _n_w(self) -> int:
        """Signals of phi and the entries."""
        return int(self.loop.E_G.shape[1]) + entry_signals(self.claim, len(self.loop.d.pairs()))

    @cached_property
    def n_K(self) -> int:
        """Rows of L_K: the smaller side of a gain block."""
        return min(self.shape_K[1:])

    def improve(self, start: Point, aim: Aim = "rho", limits: Limits | None = None) -> Point:
        """Run IPOPT from a point and return where it stops, whatever its status.

        Args:
            start: gains and witnesses; they need not satisfy F_r < 0, but nearer is better.
            aim: "rho" minimises rho at the start's fractions; "claim" maximises the fractions up to 1 with
                rho free;
                "alpha" maximises the fraction of alpha^2 alone, without the limit of 1, with rho at most the
                start's.
            limits: iterations and the largest rho.
        """
        limits = limits or Limits()
        guess, scale = self._guess(start)
        lower, upper = self._bounds(start, aim, limits)
        guess = np.clip(guess, lower, upper)
        solver = self._solver(aim, limits.iterations, limits.deadline)
        solution = solver(x0=guess, lbx=lower, ubx=upper, lbg=0, ubg=0, p=scale)
        return self._point(np.array(solution["x"]).ravel())

    def _variables(self) -> dict[str, ca.SX]:
        n_x, N = self.loop.n_x, self.loop.d.N
        sizes = {
            "P": triangle(n_x),
            "K": int(np.prod(self.shape_K)),
            "m": self.pairs,
            "t": len(self.ways),
            "r2": 1,
            "f": 2,
            "L_F": triangle(self.n_F),
            "L_P": triangle(n_x),
            "L_K": N * triangle(self.n_K),
        }
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _place(self) -> dict[str, slice]:
        ends = np.cumsum([0, *[symbol.shape[0] for symbol in self._symbols.values()]])
        return {
            name: slice(int(a), int(b)) for name, a, b in zip(self._symbols, ends[:-1], ends[1:], strict=True)
        }

    @cached_property
    def _blocks(self) -> list[ca.SX]:
        rows, columns = self.shape_K[1:]
        flat, size = self._symbols["K"], self.shape_K[1] * self.shape_K[2]
        return [ca.reshape(flat[i * size : (i + 1) * size], columns, rows).T for i in range(self.shape_K[0])]

    @cached_property
    def _F_r(self) -> ca.SX:
        loop, s, claim = self.loop, self._symbols, self.claim
        P = symmetric(s["P"], loop.n_x)
        A_cl = ca.SX(ca.DM(loop.A_0))
        for U, K, Y in zip(loop.U, self._blocks, loop.Y, strict=True):
            A_cl = A_cl + ca.mtimes([sparse(U), K, sparse(Y)])
        half = P @ A_cl
        top = half + half.T + ca.DM(performance_weight(loop, claim))
        metric = np.linalg.inv(np.kron(loop.d.S, np.eye(loop.plant.A.shape[0])))
        entering = sparse(loop.E @ metric @ loop.E.T) / s["r2"]
        signals, pairs = ca.SX(self._n_w, self._n_w), loop.d.pairs()
        for k in range(self.pairs):
            sector, (i, j) = self.sectors[k // len(pairs)], pairs[k % len(pairs)]
            W, square = sector.W[k % len(pairs)], sector.bound**2 * sector.H.T @ sector.H
            bound = np.kron(loop.d.pair_multiplier(i, j), square)
            top = top + s["f"][0] * s["m"][k] * sparse(loop.on_disagreement(bound))
            signals = signals + s["m"][k] * sparse(W.T @ W)
        for k, way in enumerate(self.ways):
            top = top + s["f"][1] * s["t"][k] * way.delta**2 * sparse(way.Y.T @ way.Y)
            entering = entering + sparse(way.X @ way.X.T) / s["t"][k]
        top = top + ca.mtimes([P, entering, P])
        if not self.pairs:
            return top
        none = np.zeros((loop.n_x, self._n_w - loop.E_G.shape[1]))
        side = P @ sparse(np.hstack([loop.E_G, none]))
        return ca.blockcat([[top, side], [side.T, -signals]])

    def _solver(self, aim: Aim, iterations: int, deadline: float | None = None) -> Any:
        if deadline is not None:
            # IPOPT takes a limit when it is made, so that this one serves once.
            return ipopt("bmi", self._program(aim), iterations, seconds=deadline - time.monotonic())
        if (aim, iterations) not in self._solvers:
            self._solvers[aim, iterations] = ipopt("bmi", self._program(aim), iterations)
        return self._solvers[aim, iterations]

    def _program(self, aim: Aim) -> dict[str, Any]:
        if aim not in self._programs:
            s, n_x = self._symbols, self.loop.n_x
            D_F, D_P = ca.SX.sym("D_F", self.n_F), ca.SX.sym("D_P", n_x)
            conditions = [
                factor_residual(s["L_F"], -ca.diag(D_F) @ self._F_r @ ca.diag(D_F)),
                factor_residual(s["L_P"], ca.diag(D_P) @ symmetric(s["P"], n_x) @ ca.diag(D_P)),
            ]
            size = triangle(self.n_K)
            for i, K in enumerate(self._blocks):
                square = K @ K.T if K.shape[0] <= K.shape[1] else K.T @ K
                room = ca.DM.eye(self.n_K) - square / self.gain_limit**2
                conditions.append(factor_residual(s["L_K"][i * size : (i + 1) * size], room))
            goal = {
                "rho": ca.log(s["r2"]),
                "alpha": -ca.log(s["f"][0]),
                "claim": -ca.log(s["f"][0]) - ca.log(s["f"][1]),
            }[aim]
            self._programs[aim] = {
                "x": ca.vertcat(*s.values()),
                "f": goal,
                "g": ca.vertcat(*conditions),
                "p": ca.vertcat(D_F, D_P),
            }
        return self._programs[aim]

    @cached_property
    def _value_of_F_r(self) -> ca.Function:
        names = ("P", "K", "m", "t", "r2", "f")
        return ca.Function("F_r", [self._symbols[name] for name in names], [self._F_r])

    def _guess(self, start: Point) -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " D"]]:
        """Return the start as a vector, its factors those of the nearest definite matrices, and D_F, D_P."""
        c = start.certificate
        P = c.P
        # A multiplier of zero has no logarithmic room to grow in: start it above, relative to the others.
        m = np.maximum(c.pair_weights[: self.pairs], 1e-6 * max(c.m.max(initial=0.0), 1.0))
        t = (
            np.maximum(c.t, 1e-6 * max(c.t.max(initial=0.0), 1.0))
            if len(c.t) == len(self.ways)
            else np.ones(len(self.ways))
        )
        r2, f = (1.05 * c.rho) ** 2, np.array([start.alpha_fraction, start.delta_fraction])
        p = P[np.triu_indices(self.loop.n_x)]
        F = -np.array(self._value_of_F_r(p, start.K.ravel(), m, t, r2, f))
        D_F, D_P = unit_diagonal(F), unit_diagonal(P)
        parts = [
            p,
            start.K.ravel(),
            m,
            t,
            [r2],
            f,
            factor(F * np.outer(D_F, D_F)),
            factor(P * np.outer(D_P, D_P)),
        ]
        for K in start.K:
            square = K @ K.T if K.shape[0] <= K.shape[1] else K.T @ K
            parts.append(factor(np.eye(self.n_K) - square / self.gain_limit**2))
        return np.concatenate(parts), np.concatenate([D_F, D_P])

    def _bounds(
        self, start: Point, aim: Aim, limits: Limits
    ) -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " x"]]:
        total = self._place["L_K"].stop
        lower, upper = np.full(total, -np.inf), np.full(total, np.inf)
        for name in ("m", "t", "r2"):
            lower[self._place[name]] = 1e-8
        upper[self._place["r2"]] = (start.certificate.rho if aim == "alpha" else limits.rho_most) ** 2
        fractions = np.array([start.alpha_fraction, start.delta_fraction])
        lower[self._place["f"]] = fractions if aim == "rho" else [0.5 * fractions[0], 0.5 * fractions[1]]
        upper[self._place["f"]] = fractions if aim == "rho" else [np.inf if aim == "alpha" else 1.0, 1.0]
        if aim == "alpha":
            lower[self._place["f"]][1:] = upper[self._place["f"]][1:] = fractions[1]
        for name, count, repeats in (
            ("L_F", self.n_F, 1),
            ("L_P", self.loop.n_x, 1),
            ("L_K", self.n_K, self.loop.d.N),
        ):
            places = np.concatenate([np.array(diagonal(count)) + k * triangle(count) for k in range(repeats)])
            lower[self._place[name].start + places.astype(int)] = FACTOR_FLOOR if name == "L_F" else 1e-4
        return lower, upper

    def _point(self, x: Float[np.ndarray, " x"]) -> Point:
        part = {name: x[place] for name, place in self._place.items()}
        upper = np.zeros((self.loop.n_x, self.loop.n_x))
        upper[np.triu_indices(self.loop.n_x)] = part["P"]
        m, m_entries = split(self.loop, self.claim, part["m"])
        # IPOPT may stop outside of its bounds, or nowhere.
        rho = float(np.sqrt(np.maximum(part["r2"][0], 0.0)))
        witnesses = Certificate(rho, upper + np.triu(upper, 1).T, m, part["t"], m_entries)
        # Where IPOPT stops short, the limit need not hold.
        K = within(part["K"].reshape(self.shape_K), self.gain_limit)
        return Point(K, witnesses, float(part["f"][0]), float(part["f"][1]))


def within(K: Float[np.ndarray, "N k l"], limit: float) -> Float[np.ndarray, "N k l"]:
    """Scale each agent's gains down to the limit on their spectral norm."""
    return np.stack([block * min(1.0, limit / max(float(np.linalg.norm(block, 2)), 1e-300)) for block in K])
