"""Where a campaign is kept: a folder named by its identity, chunk by chunk, each file there as a whole or not at all.

<output>/campaign-<identity>/chunks/0000000-0000256.npy, ...    what is done; a rerun computes the rest
<output>/campaign-<identity>/runs.parquet (or runs.csv), worst.json, summary.json    once all is done
"""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compute import RunTable, chunks, columns_of
from lockstep.campaign.draw import FAMILIES
from lockstep.campaign.plan import Plan
from lockstep.check.errors import ProblemError
from lockstep.model.whole_file import write_whole

SHORT = 16
_WHOLE_NUMBERS = ("run", "outside", "faults", "clipped")
_TRUTHS = ("covered", "diverged")


@dataclass(frozen=True, eq=False)
class Store:
    """The folder of one campaign."""

    plan: Plan
    output: Path

    @property
    def folder(self) -> Path:
        """The campaign's own folder: a changed design has another."""
        return self.output / f"campaign-{self.plan.identity[:SHORT]}"

    def open(self) -> None:
        """Make the folder.

        Raises:
            ProblemError: it cannot be made, or is another campaign's.
        """
        try:
            (self.folder / "chunks").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ProblemError(f"it cannot be made ({error.strerror})", where=str(self.folder)) from None
        identity = self.folder / "identity"
        if not identity.exists():
            write_whole(identity, self.plan.identity.encode())
        if identity.read_text(encoding="utf-8", errors="replace") != self.plan.identity:
            raise ProblemError(
                "the folder is another campaign's", where=str(self.folder), remedy="name another output"
            )

    def missing(self, runs: int) -> list[tuple[int, int]]:
        """Return the chunks that are not there."""
        return [chunk for chunk in chunks(runs) if self.read(*chunk) is None]

    def keep(self, begin: int, end: int, table: Float[np.ndarray, "runs columns"]) -> None:
        """Keep a chunk; keeping it twice is keeping it once."""
        buffer = io.BytesIO()
        np.save(buffer, table, allow_pickle=False)
        write_whole(self._path(begin, end), buffer.getvalue())

    def read(self, begin: int, end: int) -> Float[np.ndarray, "runs columns"] | None:
        """Return a chunk; None if it is not there or is not one: it is then computed again."""
        try:
            table = np.load(self._path(begin, end), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        fits = table.shape == (end - begin, len(columns_of(self.plan))) and table.dtype == np.float64
        return table if fits and np.array_equal(table[:, 0], np.arange(begin, end)) else None

    def table(self, runs: int) -> RunTable:
        """Return all runs; every chunk must be there."""
        return RunTable(columns_of(self.plan), np.vstack([self._present(*chunk) for chunk in chunks(runs)]))

    def _present(self, begin: int, end: int) -> Float[np.ndarray, "runs columns"]:
        found = self.read(begin, end)
        if found is None:
            raise ProblemError(
                f"the runs {begin} to {end - 1} are gone",
                where=str(self.folder),
                remedy="run the campaign again",
            )
        return found

    def _path(self, begin: int, end: int) -> Path:
        return self.folder / "chunks" / f"{begin:07d}-{end:07d}.npy"

    def publish(self, table: RunTable, documents: dict[str, Any]) -> Path:
        """Write the table and JSON documents by file name; return the table's path."""
        for name, document in documents.items():
            write_whole(self.folder / name, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())
        return _write_table(table, self.folder)


def _write_table(table: RunTable, folder: Path) -> Path:
    """Parquet if pyarrow is installed, else CSV with numbers that read back to the same bits."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        write_whole(folder / "runs.csv", _csv(table).encode())
        return folder / "runs.csv"
    arrays = {name: pyarrow.array(values) for name, values in _typed(table).items()}
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), buffer)
    write_whole(folder / "runs.parquet", buffer.getvalue())
    return folder / "runs.parquet"


def _csv(table: RunTable) -> str:
    typed = {name: values.tolist() for name, values in _typed(table).items()}
    show: Callable[[Any], str] = lambda value: repr(value) if isinstance(value, float) else str(value)  # noqa: E731
    lines = [",".join(typed), *(",".join(map(show, row)) for row in zip(*typed.values(), strict=True))]
    return "\n".join(lines) + "\n"


def _typed(table: RunTable) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for name in table.columns:
        values = table[name]
        if name == "family":
            found[name] = np.array(FAMILIES)[values.astype(int)]
        elif name in _TRUTHS:
            found[name] = values == 1
        else:
            found[name] = values.astype(np.int64) if name in _WHOLE_NUMBERS else values
    return found
