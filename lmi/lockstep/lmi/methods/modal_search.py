"""Identical gains for all modes: stable for every end of a segment, then down the smoothed norm of these modes together.

The modes of lambda_1 <= ... <= lambda_s are those of a small network: s + 1 agents on a graph with just these eigenvalues
(`graph_of`). With the same gains for all agents and the same weight for all pairs its loop falls apart into the modes, in
orthonormal coordinates, with mu on each and the mean of the controllers beside them: `search.smoothed` does the rest. The
size does not depend on N. What comes out is a set of gains; `modal.prove_modes` certifies them or does not.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.check.system.graph import Digraph
from lockstep.check.system.network import ExactNetwork
from lockstep.lmi.methods.modal_witness import ModalWitness, witness
from lockstep.lmi.search.smoothed import SmoothedNorm, descended, refined
from lockstep.lmi.search.stabilise import DEFECTIVE, descend
from lockstep.lmi.search.units import scaled

FRACTIONS = (0.3, 0.1, 0.03, 0.01, 1e-3)
"""Parts of alpha tried for gains that do not carry all of it."""

GAIN_WEIGHTS = (1e-3, 1e-5, 0.0)
"""Weights of the mean square of the gains while the abscissa is lowered, tried until the loop is stable. Small gains
make the better starts; a long path, whose slowest mode needs all the gain there is, is only stabilised without."""

ONE = 1e-6
"""Eigenvalues this close to each other, relatively, are one mode of the search."""

DRAWS = 4
"""Random gains per start."""


@dataclass(frozen=True)
class ModalCandidate:
    """Gains with a witness for the full alpha, or None and the part of alpha that was reached."""

    K: Float[np.ndarray, "a b"] | None
    witness: ModalWitness | None
    fraction: float

    @property
    def sigma(self) -> float:
        """The sigma reached; infinite without a witness."""
        return np.inf if self.witness is None else self.witness.sigma


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


def from_start(search: ModalSearch, seed: int, index: int) -> ModalCandidate:
    """Run one start: draw gains, make them stable, and lower rho; the same arguments, the same outcome."""
    generator, found = np.random.default_rng([seed, index]), ModalCandidate(None, None, 0.0)
    for _ in range(DRAWS):
        found = min(found, _descent(search, generator), key=lambda one: (one.sigma, -one.fraction))
    return found


def drawn(search: ModalSearch, seed: int, index: int) -> list[Float[np.ndarray, "a b"]]:
    """Return gains of one start that are stable at the ends, taken down the smoothed norm of these modes."""
    generator, found = np.random.default_rng([seed, index]), []
    for _ in range(DRAWS):
        K = _stable(search, generator)
        if K is not None:
            found.append(descended(search.norm, np.repeat(K[None], search.norm.shape[0], axis=0)).K[0])
    return found


def _stable(search: ModalSearch, generator: np.random.Generator) -> Float[np.ndarray, "a b"] | None:
    ends, norm, limit = search.ends, search.norm, search.gain_limit
    size = generator.choice([0.5, 1.0, 2.0]) / np.sqrt(ends[0] * ends[-1]) ** 0.5
    K = stabilised(search, size * generator.standard_normal(norm.shape[1:]))
    K = K * min(1.0, 0.9 * limit / max(float(np.linalg.norm(K, 2)), 1e-300))
    return None if _worst(_ways(search), K)[0] >= 0 else K


def _descent(search: ModalSearch, generator: np.random.Generator) -> ModalCandidate:
    ends, norm = search.ends, search.norm
    K = _stable(search, generator)
    if K is None:
        return ModalCandidate(None, None, 0.0)
    at = descended(norm, np.repeat(K[None], norm.shape[0], axis=0))
    K = (refined(norm, at) if np.isfinite(at.rho) else at).K[0]
    found = witness(search.modes, K, search.claim, ends)
    if found is not None:
        return ModalCandidate(K, found, 1.0)
    parts = (
        f for f in FRACTIONS if witness(search.modes, K, search.claim.at(alpha=f * search.claim.alpha), ends)
    )
    return ModalCandidate(None, None, next(parts, 0.0))
