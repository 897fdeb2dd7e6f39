"""`lockstep design`: gains and certificate."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, of_file, progress_display, respond, to_json, two_columns, write_text
from lockstep.cli.files import check_writable


def run(path: Path, output: Path | None, *, jobs: int | None, as_json: bool) -> None:
    """Design, prove, and write the design file."""
    respond(as_json, lambda: _design(path, output, jobs))


def _design(path: Path, output: Path | None, jobs: int | None) -> Answer:
    from lockstep.lmi.design import design
    from lockstep.lmi.document import document
    from lockstep.model.problem import load_problem

    check_writable(output)
    problem = load_problem(path)
    with of_file(path), progress_display() as tell:
        found = design(problem, jobs=jobs, progress=tell)
    content = document(found)
    if output is not None:
        write_text(output, to_json(content) + "\n")
    return Answer(content, summary(content))


def summary(content: Mapping[str, Any]) -> RenderableType:
    """Return what was designed and proved, for people."""
    figures = content["figures"]
    floor = (
        f"   (floor {figures['floor']:.4g}: no controllers can certify less)" if figures.get("floor") else ""
    )
    fragility = ", ".join(f"{letter} {delta:g}" for letter, delta in content["fragility"].items() if delta)
    return two_columns(
        content["title"],
        {
            "certified": f"yes, proof: {content['proof']}" if content["certified"] else "no",
            "rho": f"{content['rho']:.6g}{floor}",
            "alpha": f"{content['alpha']:.9g}",
            "gains may be off by": fragility or "nothing: certain controllers",
            "gain norms": ", ".join(f"{norm:.4g}" for norm in figures["gain_norms"]),
            "slowest pole": f"{figures['abscissa']:.4g} 1/s",
        },
    )
