"""Figures 3, 4 and 5 again, and the disagreement of all loops on a log axis: PNG and PDF."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from amini.section4.runs import AGREED, HORIZON, Runs
from lockstep.report.canvas import logarithmic
from lockstep.report.export import as_files
from lockstep.report.style import DASHES, LIGHT, line, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 10.0
"""Seconds that the figures show: the rest of a run repeats the noise."""

START = 0.5
"""Seconds of the start that figure 5 shows by themselves."""

WIDTH = 9.6
"""Inches: two columns of panels, as on a page of the paper."""

COLOURS: Mapping[str, str] = {
    "theorem_1": LIGHT["series-1"],
    "corollary_1": LIGHT["ink"],
    "certified_uncertain": LIGHT["series-3"],
    "certified": LIGHT["series-2"],
    "reference_25": LIGHT["series-6"],
}
"""A loop is told by its colour, an arm by its dashes."""

LABELS = (
    r"$\theta_m$ in rad",
    r"$\omega_m$ in rad/s",
    r"$\theta_l$ in rad",
    r"$\omega_l$ in rad/s",
)


def figures(runs: Sequence[Runs]) -> dict[str, bytes]:
    """Return every figure as PNG and PDF, by file name."""
    by_key = {one.contestant.key: one for one in runs}
    drawn = {
        "figure_3": _figure_3(by_key),
        "figure_4": _figure_4(by_key),
        "figure_5": _figure_5(by_key),
        "disagreement": _disagreement(by_key),
    }
    return {
        f"{name}.{kind}": content
        for name, figure in drawn.items()
        for kind, content in as_files(figure, name).items()
    }


def _canvas(rows: int, columns: int, height: float, title: str, **more: Any) -> "tuple[Figure, Any]":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure, figure.subplots(rows, columns, squeeze=False, **more)


@styled
def _figure_3(runs: Mapping[str, Runs]) -> "Figure":
    """States, published on the left, certified on the right; gains uncertain and certain in one panel."""
    title = "Figure 3 again: the states of the arms under noise"
    figure, axes = _canvas(4, 2, 9.0, title, sharex=True, sharey="row")
    sides = (("theorem_1", "corollary_1"), ("certified_uncertain", "certified"))
    for column, (keys, gains) in enumerate(zip(sides, ("Published gains", "Certified gains"), strict=True)):
        axes[0, column].set_title(gains, fontweight="bold")
        for state in range(4):
            # The first is drawn last: its name is first in the legend, and it is not covered.
            for depth, key in enumerate(keys):
                _curves(axes[state, column], runs[key], state, 3 - depth)
        axes[3, column].set_xlabel("t in s")
    for state in range(4):
        axes[state, 0].set_ylabel(LABELS[state])
    _name(figure, [runs[key] for keys in sides for key in keys])
    return figure


@styled
def _figure_4(runs: Mapping[str, Runs]) -> "Figure":
    title = "Figure 4 again: the states of the arms with a protocol of [25]"
    figure, axes = _canvas(2, 2, 5.4, title, sharex=True)
    for state, ax in enumerate(axes.T.ravel()):
        _curves(ax, runs["reference_25"], state, 3)
        ax.set_ylabel(LABELS[state])
    _name(figure, [runs["reference_25"]])
    for ax in axes[1]:
        ax.set_xlabel("t in s")
    return figure


@styled
def _figure_5(runs: Mapping[str, Runs]) -> "Figure":
    """Efforts, the first half second on an axis of its own: the kick at the start would hide the rest."""
    keys = ("theorem_1", "reference_25", "certified_uncertain", "certified")
    title = "Figure 5 again: the effort of the controllers under noise"
    figure, axes = _canvas(4, 2, 9.0, title, width_ratios=(1, 2.2))
    for row, (key, letter) in enumerate(zip(keys, "abcd", strict=True)):
        _effort(axes[row, 0], runs[key], 0.0, START)
        _effort(axes[row, 1], runs[key], START, SHOWN)
        axes[row, 0].set_title(f"({letter}) {runs[key].contestant.name}", fontweight="bold")
        axes[row, 0].set_ylabel("u in V")
    axes[3, 0].set_xlabel("t in s: the start")
    axes[3, 1].set_xlabel("t in s: the rest, on a scale of its own")
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@styled
def _disagreement(runs: Mapping[str, Runs]) -> "Figure":
    """Both on log axes; without a disturbance down to 1e-10, since lower values say nothing more."""
    figure, axes = _canvas(1, 2, 4.0, "How far the arms are apart")
    titles = ("No disturbance", "The same noise for all")
    for ax, which, title in zip(axes[0], ("quiet", "noisy"), titles, strict=True):
        for key, one in runs.items():
            run = getattr(one, which)
            ax.semilogy(run.t, run.disagreement(), color=COLOURS[key], label=one.contestant.name)
        ax.set_title(title, fontweight="bold")
        ax.set_xlabel("t in s")
        ax.set_xlim(0, HORIZON)
        logarithmic(ax.yaxis)
    start = float(runs["certified"].quiet.disagreement()[0])
    axes[0, 0].axhline(AGREED * start, color=LIGHT["soft"], linestyle=(0, (4, 3)), linewidth=0.9)
    axes[0, 0].text(
        HORIZON, AGREED * start * 1.3, f"{AGREED:g} of the start", ha="right", color=LIGHT["soft"]
    )
    axes[0, 0].set_ylim(bottom=1e-10)
    axes[0, 0].set_ylabel(r"disagreement $|x_d|$")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _curves(ax: "Axes", one: Runs, state: int, depth: int) -> None:
    run = one.noisy
    for i in range(run.N):
        ax.plot(
            run.t,
            run.x[:, i, state],
            color=COLOURS[one.contestant.key],
            linestyle=DASHES[i],
            zorder=depth,
        )
    ax.set_xlim(0, SHOWN)


def _effort(ax: "Axes", one: Runs, since: float, until: float) -> None:
    run = one.noisy
    shown = (run.t >= since) & (run.t <= until)
    for i in range(run.N):
        ax.plot(run.t[shown], run.u[shown, i, 0], label=f"arm {i + 1}", **line(i))
    ax.set_xlim(since, until)


def _name(figure: "Figure", runs: Sequence[Runs]) -> None:
    """Name the loops by colour and the arms by dashes."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=COLOURS[one.contestant.key], label=one.contestant.name) for one in runs]
    handles += [
        Line2D([], [], color=LIGHT["soft"], linestyle=DASHES[i], label=f"arm {i + 1}") for i in range(3)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
