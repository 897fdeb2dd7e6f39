"""A figure as SVG for a page, and as PNG and PDF beside it: the same bytes for the same figure, without date or tool."""

import io
import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from markupsafe import Markup

from lockstep.report.style import LIGHT, settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SVG = "http://www.w3.org/2000/svg"
LINK = "{http://www.w3.org/1999/xlink}href"

DOTS_PER_INCH = 160

_SHADES = {value: f"var(--{name}, {value})" for name, value in LIGHT.items()}
_SHADE = re.compile("|".join(map(re.escape, _SHADES)))
_REFERENCE = re.compile(r"url\(#([^)]+)\)")


def inline_svg(figure: "Figure", name: str, description: str) -> Markup:
    """Return a figure as an `<svg>` element for a page.

    Lettering stays text, colours become the page's variables, and every id begins with the figure's name, so that
    figures do not disturb each other.

    Args:
        figure: as drawn.
        name: of the figure, a word for ids.
        description: read out in its place to those who cannot see it.
    """
    root = ElementTree.fromstring(svg(figure, name))
    for parent in root.iter():
        for child in [c for c in parent if c.tag == f"{{{SVG}}}metadata" or _is_style(c)]:
            parent.remove(child)
    for element in root.iter():
        _adapt(element, name)
    for unwanted in ("width", "height", "version"):
        root.attrib.pop(unwanted, None)
    root.set("role", "img")
    root.set("aria-label", description)
    root.set("class", "drawing")
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    return Markup(re.sub(r">\s+<", "><", ElementTree.tostring(root, encoding="unicode")))


def png(figure: "Figure", name: str) -> bytes:
    """Return a figure as PNG on white."""
    return _saved(figure, name, "png", {"Software": None})


def pdf(figure: "Figure", name: str) -> bytes:
    """Return a figure as PDF."""
    return _saved(figure, name, "pdf", dict.fromkeys(("CreationDate", "Creator", "Producer")))


def svg(figure: "Figure", name: str) -> bytes:
    """Return a figure as SVG, a file of its own."""
    return _saved(figure, name, "svg", dict.fromkeys(("Date", "Creator", "Format", "Type")))


def as_files(figure: "Figure", name: str) -> dict[str, bytes]:
    """Return what lies beside a page: content by extension."""
    return {"png": png(figure, name), "pdf": pdf(figure, name)}


def _saved(figure: "Figure", name: str, kind: str, metadata: dict[str, None]) -> bytes:
    memory = io.BytesIO()
    face = "white" if kind == "png" else "none"
    with settings(**{"svg.hashsalt": name}):
        figure.savefig(memory, format=kind, dpi=DOTS_PER_INCH, metadata=metadata, facecolor=face)
    return memory.getvalue()


def _is_style(element: ElementTree.Element) -> bool:
    """Whether this is `<defs>` with matplotlib's style sheet, which would apply to the whole page."""
    return element.tag == f"{{{SVG}}}defs" and any(child.tag == f"{{{SVG}}}style" for child in element)


def _adapt(element: ElementTree.Element, name: str) -> None:
    for key, value in element.attrib.items():
        if key == "id":
            changed = f"{name}-{value}"
        elif key == LINK and value.startswith("#"):
            changed = f"#{name}-{value[1:]}"
        else:
            changed = _REFERENCE.sub(rf"url(#{name}-\1)", value)
            changed = _SHADE.sub(lambda found: _SHADES[found[0]], changed)
            changed = changed.replace("'DejaVu Sans'", "system-ui, sans-serif")
        element.set(key, changed)
