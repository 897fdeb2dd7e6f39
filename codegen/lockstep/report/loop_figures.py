"""Figures of the linear loop: its poles, and how much gain and phase each input may be off at each frequency."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Complex

from lockstep.report.canvas import legend, panels
from lockstep.report.style import LIGHT, line, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 400


@styled
def poles_figure(poles: Complex[np.ndarray, " n"], dt: float | None = None) -> "Figure":
    """Draw poles, with the edge of stability: the unit circle if there is a dt, else the imaginary axis."""
    figure, (axes,) = panels(1, 2.6)
    if dt:
        angle = np.linspace(0, 2 * np.pi, 200)
        axes.plot(np.cos(angle), np.sin(angle), color=LIGHT["soft"], linewidth=0.8)
        axes.set_aspect("equal")
    else:
        axes.axvline(0.0, color=LIGHT["soft"], linewidth=0.8)
    axes.plot(poles.real, poles.imag, "x", color=LIGHT["series-1"])
    axes.set_title("poles" if dt is None else f"poles, period {dt:g} s")
    return figure


@styled
def margins_figure(sensitivities: Mapping[str, Any]) -> "Figure":
    """Draw the disk margin of each input alone over frequency: 1 / |S - 1/2|.

    Args:
        sensitivities: S at each input, as a `control.ss`.
    """
    figure, (axes,) = panels(1, 2.2, rows=1)
    for k, (name, S) in enumerate(sensitivities.items()):
        poles = S.poles()
        sizes = abs(np.log(poles[abs(poles) > 1e-9]) / S.dt) if S.dt else abs(poles)
        last = np.pi / S.dt if S.dt else 100 * sizes.max(initial=1.0)
        w = np.geomspace(sizes[sizes > 1e-9].min(initial=1.0) / 10, last, POINTS)
        response = np.ravel(S(np.exp(1j * w * S.dt) if S.dt else 1j * w))
        axes.loglog(w, 1 / np.abs(response - 0.5), label=name, **line(k % 8))
    axes.set_xlabel("rad/s")
    axes.set_title("disk margin of each input alone, alpha")
    legend(figure, axes, 4)
    return figure
