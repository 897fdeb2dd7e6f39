"""Gains that are the same for all agents, on a graph that is symmetric in a metric: a search whose size does not grow with N.

The modes of lambda_1 <= ... <= lambda_s are those of a small network: s + 1 agents on a graph with just these eigenvalues
(`graph_of`). With the same gains for all agents and the same weight for all pairs its loop falls apart into the modes, in
orthonormal coordinates, with mu on each and the mean of the controllers beside them: `search.smoothed` does the rest.
Method `modal` ends with such gains; the search for many agents' own gains begins with them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.check.system.graph import Digraph
from lockstep.check.system.network import ExactNetwork
from lockstep.lmi.search.smoothed import Descended, SmoothedNorm, descended, refined
from lockstep.lmi.search.stabilise import DEFECTIVE, descend
from lockstep.lmi.search.units import scaled

GAIN_WEIGHTS = (1e-3, 1e-5, 0.0)
"""Weights of the mean square of the gains while the abscissa is lowered, tried until the loop is stable. Small gains
make the better starts; a long path, whose slowest mode needs all the gain there is, is only stabilised without."""

ONE = 1e-6
"""Eigenvalues this close to each other, relatively, are one mode of the search."""


@dataclass(frozen=True)
class ModalSearch:
    """What is searched: the modes at the ends of the segments, and their smoothed norm in units near one."""

    modes: Modes
    claim: Claim
    ends: Float[np.ndarray, " s"]
    gain_limit: float
    norm: SmoothedNorm

    @classmethod
    def of(
        cls,
        modes: Modes,
        claim: Claim,
        ends: Float[np.ndarray, " s"],
        gain_limit: float,
        rate: float | None = None,
    ) -> "ModalSearch":
        """Return the search over the modes of a plant at the ends of segments; A_C is to have a rate of its own if given."""
        graph, plant = graph_of(ends), modes.plant
        plant = replace(plant, B=(plant.B[0],) * graph.N)
        loop = ExactNetwork(plant, graph, decay=modes.decay).loop(modes.order, exact_arithmetic=False)
        few = replace(claim, delta=np.zeros((graph.N, 4)))
        loop, few, units = scaled(loop, few)
        norm = SmoothedNorm(loop, few, gain_limit, units.gains, shared=True, rate=rate)
        return cls(modes, claim, ends, gain_limit, norm)

    def stable(self, generator: np.random.Generator) -> Float[np.ndarray, "a b"] | None:
        """Return random gains made stable at every end, or None."""
        ends, limit = self.ends, self.gain_limit
        size = generator.choice([0.5, 1.0, 2.0]) / np.sqrt(ends[0] * ends[-1]) ** 0.5
        K = stabilised(self, size * generator.standard_normal(self.norm.shape[1:]))
        K = K * min(1.0, 0.9 * limit / max(float(np.linalg.norm(K, 2)), 1e-300))
        return None if _worst(_ways(self), K)[0] >= 0 else K

    def down(self, K: Float[np.ndarray, "a b"], *, far: bool = True) -> Descended:
        """Return stable gains after the descents: K of its first agent is that of all; far: to next to the maximum, too."""
        at = descended(self.norm, np.repeat(K[None], self.norm.shape[0], axis=0))
        return refined(self.norm, at) if far and np.isfinite(at.rho) else at


def graph_of(eigenvalues: Float[np.ndarray, " s"]) -> Digraph:
    """Return an undirected graph whose Laplacian has these eigenvalues besides 0; those that are one are taken once.

    Agent k + 1 and each of the agents 1 to k before it are joined with one weight v_k. The vector (1, ..., 1, -k, 0, ..., 0)
    then has the eigenvalue (k + 1) v_k + v_{k+1} + ... + v_s, and the v_k follow from the last, the smallest eigenvalue.

    >>> (np.linalg.eigvalsh(graph_of(np.array([1.0, 3.0, 4.0])).laplacian).round(9) + 0.0).tolist()
    [0.0, 1.0, 3.0, 4.0]
    """
    falling: list[float] = []
    for value in sorted(eigenvalues, reverse=True):
        if not falling or value < falling[-1] * (1 - ONE):
            falling.append(float(value))
    size, total = len(falling), 0.0
    adjacency = np.zeros((size + 1, size + 1))
    for k in range(size, 0, -1):
        weight = (falling[k - 1] - total) / (k + 1)
        adjacency[k, :k] = adjacency[:k, k] = weight
        total += weight
    return Digraph(adjacency)


def stabilised(search: ModalSearch, K: Float[np.ndarray, "a b"]) -> Float[np.ndarray, "a b"]:
    """Lower the largest abscissa over the ends of the segments, and over A_C + rate I, within the gain limit.

    The gains are gain_limit Z / sqrt(1 + |Z|^2), so that every Z is allowed.
    """
    ways, gain_limit = _ways(search), search.gain_limit
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


def _ways(search: ModalSearch) -> list[tuple[Any, Any, Any]]:
    """Return (A_0, U, Y) of the loop at each lambda, and of A_C + rate I."""
    modes = search.modes
    ways = [(loop.A_0, loop.U[0], loop.Y[0]) for loop in map(modes.at, search.ends)]
    n_C, rows, columns = modes.order, ways[0][1].shape[1], len(ways[0][2])
    return (
        [*ways, (max(modes.decay, search.norm.rate) * np.eye(n_C), np.eye(n_C, rows), np.eye(columns, n_C))]
        if n_C
        else ways
    )


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
            product = l @ r if abs(l @ r) > DEFECTIVE else DEFECTIVE
            worst, slope = float(eigenvalues[i].real), np.real(np.outer(U.T @ l, Y @ r) / product)
    return worst, slope
