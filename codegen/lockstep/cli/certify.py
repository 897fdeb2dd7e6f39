"""`lockstep certify`: the independent checker.

Of a design file it proves the continuous controllers, and the sampled, rounded ones that would ship. The exit status is
1 where a claim of the file fails: the continuous one, or the sampled one (that it is certified, its rho, its max_period)
if the file makes it; no period is looked for. A file that says itself that its sampled controllers are not certified
claims nothing of them and keeps status 0, though the answer says it all the same. Of a folder it proves the C in it, which
claims both: either failing is status 1.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, of_file, respond, two_columns
from lockstep.cli.design import floor_row, sampled_text, single_slopes
from lockstep.cli.files import read_design

if TYPE_CHECKING:
    from lockstep.lmi.certify import Verdict
    from lockstep.lmi.document import Stored

MANIFEST_NAME = "manifest.json"

COVERS = {
    "global": "the continuous controllers, for every disturbance and every initial state",
    "local": "the continuous controllers, while every agent stays in its domain",
    None: "nothing",
}


def run(path: Path, *, as_json: bool) -> None:
    """Certify a design file."""
    respond(as_json, lambda: _certify(path))


def _certify(path: Path) -> Answer:
    from lockstep.lmi.certify import certify

    stored = read_design(path)
    with of_file(path):
        verdict = certify(stored)
        return (_with_folder if is_generated(path) else _with_design)(path, stored, verdict)


def _with_design(_path: Path, stored: "Stored", verdict: "Verdict") -> Answer:
    """Certify a design file alone: its gains, and the controllers they are sampled and rounded to."""
    from lockstep.codegen.sampled_design import prove_design
    from lockstep.lmi.certify import broken_claim

    held = prove_design(stored, longest=False)
    sampled, document = held.figures(), certificate_document(stored, verdict)
    broken = broken_claim(stored, held.claims(), held.verdict.reason)
    if verdict.certified and broken:
        document |= _not_certified(broken, held.verdict.figures)
    holds = verdict.certified and not broken
    document |= {"ok": holds, "sampled": sampled}
    rows = {"sampled": sampled_text(sampled), **({"refused": broken} if broken else {})}
    return Answer(document, _table(stored, verdict, rows), holds)


def _not_certified(reason: str, figures: Mapping[str, Any]) -> dict[str, Any]:
    error = {"kind": "NotCertified", "message": reason, "figures": dict(figures)}
    return {"error": error, "reason": reason}


def is_generated(path: Path) -> bool:
    """Tell whether a path is a folder of generated C."""
    return path.is_dir() and (path / MANIFEST_NAME).is_file()


def _with_folder(path: Path, stored: "Stored", verdict: "Verdict") -> Answer:
    """Certify the design and the C beside it: both must hold, and the C must be what its manifest says."""
    from lockstep.codegen.c_certificate import certify_folder
    from lockstep.codegen.sampled_design import prove_design
    from lockstep.lmi.certify import broken_claim

    if verdict.certified:
        designed = prove_design(stored, longest=False)
        broken = broken_claim(stored, designed.claims(), designed.verdict.reason)
        verdict = replace(verdict, certified=False, reason=f"design.json: {broken}") if broken else verdict
    folder = certify_folder(path, stored, verdict)
    proved, sampled = folder.held.verdict, folder.held.figures()
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
        "sampled": sampled,
    }
    rows = {
        "sampled C": sampled_text(sampled),
        "as generated": "; ".join(folder.differences) or "yes",
        **({"not proved": f"what is in {', '.join(folder.not_proved)}"} if folder.not_proved else {}),
    }
    return Answer(document, _table(stored, verdict, rows), verdict.certified and folder.ok)


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


def _table(
    stored: "Stored",
    verdict: "Verdict",
    more: Mapping[str, str] = MappingProxyType({}),
) -> RenderableType:
    rows = {"certified": "yes" if verdict.certified else "NO", "because": verdict.reason}
    if stored.claims.rho is not None:
        rows["rho"] = f"{stored.claims.rho:.6g}"
    if verdict.certified:
        rows |= floor_row(stored.claims.floor)
    rows["alpha"] = f"{stored.claims.alpha:.9g}"
    rows |= single_slopes(stored.claims.document())
    rows["covers"] = COVERS[verdict.scope]
    if verdict.initial is not None:
        rows["initial states"] = verdict.initial.text()
    return two_columns(stored.problem.title, {**rows, **more})
