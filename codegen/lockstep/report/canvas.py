"""Panels of a known size with room for their lettering, a legend below them, and logarithmic axes.

The room is fixed in inches: matplotlib's own search for it takes longer than the drawing, and every format has the same.
"""

from typing import TYPE_CHECKING, Any

from lockstep.report.style import WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEFT, RIGHT, TITLE, AXIS, ROW = 0.6, 0.2, 0.29, 0.48, 0.21
"""Inches: for tick labels, for half a tick label, above a panel, below the last one, and for a row of the legend."""

_BELOW: dict[str, Any] = {
    "loc": "lower center",
    "borderpad": 0.1,
    "borderaxespad": 0.2,
    "labelspacing": 0.25,
    "columnspacing": 1.2,
    "handlelength": 2.4,
}

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def panels(count: int, height: float, *, rows: int = 0) -> "tuple[Figure, list[Axes]]":
    """Return a figure with `count` panels one below the other over one axis, each `height` inches high.

    rows: of a legend that will go below them.
    """
    from matplotlib.figure import Figure

    below = AXIS + ROW * rows + (0.06 if rows else 0.0)
    total = count * (height + TITLE) + below
    figure = Figure(figsize=(WIDTH, total))
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)
    figure.subplots_adjust(
        left=LEFT / WIDTH,
        right=1 - RIGHT / WIDTH,
        top=1 - TITLE / total,
        bottom=below / total,
        hspace=TITLE / height,
    )
    return figure, [row[0] for row in axes]


def legend(figure: "Figure", axes: "Axes", columns: int) -> None:
    """Put the legend of a panel below all of them.

    Names that are too long for so many columns get fewer, and the figure grows by the rows; a name that is too long
    for one gets smaller letters.
    """
    names = axes.get_legend_handles_labels()
    most, entries = (WIDTH - RIGHT) * figure.dpi, len(names[0])
    for n in range(columns, 0, -1):
        drawn = figure.legend(*names, ncols=n, **_BELOW)
        width = drawn.get_window_extent().width
        if width <= most or n == 1:
            break
        drawn.remove()
    if width > most:
        size = float(drawn.get_texts()[0].get_fontsize()) * 0.95 * most / width
        drawn.remove()
        figure.legend(*names, ncols=n, fontsize=size, **_BELOW)
    if more := rows_of(entries, n) - rows_of(entries, columns):
        _grow(figure, ROW * more)


def _grow(figure: "Figure", more: float) -> None:
    """Add `more` inches below the panels, which stay as they are."""
    width, before = figure.get_size_inches()
    total, room = before + more, figure.subplotpars
    figure.set_size_inches(width, total)
    figure.subplots_adjust(
        top=1 - (1 - room.top) * before / total, bottom=(room.bottom * before + more) / total
    )


def rows_of(entries: int, columns: int) -> int:
    """Return how many rows a legend has."""
    return -(-entries // columns)


def logarithmic(*axes: Any) -> None:
    """Mark powers of ten only, written in plain letters."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis in axes:
        axis.set_major_locator(LogLocator(10.0, numticks=7))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))


def power_of_ten(value: float) -> str:
    """Return a power of ten as it is written.

    >>> power_of_ten(1e-3)
    '10⁻³'
    """
    mantissa, _, exponent = f"{value:e}".partition("e")
    return f"10{str(int(exponent)).translate(SUPERSCRIPTS)}" if float(mantissa) == 1 else f"{value:g}"
