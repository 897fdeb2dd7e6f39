"""`lockstep certify`: the independent checker."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from lockstep.cli.console import Answer, respond, two_columns
from lockstep.cli.design import floor_row, sampled_text, single_slopes

if TYPE_CHECKING:
    from lockstep.workflow.certify import DesignVerdict

COVERS = {
    "global": "the continuous controllers, for every disturbance and every initial state",
    "local": "the continuous controllers, while every agent stays in its domain",
    None: "nothing",
}


def run(path: Path, *, as_json: bool) -> None:
    """Certify a design file, or a folder of generated C."""
    respond(as_json, lambda: _certify(path))


def _certify(path: Path) -> Answer:
    import lockstep

    found = lockstep.certify(path)
    return Answer(found.document(), _table(found), found.ok)


def _table(found: "DesignVerdict") -> RenderableType:
    verdict = found.verdict
    rows = {"certified": "yes" if verdict.certified else "NO", "because": verdict.reason}
    if found.design.rho is not None:
        rows["rho"] = f"{found.design.rho:.6g}"
    if verdict.certified:
        rows |= floor_row(found.design.floor)
    rows["alpha"] = f"{found.design.alpha:.9g}"
    rows |= single_slopes(found.design.document())
    rows["covers"] = COVERS[verdict.scope]
    if "initial_set" in found.answer:
        rows["initial states"] = found.answer["initial_set"]["text"]
    of_c = "differences" in found.answer
    rows["sampled C" if of_c else "sampled"] = sampled_text(found.sampled)
    if verdict.certified and not verdict.ok:
        rows["refused"] = verdict.reason
    if of_c:
        rows["as generated"] = "; ".join(found.differences) or "yes"
    if found.not_proved:
        rows["not proved"] = f"what is in {', '.join(found.not_proved)}"
    return two_columns(found.design.title, rows)
