"""The generated C of a folder, given to the checker's reader."""

from collections.abc import Sequence
from pathlib import Path

from lockstep.check.c_source.reader import ReadController, read_controller
from lockstep.check.errors import ProblemError


def read_controllers(folder: Path, names: Sequence[str]) -> list[ReadController]:
    """Read `include/<name>.h` and `src/<name>.c` of each agent.

    Raises:
        ProblemError: a file is missing or is no text.
        NotCertified: a file is not of the form that `lockstep generate` writes.
    """
    return [
        read_controller(
            name, _text(folder / "include" / f"{name}.h"), _text(folder / "src" / f"{name}.c"), names
        )
        for name in names
    ]


def _text(path: Path) -> str:
    try:
        # A line's end may be CR LF; a CR alone ends no line in C, so it is left for the reader to refuse.
        return path.read_bytes().decode("utf-8").replace("\r\n", "\n")
    except FileNotFoundError:
        raise ProblemError(
            "there is no such file", where=str(path), remedy="generate the folder again"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ProblemError(f"it cannot be read ({error})", where=str(path)) from None
