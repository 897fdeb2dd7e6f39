"""Theorem 1 (19) and Corollary 1 (34) as printed, with an audit of what their recovery (22) loses.

For study. (19) is linear because it takes k_i = p_s B_i D_Ci and f_i = p_s B_i C_Ci as free n x q and n x n_C
variables; (22) then recovers D_Ci = B_i^+ p_s^-1 k_i, which gives k_i back only if k_i lies in range(p_s
B_i), and nothing in (19) asks for that. The audit states the part lost and the abscissa of the loop with the
gains recovered.

As printed means: T = N - 1 independent rows of L, Cl. P = diag(I (x) p_s, P_C1, ..., P_CN) (18), h
unstructured (G = I) and H_hat = I as in Section 4, |C_r| not squared in (20), the disturbance charged on all
of x_Cl. Two slips are mended because (19) cannot be written down otherwise: 1_n in (21) reads J_{n x q} (q =
2 in the example), and the H_hat of the last block column is its transpose.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import Infeasible
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.model.network import Network

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True)
class Audit:
    """What (22) makes of a solution of (19) or (34).

    objective: rho^2 + sum_i gamma_hat_i;  rho;  alpha: 1/sqrt(gamma_i) for i = 1 ... N - 1;
    residual: the largest |k_i - p_s B_i D_Ci| / |k_i| over agents, and the same for f_i and C_Ci: 0 where
    (22) gives back what
    (19) decided;  abscissa: max Re lambda of the reduced loop (15) with the
    gains recovered: the loop the theorem calls stable.
    """

    objective: float
    rho: float
    alpha: tuple[float, ...]
    residual: float
    abscissa: float
    gains: Gains


def solve_as_printed(
    network: Network,
    order: int,
    R: Float[np.ndarray, "n n"],
    Q: Float[np.ndarray, "n_C n_C"],
    delta: Float[np.ndarray, "4"] | None,
) -> Audit:
    """Solve (19) for bounds (delta_A, delta_B, delta_C, delta_D), or (34) for None, recover the gains by
    (22), and audit them.

    Raises:
        Infeasible: the solver returns no solution.
    """
    import cvxpy as cp

    program = _Printed(network, order, R, Q, delta)
    problem = cp.Problem(cp.Minimize(program.r2 + cp.sum(program.gamma)), program.conditions())
    if not solve_sdp(problem, decompose=program.n > 1) or program.p_s.value is None:
        which, status = "(34)" if delta is None else "(19)", problem.status
        raise Infeasible(f"{which} as printed has no solution: the solver says {status}", status=status)
    return program.audit(float(problem.value))


class _Printed:
    """The variables and blocks of (18) to (21)."""

    def __init__(
        self,
        network: Network,
        order: int,
        R: Float[np.ndarray, "n n"],
        Q: Float[np.ndarray, "n_C n_C"],
        delta: Float[np.ndarray, "4"] | None,
    ) -> None:
        import cvxpy as cp

        lure = network.agent.lure
        self.network, self.order, self.R, self.Q, self.delta = network, order, R, Q, delta
        self.d = disagreement(network.graph, "laplacian_rows")
        self.N, self.n, self.q = network.N, lure.A.shape[0], lure.C.shape[0]
        self.C_r = np.kron(self.d.L_r, lure.C)
        n, N, n_C = self.n, self.N, order
        self.n_d, self.n_c = n * (N - 1), n_C * N
        self.p_s = cp.Variable((n, n), symmetric=True)
        self.P_C = [cp.Variable((n_C, n_C), symmetric=True) for _ in range(N)] if n_C else []
        self.W = [cp.Variable((n_C, n_C)) for _ in range(N)] if n_C else []
        self.Z = [cp.Variable((n_C, self.q)) for _ in range(N)] if n_C else []
        self.k = [cp.Variable((n, self.q)) for _ in range(N)]
        self.f = [cp.Variable((n, n_C)) for _ in range(N)] if n_C else []
        self.tau, self.gamma, self.r2 = cp.Variable(5), cp.Variable(N - 1), cp.Variable()

    def conditions(self) -> list["cp.Constraint"]:
        """Return (19) or (34) with the positive definiteness of (18); 1e-6 stands for > 0."""

        F = self._matrix()
        definite = [self.p_s >> 1e-6 * np.eye(self.n), *[P >> 1e-6 * np.eye(self.order) for P in self.P_C]]
        return [*definite, (F + F.T) / 2 << 0, self.tau >= 1e-9, self.gamma >= 1e-9]

    def _matrix(self) -> "cp.Expression":
        """Assemble the matrix of (19); for (34) the columns of z_1 ... z_4 are left out."""
        import cvxpy as cp
        from scipy.linalg import block_diag

        tau, n_d, n_c = self.tau, self.n_d, self.n_c
        P = _diagonal([cp.kron(np.eye(self.N - 1), self.p_s), *self.P_C])
        B = np.kron(self.d.T, np.eye(self.n)) @ block_diag(*self.network.B)
        top, bottom = np.eye(n_d + n_c, n_d), np.eye(n_d + n_c)[:, n_d:]
        columns: list[Any] = [P]
        squares: list[Any] = [self.r2 * np.eye(n_d + n_c)]
        if self.delta is not None:
            ways = [(top @ B, 0), (top @ B, 1), *([(bottom, 2), (bottom, 3)] if n_c else [])]
            columns += [P @ way for way, _ in ways]
            squares += [tau[j] * np.eye(way.shape[1]) for way, j in ways]
        columns += [P @ top, tau[4] * top]
        gamma = _diagonal([self.gamma[i] * np.eye(self.n) for i in range(self.N - 1)])
        squares += [tau[4] * np.eye(n_d), gamma]
        weights = block_diag(*[self.R] * (self.N - 1), *[self.Q] * (self.N if n_c else 0))
        head = self._Phi() + self._Delta() + weights
        side = cp.hstack(columns)
        return cp.bmat([[head, side], [side.T, -_diagonal(squares)]])

    def _Phi(self) -> "cp.Expression":
        """Phi of (20), with Pi_D and Pi_C of (21)."""
        import cvxpy as cp

        A_r = np.kron(np.eye(self.N - 1), self.network.agent.lure.A)
        P_S = cp.kron(np.eye(self.N - 1), self.p_s)
        first = P_S @ A_r + self._Pi(self.k) @ self.C_r
        if not self.order:
            return first + first.T
        cross = self.C_r.T @ _diagonal(self.Z).T + self._Pi(self.f)
        W = _diagonal(self.W)
        return cp.bmat([[first + first.T, cross], [cross.T, W + W.T]])

    def _Pi(self, blocks: list[Any]) -> "cp.Expression":
        import cvxpy as cp

        return cp.bmat([[self.d.T[row, i] * blocks[i] for i in range(self.N)] for row in range(self.N - 1)])

    def _Delta(self) -> Any:
        """Delta of (20), |C_r| not squared, as printed."""
        if self.delta is None:
            return np.zeros((self.n_d + self.n_c, self.n_d + self.n_c))
        A, B, C, D = self.delta**2
        norm = float(np.linalg.norm(self.C_r, 2))
        blocks = [norm * (self.tau[1] * D + self.tau[3] * B) * np.eye(self.n_d)]
        return _diagonal(
            [*blocks, *([(self.tau[0] * C + self.tau[2] * A) * np.eye(self.n_c)] if self.n_c else [])]
        )

    def audit(self, objective: float) -> Audit:
        """Recover the gains by (22) and measure what is lost."""
        p_s, N = self.p_s.value, self.N
        inverses = [np.linalg.pinv(b) @ np.linalg.inv(p_s) for b in self.network.B]
        D = tuple(inverses[i] @ self.k[i].value for i in range(N))
        if self.order:
            A = tuple(np.linalg.solve(self.P_C[i].value, self.W[i].value) for i in range(N))
            B = tuple(np.linalg.solve(self.P_C[i].value, self.Z[i].value) for i in range(N))
            C = tuple(inverses[i] @ self.f[i].value for i in range(N))
        else:
            A, B, C = ((np.zeros(shape),) * N for shape in ((0, 0), (0, self.q), (D[0].shape[0], 0)))
        gains = Gains(A, B, C, D)
        kept = [(p_s @ self.network.B[i] @ D[i], self.k[i].value) for i in range(N)]
        if self.order:
            kept += [(p_s @ self.network.B[i] @ C[i], self.f[i].value) for i in range(N)]
        residual = max(
            float(np.linalg.norm(full - part)) / max(float(np.linalg.norm(full)), 1e-300)
            for part, full in kept
        )
        abscissa = float(np.linalg.eigvals(self.network.loop(self.order).A_cl(gains.blocks)).real.max())
        alpha = tuple(float(np.sqrt(self.tau.value[4] / value)) for value in self.gamma.value)
        return Audit(objective, float(np.sqrt(max(self.r2.value, 0.0))), alpha, residual, abscissa, gains)


def _diagonal(blocks: list[Any]) -> "cp.Expression":
    import cvxpy as cp

    def part(i: int, j: int) -> Any:
        return blocks[i] if i == j else np.zeros((blocks[i].shape[0], blocks[j].shape[1]))

    places = range(len(blocks))
    return cp.bmat([[part(i, j) for j in places] for i in places])
