"""What the symbolic checks answer: one row per check, and the whole as plain JSON types."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from lockstep.check.system.loop import Plant
from lockstep.model.bound_search import Bound
from lockstep.model.checks.proved.finding import CheckFinding
from lockstep.model.html_table import html_table

Outcome = Literal["ok", "fails", "note"]


@dataclass(frozen=True)
class CheckRow:
    """One check: `ok`, `fails` (consensus or its proof is lost), or `note` (it holds, with a caveat)."""

    name: str
    verdict: Outcome
    figure: str
    """What was found, in a few words or numbers."""
    reason: str
    """Why it matters."""

    def __post_init__(self) -> None:
        if self.verdict not in get_args(Outcome):
            raise ValueError(f"the verdict of `{self.name}` is {self.verdict!r}")

    @property
    def is_telling(self) -> bool:
        """Whether it says something of the problem: what is always so by construction does where it is not so."""
        return self.verdict != "ok" or self.name not in ("numbers", "L 1 = 0", "h(t, 0) = 0")


@dataclass(frozen=True, eq=False)
class CheckReport:
    """All checks of one problem.

    Args:
        rows: in the order in which they are worth reading.
        bound: the bound of phi, for the scales with which `plant` has its G and H.
        plant: the matrices of (2), G and H scaled.
        roots: the agents that reach all others, from 1; empty without a spanning tree.
        controllable, stabilisable: whether (A, B_i) is for every i.
        observable, detectable: whether (A, C) is.
        everywhere: whether the bound holds for every state, so that the certificate is global.
        zeros: per agent, the zeros from u to y with Re s > 0.
        findings: of the checks that prove, where they were asked for; none of them makes a problem fail.
    """

    rows: tuple[CheckRow, ...]
    bound: Bound
    plant: Plant
    roots: tuple[int, ...]
    controllable: bool
    stabilisable: bool
    observable: bool
    detectable: bool
    everywhere: bool
    zeros: tuple[tuple[complex, ...], ...]
    findings: tuple[CheckFinding, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing fails; notes are no failures."""
        return not self.problems

    @property
    def problems(self) -> list[str]:
        """What fails, as text."""
        return [f"{row.name}: {row.figure}" for row in self.rows if row.verdict == "fails"]

    @property
    def notes(self) -> list[str]:
        """What holds with a caveat, as text."""
        return [f"{row.name}: {row.figure}" for row in self.rows if row.verdict == "note"]

    def _repr_html_(self) -> str:
        """Return the rows and findings in a table, for a notebook."""
        found = [(one.name, one.status, one.figure) for one in self.findings]
        return html_table([*((row.name, row.verdict, row.figure) for row in self.rows), *found])

    def document(self) -> dict[str, Any]:
        """Return the report as plain JSON types: what `lockstep check --json` prints."""
        return {
            "ok": self.ok,
            "bound": self._bound(),
            "controllable": self.controllable,
            "stabilisable": self.stabilisable,
            "observable": self.observable,
            "detectable": self.detectable,
            "graph": {"spanning_tree": bool(self.roots), "roots": list(self.roots)},
            "zeros": [[[z.real, z.imag] for z in zeros] for zeros in self.zeros],
            "problems": self.problems,
            "notes": self.notes,
            "checks": [
                {"name": row.name, "verdict": row.verdict, "figure": row.figure, "reason": row.reason}
                for row in self.rows
            ]
            + [finding.document() for finding in self.findings],
        }

    def _bound(self) -> dict[str, Any]:
        """Return the bound; JSON has no infinity, so a bound that is none is null."""
        bound, witness = self.bound, self.bound.witness
        return {
            "alpha": bound.alpha if np.isfinite(bound.alpha) else None,
            "proved": bound.proved,
            "reached": bound.lower,
            "witness": None if witness is None else {"v": list(witness.v), "t": witness.t},
            "domain": "everywhere" if self.everywhere else "box",
            "G": self.plant.G.tolist(),
            "H": self.plant.H.tolist(),
            "scales": {"G": list(bound.output_scale), "H": list(bound.input_scale)},
            "entries": [
                {"component": one.component + 1, "argument": one.argument + 1, "bound": one.bound}
                for one in bound.entries
            ],
        }
