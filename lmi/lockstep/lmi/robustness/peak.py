"""The largest structured singular value of a stable system over frequency.

On a grid about the system's poles the quick bound, then finer about its maxima; the semidefinite program where the quick
bound leaves the maximum open. A figure between frequencies that were looked at, no bound: `every_frequency` proves one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from lockstep.check.errors import ProblemError
from lockstep.lmi.robustness.blocks import Structure
from lockstep.lmi.robustness.d_scaling import balanced, osborne, scaled_norm
from lockstep.lmi.robustness.structured import StructuredValue, structured_singular_value

POINTS = 40
"""Of the grid, per decade."""


@dataclass(frozen=True, eq=False)
class GainPeak:
    """frequency: in rad/s;  value: mu there, from both sides;  M: the response there;  blocks: of the perturbation."""

    frequency: float
    value: StructuredValue
    M: Complex[np.ndarray, "c r"]


def peak(system: Any, blocks: Sequence[int | tuple[int, int]] | None = None) -> GainPeak:
    """Return the largest mu of a stable `control.ss` over frequency, and where.

    Args:
        system: z = M(s) w, or M(z) with a dt.
        blocks: as in `structured_singular_value`.

    Raises:
        ProblemError: an unstable system, for which mu says nothing; blocks that do not fit.
    """
    radius = abs(system.poles()) if system.dt else np.exp(system.poles().real)
    if max(radius, default=0.0) >= 1:
        raise ProblemError(
            "the closed loop is not stable",
            where="structured singular value over frequency",
            expected="a stable loop: margins are those of one",
        )
    structure = Structure.of(blocks, (system.noutputs, system.ninputs))
    respond = response_of(system)
    quick = _remembered(lambda w: _quick(respond(w), structure))
    grid = frequencies_of(system)
    values = [quick(w) for w in grid]
    for k in np.argsort(values)[::-1][:5]:
        quick_peak = _refined(quick, grid, int(k))
        grid, values = np.append(grid, quick_peak), [*values, quick(quick_peak)]
    best: GainPeak | None = None
    for k in np.argsort(values)[::-1]:
        if best is not None and values[k] <= best.value.upper * (1 + 1e-6):
            break
        M = respond(float(grid[k]))
        if best is not None and scaled_norm(M, structure, balanced(M, structure)) <= best.value.upper * (
            1 + 1e-6
        ):
            continue
        found = GainPeak(float(grid[k]), structured_singular_value(M, blocks), M)
        best = found if best is None or found.value.upper > best.value.upper else best
    assert best is not None
    return best


def response_of(system: Any) -> Callable[[float], Complex[np.ndarray, "c r"]]:
    """Return w -> C (s I - A)^-1 B + D, with s = j w or e^(j w dt), s = infinity included."""

    def respond(w: float) -> np.ndarray:
        if np.isinf(w) or not system.nstates:
            return np.asarray(system.D, dtype=complex)
        s = np.exp(1j * w * system.dt) if system.dt else 1j * w
        return np.asarray(
            system.C @ np.linalg.solve(s * np.eye(system.nstates) - system.A, system.B + 0j) + system.D
        )

    return respond


def frequencies_of(system: Any) -> Float[np.ndarray, " k"]:
    """Return 0, a grid in rad/s two decades about the poles, the poles' own, and the last frequency there is."""
    poles = np.asarray(system.poles(), dtype=complex)
    last = np.inf
    if system.dt:
        poles, last = np.log(poles[abs(poles) > 1e-9]) / system.dt, np.pi / system.dt
    sizes = abs(poles)[abs(poles) > 1e-9]
    low, high = (sizes.min() / 100, sizes.max() * 100) if len(sizes) else (1e-2, 1e2)
    high = min(high, last)
    low = min(low, high / 10)
    grid = np.geomspace(low, high, max(int(POINTS * np.log10(high / low)), 2))
    return np.unique(np.concatenate([[0.0, last], grid, sizes[sizes < last], abs(poles.imag)]))


def _quick(M: np.ndarray, structure: Structure) -> float:
    """Return the bound of Osborne's scales."""
    d = np.exp(osborne(M, structure)) if len(structure.blocks) > 1 else np.ones(1)
    return scaled_norm(M, structure, d)


def _remembered(function: Callable[[float], float]) -> Callable[[float], float]:
    known: dict[float, float] = {}

    def value(w: float) -> float:
        if float(w) not in known:
            known[float(w)] = function(float(w))
        return known[float(w)]

    return value


def _refined(quick: Callable[[float], float], grid: np.ndarray, k: int) -> float:
    """Return the frequency of a maximum between the neighbours of a grid point."""
    from scipy.optimize import minimize_scalar

    ordered = np.sort(grid)
    at = int(np.searchsorted(ordered, grid[k]))
    low, high = ordered[max(at - 1, 0)], ordered[min(at + 1, len(ordered) - 1)]
    if not np.isfinite(high):
        return float(grid[k])
    found = minimize_scalar(
        lambda w: -quick(w), bounds=(low, high), method="bounded", options={"xatol": 1e-6 * high}
    )
    return float(found.x) if -found.fun > quick(float(grid[k])) else float(grid[k])
