"""The independent checker, of a design file or of a folder of generated C.

Of a design file it proves the continuous controllers, and the sampled, rounded ones that would ship. It is refused where
a claim of the file fails: the continuous one, or the sampled one (that it is certified, its rho) if the file makes it;
max_period is computed anew. A file that says itself that its sampled controllers are not certified claims nothing of
them and is not refused, though the answer says it all the same. Of a folder it proves the C in it, which claims both:
either failing refuses it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.workflow.design import Design, as_design
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
    """

    design: Design
    verdict: "Verdict"
    answer: Mapping[str, Any]

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

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        return dict(self.answer)


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
    content, stored = found.content, found.stored
    with of_file(path):
        verdict = decided(stored)
        broken = broken_place(content, verdict) if verdict.certified else None
        if broken:
            verdict = replace(verdict, certified=False, reason=broken)
        if path is not None and not isinstance(design, Design) and is_generated(path):
            return DesignVerdict(found, verdict, _with_folder(path, content, stored, verdict))
        return DesignVerdict(found, verdict, _with_design(content, stored, verdict))


def _with_design(content: Mapping[str, Any], stored: "Stored", verdict: "Verdict") -> dict[str, Any]:
    """Certify a design file alone: its gains, and the controllers they are sampled and rounded to."""
    from lockstep.codegen.sampled_design import prove_design

    held = prove_design(stored, content)
    sampled, document = held.figures(), certificate_document(content, stored, verdict)
    broken = broken_claim(content, sampled)
    if verdict.certified and broken:
        document |= _not_certified(broken, held.verdict.figures)
    return {**document, "ok": verdict.certified and not broken, "sampled": sampled}


def broken_claim(content: Mapping[str, Any], proved: Mapping[str, Any]) -> str | None:
    """Say which claim of a design file about its sampled controllers does not hold; None if all do, or none is made.

    >>> broken_claim({"sampled": {"certified": True, "rho": 2.0}}, {"certified": True, "rho": 3.0})
    'the file claims rho = 2 of the sampled loop, but 3 is proved'
    >>> broken_claim({"sampled": {"certified": False}}, {"certified": False})
    """
    claimed = content.get("sampled")
    if not isinstance(claimed, Mapping) or claimed.get("certified") is not True:
        return None
    if not proved["certified"]:
        return str(proved["reason"])
    rho = claimed.get("rho")
    if isinstance(rho, int | float) and (proved["rho"] is None or rho < proved["rho"]):
        found = "none" if proved["rho"] is None else f"{proved['rho']:g}"
        return f"the file claims rho = {rho:g} of the sampled loop, but {found} is proved"
    return None


def broken_place(content: Mapping[str, Any], verdict: "Verdict") -> str | None:
    """Say whether a file claims its certificate for more states than it is proved for; None if it does not."""
    scope, claimed = content.get("scope"), content.get("initial_set")
    if scope is not None and scope != verdict.scope:
        return f"the file says that the certificate is {scope}, but {verdict.scope} is proved"
    proved = None if verdict.initial is None else verdict.initial.document()
    if claimed is not None and claimed != proved:
        found = "none" if verdict.initial is None else verdict.initial.text()
        return f"the file claims other initial states than are proved: {found}"
    return None


def _not_certified(reason: str, figures: Mapping[str, Any]) -> dict[str, Any]:
    error = {"kind": "NotCertified", "message": reason, "figures": dict(figures)}
    return {"error": error, "reason": reason}


def _with_folder(
    path: Path, content: Mapping[str, Any], stored: "Stored", verdict: "Verdict"
) -> dict[str, Any]:
    """Certify the design and the C beside it: both must hold, and the C must be what its manifest says."""
    from lockstep.codegen.c_certificate import certify_folder

    folder = certify_folder(path, stored, content)
    proved, sampled = folder.held.verdict, folder.held.figures()
    certified = verdict.certified and proved.certified
    document = certificate_document(content, stored, verdict)
    if verdict.certified and not proved.certified:
        document |= _not_certified(proved.reason, proved.figures)
    return {
        **document,
        "ok": verdict.certified and folder.ok,
        "certified": certified,
        "proof": "ball" if certified else "none",
        "design": {"certified": verdict.certified, "proof": document["proof"]},
        "differences": list(folder.differences),
        "sampled": sampled,
    }


def certificate_document(content: Mapping[str, Any], stored: "Stored", verdict: "Verdict") -> dict[str, Any]:
    """Return the contract's keys for a verdict."""
    rho = stored.certificate.rho if stored.certificate else None
    floor = stored.floor.rho if stored.floor and verdict.certified else None
    claims = (
        {}
        if verdict.certified
        else {"error": {"kind": "NotCertified", "message": verdict.reason, "figures": dict(verdict.figures)}}
    )
    return {
        "certified": verdict.certified,
        "proof": "exact" if verdict.certified else "none",
        "rho": rho,
        "floor": floor,
        "floor_proof": "none" if floor is None else "exact",
        "alpha": stored.alpha,
        **({"entries": content["entries"]} if stored.entries else {}),
        "fragility": dict(stored.fragility),
        "gains": content["gains"],
        "reason": verdict.reason,
        "scope": verdict.scope,
        "margin": verdict.margin,
        **({} if verdict.initial is None else {"initial_set": verdict.initial.document()}),
        **claims,
    }
