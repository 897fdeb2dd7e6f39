"""Gains for a period: the sampled inequality and the continuous one, in the same gains, as a smooth nonlinear program.

The discrete controllers that ship are the unknowns, written as what they are Tustin's rule of,

    [A_d B_d; C_d D_d] = tustin(K, T),    K = [A B; C D],

a map that is one to one wherever I - A T/2 is regular and A_d has no eigenvalue -1. So any discrete controller is
reached, and K is read, limited, written to the design file and sampled again as any other gains are.

Without errors the inequality of the sampled loop with performance (`inequality`, `performance`) is

    W(P, K) = [ P - start' Q start - T diag(0, I (x) Q_C)    N' P          ]
              [ P N                                         P - P J S J' P ] > 0,

start and N affine in the discrete controllers. The lifted (A_d, S, Q) depends on the multiplier's weights m and on rho
alone, through an exponential; it enters as its first-order expansion in log m and log rho about the start, within a
trust region, and is lifted anew afterwards. The loop with K in continuous time keeps a certificate of its own,

    F(P_c, K) = [ He(P_c A_cl) + diag(S (x) R, I (x) Q_C) + alpha^2 M_c (x) H'H + P_c E S^-1 E' P_c / rho_c^2    P_c E_G ]
                [                                   *                                                     -M_c (x) I ]
    < 0,

with a rho_c that is bounded and not minimised. As in `bmi`, each condition gets a triangular factor with a diagonal that
is bounded away from 0, and IPOPT does the rest. Nothing here is trusted.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.lmi.inequality import Certificate
from lockstep.lmi.sampled.factors import (
    factor_residual,
    lower_triangle,
    nearest_factor,
    sparse,
    symmetric,
    symmetric_value,
    triangle,
)
from lockstep.lmi.sampled.inequality import multiplier
from lockstep.lmi.sampled.lifting import Lifted
from lockstep.lmi.sampled.loop import SampledLoop
from lockstep.lmi.sampled.performance import Weights, lifted_with_performance, running_cost
from lockstep.lmi.sampled.riccati import smallest_storage
from lockstep.lmi.sampled.storage import padded
from lockstep.model.loop import build_loop
from lockstep.model.numbers import as_floats

FLOOR = 3e-3
"""Least diagonal of a factor, the matrix being scaled to a unit diagonal: as in `bmi`."""

STEP = 1e-4
"""Of the central differences in log m and log rho: their error is 1e-8."""


@dataclass(frozen=True, eq=False)
class Direct:
    """Gains K (N, n_C + m, n_C + q), weights m of the sampled multiplier, rho of the sampled loop.

    continuous: the certificate of the loop in continuous time.
    """

    K: Float[np.ndarray, "N k l"]
    m: Float[np.ndarray, " pairs"]
    rho: float
    continuous: Certificate


def tustin(K: Any, order: int, period: float) -> Any:
    """Return [A_d B_d; C_d D_d] for K = [A B; C D], symbols or numbers of CasADi.

    E = I - A T/2:  A_d = E^-1 (I + A T/2),  B_d = E^-1 B T,  C_d = C E^-1,  D_d = D + C E^-1 B T/2.

    >>> tustin(ca.DM([[-1, 1], [1, 0]]), 1, 0.5)
    DM(
    [[0.6, 0.4],
     [0.8, 0.2]])
    """
    A, B, C, D = K[:order, :order], K[:order, order:], K[order:, :order], K[order:, order:]
    if not order:
        return D
    unit = ca.DM.eye(order)
    inverse = ca.inv(unit - A * (period / 2))
    B_d = ca.mtimes(inverse, B) * period
    upper = ca.horzcat(ca.mtimes(inverse, unit + A * (period / 2)), B_d)
    return ca.vertcat(upper, ca.horzcat(ca.mtimes(C, inverse), D + ca.mtimes(C, B_d) / 2))


class DirectProgram:
    """The nonlinear program for one period; built once, solved from many starts."""

    def __init__(
        self, loop: SampledLoop, weights: Weights, order: int, gain_limit: float, rho_c: float
    ) -> None:
        """Take a loop in doubles with controllers that are zero, and the largest rho_c allowed."""
        self.loop, self.weights, self.order = loop, weights, order
        self.gain_limit, self.rho_c = gain_limit, rho_c
        plant, d = loop.network.plant, loop.network.d
        self.continuous = build_loop(plant, d, order)
        self.shape = (d.N, order + plant.sizes[1], order + plant.sizes[2])
        self.pairs = [as_floats(d.pair_multiplier(i, j)) for i, j in d.pairs()]
        self._symbols = self._variables()
        self._solvers: dict[int, Any] = {}

    def step(self, start: Direct, trust: float, iterations: int) -> Direct:
        """Return where IPOPT stops, whatever its status; its rho is that of the first-order model."""
        lifted = [
            self._lift(start.m, start.rho),
            *(self._slope(start, k) for k in range(len(self.pairs) + 1)),
        ]
        flat = np.concatenate([part.ravel(order="F") for one in lifted for part in (one.A_d, one.S, one.Q)])
        guess, scales = self._guess(start, flat)
        lower, upper = self._bounds(trust)
        solution = self._solver(iterations)(
            x0=np.clip(guess, lower, upper),
            lbx=lower,
            ubx=upper,
            lbg=0,
            ubg=0,
            p=np.concatenate([flat, scales]),
        )
        part = self._split(np.array(solution["x"]).ravel())
        c = part["c"]
        P_c = symmetric_value(part["P_c"], self.continuous.n_x)
        no_ways = np.zeros(0)
        return Direct(
            part["K"].reshape(self.shape),
            start.m * np.exp(part["logs"][:-1]),
            start.rho * float(np.exp(part["logs"][-1])),
            Certificate(float(np.sqrt(c[-1])), P_c, c[:-1], no_ways),
        )

    def _lift(self, m: Float[np.ndarray, " pairs"], rho: float) -> Lifted:
        return lifted_with_performance(self.loop, self.weights, multiplier(self.loop.network.d, m), rho)

    def _slope(self, start: Direct, k: int) -> Lifted:
        """Return the derivative of the lifted period by log m_k, or by log rho after the last."""
        ends = []
        for sign in (1, -1):
            factor = np.ones(len(start.m) + 1)
            factor[k] = np.exp(sign * STEP)
            ends.append(self._lift(start.m * factor[:-1], start.rho * float(factor[-1])))
        up, down = ends
        return Lifted(
            (up.A_d - down.A_d) / (2 * STEP), (up.S - down.S) / (2 * STEP), (up.Q - down.Q) / (2 * STEP)
        )

    @property
    def _n_F(self) -> int:
        return self.continuous.n_x + int(self.continuous.E_G.shape[1])

    def _variables(self) -> dict[str, ca.SX]:
        N, rows, columns = self.shape
        n, n_x, pairs = self.loop.n_xi, self.continuous.n_x, len(self.pairs)
        sizes = {
            "P": triangle(n),
            "K": N * rows * columns,
            "logs": pairs + 1,
            "P_c": triangle(n_x),
            "c": pairs + 1,
            "L_W": triangle(2 * n),
            "L_F": triangle(self._n_F),
            "L_c": triangle(n_x),
            "L_K": N * triangle(min(rows, columns)),
        }
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _blocks(self) -> list[ca.SX]:
        N, rows, columns = self.shape
        flat, size = self._symbols["K"], rows * columns
        return [ca.reshape(flat[i * size : (i + 1) * size], columns, rows).T for i in range(N)]

    @cached_property
    def _lifted_symbols(self) -> list[list[ca.SX]]:
        n_d, n_a = self.loop.n_d, int(self.loop.start.shape[0])
        shapes = {"A_d": (n_d, n_a), "S": (n_d, n_d), "Q": (n_a, n_a)}
        return [
            [ca.SX.sym(f"{name}_{k}", *shape) for name, shape in shapes.items()]
            for k in range(len(self.pairs) + 2)
        ]

    @cached_property
    def _W(self) -> ca.SX:
        loop, n, n_d = self.loop, self.loop.n_xi, self.loop.n_d
        first, *slopes = self._lifted_symbols
        logs = self._symbols["logs"]
        A_d, S, Q = (
            first[part] + sum(logs[k] * slope[part] for k, slope in enumerate(slopes)) for part in range(3)
        )
        tables = ca.diagcat(*[tustin(K, self.order, loop.network.period) for K in self._blocks])
        seen = sparse(np.vstack([one[:, :n] for one in loop.seen]))
        computed = ca.mtimes(tables, seen)

        def closed(rows: Any) -> ca.SX:
            # The columns of mu are where (x_C+, u) of every agent goes.
            whole: ca.SX = sparse(rows[:, :n]) + ca.mtimes(sparse(rows[:, loop.underflows]), computed)
            return whole

        start = closed(loop.start)
        N = ca.vertcat(ca.mtimes(A_d, start), closed(loop.advanced))
        P = symmetric(self._symbols["P"], n)
        stored = P - ca.mtimes([start.T, Q, start]) - ca.DM(running_cost(loop, self.weights)[:n, :n])
        side = P @ N
        corner = P - ca.mtimes([P[:, :n_d], S, P[:n_d, :]])
        W: ca.SX = ca.blockcat([[stored, side.T], [side, corner]])
        return W

    @cached_property
    def _F(self) -> ca.SX:
        loop, alpha = self.continuous, self.loop.network.alpha
        P, c = symmetric(self._symbols["P_c"], loop.n_x), self._symbols["c"]
        A_cl = ca.SX(ca.DM(loop.A_0))
        for U, K, Y in zip(loop.U, self._blocks, loop.Y, strict=True):
            A_cl = A_cl + ca.mtimes([sparse(U), K, sparse(Y)])
        S, unit = loop.d.S, np.eye(loop.plant.A.shape[0])
        inverse = np.linalg.inv(np.kron(S, unit))
        cost = loop.on_disagreement(np.kron(S, self.weights.R))
        cost[loop.n_d :, loop.n_d :] = np.kron(np.eye(loop.d.N), self.weights.Q)
        half = P @ A_cl
        top = (
            half
            + half.T
            + ca.DM(cost)
            + ca.mtimes([P, sparse(loop.E @ inverse @ loop.E.T), P]) / c[len(self.pairs)]
        )
        HH, M = alpha**2 * loop.plant.H.T @ loop.plant.H, ca.SX(loop.d.N - 1, loop.d.N - 1)
        for k, basis in enumerate(self.pairs):
            top = top + c[k] * sparse(loop.on_disagreement(np.kron(basis, HH)))
            M = M + c[k] * sparse(basis)
        side = P @ sparse(loop.E_G)
        F: ca.SX = ca.blockcat([[top, side], [side.T, -ca.kron(M, ca.DM.eye(loop.plant.G.shape[1]))]])
        return F

    @cached_property
    def _conditions(self) -> list[tuple[str, ca.SX]]:
        """Pairs of a factor's name and the matrix that has to be positive definite."""
        room = []
        for K in self._blocks:
            square = ca.mtimes(K, K.T) if K.shape[0] <= K.shape[1] else ca.mtimes(K.T, K)
            room.append(ca.DM.eye(square.shape[0]) - square / self.gain_limit**2)
        P_c = symmetric(self._symbols["P_c"], self.continuous.n_x)
        return [("L_W", self._W), ("L_F", -self._F), ("L_c", P_c), *[("L_K", one) for one in room]]

    @cached_property
    def _parameters(self) -> ca.SX:
        return ca.vertcat(*[ca.vec(part) for one in self._lifted_symbols for part in one])

    def _solver(self, iterations: int) -> Any:
        if iterations not in self._solvers:
            residuals, scales = [], []
            used = dict.fromkeys(self._symbols, 0)
            for name, matrix in self._conditions:
                size = triangle(matrix.shape[0])
                D = ca.SX.sym("D", matrix.shape[0])
                factor = self._symbols[name][used[name] : used[name] + size]
                used[name] += size
                residuals.append(factor_residual(factor, ca.mtimes([ca.diag(D), matrix, ca.diag(D)])))
                scales.append(D)
            program = {
                "x": ca.vertcat(*self._symbols.values()),
                "f": self._symbols["logs"][len(self.pairs)],
                "g": ca.vertcat(*residuals),
                "p": ca.vertcat(self._parameters, *scales),
            }
            options: Any = {
                "ipopt.max_iter": iterations,
                "ipopt.print_level": 0,
                "ipopt.sb": "yes",
                "print_time": False,
                "ipopt.mu_strategy": "monotone",
                "ipopt.mu_init": 1e-3,
                "ipopt.tol": 1e-5,
                "ipopt.acceptable_tol": 1e-4,
            }
            self._solvers[iterations] = ca.nlpsol("direct", "ipopt", program, options)
        return self._solvers[iterations]

    @cached_property
    def _values(self) -> ca.Function:
        names = ("P", "K", "logs", "P_c", "c")
        inputs = [*[self._symbols[name] for name in names], self._parameters]
        return ca.Function("conditions", inputs, [matrix for _, matrix in self._conditions])

    def _guess(
        self, start: Direct, flat: Float[np.ndarray, " p"]
    ) -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " D"]]:
        """Return the start as a vector, its factors those of the nearest definite matrices, and their scales."""
        c = start.continuous
        known = [
            lower_triangle(self._middle_storage(start)),
            start.K.ravel(),
            np.zeros(len(self.pairs) + 1),
            lower_triangle(c.P),
            [*np.maximum(c.m, 1e-6 * max(c.m.max(initial=0.0), 1.0)), c.rho**2],
        ]
        factors, scales = [], []
        values: Any = self._values
        for value in values(*known, flat):
            matrix = np.array(value)
            D = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-8))
            factors.append(nearest_factor(matrix * np.outer(D, D)))
            scales.append(D)
        return np.concatenate([*known, *factors]), np.concatenate(scales)

    def _middle_storage(self, start: Direct) -> Float[np.ndarray, "n_xi n_xi"]:
        """Return P between the smallest and the largest, which is inside; the identity where there is none."""
        loop, n = self.loop, self.loop.n_xi
        lifted = self._lift(start.m, start.rho)
        tables = np.array(ca.diagcat(*[tustin(ca.DM(K), self.order, loop.network.period) for K in start.K]))
        computed = tables @ np.vstack([one[:, :n] for one in loop.seen])
        first, rest = (
            rows[:, :n] + rows[:, loop.underflows] @ computed for rows in (loop.start, loop.advanced)
        )
        N = np.vstack([lifted.A_d @ first, rest])
        cost = first.T @ lifted.Q @ first + running_cost(loop, self.weights)[:n, :n]
        S = padded(loop, lifted.S)
        least = smallest_storage(N, S, cost)
        if least is None:
            return np.eye(n)
        reach = smallest_storage(N.T, cost, S + 1e-9 * np.diag(1 / np.diag(least)))
        return least if reach is None else np.asarray((least + np.linalg.inv(reach)) / 2)

    def _bounds(self, trust: float) -> tuple[Float[np.ndarray, " x"], Float[np.ndarray, " x"]]:
        lower = {name: np.full(symbol.shape[0], -np.inf) for name, symbol in self._symbols.items()}
        upper = {name: -value for name, value in lower.items()}
        lower["logs"][:], upper["logs"][:] = -trust, trust
        lower["c"][:], upper["c"][-1] = 1e-8, self.rho_c**2
        used = dict.fromkeys(self._symbols, 0)
        for name, matrix in self._conditions:
            n = matrix.shape[0]
            diagonal = used[name] + np.cumsum([0, *range(n, 1, -1)])
            lower[name][diagonal] = 1e-4 if name == "L_K" else FLOOR
            used[name] += triangle(n)
        return np.concatenate(list(lower.values())), np.concatenate(list(upper.values()))

    def _split(self, x: Float[np.ndarray, " x"]) -> dict[str, Float[np.ndarray, " part"]]:
        ends = np.cumsum([symbol.shape[0] for symbol in self._symbols.values()])
        return dict(zip(self._symbols, np.split(x, ends[:-1]), strict=True))
