"""One mode of the sampled loop in doubles, and the matrix of its semidefinite program.

With B_d B_d' of one agent, Omega > 0 without errors is V(A_z z + E B_d w) - mu |w|^2 < z' Pi_z z for all z and w, and so
linear in (P, mu):

    [ P - running - mu start' C_d'C_d start - A_z' P A_z - s R_d   -A_z' P E B_d            ]
    [ -B_d' E' P A_z                                               mu I - B_d' E' P E B_d   ] >= 0

at both ends of each segment; s is how much room there is, in multiples of what rho weighs during a period. With rho the
lifted period depends on mu and rho.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.inequality import step_matrix
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.modes import ModalLoop
from lockstep.lmi.analysis.semidefinite import Block, square_root_factor, symmetric_basis
from lockstep.lmi.sampled.l2_gain import lifted_with_performance
from lockstep.lmi.sampled.witnesses import period_in_doubles

Storage = Float[np.ndarray, "n n"]


@dataclass(frozen=True)
class LiftedMode:
    """One mode in doubles: its loop, its lifted period (w and z of mu = 1, or of a mu and a rho), and its running cost."""

    loop: SampledLoop
    lifted: Lifted
    running: Float[np.ndarray, "n_z n_z"]
    with_rho: bool

    @property
    def step(self) -> Float[np.ndarray, "n_x n_x"]:
        """The linear loop from one sampling instant to the next, without errors."""
        return step_matrix(self.loop, self.lifted)[:, : self.loop.n_x]

    def block(
        self, base: Storage, weighed: Storage, units: tuple[float, float], decay: float | None = None
    ) -> Block:
        """Return the matrix above in x = (P, mu, s), P = base P~ base', scaled so that weighed = I; mu, kappa in `units`.

        With a decay, that times P in the place of the first P, and kappa on the messages' noise in that of s.
        """
        n, n_d = self.loop.n_x, self.loop.n_d
        others = self.loop.outputs if decay is None else self.loop.messages
        kept = np.r_[0:n, others.start : others.stop]
        E, (of_mu, of_noise) = square_root_factor(self.lifted.BB_d), units
        z, e = len(kept), E.shape[1]
        D = np.zeros((z, z))
        D[:n, :n] = np.linalg.inv(np.linalg.cholesky(weighed)).T
        for k in range(n, z):
            D[k, k] = (
                of_noise**-0.5 if decay is not None else max(-self.running[kept[k], kept[k]], 1e-300) ** -0.5
            )
        N, start = step_matrix(self.loop, self.lifted)[:, kept] @ D, self.loop.start[:, kept] @ D
        here, after = np.zeros((n, z + e)), np.zeros((n, z + e))
        here[:, :n] = (1.0 if decay is None else decay**0.5) * base.T @ D[:n, :n]
        after[:, :z], after[:, z:] = base.T @ N, base.T[:, :n_d] @ E / of_mu**0.5
        basis = symmetric_basis(n)
        slopes = np.zeros((len(basis) + 2, z + e, z + e))
        slopes[:-2] = here.T @ basis @ here - after.T @ basis @ after
        constant, of_w = np.zeros((z + e, z + e)), slopes[-2]
        constant[:z, :z] = -D.T @ self.running[np.ix_(kept, kept)] @ D
        lost = start.T @ self.lifted.CC_d @ start
        if self.with_rho:
            constant[:z, :z] -= lost
            constant[z:, z:] = np.eye(e) / of_mu
        else:
            of_w[:z, :z], of_w[z:, z:] = -of_mu * lost, np.eye(e)
        if decay is None:
            slopes[-1][:n, :n] = -np.eye(n)
        else:
            slopes[-1][n:z, n:z] = np.eye(z - n)
        return constant, slopes

    def units(self, base: Storage, weighed: Storage) -> tuple[float, float]:
        """Return what mu and kappa are about, for P = base base' and a form that weighs the state."""
        step, n = step_matrix(self.loop, self.lifted), self.loop.n_x
        N = base.T @ step[:, :n] @ np.linalg.inv(np.linalg.cholesky(weighed)).T
        noise = base.T @ step[:, self.loop.messages]
        E = base.T[:, : self.loop.n_d] @ square_root_factor(self.lifted.BB_d)
        sizes = [float(np.linalg.norm(N.T @ one, 2)) ** 2 if one.size else 0.0 for one in (E, noise)]
        return sizes[0] or 1.0, sizes[1] or 1.0


@dataclass(frozen=True)
class ModalSetting:
    """What witnesses are looked for: a loop, where segments end, what is weighed, and, with rho, a mu and a rho."""

    loop: ModalLoop
    ends: tuple[float, ...]
    weights: Performance
    mu: float = 1.0
    rho: float | None = None
    loops: dict[tuple[float, bool], SampledLoop] = field(default_factory=dict)
    periods: dict[int, Lifted | None] = field(default_factory=dict)

    def mode(self, value: float) -> LiftedMode | None:
        """Return a mode; None where its period overflows or passes a conjugate point."""
        key = (value, self.rho is not None)
        if key not in self.loops:
            noise = self.weights.outputs if self.rho is not None else np.zeros(0)
            self.loops[key] = self.loop.at(value, noise, exact=False)
        loop, own = self.loops[key], self.weights
        if not loop.n_d:
            own = own._replace(R=np.zeros((0, 0)), states=np.zeros(0))
        # A period is the same for all lambda: only what is held during it is not.
        if loop.n_d not in self.periods:
            self.periods[loop.n_d] = self._period(loop, own)
        lifted = self.periods[loop.n_d]
        if lifted is None:
            return None
        running = np.zeros((loop.n_z, loop.n_z)) if self.rho is None else running_cost(loop, own, self.rho)
        return LiftedMode(loop, lifted, running, self.rho is not None)

    def _period(self, loop: SampledLoop, weights: Performance) -> Lifted | None:
        if self.rho is None:
            lifted = period_in_doubles(loop)
        else:
            with np.errstate(all="ignore"):
                try:
                    lifted = lifted_with_performance(loop, weights, self.mu * np.eye(1), self.rho)
                except np.linalg.LinAlgError:
                    return None
        return lifted if lifted is not None and _is_a_period(lifted) else None

    def at(self, mu: float, rho: float) -> "ModalSetting":
        """Return the setting with another mu and rho."""
        return replace(self, mu=mu, rho=rho, periods={})

    def weighed(self, mode: LiftedMode) -> Storage:
        """Return T diag(R, Q, 0) of a mode, with a little of every other state."""
        n_C = len(self.weights.Q)
        form = 1e-6 * np.eye(mode.loop.n_x)
        if mode.loop.n_d:
            form[: mode.loop.n_d, : mode.loop.n_d] = self.weights.R
        form[mode.loop.n_d : mode.loop.n_d + n_C, mode.loop.n_d : mode.loop.n_d + n_C] = self.weights.Q
        return self.loop.network.period * form


def _is_a_period(lifted: Lifted) -> bool:
    parts = (lifted.A_d, lifted.BB_d, lifted.CC_d)
    if not all(np.isfinite(one).all() for one in parts):
        return False
    squares = (one for one in parts[1:] if len(one))
    return all(np.linalg.eigvalsh(one)[0] >= -1e-9 * np.abs(one).max() for one in squares)
