"""The step inequality of the sampled loop in P and the pair weights together: a convex program, without rounding.

For a given decay, with z = (x_cl, zeta) the state and, where they matter, the messages' errors, A_z = [A B], F F' = I (x) B_d
B_d' and M = sum m_ij M_ij, B_d and C_d of one agent, the inequality of `lockstep.check.sampled.inequality` is

    [ Pi_z - start' (M (x) C_d'C_d) start    A_z' P    0         ]
    [ P A_z                                  P         P E F     ]  >= 0,
    [ 0                                      F'E'P     M (x) I   ]

Pi_z = diag(decay P - weight (T T')^-1 (x) I, kappa I). It is put to the solver for (x_cl+ - x_cl) / h, h the norm of A - I,
with P = L V L' so that V is near the identity, and zeta in units in which B is near one: a step of 5 ms hardly moves
anything, its differences would drown in the solver's tolerance, and in which unit time is counted does not matter. The
Riccati equations of `storage` are faster and need m; here m is free.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.analysis.dense_sdp import run_dense

NEAR = 1e-4
"""The gap of a goal, relative to it: what is found is held to the checker's proof, and twice as many steps gain no digit
that a design shows. On a loop of 27 states it takes a twelfth of the time of a sparse solver."""

FLATTEST = 1e-5
"""The least eigenvalue of V: the room for rounding is a part of P."""

FAR_APART = 300.0
"""Between the units in which N is balanced: beyond, those of the loop are left for these, an input held in A beside a state
in Pa."""

NOTHING = 1e-14
"""An eigenvalue of S_1, relative to the largest, that is rounding."""


@dataclass(frozen=True, eq=False)
class StepProgram:
    """The program of one loop and decay.

    basis: L;  h: how far a step moves;  V, m, kappa: variables, kappa in units of `unit`;  conditions: the
    inequality;  cross: tau H L^-T sqrt(unit / h), a variable, where a sector is part of it.
    """

    loop: SampledLoop
    decay: float
    basis: Float[np.ndarray, "n n"]
    h: float
    unit: float
    V: Any
    m: Any
    kappa: Any
    conditions: list[Any]
    cross: Any = None

    def in_units_of_V(self, form: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        """Return L^-1 form L^-T: P >= form where V is above it. In units of the loop entries may be 1e6 apart."""
        inverse = np.linalg.inv(self.basis)
        return np.asarray(inverse @ form @ inverse.T)

    def least(self, goal: Any, conditions: list[Any], weight: float = 0.0) -> tuple[float, Witness] | None:
        """Minimise a goal; return its value and the witness, without prices of the rounding, or None.

        weight: of the disagreement, in multiples of kappa: what the conditions of the program were made with.
        """
        import cvxpy as cp

        problem = cp.Problem(cp.Minimize(goal), [*self.conditions, *conditions])
        if not run_dense(problem, NEAR):
            return None
        P, m = self.basis @ self.V.value @ self.basis.T, self.m.value
        m = np.maximum(m, 1e-9 * max(float(m.max(initial=0.0)), 1e-300))
        kappa, t = float(self.kappa.value) * self.unit, np.zeros(len(self.loop.ways))
        return float(problem.value), Witness((P + P.T) / 2, m, t, self.decay, kappa, weight * kappa)


def step_program(
    loop: SampledLoop,
    one: Lifted,
    decay: float,
    near: Float[np.ndarray, "n n"],
    *,
    noise: bool = False,
    weight: float = 0.0,
    tau: Float[np.ndarray, " l"] | None = None,
) -> StepProgram | None:
    """State the program; None where the linear loop is not stable.

    Args:
        loop, one: in doubles;  decay: of V per step.
        near: (n_x, n_x) a form that P should be near a multiple of, beyond what it sums up to along the loop.
        noise: whether the messages' errors count.
        weight: of the squared disagreement in each step, in multiples of kappa.
        tau: of the sectors of `lockstep.check.sampled.inputs.saturation`, in units of `unit`, the loop being the clipped one.
    """
    import cvxpy as cp

    d, n, n_d = loop.network.d, loop.n_x, loop.n_d
    others = np.arange(loop.messages.start, loop.messages.stop) if noise else np.arange(0)
    if tau is not None:
        others = np.arange(loop.n_z - len(tau), loop.n_z)
    columns = np.r_[0:n, others]
    lifted, pairs, start = copies(one, np.eye(d.N - 1)), d.pairs(), loop.start[:, columns]
    N = np.vstack([lifted.A_d @ start, loop.advanced[:, columns]])
    L = basis_of(N[:, :n], near)
    if L is None:
        return None
    inverse = np.linalg.inv(L)
    D = L.T @ (N[:, :n] - np.eye(n)) @ inverse.T
    h = float(np.linalg.norm(D, 2)) or 1.0
    # In units of each state: beside pascals an eigenvalue of metres looks like rounding.
    sizes = np.sqrt(np.maximum(np.diag(one.BB_d), 1e-300))[:, None]
    values, vectors = np.linalg.eigh(one.BB_d / sizes / sizes.T)
    root = (sizes * vectors * np.sqrt(np.maximum(values, 0.0)))[:, values > NOTHING * values.max(initial=0.0)]
    F = L[:n_d].T @ np.kron(np.eye(d.N - 1), root) / np.sqrt(h)
    D, rate = D / h, (1 - decay) / h
    B = L.T @ N[:, n:] / np.sqrt(h)
    scale = float(np.linalg.norm(B, 2)) if B.size else 1.0
    B = B / (scale or 1.0)
    # (x_cl, zeta) in the program's coordinates; the costs are linear in M, and `copies` wants a regular one.
    into = np.zeros((len(columns),) * 2)
    into[:n, :n] = inverse.T / np.sqrt(h)
    into[n:, n:] = np.eye(len(columns) - n) / (scale or 1.0)
    whole, unit = np.eye(d.N - 1), np.eye(root.shape[1])
    Q_of = [copies(one, whole + d.pair_multiplier(i, j)).CC_d - lifted.CC_d for i, j in pairs]
    costs = [into.T @ start.T @ each @ start @ into for each in Q_of]
    size = max(float(np.linalg.norm(cost, 2)) for cost in costs) or 1.0
    V, m = cp.Variable((n, n), symmetric=True), cp.Variable(len(pairs), nonneg=True)
    kappa = cp.Variable(nonneg=True)
    M = sum(m[k] * np.kron(d.pair_multiplier(i, j), unit) for k, (i, j) in enumerate(pairs))
    Q = sum(m[k] * (cost + cost.T) / (2 * size) for k, cost in enumerate(costs))
    along, out = V @ D, V @ (F * np.sqrt(size))
    price = (scale or 1.0) ** 2
    weighed = np.zeros((n, n))
    weighed[:n_d, :n_d] = metric(loop)
    dear = kappa * (price * weight / h) * (inverse @ weighed @ inverse.T)
    first = -rate * V - along - along.T - Q[:n, :n] - dear
    rows = [
        [first, np.sqrt(h) * along.T, -out],
        [np.sqrt(h) * along, V, np.sqrt(h) * out],
        [-out.T, np.sqrt(h) * out.T, M],
    ]
    mixed = None if tau is None else cp.Variable((len(tau), n))
    if len(others):
        enters, count = V @ B, B.shape[1]
        cross = -enters - Q[:n, n:] if mixed is None else -enters - Q[:n, n:] - mixed.T
        cost = kappa * np.eye(count) if tau is None else 2 * np.diag(tau)
        none = np.zeros((count, F.shape[1]))
        rows[0].insert(1, cross)
        rows[1].insert(1, np.sqrt(h) * enters)
        rows[2].insert(1, none.T)
        rows.insert(1, [cross.T, cost - Q[n:, n:], np.sqrt(h) * enters.T, none])
    form = cp.bmat(rows)
    conditions = [(form + form.T) / 2 >> 0, V >> FLATTEST * np.eye(n)]
    return StepProgram(loop, decay, L, h, price, V, m / size, kappa, conditions, mixed)


def basis_of(N: Float[np.ndarray, "n n"], near: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"] | None:
    """Return L, L L' a multiple of the sum of N'^k near N^k in which `near` has the norm 1; None if N is not stable."""
    from scipy.linalg import matrix_balance, solve_discrete_lyapunov

    _, (units, _) = matrix_balance(N - np.eye(len(N)), permute=False, separate=True)
    units = units if units.max() > FAR_APART * units.min() else np.ones(len(N))
    scaled = near * np.outer(units, units)
    whole = scaled + 1e-2 * np.linalg.norm(scaled, 2) * np.eye(len(N))
    try:
        sums = solve_discrete_lyapunov((N * units / units[:, None]).T, whole)
        L = np.linalg.cholesky(sums) / units[:, None]
    except (np.linalg.LinAlgError, ValueError):
        return None
    inverse = np.linalg.inv(L)
    return np.asarray(L * np.sqrt(np.linalg.norm(inverse @ near @ inverse.T, 2)))
