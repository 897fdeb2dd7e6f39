"""`lockstep certify`: the independent checker."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, of_file, respond, two_columns
from lockstep.cli.design import sampled_text
from lockstep.cli.files import read_design

if TYPE_CHECKING:
    from lockstep.lmi.certify import Verdict
    from lockstep.lmi.document import Stored

MANIFEST_NAME = "manifest.json"

COVERS = {
    "global": "the continuous controllers, for every disturbance and every initial state",
    "local": "the continuous controllers, while every agent stays in its domain; that they do is not shown",
    None: "nothing",
}


def run(path: Path, *, as_json: bool) -> None:
    """Certify a design file."""
    respond(as_json, lambda: _certify(path))


def _certify(path: Path) -> Answer:
    from lockstep.lmi.certify import certify

    content, stored = read_design(path)
    with of_file(path):
        verdict = certify(stored)
        if is_generated(path):
            return _with_folder(path, content, stored, verdict)
    return Answer(certificate_document(content, stored, verdict), _table(stored, verdict), verdict.certified)


def is_generated(path: Path) -> bool:
    """Tell whether a path is a folder of generated C."""
    return path.is_dir() and (path / MANIFEST_NAME).is_file()


def _with_folder(path: Path, content: dict[str, Any], stored: "Stored", verdict: "Verdict") -> Answer:
    """Certify the design and the C beside it: both must hold, and the C must be what its manifest says."""
    from lockstep.codegen.sampled_certificate import certify_folder

    folder = certify_folder(path, stored, content)
    sampled = folder.sampled
    longest = None if folder.longest is None else folder.longest.period
    rho = None if folder.rho is None else folder.rho.rho
    certified = verdict.certified and sampled.certified
    document = certificate_document(content, stored, verdict)
    if verdict.certified and not sampled.certified:
        document["error"] = {
            "kind": "NotCertified",
            "message": sampled.reason,
            "figures": dict(sampled.figures),
        }
        document["reason"] = sampled.reason
    document |= {
        "ok": verdict.certified and folder.ok,
        "certified": certified,
        "proof": "ball" if certified else "none",
        "design": {"certified": verdict.certified, "proof": document["proof"]},
        "differences": list(folder.differences),
        "sampled": {**sampled.document(), "max_period": longest, "rho": rho},
    }
    rows = {
        "sampled C": sampled_text({**sampled.document(), "max_period": longest}),
        "sampled rho": "none proved" if rho is None else f"{rho:.6g}",
        "as generated": "; ".join(folder.differences) or "yes",
    }
    return Answer(document, _table(stored, verdict, rows), verdict.certified and folder.ok)


def certificate_document(content: dict[str, Any], stored: "Stored", verdict: "Verdict") -> dict[str, Any]:
    """Return the contract's keys for a verdict."""
    rho = stored.certificate.rho if stored.certificate else None
    claims = (
        {}
        if verdict.certified
        else {"error": {"kind": "NotCertified", "message": verdict.reason, "figures": dict(verdict.figures)}}
    )
    return {
        "certified": verdict.certified,
        "proof": "exact" if verdict.certified else "none",
        "rho": rho,
        "alpha": stored.alpha,
        "fragility": dict(stored.fragility),
        "gains": content["gains"],
        "reason": verdict.reason,
        "scope": verdict.scope,
        "margin": verdict.margin,
        "sampled": {"certified": False, "period": stored.problem.controller.period, "max_period": None},
        **claims,
    }


def _table(
    stored: "Stored", verdict: "Verdict", more: Mapping[str, str] = MappingProxyType({})
) -> RenderableType:
    rows = {"certified": "yes" if verdict.certified else "NO", "because": verdict.reason}
    if stored.certificate:
        rows["rho"] = f"{stored.certificate.rho:.6g}"
    rows["alpha"] = f"{stored.alpha:.9g}"
    return two_columns(stored.problem.title, {**rows, "covers": COVERS[verdict.scope], **more})
