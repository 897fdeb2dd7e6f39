"""`lockstep design`: gains and certificate."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from lockstep.cli.console import Answer, of_file, progress_display, respond, to_json, two_columns, write_text
from lockstep.cli.files import check_writable


def run(
    path: Path,
    output: Path | None,
    *,
    jobs: int | None,
    trade_off: Path | None,
    time_limit: float | None,
    as_json: bool,
) -> None:
    """Design, prove, and write the design file, and the curve of rho against alpha if asked for."""
    respond(as_json, lambda: _design(path, output, jobs, trade_off, time_limit))


def _design(
    path: Path, output: Path | None, jobs: int | None, trade_off: Path | None, time_limit: float | None
) -> Answer:
    from lockstep.lmi.design import design
    from lockstep.lmi.document import document
    from lockstep.model.problem import load_problem

    check_writable(output, path)
    check_writable(trade_off, path, output)
    problem = load_problem(path)
    with of_file(path), progress_display() as tell:
        made = design(problem, jobs=jobs, progress=tell, time_limit=time_limit)
        content = sampled_too(document(made), tell)
    curve = "" if trade_off is None else _trade_off(content)
    if output is not None:
        write_text(output, to_json(content) + "\n")
    if trade_off is not None:
        write_text(trade_off, curve)
    return Answer(content, summary(content))


def _trade_off(content: Mapping[str, Any]) -> str:
    """Return the least rho of the gains for each alpha, as CSV."""
    from lockstep.cli.files import DESIGN_NAME
    from lockstep.lmi.document import parse
    from lockstep.lmi.trade import as_csv, curve

    return as_csv(curve(parse(content, DESIGN_NAME)))


def sampled_too(
    content: Mapping[str, Any], tell: Callable[[str, float], None] = lambda _what, _part: None
) -> dict[str, Any]:
    """Return a design with what is proved of its controllers sampled and rounded, as a reader of the file sees it.

    Where the period is too long for the continuous design, or the problem asks for it, gains are designed for the
    sampled loop instead; where that fails, the continuous design is kept and `sampled` says why.
    """
    import json

    from lockstep.cli.files import DESIGN_NAME
    from lockstep.codegen.for_the_period import designed_for_period, is_asked, obstacle
    from lockstep.codegen.sampled_design import NOT_FOR_PERIOD, prove_design, with_sampled
    from lockstep.lmi.certify import certify
    from lockstep.lmi.document import parse
    from lockstep.model.errors import Infeasible, NotCertified

    plain: dict[str, Any] = json.loads(to_json(content))
    stored = parse(plain, DESIGN_NAME)
    verdict = certify(stored)
    if plain["certified"] and not verdict.certified:
        raise NotCertified(f"the checker refuses the design: {verdict.reason}", **verdict.figures)
    tell("proving the sampled controllers", 0.95)
    plain = with_sampled(plain, prove_design(stored, plain))
    if plain["sampled"]["certified"] and not is_asked(stored.problem):
        return plain
    found = obstacle(stored)
    if found is None:
        try:
            made = designed_for_period(plain, stored, lambda part: tell("designing for the period", part))
        except Infeasible as error:
            found = str(error)
        else:
            again: dict[str, Any] = json.loads(to_json(made))
            return again
    return {**plain, "sampled": {**plain["sampled"], NOT_FOR_PERIOD: found}}


def sampled_text(sampled: Mapping[str, Any]) -> str:
    """Return in a line what is proved of the sampled controllers."""
    longest = sampled.get("max_period")
    reach = f"; certified up to {longest:g} s" if longest else ""
    failed = sampled.get("not_designed_for_period")
    reach += f"; not designed for the period: {failed}" if failed else ""
    if sampled["certified"]:
        gain = f", rho {sampled['rho']:.6g}" if sampled.get("rho") else ""
        made = ", designed for it" if sampled.get("designed_for_period") else ""
        return f"yes, every {sampled['period']:g} s{made}{gain}, rounding included, proof: {sampled['proof']}{reach}"
    return f"NO: {sampled.get('reason') or 'not looked at'}{reach}"


def _where(content: Mapping[str, Any]) -> dict[str, str]:
    if content.get("scope") != "local":
        return {}
    return {
        "holds": "while every agent stays in its domain",
        "initial states": content["initial_set"]["text"],
    }


def _cut(figures: Mapping[str, Any]) -> dict[str, str]:
    limit = figures.get("time_limit")
    if limit is None:
        return {}
    return {
        "search": f"cut by the limit of {limit:g} s: which gains it had found by then depends on the machine"
    }


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
            **_where(content),
            "gain norms": ", ".join(f"{norm:.4g}" for norm in figures["gain_norms"]),
            "sampled": sampled_text(content["sampled"]),
            "slowest pole": f"{figures['abscissa']:.4g} 1/s",
            **_cut(figures),
        },
    )
