"""Write what the architecture page shows of the code as it stands: the picture of its rooms, and a row for every module.

    python docs/make_architecture.py           writes docs/architecture.svg and the tables of docs/architecture.md
    python docs/make_architecture.py --check   exit status 1 where the page is not what the code gives

A row is the first paragraph of a module's docstring, an arrow an import, those within functions included. The page lists
those of the picture in a comment, so that tests/test_docs.py holds both to the code, whatever draws them.
"""

import argparse
import ast
import itertools
import sys
from collections.abc import Iterator
from pathlib import Path

import networkx as nx

from lockstep.report.export import svg
from lockstep.report.style import LIGHT, settings
from lockstep.workflow.output_files import write_text

ROOT = Path(__file__).parents[1]
PAGE, PICTURE = ROOT / "docs" / "architecture.md", ROOT / "docs" / "architecture.svg"
BEGIN, END = "<!-- modules: python docs/make_architecture.py -->", "<!-- end of the modules -->"
ROOMS = {
    "check": "check",
    "model": "model",
    "lmi": "lmi",
    **dict.fromkeys(("codegen", "verification", "swarm", "campaign", "report", "workflow", "cli"), "codegen"),
}
"""The parts of the package, and the source root of each."""


def folder_of(room: str) -> Path:
    """Return the folder of a part of the package."""
    return ROOT / ROOMS[room] / "lockstep" / room


def modules_of(room: str) -> list[Path]:
    """Return the modules of a part, a folder's `__init__` before what is in the folder."""
    return sorted(
        folder_of(room).rglob("*.py"), key=lambda path: (path.parent, path.stem != "__init__", path)
    )


def described(path: Path) -> str:
    """Return the first paragraph of a module's docstring on one line, as Markdown within a table."""
    said = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n\n")[0]
    return " ".join(said.split()).replace("|", "\\|")


def imports_of(path: Path) -> Iterator[str]:
    """Yield the parts of the package that a module imports from, within functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        yield from (name.split(".")[1] for name in names if name.startswith("lockstep."))


def arrows() -> "nx.DiGraph[str]":
    """Return the parts and their imports, without an arrow where a chain of others says the same."""
    graph: nx.DiGraph[str] = nx.DiGraph()
    graph.add_nodes_from(ROOMS)
    for room in ROOMS:
        found = {name for path in modules_of(room) for name in imports_of(path)} & ROOMS.keys() - {room}
        graph.add_edges_from((room, name) for name in found)
    return nx.transitive_reduction(graph)


def tables() -> str:
    """Return a table for each folder of the package, of a folder without modules what it holds."""
    parts = []
    for room in ROOMS:
        for folder, paths in itertools.groupby(modules_of(room), key=lambda path: path.parent):
            place = folder.relative_to(ROOT / ROOMS[room] / "lockstep")
            package, *modules = paths
            parts.append(f"\n### {place.as_posix()}\n\n{described(package)}")
            rows = [f"| `{path.stem}` | {described(path)} |" for path in modules]
            parts += ["\n| module | what it does |\n|---|---|", *rows] if rows else []
    return "\n".join(parts).strip()


def picture() -> bytes:
    """Return the drawing of the parts, those that import nothing of the package at the bottom."""
    from matplotlib.figure import Figure

    graph = arrows()
    level = {
        room: depth
        for depth, rooms in enumerate(nx.topological_generations(graph.reverse()))
        for room in rooms
    }
    beside = {depth: sorted(room for room in ROOMS if level[room] == depth) for depth in level.values()}
    place = {
        room: (2.6 * (beside[depth].index(room) - (len(beside[depth]) - 1) / 2), 1.1 * depth)
        for room, depth in level.items()
    }
    with settings():
        figure = Figure(figsize=(6.4, 0.75 * len(beside) + 0.4))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(-4.6, 4.6)
        axes.set_ylim(-0.6, 1.1 * len(beside) - 0.5)
        for start, end in sorted(graph.edges):
            axes.annotate(
                "",
                xy=(place[end][0], place[end][1] + 0.3),
                xytext=(place[start][0], place[start][1] - 0.3),
                arrowprops={"arrowstyle": "->", "color": LIGHT["soft"]},
            )
        for room, (x, y) in place.items():
            axes.text(
                *(x, y, room),
                ha="center",
                va="center",
                bbox={"boxstyle": "round,pad=0.45", "facecolor": "white", "edgecolor": LIGHT["ink"]},
            )
    return svg(figure, "architecture")


def page() -> str:
    """Return the page with its tables, and the arrows of its picture, as the code gives them."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    drawn = ", ".join(f"{start} on {end}" for start, end in sorted(arrows().edges))
    return f"{head}{BEGIN}\n<!-- drawn: {drawn} -->\n\n{tables()}\n\n{END}{rest.split(END)[1]}"


def main() -> int:
    """Write both files, or tell whether they are as the code gives them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    if parser.parse_args().check:
        return int(PAGE.read_text(encoding="utf-8") != page())
    write_text(PAGE, page())
    PICTURE.write_bytes(picture())
    return 0


if __name__ == "__main__":
    sys.exit(main())
