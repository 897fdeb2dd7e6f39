"""A trajectory in the terminal: the disagreement as a power of ten, and the inputs, drawn with characters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from lockstep.model.simulation import Trajectory

    Floats = Float[np.ndarray, " K"]

WIDTH, HEIGHT = 96, 18

POINTS = 600
"""More points than a plot of this width can tell apart only cost time."""

MARKERS = "123456789"
"""What the agents' curves are drawn with: legible without colour; more agents than these are not drawn."""


def terminal_plot(trajectory: "Trajectory", *, colour: bool) -> str:
    """Return two plots, one above the other.

    Args:
        trajectory: what to plot.
        colour: with the terminal's colour codes.
    """
    import numpy as np

    few = slice(None, None, max(1, len(trajectory.t) // POINTS))
    t, d = trajectory.t[few], trajectory.disagreement_by_state()[few]
    least = np.where(d > 0, d, max(float(d.max()), 1e-300)).min(axis=0)  # a logarithm has no zero
    powers = np.log10(np.maximum(d, least))
    marks = {MARKERS[j]: j for j in range(min(d.shape[1], 9)) if d[:, j].any()} or {"1": 0}
    names = ", ".join(f"{mark} {trajectory.state_names[j]}" for mark, j in marks.items())
    curves = {mark: powers[:, j] for mark, j in marks.items()}
    upper = _plot("log10 of the disagreement of each state over t in s", t, curves, colour) + names + "\n"
    name, agents = trajectory.agent, range(min(trajectory.N, len(MARKERS)))
    title = f"{{}} of {name}1 (drawn with 1), {name}2 (with 2), ... over t in s"
    lower = [
        _plot(title.format(u), t, {MARKERS[i]: trajectory.u[few, i, k] for i in agents}, colour)
        for k, u in enumerate(trajectory.input_names)
    ]
    return "\n".join([upper, *lower])


def _plot(title: str, t: "Floats", curves: "Mapping[str, Floats]", colour: bool) -> str:
    import plotext

    figure = plotext.figure
    figure.clear()
    figure.theme("simple" if colour else "colorless")
    figure.plot_size(WIDTH, HEIGHT)
    figure.title(title)
    for marker, values in curves.items():
        signal = figure.signal(list(t), list(values), marker=marker)
        signal.lines(True)
        figure.draw(signal)
    figure.legend(active=False)
    text = str(figure.build())
    return text if colour else str(plotext.uncolorize(text))
