"""`lockstep certify`: the independent checker.

Of a design file it proves the continuous controllers, and the sampled, rounded ones that would ship. The exit status is
1 where a claim of the file fails: the continuous one, or the sampled one (that it is certified, its rho) if the file
makes it; max_period is computed anew. A file that says itself that its sampled controllers are not certified claims
nothing of them and keeps status 0, though the answer says it all the same. Of a folder it proves the C in it, which
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

    content, stored = read_design(path)
    with of_file(path):
        verdict = certify(stored)
        broken = broken_place(content, verdict) if verdict.certified else None
        if broken:
            verdict = replace(verdict, certified=False, reason=broken)
        if is_generated(path):
            return _with_folder(path, content, stored, verdict)
        return _with_design(content, stored, verdict)


def _with_design(content: dict[str, Any], stored: "Stored", verdict: "Verdict") -> Answer:
    """Certify a design file alone: its gains, and the controllers they are sampled and rounded to."""
    from lockstep.codegen.sampled_design import prove_design

    held = prove_design(stored, content)
    sampled, document = held.figures(), certificate_document(content, stored, verdict)
    broken = broken_claim(content, sampled)
    if verdict.certified and broken:
        document |= _not_certified(broken, held.verdict.figures)
    holds = verdict.certified and not broken
    document |= {"ok": holds, "sampled": sampled}
    return Answer(document, _table(content, stored, verdict, {"sampled": sampled_text(sampled)}), holds)


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


def is_generated(path: Path) -> bool:
    """Tell whether a path is a folder of generated C."""
    return path.is_dir() and (path / MANIFEST_NAME).is_file()


def _with_folder(path: Path, content: dict[str, Any], stored: "Stored", verdict: "Verdict") -> Answer:
    """Certify the design and the C beside it: both must hold, and the C must be what its manifest says."""
    from lockstep.codegen.c_certificate import certify_folder

    folder = certify_folder(path, stored, content)
    proved, sampled = folder.held.verdict, folder.held.figures()
    certified = verdict.certified and proved.certified
    document = certificate_document(content, stored, verdict)
    if verdict.certified and not proved.certified:
        document |= _not_certified(proved.reason, proved.figures)
    document |= {
        "ok": verdict.certified and folder.ok,
        "certified": certified,
        "proof": "ball" if certified else "none",
        "design": {"certified": verdict.certified, "proof": document["proof"]},
        "differences": list(folder.differences),
        "sampled": sampled,
    }
    rows = {
        "sampled C": sampled_text(sampled),
        "as generated": "; ".join(folder.differences) or "yes",
    }
    return Answer(document, _table(content, stored, verdict, rows), verdict.certified and folder.ok)


def certificate_document(content: dict[str, Any], stored: "Stored", verdict: "Verdict") -> dict[str, Any]:
    """Return the contract's keys for a verdict."""
    rho = stored.proofs.certificate.rho if stored.proofs.certificate else None
    floor = stored.proofs.floor.rho if stored.proofs.floor and verdict.certified else None
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
        "alpha": stored.claims.alpha,
        **({"entries": content["entries"]} if stored.claims.entries else {}),
        "fragility": dict(stored.claims.fragility),
        "gains": content["gains"],
        "reason": verdict.reason,
        "scope": verdict.scope,
        "margin": verdict.margin,
        **({} if verdict.initial is None else {"initial_set": verdict.initial.document()}),
        **claims,
    }


def _table(
    content: dict[str, Any],
    stored: "Stored",
    verdict: "Verdict",
    more: Mapping[str, str] = MappingProxyType({}),
) -> RenderableType:
    rows = {"certified": "yes" if verdict.certified else "NO", "because": verdict.reason}
    if stored.proofs.certificate:
        rows["rho"] = f"{stored.proofs.certificate.rho:.6g}"
    if stored.proofs.floor and verdict.certified:
        rows |= floor_row(stored.proofs.floor.rho)
    rows["alpha"] = f"{stored.claims.alpha:.9g}"
    rows |= single_slopes(content)
    rows["covers"] = COVERS[verdict.scope]
    if verdict.initial is not None:
        rows["initial states"] = verdict.initial.text()
    return two_columns(stored.problem.title, {**rows, **more})
