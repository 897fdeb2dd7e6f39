"""Commented problem files to begin from, one per field."""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import nearest, shorten
from lockstep.workflow.output_files import check_writable, write_text

BLANK = "blank"
"""The file to fill in where no field is named."""

SCHEMA_NAME = "lockstep-problem.schema.json"
"""The JSON Schema beside a problem file: editors read it from the file's first line."""


@dataclass(frozen=True)
class Begun:
    """A problem file to begin from.

    Args:
        field: of which field it is.
        text: the file.
        written: the files that were written: the problem's, and the schema beside it for editors.
    """

    field: str
    text: str
    written: tuple[Path, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return what `lockstep init --json` prints."""
        return {"ok": True, "field": self.field, "text": self.text, "files": list(map(str, self.written))}


@cache
def fields() -> tuple[str, ...]:
    """Return the names of the fields.

    >>> {"arms", "platoon", "rooms"} <= set(fields())
    True
    """
    found = (one.name for one in files("lockstep.workflow.fields").iterdir())
    return tuple(
        sorted(
            name.removesuffix(".toml") for name in found if name.endswith(".toml") and name != f"{BLANK}.toml"
        )
    )


def init(field: str = BLANK, *, output: Path | str | None = None) -> Begun:
    """Return a commented problem file, and write it if asked to, with the JSON Schema that editors hold it against.

    Args:
        field: one of `fields()`; by default a file to fill in.
        output: where to write it; a file that is there is left as it is.

    Raises:
        ProblemError: an unknown field, or a file that is there or cannot be written.

    >>> init("platoon").text.splitlines()[0]
    '#:schema ./lockstep-problem.schema.json'
    """
    if field not in (*fields(), BLANK):
        raise ProblemError(
            f"`{shorten(field)}` is no field that there is a file of",
            where="lockstep init",
            expected=", ".join(fields()),
            remedy=nearest(field, fields()) or "without a field, a file to fill in is made",
        )
    body = (files("lockstep.workflow.fields") / f"{field}.toml").read_text(encoding="utf-8")
    text = f"#:schema ./{SCHEMA_NAME}\n{body}"
    if output is None:
        return Begun(field, text)
    return Begun(field, text, _written(Path(output), text))


def _written(path: Path, text: str) -> tuple[Path, ...]:
    check_writable(path)
    if path.exists():
        raise ProblemError("it is there already", where=str(path), expected="the name of a new file")
    schema = path.with_name(SCHEMA_NAME)
    demand(schema != path, "that is the schema's name", str(path), "another one, such as problem.toml")
    known = files("lockstep.model.problem") / "schemas" / "problem.draft-07.json"
    write_text(schema, known.read_text(encoding="utf-8"))
    write_text(path, text)
    return path, schema
