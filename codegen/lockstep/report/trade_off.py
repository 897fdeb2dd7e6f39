"""What rho costs, as a figure: effort, noise and decay over rho, a mark for each proved point, a line through the best."""

from typing import TYPE_CHECKING

from lockstep.lmi.trade_off.pareto import ParetoPoint, pareto_front
from lockstep.report.canvas import legend, panels, rows_of
from lockstep.report.style import LIGHT, colour, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = (("effort", "gain to u"), ("noise", "gain from noise"), ("decay", "decay in 1/s"))
"""A figure of `Figures`, and what stands at its axis."""

MARKS = "o^vsDP*X"
"""Of the families, in the order in which they come: the design first."""

COLUMNS = 3


@styled
def trade_off_figure(points: tuple[ParetoPoint, ...]) -> "Figure":
    """Draw effort, noise and decay over rho, all of them proved; grey lines join the points that none beats in both."""
    families = list(dict.fromkeys(one.family for one in points))
    figure, stack = panels(len(PANELS), 1.5, rows=rows_of(len(families), COLUMNS))
    for axes, (name, label) in zip(stack, PANELS, strict=True):
        best = pareto_front(points, name)
        axes.plot(
            [one.figures.rho for one in best],
            [getattr(one.figures, name) for one in best],
            color=LIGHT["series-8"],
            linewidth=0.8,
            zorder=1,
        )
        for k, family in enumerate(families):
            chosen = [one for one in points if one.family == family]
            axes.scatter(
                [one.figures.rho for one in chosen],
                [getattr(one.figures, name) for one in chosen],
                marker=MARKS[k % len(MARKS)],
                color=colour(k),
                s=26 if k else 60,
                label=family,
                zorder=3 - min(k, 1),
            )
        axes.set_title(label)
        if name != "decay":
            axes.set_yscale("log")
    stack[-1].set_xscale("log")
    stack[-1].set_xlabel("ρ")
    for axis in (stack[-1].xaxis, *(axes.yaxis for axes in stack[:-1])):
        _plain(axis)
    legend(figure, stack[0], COLUMNS)
    return figure


def _plain(axis: object) -> None:
    """Mark 1, 2 and 5 of each power of ten, in plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))  # type: ignore[attr-defined]
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))  # type: ignore[attr-defined]
    axis.set_minor_formatter(NullFormatter())  # type: ignore[attr-defined]


def described(points: tuple[ParetoPoint, ...]) -> str:
    """Return the figure in words with its numbers, for those who cannot see it."""
    own, least = points[0].figures, min(points, key=lambda one: one.figures.rho)
    said = f"{len(points)} sets of gains. The design: rho {own.rho:.4g}, gain to u {own.effort:.4g},"
    said += f" gain from noise {own.noise:.4g}, decay {own.decay:.3g} per second. The least rho among them is"
    return f"{said} {least.figures.rho:.4g}, with a gain to u of {least.figures.effort:.4g}."
