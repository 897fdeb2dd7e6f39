"""Execute the notebooks, and keep what they print and draw.

    python docs/make_notebooks.py [FIELD ...]

They are committed as executed, so that they can be read without running them; tests/test_gallery.py executes them again.
"""

import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent / "notebooks"
LONGEST = 600
"""Seconds that one cell may take."""

SHOWN = {
    "states": "states of all agents against time",
    "disagreement": "distance from agreement against time",
    "effort": "inputs of all agents against time",
    "phase": "two states of each agent against each other",
}
"""What a picture shows, by what `plot` is asked for: for those who do not see it."""


def tidied(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Return a notebook without times and counts, its pictures described."""
    title = notebook.cells[0].source.splitlines()[0].removeprefix("# ")
    for cell in notebook.cells:
        plots = re.findall(r'plot\("(\w+)"\)', cell.source) if cell.cell_type == "code" else []
        cell.metadata = {"mystnb": {"image": {"alt": f"{title}: {SHOWN[plots[-1]]}"}}} if plots else {}
        if cell.cell_type == "code":
            cell.execution_count = None
            for output in cell.outputs:
                output.pop("execution_count", None)
                if output.output_type == "execute_result":
                    output["execution_count"] = None
                output.get("data", {}).pop("text/plain", None)
    notebook.metadata = {
        "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
        "language_info": {"name": "python"},
    }
    return notebook


def executed(path: Path) -> nbformat.NotebookNode:
    """Return a notebook with its outputs.

    Raises:
        CellExecutionError: a cell ends with an exception.
    """
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=LONGEST, resources={"metadata": {"path": str(FOLDER)}}).execute()
    return tidied(notebook)


def main() -> None:
    """Execute those that are named, or all."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        if sys.argv[1:] in ([], [path.stem]) or path.stem in sys.argv[1:]:
            nbformat.write(executed(path), path)


if __name__ == "__main__":
    main()
