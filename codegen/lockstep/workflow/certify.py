"""The independent checker, of a design file or of a folder of generated C.

Of a design file it proves the continuous controllers, and the sampled, rounded ones that would ship. It is refused where
a claim of the file fails: the continuous one, or the sampled one (that it is certified, its rho, its max_period) if the
file makes it; no period is looked for. A file that says itself that its sampled controllers are not certified claims
nothing of them and is not refused, though the answer says it all the same. Of a folder it proves the C in it, which
claims both: either failing refuses it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.workflow.design import DESIGN_NAME, Design, as_design
from lockstep.workflow.files import of_file
from lockstep.workflow.folders import is_generated

if TYPE_CHECKING:
    from lockstep.lmi.certify import Verdict
    from lockstep.lmi.document import Stored


@dataclass(frozen=True, eq=False)
class DesignVerdict:
    """What is proved of a design, or of a folder of generated C.

    Args:
        design: what was checked.
        verdict: of the continuous controllers.
        answer: the contract's keys.
        refused: which claim of a design file about its sampled controllers fails; None if none does.
    """

    design: Design
    verdict: "Verdict"
    answer: Mapping[str, Any]
    refused: str | None = None

    @property
    def ok(self) -> bool:
        """Whether every claim holds: of the design file, and of the C where it is a folder."""
        return bool(self.answer["ok"])

    @property
    def certified(self) -> bool:
        """Whether the certificate is proved: of the continuous controllers, of a folder also of those in the C."""
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
        from html import escape

        sampled = "certified" if self.sampled.get("certified") is True else "not certified"
        rows = {"every claim holds": "yes" if self.ok else "no", "because": self.reason, "sampled": sampled}
        body = "".join(f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        return f"<table><caption>{escape(self.design.title)}</caption>{body}</table>"


def certify(design: Design | Path | str) -> DesignVerdict:
    """Check a design's proof independently: no solver, exact arithmetic, and nothing that the file says is believed.

    Args:
        design: itself, its file, or a folder that holds one; of a folder of generated C, the C is proved besides, by
            the numbers in it.

    Raises:
        ProblemError: no design, or a problem in it that cannot be posed. A claim that fails is not raised: `ok` and
            `reason` say it.
    """
    from lockstep.lmi.certify import certify as decided

    found, path = as_design(design)
    stored = found.stored
    with of_file(path):
        verdict = decided(stored)
        if path is not None and is_generated(path):
            return _with_folder(path, found, verdict)
        return _with_design(found, verdict)


def _with_design(design: Design, verdict: "Verdict") -> DesignVerdict:
    """Certify a design file alone: its gains, and the controllers they are sampled and rounded to."""
    from lockstep.codegen.sampled_design import prove_design
    from lockstep.lmi.certify import broken_claim

    stored = design.stored
    held = prove_design(stored, longest=False)
    document = certificate_document(stored, verdict)
    broken = broken_claim(stored, held.claims(), held.verdict.reason)
    if verdict.certified and broken:
        document |= _not_certified(broken, held.verdict.figures)
    document |= {"ok": verdict.certified and not broken, "sampled": held.figures()}
    return DesignVerdict(design, verdict, document, broken)


def _not_certified(reason: str, figures: Mapping[str, Any]) -> dict[str, Any]:
    error = {"kind": "NotCertified", "message": reason, "figures": dict(figures)}
    return {"error": error, "reason": reason}


def _with_folder(path: Path, design: Design, verdict: "Verdict") -> DesignVerdict:
    """Certify the design and the C beside it: both must hold, and the C must be what its manifest says."""
    from lockstep.codegen.c_certificate import certify_folder
    from lockstep.codegen.sampled_design import prove_design
    from lockstep.lmi.certify import broken_claim

    stored = design.stored
    if verdict.certified:
        designed = prove_design(stored, longest=False)
        broken = broken_claim(stored, designed.claims(), designed.verdict.reason)
        verdict = replace(verdict, certified=False, reason=f"{DESIGN_NAME}: {broken}") if broken else verdict
    folder = certify_folder(path, stored, verdict)
    proved = folder.held.verdict
    certified = verdict.certified and proved.certified
    document = certificate_document(stored, verdict)
    if verdict.certified and not proved.certified:
        document |= _not_certified(proved.reason, proved.figures)
    document |= {
        "ok": verdict.certified and folder.ok,
        "certified": certified,
        "proof": "ball" if certified else "none",
        "design": {"certified": verdict.certified, "proof": document["proof"]},
        "differences": list(folder.differences),
        "not_proved": list(folder.not_proved),
        "sampled": folder.held.figures(),
    }
    return DesignVerdict(design, verdict, document)


def certificate_document(stored: "Stored", verdict: "Verdict") -> dict[str, Any]:
    """Return the contract's keys for a verdict."""
    from lockstep.lmi.document import answer

    said = answer(stored)
    floor = stored.claims.floor if verdict.certified else None
    refused = (
        {}
        if verdict.certified
        else {"error": {"kind": "NotCertified", "message": verdict.reason, "figures": dict(verdict.figures)}}
    )
    return {
        "certified": verdict.certified,
        "proof": "exact" if verdict.certified else "none",
        "rho": said["rho"],
        "floor": floor,
        "floor_proof": "none" if floor is None else "exact",
        **{key: said[key] for key in ("alpha", "entries", "fragility", "gains")},
        "reason": verdict.reason,
        "scope": verdict.scope,
        "margin": verdict.margin,
        **({} if verdict.initial is None else {"initial_set": verdict.initial.document()}),
        **refused,
    }
