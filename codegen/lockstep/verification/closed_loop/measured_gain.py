"""A simulated run against what is proved of its loop: which rho covers it, and whether the run keeps to it.

The continuous rho covers (12) with gain errors within the certified delta; the sampled rho of a design file covers the
sampled controllers with every message arriving, |z|^2 then counting the controllers' states as they are held. A
certificate on a domain covers runs whose agents stay in it.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.numbers import as_floats
from lockstep.check.sampled.controller import PRECISIONS
from lockstep.check.sampled.inequality import Witness
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.model.assembly import network_of
from lockstep.model.network import Network
from lockstep.model.simulation.divergence import left_domain
from lockstep.model.simulation.perturbation import norms
from lockstep.model.simulation.results.trajectory import RhoWeights, Trajectory, energies
from lockstep.model.simulation.run import rates
from lockstep.model.simulation.scenario import Scenario

Kind = Literal["continuous", "sampled", "compiled", "off"]

QUADRATURE = 1e-3
"""Part by which the integrals of a record may be off: a ratio above 1 by less is no contradiction. Where inputs and noise
are held, an agent moves by less than half a radian between instants (`step_of`), of which cubics leave some 1e-4."""


@dataclass(frozen=True, eq=False)
class Promise:
    """What is proved of a loop: rho (None: nothing), its scope, the P of V where it is known, and why not.

    residual: the ultimate distance from consensus per unit of error of every message entry, and that of underflow alone.
    """

    kind: Kind
    rho: float | None
    scope: str | None
    P: Float[np.ndarray, "n_x n_x"] | None
    reason: str
    residual: tuple[float, float] | None = None


@dataclass(frozen=True)
class Measured:
    """|z| and |xi_d| in L2, their ratio, and the promise it is held against.

    ratio: the largest int |z|^2 / (V(0) + rho^2 int |xi_d|^2) over the run, its root; at most 1 where it is covered.
    off: the part by which it may be off;  scaled: whether xi_d is told in the scales of [design.disturbances].
    """

    output: float
    input: float
    gain: float | None
    rho: float | None
    ratio: float | None
    covered: bool
    reason: str
    off: float = QUADRATURE
    scaled: bool = False

    @property
    def holds(self) -> bool:
        """Whether the run is within the promise, or none was made."""
        return not self.covered or self.ratio is None or self.ratio <= 1 + self.off

    @property
    def text(self) -> str:
        """How the run compares with the promise."""
        if not self.covered or self.ratio is None:
            return f"not held against a proof: {self.reason}" if self.reason else "nothing came in"
        share = f"{100 * self.ratio:.4g} % of what rho = {self.rho:.4g} and the start allow"
        gain = "" if self.gain is None else f"{self.gain:.4g}, "
        return f"{gain}{share}" if self.holds else self.excess

    @property
    def excess(self) -> str:
        """What a run above the promise comes to."""
        above = 100 * ((self.ratio or 0) - 1)
        return f"the run exceeds rho = {self.rho:.6g}, which is proved: by {above:.3g} %"


def promise(stored: Stored, kind: Kind) -> Promise:
    """Return what is proved of a design's loop, by the checker, not by what the file says of itself; nothing of u = 0."""
    if kind == "off":
        return Promise(kind, None, None, None, "u = 0, of which nothing is claimed")
    verdict = certify(stored)
    if not verdict.certified:
        return Promise(kind, None, None, None, f"the design is not certified: {verdict.reason}")
    if kind == "continuous":
        c = stored.proofs.certificate
        P = c.P if isinstance(c, Certificate) else None
        return Promise(kind, None if c is None else c.rho, verdict.scope, P, verdict.reason)
    witness, sampled = stored.proofs.sampled_rho, stored.claims.sampled
    residual, kappa, underflow = None, sampled.residual_per_message_error, sampled.residual_from_underflow
    if verdict.proves("sampled") and kappa is not None and underflow is not None:
        residual = kappa, underflow
    if not verdict.proves("sampled_rho") or witness is None:
        reason = "no rho of the sampled loop is proved in the design file"
        return Promise(kind, None, verdict.scope, None, reason, residual)
    rho, reason = sampled.rho, "proved of the sampled loop in ball arithmetic"
    P = witness.P if isinstance(witness, Witness) else None
    return Promise(kind, rho, verdict.scope, P, reason, residual)


def network_of_design(stored: Stored) -> Network:
    """Return the network of a design, with the scales its bound is proved with: those its P belongs to."""
    return network_of(stored.problem, reproved_bound(stored))


def weights_of_design(stored: Stored, network: Network) -> RhoWeights:
    """Return the weights that the design's rho is measured with."""
    return RhoWeights.of(network.graph, stored.problem.performance, network.coordinates)


