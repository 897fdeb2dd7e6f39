"""Section 4 again as a folder of figures, with the table as CSV and as a page."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from amini.section4.figures import figures
from amini.section4.runs import Runs, all_runs
from amini.section4.table import to_csv, to_markdown
from lockstep.workflow.output_folders import check_folder, write_files


@dataclass(frozen=True, eq=False)
class Section4:
    """The runs of every loop, and the files that show them.

    folder: where the files are;  names: theirs, in order;  table: Table 2's counterpart as Markdown.
    """

    folder: Path
    runs: tuple[Runs, ...]
    names: tuple[str, ...]
    table: str

    @property
    def ok(self) -> bool:
        """Whether every loop agrees."""
        return all(one.agrees for one in self.runs)

    def document(self) -> dict[str, Any]:
        """Return the answer of `lockstep reproduce --figures`."""
        return {
            "ok": self.ok,
            "directory": str(self.folder),
            "files": list(self.names),
            "runs": [one.document() for one in self.runs],
        }


def section_4(folder: Path, tell: Callable[[str, float], None]) -> Section4:
    """Run every loop, draw the figures, and write them and the table.

    Raises:
        ProblemError: a folder that cannot be written.
    """
    check_folder(folder)
    runs = tuple(all_runs(tell))
    tell("figures", 1.0)
    table = to_markdown(runs)
    texts = {"table_2.csv": to_csv(runs), "table_2.md": table}
    files = {**figures(list(runs)), **{name: text.encode() for name, text in texts.items()}}
    write_files(folder, files)
    return Section4(folder, runs, tuple(sorted(files)), table)
