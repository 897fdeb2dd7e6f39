"""Figures 3, 4 and 5 again, and the disagreement of all loops on a log axis: PNG and PDF."""

import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from lockstep.codegen.section4.runs import AGREED, HORIZON, Runs

if TYPE_CHECKING:
    from collections.abc import Iterator

SHOWN = 10.0
"""Seconds that the figures show: the rest of a run repeats the noise."""

START = 0.5
"""Seconds of the start that figure 5 shows by themselves."""

BLUE, BLACK, GREEN, ORANGE, RED = "#0b5cad", "#1c2128", "#13753a", "#b06000", "#a3123a"
COLOURS: Mapping[str, str] = {
    "theorem_1": BLUE,
    "corollary_1": BLACK,
    "certified_uncertain": GREEN,
    "certified": ORANGE,
    "reference_25": RED,
}
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)))
"""One per arm: an arm is told by its dashes, a loop by its colour."""

LABELS = (
    r"$\theta_m$ in rad",
    r"$\omega_m$ in rad/s",
    r"$\theta_l$ in rad",
    r"$\omega_l$ in rad/s",
)

Files = dict[str, bytes]


def figures(runs: Sequence[Runs]) -> Files:
    """Return every figure as PNG and PDF, by file name."""
    by_key = {one.contestant.key: one for one in runs}
    files: Files = {}
    for name, draw in (
        ("figure_3", _figure_3),
        ("figure_4", _figure_4),
        ("figure_5", _figure_5),
        ("disagreement", _disagreement),
    ):
        files |= _drawn(name, draw, by_key)
    return files


def _drawn(name: str, draw: Callable[[Mapping[str, Runs]], Any], by_key: Mapping[str, Runs]) -> Files:
    """Draw one figure without a display, and without dates in its files."""
    with _style():
        figure = draw(by_key)
        files = {}
        for ending, metadata in (("png", {"Software": None}), ("pdf", {"CreationDate": None})):
            sink = io.BytesIO()
            figure.savefig(sink, format=ending, dpi=150, metadata=metadata)
            files[f"{name}.{ending}"] = sink.getvalue()
    return files


@contextmanager
def _style() -> "Iterator[None]":
    import matplotlib as mpl

    with mpl.rc_context(
        {
            "font.size": 9,
            "axes.grid": True,
            "grid.color": "#d5dae0",
            "grid.linewidth": 0.6,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": "#59636e",
            "lines.linewidth": 1.1,
            "legend.frameon": False,
            "figure.facecolor": "white",
            "pdf.fonttype": 42,
        }
    ):
        yield


def _canvas(rows: int, columns: int, size: tuple[float, float], **more: Any) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **more)


def _figure_3(runs: Mapping[str, Runs]) -> Any:
    """States, published on the left, certified on the right; gains uncertain and certain in one panel."""
    figure, axes = _canvas(4, 2, (9.6, 9.0), sharex=True, sharey="row")
    sides = (("theorem_1", "corollary_1"), ("certified_uncertain", "certified"))
    for column, (keys, title) in enumerate(zip(sides, ("Published gains", "Certified gains"), strict=True)):
        axes[0, column].set_title(title, loc="left", fontweight="bold")
        for state in range(4):
            # The first is drawn last: its name is first in the legend, and it is not covered.
            for depth, key in enumerate(keys):
                _curves(axes[state, column], runs[key], state, 3 - depth)
        axes[3, column].set_xlabel("t in s")
    for state in range(4):
        axes[state, 0].set_ylabel(LABELS[state])
    _name(figure, [runs[key] for keys in sides for key in keys])
    return _headed(figure, "Figure 3 again: the states of the arms under noise")


def _figure_4(runs: Mapping[str, Runs]) -> Any:
    figure, axes = _canvas(2, 2, (9.6, 5.4), sharex=True)
    for state, ax in enumerate(axes.T.ravel()):
        _curves(ax, runs["reference_25"], state, 3)
        ax.set_ylabel(LABELS[state])
    _name(figure, [runs["reference_25"]])
    for ax in axes[1]:
        ax.set_xlabel("t in s")
    return _headed(figure, "Figure 4 again: the states of the arms with a protocol of [25]")


def _figure_5(runs: Mapping[str, Runs]) -> Any:
    """Efforts, the first half second on an axis of its own: the kick at the start would hide the rest."""
    keys = ("theorem_1", "reference_25", "certified_uncertain", "certified")
    figure, axes = _canvas(4, 2, (9.6, 9.0), width_ratios=(1, 2.2))
    for row, (key, letter) in enumerate(zip(keys, "abcd", strict=True)):
        _effort(axes[row, 0], runs[key], 0.0, START)
        _effort(axes[row, 1], runs[key], START, SHOWN)
        axes[row, 0].set_title(
            f"({letter}) {runs[key].contestant.name}", loc="left", fontweight="bold", fontsize=9
        )
        axes[row, 0].set_ylabel("u in V")
    axes[3, 0].set_xlabel("t in s: the start")
    axes[3, 1].set_xlabel("t in s: the rest, on a scale of its own")
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return _headed(figure, "Figure 5 again: the effort of the controllers under noise")


def _disagreement(runs: Mapping[str, Runs]) -> Any:
    """Both on log axes; without a disturbance down to 1e-10, since lower values say nothing more."""
    figure, axes = _canvas(1, 2, (9.6, 4.0))
    for ax, which, title in zip(
        axes[0], ("quiet", "noisy"), ("No disturbance", "The same noise for all"), strict=True
    ):
        for key, one in runs.items():
            run = getattr(one, which)
            ax.semilogy(run.t, run.disagreement(), color=COLOURS[key], label=one.contestant.name)
        ax.set_title(title, loc="left", fontweight="bold")
        ax.set_xlabel("t in s")
        ax.set_xlim(0, HORIZON)
    start = float(runs["certified"].quiet.disagreement()[0])
    axes[0, 0].axhline(AGREED * start, color="#59636e", linestyle=(0, (4, 3)), linewidth=0.9)
    axes[0, 0].text(HORIZON, AGREED * start * 1.3, f"{AGREED:g} of the start", ha="right", color="#59636e")
    axes[0, 0].set_ylim(bottom=1e-10)
    axes[0, 0].set_ylabel(r"disagreement $|x_d|$")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return _headed(figure, "How far the arms are apart")


def _curves(ax: Any, one: Runs, state: int, depth: int) -> None:
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


def _effort(ax: Any, one: Runs, since: float, until: float) -> None:
    run = one.noisy
    shown = (run.t >= since) & (run.t <= until)
    for i in range(run.N):
        colour = (BLUE, ORANGE, GREEN)[i]
        ax.plot(run.t[shown], run.u[shown, i, 0], color=colour, linestyle=DASHES[i], label=f"arm {i + 1}")
    ax.set_xlim(since, until)


def _name(figure: Any, runs: Sequence[Runs]) -> None:
    """Name the loops by colour and the arms by dashes."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=COLOURS[one.contestant.key], label=one.contestant.name) for one in runs]
    handles += [
        Line2D([], [], color="#59636e", linestyle=dash, label=f"arm {i + 1}") for i, dash in enumerate(DASHES)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)


def _headed(figure: Any, title: str) -> Any:
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure
