"""`lockstep design`: gains and certificate."""

from pathlib import Path

from rich.table import Table

from lockstep.cli.console import Answer, progress_display, respond, to_json, write_text


def run(path: Path, output: Path | None, *, jobs: int | None, as_json: bool) -> None:
    """Design, prove, and write the design file."""
    respond(as_json, lambda: _design(path, output, jobs))


def _design(path: Path, output: Path | None, jobs: int | None) -> Answer:
    from lockstep.cli.files import check_writable
    from lockstep.lmi.design import design
    from lockstep.lmi.document import document
    from lockstep.model.problem import load_problem

    check_writable(output)
    problem = load_problem(path)
    with progress_display() as tell:
        found = design(problem, jobs=jobs, progress=tell)
    content = document(found)
    if output is not None:
        write_text(output, to_json(content) + "\n")
    return Answer(content, summary(content))


def summary(content: dict) -> Table:  # type: ignore[type-arg]
    """Return what was designed and proved, for people."""
    figures = content["figures"]
    table = Table(title=content["title"], show_header=False, title_justify="left")
    table.add_row("certified", f"yes, proof: {content['proof']}" if content["certified"] else "no")
    table.add_row("rho", f"{content['rho']:.6g}" + (f"   (floor {figures['floor']:.4g})" if figures.get("floor") else ""))
    table.add_row("alpha", f"{content['alpha']:.9g}")
    fragility = {letter: delta for letter, delta in content["fragility"].items() if delta}
    table.add_row("gains may be off by", ", ".join(f"{k} {v:g}" for k, v in fragility.items()) or "nothing: certain controllers")
    table.add_row("gain norms", ", ".join(f"{norm:.4g}" for norm in figures["gain_norms"]))
    table.add_row("slowest pole", f"{figures['abscissa']:.4g} 1/s")
    return table
