"""`lockstep certify`: the independent checker."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from lockstep.check.errors import ProblemError
from lockstep.cli.console import Answer, two_columns
from lockstep.cli.design import proved_besides, sampled_text
from lockstep.cli.messages import messages_row

if TYPE_CHECKING:
    from lockstep.workflow.certify import DesignVerdict

COVERS = {
    "global": "the continuous controllers, for every disturbance and initial state",
    "local": "the continuous controllers, while every agent stays in its domain",
}


def run(path: Path | None, lmi: Path | None) -> Answer:
    """Certify a design file, a folder of generated C, or an LMI file."""
    import lockstep

    if path is None or lmi is not None:
        return _inequality(path, lmi)
    found = lockstep.certify(path)
    return Answer(found.document(), _table(found), found.ok)


def _table(found: "DesignVerdict") -> RenderableType:
    verdict = found.verdict
    rows = {"certified": "yes" if found.ok else "NO", "because": found.reason}
    if found.design.rho is not None:
        rows["rho"] = f"{found.design.rho:.6g}"
    rows["alpha"] = found.design.alpha_text
    rows |= proved_besides(found.design.document(), verdict.proves)
    within = ", while no input is clipped" * found.design.problem.has_limits
    rows["covers"] = COVERS[verdict.scope] + within if verdict.scope else "nothing"
    if "initial_set" in found.answer:
        rows["initial states"] = found.answer["initial_set"]["text"]
    of_c = "differences" in found.answer
    rows["sampled C" if of_c else "sampled"] = sampled_text(found.sampled)
    rows |= messages_row(found.answer)
    if (fixed := found.answer.get("fixed")) is not None and verdict.proves("fixed"):
        rho, radius = (fixed[key] or "not proved" for key in ("rho", "radius"))
        read = fixed["residual_per_message_error"] / 2 ** (1 + min(fixed["outputs"]))  # half a count
        ends = f"at most {fixed['residual_from_rounding'] + read:.2g} apart in the end, readings rounded"
        rows["in integers"] = f"yes, while none saturates: rho {rho}, radius {radius}; {ends}"
    if of_c:
        first, more = "; ".join(found.differences[:3]), len(found.differences) - 3
        rows["as generated"] = f"{first}; and {more} more (--json tells each)" if more > 0 else first or "yes"
    if found.not_proved:
        rows["not proved"] = f"what is in {', '.join(found.not_proved)}"
    return two_columns(found.design.title, rows)


def _inequality(path: Path | None, lmi: Path | None) -> Answer:
    if path is not None or lmi is None:
        found = "neither a design nor --lmi" if lmi is None else "a design and --lmi"
        raise ProblemError(found, where="lockstep certify", expected="one of the two")
    from lockstep.lmi.external_lmi import decide_lmi

    decided = decide_lmi(lmi)
    rows = {"certified": "yes" if decided.ok else "NO", "because": decided.reason}
    for one in decided.constraints:
        said = f"{one.found}: {one.method}"
        if one.vector is not None:
            said += f"; v = ({', '.join(map(str, one.vector))}), v' F v = {one.value}"
        rows[f"{one.constraint.name} {one.constraint.sign} 0"] = said
    return Answer(decided.document(), two_columns(lmi.name, rows), decided.ok)
