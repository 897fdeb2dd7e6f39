"""A design file: complete enough to be proved again by someone who trusts nothing in it.

    format     "lockstep-design/2"
    problem    the agents, the network, and what is asked: what the claims are about
    gains      (10) of each agent's controller
    claims     everything that is said to be proved: a checker checks each number of it
    proofs     the witnesses that it is checked with
    info       remarks: how the design was found, figures in doubles, reasons; never shown as proved

The file holds the problem, not matrices derived from it: whoever checks it builds them anew. Every number is read as the
IEEE double it denotes, and that double is taken exactly.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from lockstep.check.design_file.claims import Claims, claims_of
from lockstep.check.design_file.problem_part import ProblemPart, Sizes
from lockstep.check.design_file.proofs import Proofs, proofs_of
from lockstep.check.errors import ProblemError, demand
from lockstep.check.json_text import A_DESIGN, each, matrix, only, part, record
from lockstep.check.system.loop import Gains
from lockstep.check.wording import shorten

FORMAT = "lockstep-design/2"
GIVEN = "given"

P = TypeVar("P", bound=ProblemPart)


@dataclass(frozen=True, eq=False)
class DesignFile(Generic[P]):
    """What a design file says, its problem as the reader builds it.

    Raises:
        ProblemError: gains that do not fit the problem, or a witness of another rho or floor than is claimed.
    """

    problem: P
    gains: Gains
    claims: Claims
    proofs: Proofs = field(default_factory=Proofs)
    info: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that the parts belong together."""
        sizes, sampled, initial = self.problem.sizes, self.claims.sampled, self.claims.initial_set
        demand(self.gains.N == sizes.N, f"gains for {self.gains.N} agents", "gains", f"{sizes.N}")
        for axes in (sampled.half_axes, sampled.clipped_half_axes, initial.half_axes if initial else None):
            if axes is not None:
                demand(len(axes) == sizes.n, f"{len(axes)} half-axes", "claims", f"{sizes.n}, one per state")
        for name, witness in (("rho", self.proofs.certificate), ("floor", self.proofs.floor)):
            if witness is not None:
                claimed, found = getattr(self.claims, name), f"a witness of {name} = {witness.rho}"
                demand(witness.rho == claimed, found, "proofs", "what is claimed")


def parse(content: Any, where: str, problem_of: Callable[[Mapping[str, Any]], P]) -> DesignFile[P]:
    """Return what a design file holds.

    Args:
        content: its JSON;  where: its name, for messages;  problem_of: builds the problem from its tables.

    Raises:
        ProblemError: a part missing, unknown, or of the wrong shape.
    """
    found = f"it holds a JSON {type(content).__name__}, not an object"
    demand(isinstance(content, dict), found, where, A_DESIGN)
    found = content.get("format")
    remedy = f"give {A_DESIGN}; `lockstep generate` writes an older one anew"
    demand(found == FORMAT, f"`format` is {shorten(repr(found))}", where, repr(FORMAT), remedy)
    try:
        return _parsed(content, problem_of)
    except ProblemError as error:
        raise error.within(where) from None


def _parsed(content: Mapping[str, Any], problem_of: Callable[[Mapping[str, Any]], P]) -> DesignFile[P]:
    only(content, ("format", "problem", "gains", "claims", "proofs", "info"), "the file")
    problem = problem_of(_with_given_gains(content))
    gains = _gains(content, problem.sizes)
    claims = claims_of(content.get("claims"))
    proofs = proofs_of(content.get("proofs"), claims, problem.sizes)
    return DesignFile(problem, gains, claims, proofs, part(content, "info", dict))


def _with_given_gains(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem of a file, with the file's gains for a method that takes gains and does not repeat them."""
    table: dict[str, Any] = part(content, "problem", dict)
    asked = table.get("design")
    if not isinstance(asked, dict) or asked.get("method") != GIVEN or "gains" in asked:
        return table
    return {**table, "design": {**asked, "gains": part(content, "gains", list)}}


def _gains(content: Mapping[str, Any], sizes: Sizes) -> Gains:
    n_C, m, q = sizes.n_C, sizes.m, sizes.q
    readers = {"A": matrix(n_C, n_C), "B": matrix(n_C, q), "C": matrix(m, n_C), "D": matrix(m, q)}
    found = each(content.get("gains"), "gains", lambda one, place: record(one, place, readers), "agent")
    return Gains(*(tuple(one[k] for one in found) for k in range(4)))
