"""The structured singular value of a complex matrix: mu(M) = 1 / min {sigma(Delta): det(I - M Delta) = 0}.

From above by `d_scaling`, from below by the power iteration of Packard, Fan and Doyle (1988): with M b = beta a it
looks for a Delta of norm 1 / beta in the structure. Whatever it ends with, Q of norm 1 in the structure gives
mu >= rho(M Q) (Zhou, Doyle and Glover 1996, chapter 11), and that is what is returned.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex

from lockstep.lmi.robustness.blocks import Structure
from lockstep.lmi.robustness.d_scaling import (
    MARGIN,
    Scales,
    balanced,
    decide,
    improved_scales,
    least_beta,
    scales_from_numbers,
)

ITERATIONS, STARTS = 200, 6
"""Of the power iteration."""

CLOSED = 1e-7
"""A relative gap between the two sides that no semidefinite program is worth."""


@dataclass(frozen=True, eq=False)
class StructuredValue:
    """mu of one matrix.

    upper: computed by D scaling;  proved: a beta with mu < beta that was decided exactly for the doubles of M, or None;
    lower: computed;  Delta: a perturbation of norm 1/lower in the structure that makes I - M Delta singular, to rounding;
    X: the scales of `upper`.
    """

    upper: float
    proved: float | None
    lower: float
    Delta: Complex[np.ndarray, "r c"]
    X: Scales


def structured_singular_value(
    M: Complex[np.ndarray, "c r"], blocks: Sequence[int | tuple[int, int]] | None = None
) -> StructuredValue:
    """Return mu from both sides.

    Args:
        M: z = M w.
        blocks: (r, c) for a full complex block w_i = Delta_i z_i, k for delta I_k; by default scalars.

    Raises:
        ProblemError: blocks that do not fit M.

    >>> M = np.outer([1.0, 2.0, 3.0], [3.0, -1.0, 0.5])     # of rank one: mu = sum |a_i b_i|
    >>> found = structured_singular_value(M)
    >>> round(found.lower, 6), round(found.upper, 6), bool(found.proved < 6.5001)
    (6.5, 6.5, True)
    """
    M = np.atleast_2d(np.asarray(M, dtype=complex))
    structure = Structure.of(blocks, M.shape)
    lower, Q = lower_bound(M, structure)
    X = scales_from_numbers(structure, balanced(M, structure))
    if least_beta(M, structure, X) > lower * (1 + CLOSED):
        X = improved_scales(M, structure, X)
    upper = least_beta(M, structure, X)
    raised = upper * (1 + MARGIN) + np.finfo(float).tiny
    decided = decide(M, structure, X, raised)
    return StructuredValue(upper, raised if decided.positive else None, lower, Q / lower if lower else Q, X)


def lower_bound(
    M: Complex[np.ndarray, "c r"], structure: Structure
) -> tuple[float, Complex[np.ndarray, "r c"]]:
    """Return rho(M Q) and Q, |Q| = 1 in the structure, such that M Q has that eigenvalue, real and positive."""
    rng = np.random.default_rng(0)
    best, Q_best = 0.0, np.zeros(M.T.shape, dtype=complex)
    _, _, V = np.linalg.svd(M)
    for start in range(STARTS):
        b = V[0].conj() if start == 0 else rng.normal(size=(2, M.shape[1])).T @ [1, 1j]
        value, Q = _iterated(M, structure, b)
        if value > best:
            best, Q_best = value, Q
    return best, Q_best


def _iterated(M: np.ndarray, structure: Structure, b: np.ndarray) -> tuple[float, np.ndarray]:
    places = list(zip(structure.blocks, structure.of_z, structure.of_w, strict=True))
    b = b / np.linalg.norm(b)
    w = b.copy()
    best, Q_best = 0.0, np.zeros(M.T.shape, dtype=complex)
    for k in range(ITERATIONS):
        a = M @ b
        a, z = a / (np.linalg.norm(a) or 1.0), np.zeros(M.shape[0], dtype=complex)
        for block, at_z, at_w in places:
            z[at_z] = _aligned(w[at_w], a[at_z], repeated=block.repeated)
        w = M.conj().T @ z
        w = w / (np.linalg.norm(w) or 1.0)
        before, b = b, np.zeros(M.shape[1], dtype=complex)
        for block, at_z, at_w in places:
            b[at_w] = _aligned(a[at_z], w[at_w], repeated=block.repeated)
        settled = np.linalg.norm(b - before) < 1e-12
        if k % 20 == 19 or settled:
            value, Q = _spectral(M, structure, M @ b, b)
            best, Q_best = (value, Q) if value > best else (best, Q_best)
        if settled:
            break
    return best, Q_best


def _aligned(of_length: np.ndarray, along: np.ndarray, *, repeated: bool) -> np.ndarray:
    """Return the step of the iteration: the length of one vector along the other; for delta I its phase only."""
    if repeated:
        product = np.vdot(along, of_length)
        # z = (w* a / |w* a|) w, and b likewise: the phase that makes w* z and a* b agree.
        return np.asarray(of_length * (product.conjugate() / abs(product) if abs(product) else 1.0))
    length = np.linalg.norm(along)
    return np.asarray(along * (np.linalg.norm(of_length) / length)) if length else along


def _spectral(M: np.ndarray, structure: Structure, a: np.ndarray, b: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the spectral radius of M Q for the Q that takes a along b, turned so that the eigenvalue is positive."""
    Q = np.zeros(M.T.shape, dtype=complex)
    for block, at_z, at_w in zip(structure.blocks, structure.of_z, structure.of_w, strict=True):
        if block.repeated:
            product = np.vdot(a[at_z], b[at_w])
            Q[at_w, at_z] = np.eye(block.rows) * (product / abs(product) if abs(product) else 1.0)
            continue
        lengths = np.linalg.norm(a[at_z]), np.linalg.norm(b[at_w])
        if min(lengths):
            Q[at_w, at_z] = np.outer(b[at_w], a[at_z].conj()) / (lengths[0] * lengths[1])
    values = np.linalg.eigvals(M @ Q)
    largest = values[np.argmax(abs(values))]
    return float(abs(largest)), Q * (abs(largest) / largest if largest else 1.0)
