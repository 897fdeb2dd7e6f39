"""How figures look: one palette for print, PNG and PDF, and the names under which a page gives it light and dark shades.

A figure is drawn in the light colours below. In a page each of them becomes a CSS variable with that colour as its
fallback, so the same drawing follows the reader's colour scheme.
"""

import functools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

SHADES: Mapping[str, tuple[str, str]] = {
    "ink": ("#1c2128", "#e8ecf1"),
    "soft": ("#59636e", "#a6b0bb"),
    "grid": ("#d5dae0", "#37404a"),
    "paper": ("#fefefe", "#12161b"),
    "series-1": ("#0b5cad", "#74b8ff"),
    "series-2": ("#b93a06", "#ffa06b"),
    "series-3": ("#13753a", "#63d48f"),
    "series-4": ("#7b26c9", "#cda6ff"),
    "series-5": ("#0d6b86", "#57d0e0"),
    "series-6": ("#b01657", "#ff8fc0"),
    "series-7": ("#7d4a0b", "#e3b768"),
    "series-8": ("#4d5560", "#b3bcc6"),
}
"""Each colour's light shade, and its dark one.

Each has a contrast of 4.5 or more against its paper, but the grid, which carries no information.
"""

LIGHT = {name: light for name, (light, _) in SHADES.items()}
DARK = {name: dark for name, (_, dark) in SHADES.items()}

SERIES = tuple(name for name in LIGHT if name.startswith("series-"))
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.6)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1, 3, 1, 1, 1)),
    (0, (8, 2)),
    (0, (2, 2)),
    (0, (4, 1, 1, 1, 1, 1)),
)
"""A line is told from the others by its dashes too: colour alone is not enough for every reader and printer."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

WIDTH = 4.2
"""Inches: at this width the lettering is readable on a telephone without enlarging it."""

_SETTINGS: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.5,
    "legend.fontsize": 9.5,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "text.color": LIGHT["ink"],
    "axes.labelcolor": LIGHT["ink"],
    "axes.edgecolor": LIGHT["soft"],
    "axes.titlecolor": LIGHT["ink"],
    "xtick.color": LIGHT["soft"],
    "ytick.color": LIGHT["soft"],
    "xtick.labelcolor": LIGHT["ink"],
    "ytick.labelcolor": LIGHT["ink"],
    "grid.color": LIGHT["grid"],
    "grid.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "svg.fonttype": "none",
    "pdf.fonttype": 3,
}


@contextmanager
def settings(**more: Any) -> Iterator[None]:
    """Draw and write under these settings, whatever the user's own matplotlib is set to."""
    import matplotlib.style

    with matplotlib.style.context(["default", {**_SETTINGS, **more}]):
        yield


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Make a function that draws do so under `settings`."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        with settings():
            return draw(*args, **kwargs)

    return drawn


def colour(k: int) -> str:
    """Return the colour of series k = 0, 1, ..., again from the first after the last.

    >>> colour(0) == colour(8)
    True
    """
    return LIGHT[SERIES[k % len(SERIES)]]


def line(k: int) -> dict[str, Any]:
    """Return colour and dashes of series k."""
    return {"color": colour(k), "linestyle": DASHES[k % len(DASHES)]}


def shades(scheme: Mapping[str, str]) -> str:
    """Return a colour scheme as CSS declarations.

    >>> shades({"ink": "#000000"})
    '--ink: #000000;'
    """
    return " ".join(f"--{name}: {value};" for name, value in scheme.items())
