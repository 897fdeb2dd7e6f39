"""What the checker says of a design file or of a folder of generated C, and whether the folder is as it is generated.

Every claim is decided by `lockstep.check.certify`, which is what `lockstep-check` runs. A claim that the file makes is
checked; what it does not claim is not searched for. What is beyond the checker is about folders: nothing stands in them
but what Lockstep writes there, and every text file that follows from the design is rendered again and compared, byte by byte.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.model.html_table import html_table
from lockstep.workflow.design_file import DESIGN_NAME, Design, as_design
from lockstep.workflow.output_files import of_file
from lockstep.workflow.output_folders import is_generated

if TYPE_CHECKING:
    from lockstep.lmi.design_verdict import ClaimDecisions

UNCLAIMED = "the file does not claim it"
NOT_AS_GENERATED = (
    "the folder is not as generated: what its C, comments or manifest say is not what the design gives with this version;"
    " generate it again (`lockstep-check` decides the numbers in the C alone)"
)
UNDECIDED = "not decided: it rests on a claim that fails"


@dataclass(frozen=True, eq=False)
class DesignVerdict:
    """What is proved of a design, or of a folder of generated C.

    Args:
        design: what was checked.
        verdict: of each of its claims.
        answer: the contract's keys.
    """

    design: Design
    verdict: "ClaimDecisions"
    answer: Mapping[str, Any]

    @property
    def ok(self) -> bool:
        """Whether every claim holds: of the design file, and of the C where it is a folder."""
        return bool(self.answer["ok"])

    def __bool__(self) -> bool:
        """Whether every claim holds: `assert lockstep.certify(design)`."""
        return self.ok

    @property
    def certified(self) -> bool:
        """Whether the certificate is proved: of the continuous controllers; of a folder, of those in its C, as generated."""
        return bool(self.answer["certified"])

    @property
    def reason(self) -> str:
        """How it was decided, or which claim fails and by how much."""
        return str(self.answer["reason"])

    @property
    def rho(self) -> float | None:
        """The gain that is proved of the continuous controllers; None: nothing is proved."""
        return self.answer["rho"] if self.verdict.certified else None

    @property
    def sampled(self) -> Mapping[str, Any]:
        """What is proved of the sampled, rounded controllers: `certified`, `period`, `max_period`, `rho`, ..."""
        return dict(self.answer["sampled"])

    @property
    def differences(self) -> tuple[str, ...]:
        """A line for each thing in a folder that is not as generated."""
        return tuple(self.answer.get("differences", ()))

    @property
    def not_proved(self) -> tuple[str, ...]:
        """The files in a folder of which nothing is proved."""
        return tuple(self.answer.get("not_proved", ()))

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        return dict(self.answer)

    def __repr__(self) -> str:
        """Say what was decided."""
        return f"<DesignVerdict of {self.design.title!r}: {'every claim holds' if self.ok else 'refused'}, {self.reason}>"

    def _repr_html_(self) -> str:
        """Return the same in a table, for a notebook."""
        sampled = "certified" if self.sampled.get("certified") is True else "not certified"
        rows = {"every claim holds": "yes" if self.ok else "no", "because": self.reason, "sampled": sampled}
        return html_table(rows.items(), title=self.design.title)


def certify(design: Design | Path | str) -> DesignVerdict:
    """Check a design's proof independently: no solver, exact arithmetic, and nothing that the file says is believed.

    Args:
        design: itself, its file, or a folder that holds one; of a folder of generated C, the C is proved besides, by
            the numbers in it.

    Raises:
        ProblemError: no design, or a problem in it that cannot be posed. A claim that fails is not raised: `ok` and
            `reason` say it.
    """
    from lockstep.codegen.folder.as_generated import compared
    from lockstep.lmi.design_verdict import certify as decided

    found, path = as_design(design)
    with of_file(path):
        of_c = path is not None and is_generated(path)
        file = path / DESIGN_NAME if path is not None and path.is_dir() and not of_c else path
        verdict = decided(found.stored, file)
        document = _document(found, verdict)
        if of_c and path is not None:
            folder = compared(path, found.stored)
            proved = verdict.certified and verdict.proves("sampled") and not folder.differences
            if verdict.ok and folder.differences:
                error = {"kind": "NotCertified", "message": NOT_AS_GENERATED, "figures": {}}
                document |= {"reason": NOT_AS_GENERATED, "error": error}
            document |= {
                "ok": verdict.ok and not folder.differences,
                "certified": proved,
                "proof": "ball" if proved else "none",
                "design": {key: document[key] for key in ("certified", "proof")},
                "differences": list(folder.differences),
                "not_proved": list(folder.not_proved),
            }
    return DesignVerdict(found, verdict, document)


def _document(design: Design, verdict: "ClaimDecisions") -> dict[str, Any]:
    """Return the contract's keys for what is decided of a design file."""
    from lockstep.lmi.document import answer_document, messages_answer

    stored, proved = design.stored, verdict.certified
    said, floor = answer_document(stored), stored.claims.floor if proved else None
    error = {"kind": "NotCertified", "message": verdict.reason, "figures": dict(verdict.figures)}
    return {
        "ok": verdict.ok,
        "certified": proved,
        "proof": "exact" if proved else "none",
        "rho": said["rho"],
        "floor": floor,
        "floor_proof": "none" if floor is None else "exact",
        **{key: said[key] for key in ("alpha", "entries", "fragility", "gains")},
        **{key: said.get(key) if verdict.ok else None for key in ("decay", "controllers_stable", "limits")},
        **{key: said[key] for key in ("spectrum", "max_degree", "graph_proof") if key in said},
        "reason": verdict.reason,
        "scope": verdict.scope,
        "margin": verdict.margin,
        **({"initial_set": _initial_set(design)} if verdict.scope == "local" else {}),
        **({} if verdict.ok else {"error": error}),
        "sampled": _sampled(design, verdict),
        **messages_answer(stored, certified=verdict.proves("messages") and verdict.failed != "messages_rho"),
        **({"fixed": said["fixed"]} if verdict.ok and verdict.proves("fixed") else {}),
    }


