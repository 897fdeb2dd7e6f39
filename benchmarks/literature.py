"""Published gains beside ours, on problems from the literature: both certified in the same loop, with the same weights.

Run by hand:  python benchmarks/literature.py [NAME]... [--json] [--update]

Each problem file of examples/literature holds the published gains; `certify`ing them gives their rho. Ours are designed
for the same problem, with `order` and `gain_limit` as in `ROWS`. --update writes the table of docs/literature.md.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from page import markdown, write

from lockstep.lmi.design import design
from lockstep.model.problem import Problem, load_problem

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "literature.md"
BEGIN, END = "<!-- table: python benchmarks/literature.py --update -->", "<!-- end of the table -->"
HEAD = (
    "problem", "their rho", "our rho", "floor", "their order", "our order", "their largest norm", "our gain limit",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A problem file with published gains, and what is asked of ours.

    order, gain_limit, starts, method: of our design;  rho: of the published gains where it is known in closed form.
    """

    name: str
    label: str
    file: str
    order: int
    gain_limit: float
    starts: int = 4
    rho: float | None = None
    method: str = "certified"


ROWS = (
    Row("theorem-1", "Amini et al., arms, Table 1 (I)", "examples/literature/amini_theorem_1.toml", 2, 50.0),
    Row("corollary-1", "Amini et al., arms, Table 1 (II)", "examples/table_1.toml", 2, 50.0),
    Row("li", "Li, Liu and Fu, six arms", "examples/literature/li_liu_fu.toml", 0, 91.3, method="modal"),
    Row(
        "olfati-saber",
        "Olfati-Saber and Murray, cycle of ten",
        "examples/literature/olfati_saber_murray.toml",
        1,
        1.0,
        2,
        rho=1 / (1 - np.cos(np.pi / 5)),
    ),
    Row("chua", "Chua et al., two circuits", "examples/literature/chua.toml", 2, 6.0),
    Row("observer", "Rajamani and Cho, an observer", "examples/literature/rajamani_cho.toml", 0, 57.2, 2),
)


@dataclass(frozen=True)
class Measured:
    """The figures of a row; every rho, and the floor, is that of an exact proof; no floor where none is proved."""

    name: str
    label: str
    their_order: int
    their_norm: float
    their_rho: float
    our_order: int
    our_limit: float
    our_norm: float
    our_rho: float
    floor: float | None
    alpha: float
    seconds: float


def measured(row: Row, jobs: int | None = None) -> Measured:
    """Certify the published gains and design ours."""
    start = time.process_time()
    theirs = design(load_problem(ROOT / row.file))
    ours = design(our_problem(row), jobs=jobs)
    if theirs.certificate is None or ours.certificate is None:
        raise SystemExit(f"{row.name}: not certified")
    return Measured(
        row.name,
        row.label,
        theirs.gains.order,
        max(theirs.problem.gain_norms(theirs.gains.blocks)),
        theirs.certificate.rho,
        row.order,
        row.gain_limit,
        max(ours.problem.gain_norms(ours.gains.blocks)),
        ours.certificate.rho,
        None if ours.floor is None else ours.floor.rho,
        theirs.claim.alpha,
        time.process_time() - start,
    )


def our_problem(row: Row) -> Problem:
    """Return the problem of a row with its gains taken away and ours asked for."""
    table: dict[str, Any] = load_problem(ROOT / row.file).document()
    table["design"].pop("gains")
    table["design"] |= {
        "method": row.method,
        "order": row.order,
        "gain_limit": row.gain_limit,
        "starts": row.starts,
    }
    return Problem.from_document(table)


def table_of(found: Sequence[Measured]) -> str:
    """Return the figures as a table in Markdown."""
    return markdown(HEAD, (cells_of(m) for m in found))


def cells_of(m: Measured) -> tuple[str, ...]:
    """Return a row of the table."""
    return (
        m.label,
        f"{m.their_rho:.4g}",
        f"{m.our_rho:.4g}",
        "none" if m.floor is None else f"{m.floor:.4g}",
        str(m.their_order),
        str(m.our_order),
        f"{m.their_norm:.4g}",
        f"{m.our_limit:.4g}",
    )


def main() -> None:
    """Measure the rows that are named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--update", action="store_true", help="write the table of docs/literature.md")
    parser.add_argument("--jobs", type=int)
    asked = parser.parse_args()
    if asked.update and asked.names:
        parser.error("--update measures all rows")
    found = []
    for row in ROWS:
        if row.name in asked.names or not asked.names:
            found.append(measured(row, asked.jobs))
            print(f"{row.name}: {found[-1].seconds:.0f} s of this process", file=sys.stderr)
    if asked.update:
        write(PAGE, BEGIN, END, table_of(found))
    print(json.dumps([asdict(m) for m in found], indent=1) if asked.json else table_of(found))


if __name__ == "__main__":
    main()
