"""Where designs are read from and outputs may go."""

import os
from pathlib import Path
from typing import Any

from lockstep.model.errors import ProblemError

DESIGN_NAME = "design.json"


def check_writable(output: Path | None) -> None:
    """Refuse an output that could not be written, before hours are spent on what goes into it."""
    if output is None:
        return
    if output.is_dir():
        raise ProblemError("it is a folder", where=str(output), expected="a file to write")
    if not output.parent.is_dir():
        raise ProblemError("there is no such folder", where=str(output.parent), remedy="make it first")
    if not os.access(output.parent, os.W_OK):
        raise ProblemError("the folder is not writable", where=str(output.parent))


def read_design(path: Path) -> tuple[dict[str, Any], Any]:
    """Return a design file's content and what it says, from the file or from a folder that holds it."""
    from lockstep.lmi.document import load_json, parse

    place = path / DESIGN_NAME if path.is_dir() else path
    content = load_json(place)
    return content, parse(content, str(place))
