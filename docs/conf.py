"""The documentation site: Sphinx with MyST, and the API pages from the docstrings."""

import html
import re
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed

from bs4 import BeautifulSoup
from docutils import nodes
from latex2mathml.converter import convert

project = "Lockstep"
author = "The Lockstep developers"
project_copyright = "The Lockstep developers, Apache-2.0"
try:
    release = installed("lockstep-control")
except PackageNotFoundError:  # the sources on the path, not installed
    release = ""

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
nb_execution_mode = "off"  # notebooks are committed as executed; the tests execute them again
exclude_patterns = ["_build", "paper"]
html_theme = "furo"
html_title = "Lockstep"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_show_sphinx = False
nitpicky = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_dmath_allow_labels = False
myst_dmath_allow_space = False  # the dollar of a shell or a price begins no formula
myst_dmath_allow_digits = False
html_math_renderer = "mathml"  # of the page itself: no script and no font is fetched by any reader
myst_heading_anchors = 3
smartquotes_action = "De"  # dashes and dots: the quote of a transpose stays as it is

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
default_role = "code"

_UPWARDS = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+)([^)#]+)[^)]*\)")
"""Links upwards: to other pages, or to files of the repository that are no pages, whose names are shown instead."""

_LITERAL = re.compile(r"(``.*?``|`.*?`)")


def _read(app: object, name: str, source: list[str]) -> None:
    def shown(found: re.Match[str]) -> str:
        outside = found[2].count("../") > name.count("/")
        return f"{found[1]} (`{found[3]}`)" if outside else found[0]

    if str(app.env.doc2path(name)).endswith(".md"):  # type: ignore[attr-defined]
        source[0] = _UPWARDS.sub(shown, source[0])


def _docstring(
    _app: object, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Our docstrings are plain text with doctests: |x| is a norm and not a substitution, A_ is no link."""
    in_doctest = False
    for k, line in enumerate(lines):
        in_doctest = line.lstrip().startswith(">>>") or (in_doctest and bool(line.strip()))
        if not in_doctest and not line.lstrip().startswith(".."):
            field = re.match(r"\s*:[^:]+:", line)
            head = field[0] if field else ""
            parts = _LITERAL.split(line[len(head) :])
            parts[::2] = [re.sub(r"(?<!\\)([|*])|(?<=\w)_(?!\w)", r"\\\g<0>", part) for part in parts[::2]]
            lines[k] = head + "".join(parts)


_COLON = "\ufdd0"
"""Stands for a colon, in no text."""


def _hidden_colon(
    _app: object, what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Napoleon takes what is before the first colon of a property for its type: hide the colon from it."""
    if what in ("property", "attribute", "data") and lines:
        lines[0] = lines[0].replace(":", _COLON)


def _shown_colon(
    _app: object, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    lines[:] = [line.replace(_COLON, ":") for line in lines]


# In the pages: `split` for lines of equations, {|x|} for a norm, \vert in tables, and no \, \{ or _ after a bracket in a
# line of text, which the repository's host takes for its own.
def _formula(node: nodes.math | nodes.math_block, display: str) -> str:
    made = convert(node.astext(), display=display)
    if re.search(r"\\|&(?!#?\w+;)", made):  # what the converter does not know it leaves as it is
        raise ValueError(f"no MathML for {node.astext()!r}: use what latex2mathml knows")
    # Browsers want the bold letter itself.
    return made.replace('<mn mathvariant="bold">1</mn>', "<mn>&#x1D7CF;</mn>")


def _kept(_app: object, page: nodes.document) -> None:
    """Keep formulas and code in one line with the punctuation around them: browsers break there."""
    for found in [*page.findall(nodes.math), *page.findall(nodes.literal)]:
        line, k = found.parent, found.parent.index(found)
        before, after = (line[j] if 0 <= j < len(line) else None for j in (k - 1, k + 1))
        begin = re.search(r"[(\[]*$", before.astext())[0] if isinstance(before, nodes.Text) else ""
        end = re.match(r"[,.;:)\]]*", after.astext())[0] if isinstance(after, nodes.Text) else ""
        if begin or end:
            line[k] = nodes.inline("", "", nodes.Text(begin), found, nodes.Text(end), classes=["kept"])
        if begin:
            line[k - 1] = nodes.Text(before.astext()[: -len(begin)])
        if end:
            line[k + 1] = nodes.Text(after.astext()[len(end) :])


_NUMBER = re.compile(r"(\d(?:\.\d+)?e-\d+)")

_JOINTS = re.compile(r"(?<=[/_.(=,])(?=[^\W\d])")
"""Where a long name may go on in the next line."""

LONG_NAME = 20
"""Characters."""

LEFT_ALONE = ("pre", "code", "math", "script", "style", "svg")


def _whole(_app: object, _page: str, _template: str, context: dict[str, str], _tree: object) -> None:
    """Say to browsers what breaks where: long names and numbers; and what cells are of that are stacked on a phone."""
    page = BeautifulSoup(context.get("body", ""), "html.parser")
    names = [name.string for name in page.select("code .pre") if len(name.string or "") > LONG_NAME]
    numbers = [text for text in page.find_all(string=_NUMBER) if not text.find_parent(LEFT_ALONE)]
    for texts, pattern, made in (
        (names, _JOINTS, "<wbr>"),
        (numbers, _NUMBER, r'<span class="kept">\1</span>'),
    ):
        for text in texts:
            text.replace_with(BeautifulSoup(pattern.sub(made, html.escape(text)), "html.parser"))
    for table in page.select(".stacked table"):
        heads = [head.get_text() for head in table.select("th")]
        for row in table.select("tbody tr"):
            for head, cell in zip(heads[1:], row.select("td")[1:], strict=False):
                cell["data-label"] = "" if len(heads) == 2 or head == "what it is" else f"{head}: "
                if not cell.get_text(strip=True):
                    cell["class"] = [*cell.get("class", []), "empty"]
    context["body"] = page.decode(formatter="minimal")


def _inline(translator: object, node: nodes.math) -> None:
    translator.body.append(_formula(node, "inline"))  # type: ignore[attr-defined]
    raise nodes.SkipNode


def _display(translator: object, node: nodes.math_block) -> None:
    formula = _formula(node, "block")
    translator.body.append(f'<div class="formula">{formula}</div>\n')  # type: ignore[attr-defined]
    raise nodes.SkipNode


def setup(app: object) -> None:
    """Register what is done to pages and docstrings before they are parsed, and how formulas are written."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))  # type: ignore[attr-defined]
    app.connect("doctree-read", _kept)  # type: ignore[attr-defined]
    app.connect("source-read", _read)  # type: ignore[attr-defined]
    app.connect("html-page-context", _whole)  # type: ignore[attr-defined]
    for priority, change in ((100, _hidden_colon), (800, _shown_colon), (900, _docstring)):
        app.connect("autodoc-process-docstring", change, priority=priority)  # type: ignore[attr-defined]
