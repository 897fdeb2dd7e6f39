"""The runs: every loop from the same declared initial states, without a disturbance and with the same noise."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from amini.claims.example import claim
from amini.section4.contestants import Contestant, contestants
from lockstep.check.system.disagreement import Coordinates
from lockstep.model.simulation import RhoWeights, Scenario, Trajectory, energies, noise, simulate

START = np.array([[0.8, 0.0, 0.8, 0.0], [-0.5, 0.0, -0.5, 0.0], [0.2, 0.0, 0.2, 0.0]])
"""Initial states in rad and rad/s, those of examples/flexible_joint_arms.toml: the paper gives none."""

HORIZON, STEP = 20.0, 0.005

SEED, SIGMA, INTERVAL = 1, 1.0, 0.005
"""The noise: zero mean, unit variance, on every state of every arm by itself, each sample held for 5 ms; its intensity is
0.005. The paper says zero mean and unit variance, which without a time for which it is held means nothing."""

AGREED = 1e-3
"""Part of the initial disagreement that may be left at the end of a run without a disturbance."""

COORDINATES: Coordinates = "orthonormal"


@dataclass(frozen=True, eq=False)
class Runs:
    """One loop's two runs, and its L2 figures under noise from agreement.

    gain: |z| / |xi_d| of a third run, from agreement, for comparison with the proved rho.
    """

    contestant: Contestant
    quiet: Trajectory
    noisy: Trajectory
    gain: float | None

    @property
    def left(self) -> float:
        """The disagreement at the end of the quiet run, as a part of that at its start."""
        d = self.quiet.disagreement()
        return float(d[-1] / d[0])

    @property
    def agrees(self) -> bool:
        """Whether next to nothing of the disagreement is left."""
        return self.left < AGREED

    def document(self) -> dict[str, str | float | bool | None]:
        """Return the figures as plain JSON types."""
        d = self.quiet.disagreement()
        return {
            "name": self.contestant.key,
            "disagreement_initial": float(d[0]),
            "disagreement_final": float(d[-1]),
            "agrees": self.agrees,
            "gain": self.gain,
            "rho": self.contestant.rho,
        }


def all_runs(tell: Callable[[str, float], None]) -> Iterator[Runs]:
    """Yield the runs of every loop."""
    for k, one in enumerate(contestants()):
        tell(one.name, k / 5)
        yield runs_of(one)


def runs_of(one: Contestant) -> Runs:
    """Return the runs of one loop."""
    N, n = START.shape
    shaking = noise(N, n, interval=INTERVAL, horizon=HORIZON, seed=SEED, sigma=SIGMA)
    quiet = Scenario(START, HORIZON, STEP, perturbation=one.perturbation)
    noisy = Scenario(START, HORIZON, STEP, shaking, one.perturbation)
    rest = Scenario(np.zeros((N, n)), HORIZON, STEP, shaking, one.perturbation)
    asked = claim(order=one.gains.order)
    weights = RhoWeights.of(one.network.graph, asked.performance, COORDINATES)
    gain = energies(simulate(one.network, one.gains, rest), weights).gain
    return Runs(one, simulate(one.network, one.gains, quiet), simulate(one.network, one.gains, noisy), gain)