def _initial_set(design: Design) -> dict[str, Any]:
    """Return the states from which the agents stay in their domain, as they are claimed."""
    from lockstep.lmi.initial_set import InitialStates, Unavailable

    claimed = design.stored.claims.initial_set
    if claimed is None:
        return Unavailable(UNCLAIMED).document()
    return InitialStates.named(claimed, design.problem.agent()).document()


def _sampled(design: Design, verdict: "ClaimDecisions") -> dict[str, Any]:
    """Return what is proved of the controllers as they ship; what is not, or is not claimed, is None."""
    from lockstep.check.design_file.claims import SampledClaims
    from lockstep.lmi.design_json import sampled_document
    from lockstep.lmi.initial_set import sampled_rate

    claims, table = design.stored.claims.sampled, design.problem.controller
    certified = verdict.proves("sampled")
    longest = claims.max_period if verdict.proves("max_period") else None
    shown = SampledClaims(max_period=longest)
    if certified:
        named = {"sampled_rho": ["rho"], "limits": ["radius", "half_axes"], "limits_gain": ["limits_gain"]}
        named |= {"clipped": ["clipped_radius", "clipped_half_axes"], "sampled_decay": ["fastest_decay"]}
        lost: dict[str, Any] = {
            key: None for name in named if not verdict.proves(name) for key in named[name]
        }
        shown = replace(claims, certified=True, max_period=longest or table.period, **lost)
    made = verdict.verdicts.get("sampled") or verdict.verdicts.get("code")
    reason = made.reason if made else UNDECIDED if claims.certified else UNCLAIMED
    rate = sampled_rate(table.period, shown.decay, shown.fastest_decay)
    of = {"rate": rate, "period": table.period, "delay": table.delay}
    return {"reason": reason, **sampled_document(shown), **of}
