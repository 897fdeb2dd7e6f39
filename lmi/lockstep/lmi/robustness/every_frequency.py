"""A bound on mu that holds at every frequency, proved: the bounded real lemma with one constant scaling.

If P > 0 and X > 0, X of the structure, satisfy, continuous or discrete,

    [A'P + P A + C'X_z C    P B + C'X_z D   ]               [A'P A - P + C'X_z C    A'P B + C'X_z D           ]
    [       *            D'X_z D - g^2 X_w  ] < 0    or     [        *           B'P B + D'X_z D - g^2 X_w  ] < 0,

then |X_z^1/2 M X_w^-1/2| < g at every frequency, and mu(M) < g there; perturbations may even vary with time, of any speed.
The inequalities are decided in rationals for the doubles A, B, C, D of the system that was given: what rounding did before,
in making a sampled system say, is not covered.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.check.numbers import exactly
from lockstep.check.psd import decide_positive_definite
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.lmi.robustness.blocks import Structure

STEPS = 12
"""Of the bisection: the last interval is 2^-12 of the first."""


def proved_gain(
    system: Any, blocks: Sequence[int | tuple[int, int]] | None = None, *, steps: int = STEPS
) -> float | None:
    """Return a g for which mu < g is proved at every frequency, as small as a bisection finds, or None.

    Args:
        system: a stable `control.ss`, z = M w.
        blocks: as in `structured_singular_value`, full ones only.

    Raises:
        ProblemError: blocks that do not fit, or repeated ones.
    """
    from lockstep.lmi.robustness.peak import peak

    structure = Structure.of(blocks, (system.noutputs, system.ninputs))
    sizes = [b.rows for b in structure.blocks if b.repeated]
    demand(
        not sizes,
        f"delta I of sizes {sizes}",
        "proved gain",
        "full blocks, (r, c): one scaling is a number for each",
    )
    low = peak(system, blocks).value.lower
    high, found = max(low, 1e-9) * 1.02, None
    while found is None and high < 1e3 * max(low, 1e-9):
        found = high if _proved(system, structure, high) else None
        high *= 1.5
    if found is None:
        return None
    for _ in range(steps):
        middle = (low + found) / 2
        if found - low < 1e-3 * found:
            break
        low, found = (low, middle) if _proved(system, structure, middle) else (middle, found)
    return found


def _proved(system: Any, structure: Structure, g: float) -> bool:
    proposal = _proposed(system, structure, g)
    return proposal is not None and _decided(system, structure, g, *proposal)


def _proposed(system: Any, structure: Structure, g: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return P and the x_i that a solver finds, with a margin."""
    import cvxpy as cp

    T, scaled = _coordinates(system)
    A, B, C, D = scaled
    n = len(A)
    P, x = cp.Variable((n, n), symmetric=True), cp.Variable(len(structure.blocks))
    margin = cp.Variable()
    X_z = cp.diag(
        np.array([[float(r in range(s.start, s.stop)) for s in structure.of_z] for r in range(len(C))]) @ x
    )
    X_w = cp.diag(
        np.array([[float(r in range(s.start, s.stop)) for s in structure.of_w] for r in range(B.shape[1])])
        @ x
    )
    F = _inequality(cp.bmat, (A, B, C, D), bool(system.dt), P, X_z, g**2 * X_w)
    limits = [
        F << -margin * np.eye(n + B.shape[1]),
        P >> margin * np.eye(n),
        x >= 1e-3,
        cp.sum(x) == len(structure.blocks),
    ]
    program = cp.Problem(cp.Maximize(margin), [*limits, margin <= 1])
    if not solve_sdp(program) or P.value is None or margin.value is None or margin.value <= 0:
        return None
    back = np.linalg.inv(T)
    found = back.T @ P.value @ back
    return (found + found.T) / 2, np.asarray(x.value)


def _coordinates(system: Any) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return T and the system in x = T x': states of like size, by the Gramian of its inputs."""
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    A, B, C, D = system.A, system.B, system.C, system.D
    W = solve_discrete_lyapunov(A, B @ B.T) if system.dt else solve_continuous_lyapunov(A, -B @ B.T)
    values, vectors = np.linalg.eigh((W + W.T) / 2)
    floor = max(values.max(initial=0.0), 1e-300) * 1e-10
    T = vectors * np.sqrt(np.maximum(values, floor))
    back = np.linalg.inv(T) if len(A) else T
    return T, (back @ A @ T, back @ B, C @ T, D)


def _decided(
    system: Any, structure: Structure, g: float, P: Float[np.ndarray, "n n"], x: Float[np.ndarray, " b"]
) -> bool:
    """Decide the inequalities for the doubles A, B, C, D, P, x and g."""
    matrices = tuple(exactly(np.asarray(M, dtype=float)) for M in (system.A, system.B, system.C, system.D))
    exact_P, scales, level = exactly(P), exactly(x), exactly(np.array([g]))[0]
    if any(value <= 0 for value in scales) or not decide_positive_definite(exact_P).positive:
        return False
    X_z = _diagonal(scales, [b.columns for b in structure.blocks])
    X_w = _diagonal(scales, [b.rows for b in structure.blocks])
    F = _inequality(np.block, matrices, bool(system.dt), exact_P, X_z, level * level * X_w)
    return decide_positive_definite(-F).positive


def _diagonal(scales: np.ndarray, widths: Sequence[int]) -> np.ndarray:
    values = [scale for scale, width in zip(scales, widths, strict=True) for _ in range(width)]
    whole = exactly(np.zeros((len(values),) * 2))
    for k, value in enumerate(values):
        whole[k, k] = value
    return whole


def _inequality(block: Any, matrices: tuple[Any, ...], discrete: bool, P: Any, X_z: Any, X_w: Any) -> Any:
    """Return the left side, in doubles, rationals or for cvxpy."""
    A, B, C, D = matrices
    if discrete:
        rows = [
            [A.T @ P @ A - P + C.T @ X_z @ C, A.T @ P @ B + C.T @ X_z @ D],
            [B.T @ P @ A + D.T @ X_z @ C, B.T @ P @ B + D.T @ X_z @ D - X_w],
        ]
    else:
        rows = [
            [A.T @ P + P @ A + C.T @ X_z @ C, P @ B + C.T @ X_z @ D],
            [B.T @ P + D.T @ X_z @ C, D.T @ X_z @ D - X_w],
        ]
    return block(rows)
