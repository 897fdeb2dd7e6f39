"""Agents that join, leave and rewire under one certificate: what it promises against what is simulated.

    python benchmarks/joins.py DESIGN.json [SEQUENCES]

DESIGN.json is a design with `[network] spectrum`. Each sequence starts with 2 to 200 agents on a random graph with its
spectrum in the interval; then agents join with random states, leave, or all change to another such graph; disturbances act.
The dissipation inequality (`lockstep.check.continuous.modes`) bounds, with V_d = sum_i (x_i - mean)'P(x_i - mean),

    int x_d'R x_d + x_Cd'Q x_Cd dt + V_d <= V_d(0) + rho^2 int |xi_d|^2 dt
                                            + sum over joins of N / (N + 1) (x_new - mean)'P(x_new - mean).

Printed is the largest part of the right side that any sequence reached, at the end of any of its pieces.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from lockstep.lmi.document import Stored, read

MOST_AGENTS, PIECES, STEPS, STEP = 200, 6, 60, 0.004
"""Agents, pieces of a sequence, steps of a piece, and their length in s."""


@dataclass(frozen=True)
class Loop:
    """The closed loop of any number of agents: A, B, C, G phi(H x), K; the witness P, and what is weighed."""

    stored: Stored

    def __post_init__(self):
        lure, certificate = self.stored.problem.agent().lure, self.stored.proofs.certificate
        gains, weights = self.stored.gains, self.stored.problem.performance
        n, n_C = len(lure.A), gains.order
        weight = np.zeros((n + n_C, n + n_C))
        weight[:n, :n], weight[n:, n:] = weights.R, weights.Q
        (segment,) = certificate.segments
        v, t = ca.SX.sym("v", lure.H.shape[0]), ca.SX.sym("t")
        phi = ca.Function("phi", [v, t], [lure.phi(v, t)])
        for name, value in {
            "lure": lure, "n": n, "n_C": n_C, "K": gains.blocks[0], "P": segment.P, "weight": weight,
            "rho": certificate.rho, "phi": phi,
        }.items():  # fmt: skip
            object.__setattr__(self, name, value)

    def slope(self, z, L, xi, t):
        """Return d/dt of (x_i, x_Ci), (N, n + n_C)."""
        x, x_C, lure = z[:, : self.n], z[:, self.n :], self.lure
        out = np.hstack([x_C, (L @ x) @ lure.C.T]) @ self.K.T
        phi = np.array(self.phi(lure.H @ x.T, t)).T if len(lure.H) else np.zeros((len(x), 0))
        dx = x @ lure.A.T + out[:, self.n_C :] @ lure.B.T + phi @ lure.G.T + xi
        return np.hstack([dx, out[:, : self.n_C]])

    def V(self, z):
        """V_d."""
        d = z - z.mean(axis=0)
        return float(np.einsum("ij,jk,ik->", d, self.P, d))

    def cost(self, z):
        """x_d'R x_d + x_Cd'Q x_Cd."""
        d = z - z.mean(axis=0)
        return float(np.einsum("ij,jk,ik->", d, self.weight, d))


def laplacian(random, N, lower, upper):
    """Return a random Laplacian with its nonzero eigenvalues in [lower, upper]."""
    while True:
        density = random.uniform(0.2, 1.0)
        a = np.triu(random.uniform(0.3, 1.0, (N, N)) * (random.random((N, N)) < density), 1)
        a = a + a.T
        L = np.diag(a.sum(axis=1)) - a
        values = np.linalg.eigvalsh(L)[1:]
        if values[0] > 1e-9 and values[-1] * lower <= 0.999 * values[0] * upper:
            least, most = lower / values[0], upper / values[-1]
            return L * random.uniform(least, most)


def sequence(loop, random, lower, upper, most=MOST_AGENTS):
    """Return the largest part of the bound that is reached."""

    def size(N):
        return random.standard_normal((N, loop.n + loop.n_C)) * np.r_[np.ones(loop.n), np.zeros(loop.n_C)]

    N = int(random.integers(2, most + 1))
    z, t, cost = size(N), 0.0, 0.0
    bound, worst = loop.V(z), 0.0
    for _ in range(PIECES):
        L = laplacian(random, len(z), lower, upper)
        strength = random.choice([0.0, 1.0, 5.0])
        for _ in range(STEPS):
            xi = strength * random.standard_normal((len(z), loop.n))
            xi_d = xi - xi.mean(axis=0)
            before = loop.cost(z)
            k1 = loop.slope(z, L, xi, t)
            k2 = loop.slope(z + STEP / 2 * k1, L, xi, t + STEP / 2)
            k3 = loop.slope(z + STEP / 2 * k2, L, xi, t + STEP / 2)
            k4 = loop.slope(z + STEP * k3, L, xi, t + STEP)
            middle = z + STEP / 2 * k2
            z, t = z + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4), t + STEP
            cost += STEP / 6 * (before + 4 * loop.cost(middle) + loop.cost(z))
            bound += loop.rho**2 * STEP * float((xi_d**2).sum())
        worst = max(worst, (cost + loop.V(z)) / bound)
        event = random.integers(3)
        if event == 0 and len(z) < most:
            new = size(1)
            d, count = new - z.mean(axis=0), len(z)
            bound += count / (count + 1) * float((d @ loop.P @ d.T)[0, 0])
            z = np.vstack([z, new])
        elif event == 1 and len(z) > 2:
            z = np.delete(z, int(random.integers(len(z))), axis=0)
    return worst


def largest(stored, sequences, seed=0, most=MOST_AGENTS):
    """Return the largest part of the bound that any of some sequences reaches."""
    loop, random = Loop(stored), np.random.default_rng(seed)
    spectrum = stored.problem.spectrum
    return max(sequence(loop, random, spectrum.lower, spectrum.upper, most) for _ in range(sequences))


def main():
    count, start = int(sys.argv[2]) if len(sys.argv) > 2 else 1000, time.process_time()
    worst = largest(read(Path(sys.argv[1])), count)
    print(
        f"{count} sequences: at most {worst:.4f} of the bound, {time.process_time() - start:.0f} s of processor"
    )


if __name__ == "__main__":
    main()
