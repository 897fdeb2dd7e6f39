"""The p-norm of a Hermitian response over frequencies, which ones it is looked at, and its slope.

The largest eigenvalue over all frequencies is not smooth; (sum_omega tr M(omega)^p)^(1/p) is, and is near it for a large p.
"""

import numpy as np
from jaxtyping import Bool, Complex, Float

GRID = 60
"""Frequencies over the range of the poles, besides those at the poles and about each resonance."""

AROUND = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
"""Frequencies about each resonance, in half widths of it."""

MARGIN = 1e-9
"""The part of the largest pole that others count as at least, and by which stable ones are inside: less is rounding,
and a pole at 0 has no frequency of its own."""

NEGLIGIBLE = 4e-3
"""A frequency whose largest eigenvalue adds less than this part of the largest one to the p-norm is left out."""

APART = 1.03
"""Frequencies of a large loop are at least this factor apart: its poles are those of one agent many times, nearly."""

FEW_APART = 1.3
"""The factor between the frequencies that count wherever the top is."""


def are_stable(poles: Complex[np.ndarray, " n"]) -> bool:
    """Tell whether poles are stable as far as doubles tell."""
    return bool(poles.real.max() < -MARGIN * np.abs(poles).max())


def frequencies_of(poles: Complex[np.ndarray, " n"], grid: int = GRID) -> Float[np.ndarray, " f"]:
    """Return frequencies at which a response is looked at: over the range of its poles, and about each."""
    sizes = np.maximum(np.abs(poles), MARGIN * np.abs(poles).max())
    swinging = poles[poles.imag > 0]
    near = swinging.imag[:, None] + np.outer(swinging.real, AROUND)
    between = np.geomspace(1e-2 * float(sizes.min()), 10 * float(sizes.max()), grid)
    return np.unique(np.concatenate([[0.0], between, sizes, swinging.imag, near[near > 0]]))


def thinned(frequencies: Float[np.ndarray, " f"], apart: float = APART) -> Float[np.ndarray, " f"]:
    """Return rising frequencies without those less than a factor above the one before.

    >>> thinned(np.array([0.0, 1.0, 1.01, 1.02, 1.04, 2.0])).tolist()
    [0.0, 1.0, 1.04, 2.0]
    """
    kept = [float(frequencies[0])]
    for one in frequencies[1:]:
        if one >= apart * kept[-1]:
            kept.append(float(one))
    return np.array(kept)


def near_top(levels: Float[np.ndarray, " f"], p: int) -> Bool[np.ndarray, " f"]:
    """Tell which frequencies count in the p-norm, by their largest eigenvalues."""
    return np.asarray(levels >= NEGLIGIBLE ** (1 / p) * levels.max())


def dominant(
    frequencies: Float[np.ndarray, " f"], levels: Float[np.ndarray, " f"], p: int
) -> Bool[np.ndarray, " f"]:
    """Tell which frequencies a descent looks at: those near the top, and a few over the range.

    Without the few a descent lowers the top and raises what it does not see.
    """
    return np.asarray(np.isin(frequencies, thinned(frequencies, FEW_APART)) | near_top(levels, p))


def size_of(M: Complex[np.ndarray, "f d d"]) -> float:
    """Return the largest eigenvalue of Hermitian M within a factor d^(1/8), so that no power of M over it is lost."""
    size = float(np.abs(M).max(initial=0.0))
    if not 0 < size < np.inf:
        return size
    return float(size * np.linalg.norm(np.linalg.matrix_power(M / size, 4), axis=(1, 2)).max() ** 0.25)


def p_norm(M: Complex[np.ndarray, "f d d"], p: int) -> tuple[float, Complex[np.ndarray, "f d d"]]:
    """Return log of (sum_f tr M_f^p)^(1/p) and factors S_f of its slope, <sum S_f S_f^H, dM_f>; infinite where there is none.

    Args:
        M: Hermitian, positive semidefinite but for rounding.
        p: odd. M^((p - 1) / 2) is a few products, where the eigenvectors take ten times as long.
    """
    assert p % 2, "half of p - 1 is a power"
    size = size_of(M)
    if not 0 < size < np.inf:
        return np.inf, M
    unit = M / size
    factor = np.linalg.matrix_power(unit, (p - 1) // 2)
    total = float(np.vdot(factor, unit @ factor).real)
    if not total > 0:
        return np.inf, M
    return np.log(size) + np.log(total) / p, factor / np.sqrt(total * size)


def gram(
    signals: Complex[np.ndarray, "f n s"], others: Complex[np.ndarray, "f n s"] | None = None
) -> Float[np.ndarray, "n n"]:
    """Return the real part of sum s t^H, by default of s s^H."""
    others = signals if others is None else others
    return np.asarray(np.tensordot(signals, others.conj(), ([0, 2], [0, 2])).real)
