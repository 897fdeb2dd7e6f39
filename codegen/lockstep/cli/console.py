"""What the command prints: one answer on standard output, everything else on standard error."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import typer
from rich import box
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, Progress, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from lockstep.check.errors import ClaimError, LockstepError, ProblemError
from lockstep.check.wording import visible
from lockstep.model.plain_json import to_json
from lockstep.workflow.waiting.progress_lines import ProgressLines
from lockstep.workflow.waiting.time_left import TimeLeft

HOLDS, FAILS, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
LARGE = 1.0
"""MB, from which on the size of a file that was written is told."""

errors = Console(stderr=True, soft_wrap=True, highlight=False)


@dataclass(frozen=True)
class Answer:
    """What a command found: as JSON, as text, and whether every claim holds."""

    document: Mapping[str, Any]
    text: RenderableType
    holds: bool = True


def respond(as_json: bool, work: Callable[[], Answer]) -> None:
    """Run a command's work, print its answer, and leave with the exit status of the contract."""
    try:
        answer = work()
    except ProblemError as error:
        _leave(as_json, {"ok": False, "error": _problem(error)}, str(error), BAD_INPUT)
    except ClaimError as error:
        document = {"ok": False, "certified": False, **_partial(error), "error": _claim(error)}
        _leave(as_json, document, str(error), FAILS)
    except KeyboardInterrupt as interrupt:
        found = str(interrupt) or "interrupted; nothing was written"
        document = {"ok": False, "error": {"kind": "interrupted", "message": found}}
        _leave(as_json, document, found, INTERRUPTED)
    except Exception as error:
        if os.environ.get("LOCKSTEP_DEBUG"):
            raise
        found = f"internal error, please report it: {type(error).__name__}: {error}"
        _leave(as_json, {"ok": False, "error": {"kind": "internal", "message": found}}, found, FAILS)
    if as_json:
        _print_json(answer.document)
    elif isinstance(answer.text, str):  # as it is: a file that a shell redirects
        typer.echo(answer.text)
    else:
        Console(highlight=False).print(answer.text)
    if not answer.holds:
        raise typer.Exit(FAILS)


def remark(said: str) -> None:
    """Say something beside the answer, on standard error."""
    errors.print(f"lockstep: {visible(said)}", markup=False)


def wrote(*places: Path | None) -> None:
    """Say which files and folders were written, on standard error; None stands for one that was not asked for."""
    made = [place for place in places if place is not None]
    large = (f" ({size:.3g} MB)" * (size >= LARGE) for size in (place.stat().st_size / 1e6 for place in made))
    if said := ", ".join(f"{place}{size}" for place, size in zip(made, large, strict=True)):
        remark(f"written: {said}")


@contextmanager
def left_from_before(place: Path | None) -> Iterator[None]:
    """Say, where a command fails, that what stands where it would have written is as it was."""
    try:
        yield
    except LockstepError:
        if place is not None and place.exists():
            remark(f"{place} was there before, and is as it was")
        raise


def misused(message: str) -> int:
    """Answer a command line that no command understands with JSON, and return the exit status.

    The keys are those of every other bad input; what was expected is in the message.
    """
    remark(message)
    error = {"kind": "usage", "message": message, "found": message, "where": "command line"}
    _print_json({"ok": False, "error": {**error, "expected": "", "remedy": "see `lockstep --help`"}})
    return BAD_INPUT


@contextmanager
def progress_display() -> Iterator[Callable[[str, float], None]]:
    """Show progress on standard error; the callable takes what is being done and the part of it that is done.

    On a terminal it is a bar; elsewhere, in the log of a build server say, plain lines of a long run.
    """
    if not errors.is_terminal:
        with ProgressLines(lambda line: errors.print(line, markup=False)) as lines:
            yield lines.tell
        return
    with Doing() as bars:
        task = bars.add_task("starting", total=1.0)

        def tell(what: str, part: float) -> None:
            bars.left.tell(what, part)
            # The clock of a full bar stands still.
            bars.update(task, description=what, completed=min(part, 0.999))

        yield tell


class Doing(Progress):
    """What is being done, with the time left where that is known, and a bar under it: beside it, it would be cut off."""

    def __init__(self) -> None:
        self.left = TimeLeft()
        super().__init__(BarColumn(bar_width=30), TimeElapsedColumn(), console=errors, transient=True)

    def get_renderables(self) -> Iterable[RenderableType]:
        """Return both."""
        said = (", ".join(filter(None, (one.description, self.left.text()))) for one in self.tasks)
        yield from (Text(one, overflow="fold", no_wrap=False) for one in said)
        yield self.make_tasks_table(self.tasks)


def two_columns(title: str, rows: Mapping[str, str]) -> RenderableType:
    """Return names and what is to be said of each, under a title."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for name, said in rows.items():
        table.add_row(visible(name).replace("\n", " "), Text(visible(said)))
    return Group(Text(visible(title).replace("\n", " "), style="bold underline"), table)


def table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    title: str | None = None,
    words: int = 1,
    **style: Any,
) -> Table:
    """Return rows under headings: the first columns, as many as `words`, on the left, figures on the right."""
    found = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, **style)
    for place, heading in enumerate(headings):
        found.add_column(heading, justify="left" if place < words else "right", overflow="fold")
    for row in rows:
        found.add_row(*row)
    return found


def _leave(as_json: bool, document: Mapping[str, Any], message: str, status: int) -> NoReturn:
    remark(message)
    if as_json:
        _print_json(document)
    raise typer.Exit(status)


def _print_json(document: Mapping[str, Any]) -> None:
    typer.echo(to_json(document))


def _problem(error: ProblemError) -> dict[str, str]:
    said = {name: str(getattr(error, name)) for name in ("found", "where", "expected", "remedy")}
    return {"kind": "problem", "message": str(error), **said}


def _claim(error: ClaimError) -> dict[str, Any]:
    figures = {key: value for key, value in error.figures.items() if key != "design"}
    return {"kind": type(error).__name__, "message": str(error), "figures": _described(figures)}


def _described(figures: Mapping[str, Any]) -> dict[str, Any]:
    known = (str, int, float, bool, list, tuple, dict, type(None))
    return {
        key: value if isinstance(value, known) or hasattr(value, "tolist") else str(value)
        for key, value in figures.items()
    }


def _partial(error: ClaimError) -> Mapping[str, Any]:
    """Return the design a refused method came to, for study."""
    found = error.figures.get("design")
    if found is None:
        return {}
    from lockstep.lmi.document import answer_document, design_file_of

    return answer_document(design_file_of(found))
