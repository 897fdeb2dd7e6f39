"""A design: made of a problem, or read from a design file; the same object either way."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.check.certify import DESIGN_NAME as DESIGN_NAME
from lockstep.check.files import as_text, read_inside
from lockstep.check.json_text import A_DESIGN, parse_json
from lockstep.lmi.document import Stored, answer_document, parse, read, sampled_answer
from lockstep.model.agents.arguments import units_text
from lockstep.model.html_table import html_table
from lockstep.model.plain_json import to_json
from lockstep.model.problem import Problem
from lockstep.workflow.output_files import check_writable, seen, write_text
from lockstep.workflow.python_control import Analysis

if TYPE_CHECKING:
    from lockstep.check.system.loop import Gains
    from lockstep.model.network import Network


@dataclass(frozen=True, eq=False)
class Design(Analysis):
    """A design file: the problem, one controller per agent, what is claimed of the loop, and the witnesses.

    Its figures are claims, made by whoever wrote the file; `lockstep.certify` decides whether they hold.

    Args:
        stored: the file, checked and typed; two designs are equal if their files are.
        folder: the folder that it was read from, if it was one: of generated C, perhaps.
        reused: whether it was made before and proved again, rather than searched for.

    >>> problem = Problem.parse('''
    ... [agent]
    ... states = ["x"]
    ... inputs = ["u"]
    ... dynamics = { x = "u - sin(x)" }
    ... outputs = { y = "x" }
    ... [network]
    ... agents = 2
    ... topology = "complete"
    ... [design]
    ... method = "given"
    ... gains = [{ D = [[-2.0]] }, { D = [[-2.0]] }]
    ... ''')
    >>> from lockstep.workflow.design import design
    >>> found = design(problem)
    >>> found.certified, found.alpha, found.gains.D[0].tolist(), found.sampled["certified"]
    (True, 1.0, [[-2.0]], True)
    """

    stored: Stored
    folder: Path | None = None
    reused: bool = False

    @classmethod
    def of(cls, content: Any, where: str, folder: Path | None = None) -> "Design":
        """Return the design that a file holds.

        Args:
            content: the file, made of JSON types.
            where: the file's name, for messages.
            folder: the folder it is in, if that is what was named.

        Raises:
            ProblemError: no design file, or a part of it missing or of the wrong shape.
        """
        return cls(parse(content, where), folder)

    def __post_init__(self) -> None:
        """Keep what was made of the file as the file is."""
        for blocks in vars(self.stored.gains).values():
            for block in blocks:
                block.setflags(write=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the file, without what was made of it."""
        return Design, (self.stored, self.folder, self.reused)

    def __eq__(self, other: object) -> bool:
        """Whether the files say the same, wherever they are."""
        if not isinstance(other, Design):
            return NotImplemented
        return self.stored.document() == other.stored.document()

    __hash__ = None  # type: ignore[assignment]

    @property
    def title(self) -> str:
        """The problem's title, for people."""
        return self.problem.title

    @property
    def problem(self) -> Problem:
        """The problem that the design is for."""
        return self.stored.problem

    @property
    def certified(self) -> bool:
        """Whether the continuous controllers are claimed to be certified."""
        return self.stored.claims.certified

    @property
    def rho(self) -> float | None:
        """The claimed gain from the disagreement of the disturbances to the weighted one of the states, in L2."""
        return self.stored.claims.rho

    @property
    def alpha(self) -> float:
        """The claimed bound |phi(a, t) - phi(b, t)| <= alpha |a - b|, phi and v in the units that `alpha_text` names."""
        return self.stored.claims.alpha

    @property
    def alpha_text(self) -> str:
        """The same as text, with the units in which phi and v count."""
        return f"{self.alpha:.9g}{units_text(self.stored.claims.scales or ())}"

    @property
    def floor(self) -> float | None:
        """A rho below which no controllers can be certified, as claimed; None: nothing is claimed."""
        return self.stored.claims.floor

    @property
    def gains(self) -> "Gains":
        """(9): of agent i + 1, `gains.A[i]` is n_c x n_c, `B[i]` n_c x q, `C[i]` m x n_c, `D[i]` m x q."""
        return self.stored.gains

    @property
    def sampled(self) -> Mapping[str, Any]:
        """What is claimed of the controllers as they ship, sampled and rounded: `certified`, `period`, `rho`, ..."""
        return sampled_answer(self.stored)

    @cached_property
    def network(self) -> "Network":
        """The agents on their graph, with the bound of the nonlinearity, which is proved again.

        Raises:
            BoundNotProved: alpha does not bound the nonlinearity.
        """
        from lockstep.lmi.stored_bound import reproved_bound
        from lockstep.model.assembly import network_of

        self.problem.demand_one_graph("for a network of agents")
        return network_of(self.problem, reproved_bound(self.stored))

    def document(self) -> dict[str, Any]:
        """Return the contract's keys: claims at the top, remarks beside them."""
        return answer_document(self.stored)

    def text(self) -> str:
        """Return the text of the design file."""
        return to_json(self.stored.document()) + "\n"

    def save(self, path: Path | str) -> None:
        """Write the design file, as a whole or not at all.

        Raises:
            ProblemError: it cannot be written.
        """
        check_writable(Path(path))
        write_text(Path(path), self.text())

    def trade_off(self) -> str:
        """Return the least rho of these gains for each alpha, as CSV."""
        from lockstep.lmi.trade_off.rho_against_alpha import as_csv, curve

        return as_csv(curve(self.stored))

    def rows(self) -> dict[str, str]:
        """Return what is claimed, name -> text, for people."""
        local = " while every agent stays in its domain" * (self.stored.claims.scope == "local")
        claimed = f"claimed{local}; lockstep.certify(...) decides"
        sampled = self.sampled
        rho = sampled.get("rho")
        held = f"every {sampled.get('period')} s" + ("" if rho is None else f", rho {rho:.6g}")
        return {
            "certified": claimed if self.certified else "no",
            "rho": "none" if self.rho is None else f"{self.rho:.6g}",
            "alpha": "; ".join(filter(None, (self.alpha_text, slopes_text(self.document())))),
            "controllers": f"{self.gains.N} of order {self.gains.order}",
            "sampled": f"{held}: {claimed}" if sampled.get("certified") is True else "not certified",
        }

    def __repr__(self) -> str:
        """Say what is claimed, in a line."""
        return f"<Design {self.title!r}: {', '.join(f'{name} {text}' for name, text in self.rows().items())}>"

    def _repr_html_(self) -> str:
        """Return a table of what is claimed, for a notebook; texts of the file are escaped."""
        return html_table(self.rows().items(), title=self.title)


def slopes_text(content: Mapping[str, Any]) -> str:
    """Return the bounds of single slopes that a certificate needs besides alpha, of what `Design.document` returns."""
    entries = content.get("entries", ())
    return ", ".join(f"|d phi{x['component']}/d v{x['argument']}| <= {x['slope']:.6g}" for x in entries)


def load(path: Path | str) -> Design:
    """Read a design file, or the one in a folder.

    Args:
        path: what `lockstep design`, `generate` or `build` wrote.

    Raises:
        ProblemError: not there, not JSON, not a design file, or a part missing or of the wrong shape.

    >>> load("no_such_file.json")
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: no_such_file.json: there is no such file; expected ...
    """
    path = Path(path)
    with seen(path):
        is_folder = path.is_dir()
    if not is_folder:
        return Design(read(path))
    place = str(path / DESIGN_NAME)
    text = as_text(read_inside(path, DESIGN_NAME, expected=A_DESIGN), place, A_DESIGN)
    return Design.of(parse_json(text, place), place, path)


def as_design(design: Design | Path | str) -> tuple[Design, Path | None]:
    """Return a design, and the path it was read from, if it was."""
    if isinstance(design, Design):
        return design, design.folder
    return load(design), Path(design)
