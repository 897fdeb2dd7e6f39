"""What a simulation returns: every signal of every agent on one time grid, and the figures taken from it.

The performance output is the certificate's (`lockstep.check.continuous.inequality`):

    |z|^2 = x_d' (S (x) R) x_d + x_C' (I (x) Q) x_C + u' (I (x) W) u,      |w|^2 = xi_d' (S (x) I) xi_d,

with x_d = (T (x) I) x, and xi in units of the scales that rho is measured with. For the orthonormal coordinates
x_d' (S (x) R) x_d = sum_i (x_i - mean)' R (x_i - mean).
The certificate says that |z|^2 integrates to at most rho^2 |w|^2 + V(0), and to rho^2 |w|^2 from V(0) = 0.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import as_floats
from lockstep.check.system.disagreement import Coordinates, disagreement
from lockstep.model.graphs.graph import Graph
from lockstep.model.simulation.quadrature import Hold, running_integral, running_integral_of_cubics

AT_REST = 1e-12
"""Largest initial disagreement, in units of its state, that still counts as none: what rounding may leave."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run of N agents on K instants.

    Args:
        t: the instants in s, increasing.
        x, x_C, u, y, xi: states, controller states, inputs, outputs and disturbances of every agent. Of a sampled
            controller x_C is what its memory holds (Tustin's memory is not the x_C of (9)).
        state_names, input_names, output_names: the names of one agent's signals.
        agent: the agent's name; agent i is `<agent><i>`.
        u_hold: "held" if rows k of u and x_C are the values on [t_k, t_k+1) (sampled controllers), "smooth" if they
            are the values at t_k.
        xi_hold: the same of xi.
        faults: how many steps of sampled controllers reported a fault and held their output.
        clipped: how many of them clipped an input at its limit.
        offsets: (N, n), o_i of a formation: disagreement is that of x_i - o_i.
        sent, saved: messages of all links that were sent, and that send on change did without.

    Raises:
        ProblemError: shapes that do not fit, instants that do not increase, or a number that is not finite.
    """

    t: Float[np.ndarray, " K"]
    x: Float[np.ndarray, "K N n"]
    x_C: Float[np.ndarray, "K N n_C"]
    u: Float[np.ndarray, "K N m"]
    y: Float[np.ndarray, "K N q"]
    xi: Float[np.ndarray, "K N n"]
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    agent: str
    u_hold: Hold = "smooth"
    xi_hold: Hold = "held"
    faults: int = 0
    clipped: int = 0
    sent: int = 0
    saved: int = 0
    offsets: Float[np.ndarray, "N n"] | None = None

    def __post_init__(self) -> None:
        t = np.asarray(self.t, dtype=float)
        if t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0).all():
            raise ProblemError("`t` is no increasing list of two instants or more", where="trajectory")
        object.__setattr__(self, "t", t)
        N = np.shape(self.x)[1] if np.ndim(self.x) == 3 else 0
        widths = {
            "x": len(self.state_names),
            "x_C": np.shape(self.x_C)[-1],
            "u": len(self.input_names),
            "y": len(self.output_names),
            "xi": len(self.state_names),
        }
        for letter, width in widths.items():
            array = np.asarray(getattr(self, letter), dtype=float)
            found = f"`{letter}` has the shape {' x '.join(map(str, array.shape))}"
            expected = f"{len(t)} x {N} x {width}: instants, agents, signals"
            demand(array.shape == (len(t), N, width), found, "trajectory", expected)
            demand(np.isfinite(array).all(), f"`{letter}` holds a number that is not finite", "trajectory")
            object.__setattr__(self, letter, array)

    @property
    def N(self) -> int:
        """Number of agents."""
        return int(self.x.shape[1])

    @property
    def horizon(self) -> float:
        """From the first instant to the last, in s."""
        return float(self.t[-1] - self.t[0])

    @property
    def less_offsets(self) -> Float[np.ndarray, "K N n"]:
        """x_i - o_i, which are to agree; x_i where there are no offsets."""
        return self.x if self.offsets is None else np.asarray(self.x - self.offsets)

    def errors(self) -> Float[np.ndarray, "K N n"]:
        """Return e_i = x_i - mean of all x_j, of states less their offsets: the disagreement of each agent."""
        x = self.less_offsets
        return np.asarray(x - x.mean(axis=1, keepdims=True))

    def disagreement_by_state(self) -> Float[np.ndarray, "K n"]:
        """Return (sum_i (x_ij - mean)^2)^1/2 of each state j, in its own unit."""
        return np.asarray(np.linalg.norm(self.errors(), axis=1))

    def disagreement(self) -> Float[np.ndarray, " K"]:
        """Return |x_d| = (sum_i |x_i - mean|^2)^1/2, x_d in orthonormal coordinates."""
        return np.asarray(np.linalg.norm(self.disagreement_by_state(), axis=1))


@dataclass(frozen=True, eq=False)
class RhoWeights:
    """What rho is measured with: coordinates T (N-1, N) with metric S, R (n, n) of the states, Q (n_C, n_C), W (m, m) of u.

    scales: (n,) of the disturbance of each state, none for 1 each; where one is 0, rho is no gain from that state.
    """

    T: Float[np.ndarray, "N-1 N"]
    S: Float[np.ndarray, "N-1 N-1"]
    R: Float[np.ndarray, "n n"]
    Q: Float[np.ndarray, "n_C n_C"]
    W: Float[np.ndarray, "m m"] = field(default_factory=lambda: np.zeros((0, 0)))
    scales: Float[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(
        cls, graph: Graph, performance: Performance, coordinates: Coordinates = "orthonormal"
    ) -> "RhoWeights":
        """Return the weights of a certificate on a graph, in the coordinates it was made in."""
        d = disagreement(graph, coordinates)
        R, Q, W, scales, _ = performance
        return cls(as_floats(d.T), as_floats(d.S), R, Q, W, scales)

    @property
    def metric(self) -> Float[np.ndarray, "N N"]:
        """T' S T: the projection on the complement of 1 for orthonormal coordinates."""
        return np.asarray(self.T.T @ self.S @ self.T)

    def squared_states(self, x: Float[np.ndarray, "K N n"]) -> Float[np.ndarray, " K"]:
        """Return x_d' (S (x) R) x_d at each instant."""
        e = _from_first(x)
        return np.asarray(np.einsum("ij,kia,ab,kjb->k", self.metric, e, self.R, e, optimize=True))

    def squared_controllers(self, x_C: Float[np.ndarray, "K N n_C"]) -> Float[np.ndarray, " K"]:
        """Return x_C' (I (x) Q) x_C at each instant."""
        return np.asarray(np.einsum("kia,ab,kib->k", x_C, self.Q, x_C, optimize=True))

    def squared_inputs(self, u: Float[np.ndarray, "K N m"]) -> Float[np.ndarray, " K"]:
        """Return u' (I (x) W) u at each instant, 0 where u weighs nothing."""
        return np.asarray(np.einsum("kia,ab,kib->k", u, self.W, u)) if len(self.W) else np.zeros(len(u))

    def squared_disturbance(self, xi: Float[np.ndarray, "K N n"]) -> Float[np.ndarray, " K"]:
        """Return |xi_d|^2 at each instant, in units of the scales."""
        e = _from_first(xi)
        if len(self.scales):
            counted = self.scales > 0
            e = e[..., counted] / self.scales[counted]
        return np.asarray(np.einsum("ij,kia,kja->k", self.metric, e, e, optimize=True))


@dataclass(frozen=True, eq=False)
class Energies:
    """What went out and what came in up to each instant: int |z|^2 dt and int |xi_d|^2 dt, from the start."""

    t: Float[np.ndarray, " K"]
    output: Float[np.ndarray, " K"]
    input: Float[np.ndarray, " K"]
    at_rest: bool
    """Whether the run starts in agreement, with controllers at zero."""
    off: float = 0.0
    """The part by which the output may be off, where trapezoids are what there is: what every other instant changes."""

    @property
    def gain(self) -> float | None:
        """|z| / |xi_d| in L2 over the run: at most the certified rho if the certificate covers the run.

        None where it starts in disagreement or nothing came in: the ratio is then no gain.
        """
        if not self.at_rest or self.input[-1] <= 0:
            return None
        return float(np.sqrt(self.output[-1] / self.input[-1]))

    def largest_ratio(self, rho: float, storage: float = 0.0) -> float | None:
        """Return the largest int |z|^2 / (V(0) + rho^2 int |xi_d|^2) over the run: at most 1 if rho is certified.

        None where the denominator stays 0: nothing is claimed then.
        """
        allowed = storage + rho**2 * self.input
        there = allowed > 0
        return float((self.output[there] / allowed[there]).max()) if there.any() else None


def energies(
    trajectory: Trajectory, weights: RhoWeights, rates: Float[np.ndarray, "2 K-1 N n"] | None = None
) -> Energies:
    """Return the energies of performance output and disturbance along a run.

    Held signals are integrated exactly. Smooth ones are by the trapezoidal rule, whose relative error is about
    (omega h)^2 / 12 for signals of omega rad/s on instants h apart; x by cubics, if its rates are given (`run.rates`).
    """
    t, x = trajectory.t, trajectory.less_offsets
    squared = weights.squared_states(x)
    at_rest = squared[0] <= AT_REST**2 * max(1.0, float(np.abs(weights.R).max()))
    if rates is None:
        output = running_integral(squared, t, "smooth")
    else:
        output = running_integral_of_cubics(weights.squared_states, x, rates, t)
    held = weights.squared_controllers(trajectory.x_C) + weights.squared_inputs(trajectory.u)
    output += running_integral(held, t, trajectory.u_hold)
    entered = running_integral(weights.squared_disturbance(trajectory.xi), t, trajectory.xi_hold)
    return Energies(t, output, entered, bool(at_rest and not trajectory.x_C[0].any()))


def _from_first(signal: Float[np.ndarray, "K N k"]) -> Float[np.ndarray, "K N k"]:
    """Return every agent's signal less the first one's: T 1 = 0, so x_d is the same, and agreement is exactly 0."""
    return np.asarray(signal - signal[:, :1])