def measured(
    trajectory: Trajectory, scenario: Scenario, stored: Stored, network: Network, promised: Promise
) -> Measured:
    """Hold a run against what is proved of its loop."""
    weights = weights_of_design(stored, network)
    scaled = len(weights.scales) > 0
    found = energies(trajectory, weights, rates(network, trajectory))
    output, entered = float(np.sqrt(found.output[-1])), float(np.sqrt(found.input[-1]))
    reason, storage = promised.reason, None
    if promised.rho is not None:
        reason = _uncovered(trajectory, scenario, stored, network, promised)
        storage = _storage(trajectory, network, stored, promised)
        if not reason and storage is None:
            reason = "the run starts in disagreement, and this proof has no V(0): let it start in agreement, disturbed"
    if promised.rho is None or storage is None or reason:
        return Measured(output, entered, found.gain, promised.rho, None, False, reason, scaled=scaled)
    ratio = found.largest_ratio(promised.rho, storage)
    root = None if ratio is None else float(np.sqrt(ratio))
    if root is not None and root > 1 and (reason := _lost_in_rounding(trajectory, stored, promised, output)):
        return Measured(output, entered, found.gain, promised.rho, None, False, reason, scaled=scaled)
    return Measured(output, entered, found.gain, promised.rho, root, True, promised.reason, scaled=scaled)


def _uncovered(
    trajectory: Trajectory, scenario: Scenario, stored: Stored, network: Network, promised: Promise
) -> str:
    """Return why the run is outside of what is proved; empty if it is inside."""
    if promised.scope == "local" and (left := left_domain(trajectory.t, trajectory.x, network.agent)):
        return f"{left}, and the certificate is for agents inside it"
    unnamed = np.flatnonzero(stored.problem.performance.states == 0)
    if (trajectory.xi - trajectory.xi[:, :1])[..., unnamed].any():
        return "rho is a gain from the states named in [design.disturbances], and the run disturbs others"
    if not scenario.channel.is_ideal:
        return "rho is proved for messages that all arrive at once, as they were sent"
    if trajectory.faults:
        return f"{trajectory.faults} steps reported a fault"
    if trajectory.clipped:
        return f"{trajectory.clipped} steps clipped an input at its limit, and rho is proved without clipping"
    if promised.kind == "continuous" and _beyond(trajectory, stored):
        return "an input is beyond its limit, where the actuator would clip it"
    if scenario.perturbation is not None:
        t = trajectory.t
        found = norms(scenario.perturbation.at(t, t), stored.gains.order)
        for letter, size in found.items():
            if size > stored.claims.fragility[letter] * (1 + 1e-9):
                return f"|Delta {letter}| reaches {size:.4g}, and the certificate is for {stored.claims.fragility[letter]:g}"
    return ""


def _lost_in_rounding(trajectory: Trajectory, stored: Stored, promised: Promise, output: float) -> str:
    """Return why the rounding of messages counts: agents that are not stable, and agree, move together without end.

    What is read is rounded to a part of its size; rho is proved of messages as they are, and what their errors add is the
    residual. Looked at where a run is above rho: the residual is the most that is possible, and runs seldom come near it.
    """
    if promised.kind == "continuous" or promised.residual is None:
        return ""
    real, largest = stored.problem.controller.real, float(np.abs(trajectory.y).max())
    error = PRECISIONS[real].u * largest
    lost = promised.residual[0] * error
    # |z|^2 is at least the integral of x_d'R x_d.
    R = stored.problem.state_weight(trajectory.x.shape[2])
    if lost**2 * np.linalg.norm(R, 2) * np.ptp(trajectory.t) <= (QUADRATURE * output) ** 2:
        return ""
    return (
        f"the outputs reach {largest:.3g}, which {real} rounds by up to {error:.2g}: that alone"
        f" may keep the agents {lost:.2g} apart, and rho is proved of messages that are not rounded"
    )


def _beyond(trajectory: Trajectory, stored: Stored) -> bool:
    low, high = stored.problem.sides.T
    return bool(((trajectory.u < low) | (trajectory.u > high)).any())


def _storage(trajectory: Trajectory, network: Network, stored: Stored, promised: Promise) -> float | None:
    """Return V(0) = x_d' P_d x_d, the controllers being at rest; None where P is not known."""
    start = trajectory.less_offsets[0]
    x = start - start[:1]
    if not x.any() and not trajectory.x_C[0].any():
        return 0.0
    if promised.P is None or trajectory.x_C[0].any():
        return None
    return storage_of(x, network, stored, promised.P)


def storage_of(
    x: Float[np.ndarray, "N n"], network: Network, stored: Stored, P: Float[np.ndarray, "n_x n_x"]
) -> float:
    """Return x_d' P_d x_d of the agents' states, the controllers being at rest."""
    x_d = (as_floats(network.loop(stored.gains.order).d.T) @ (x - x[:1])).ravel()
    return float(x_d @ P[: len(x_d), : len(x_d)] @ x_d)
