"""`lockstep certify`: the independent checker."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, of_file, respond, two_columns
from lockstep.cli.files import read_design

if TYPE_CHECKING:
    from lockstep.lmi.certify import Verdict
    from lockstep.lmi.document import Stored

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
    return Answer(certificate_document(content, stored, verdict), _table(stored, verdict), verdict.certified)


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


def _table(stored: "Stored", verdict: "Verdict") -> RenderableType:
    rows = {"certified": "yes" if verdict.certified else "NO", "because": verdict.reason}
    if stored.certificate:
        rows["rho"] = f"{stored.certificate.rho:.6g}"
    rows["alpha"] = f"{stored.alpha:.9g}"
    return two_columns(stored.problem.title, {**rows, "covers": COVERS[verdict.scope]})
