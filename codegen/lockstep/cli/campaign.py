"""`lockstep simulate --campaign N`: network tests against the certificate, here or on a cluster."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from lockstep.cli.console import Answer, progress_display, table, two_columns

if TYPE_CHECKING:
    from lockstep.campaign import Campaign
    from lockstep.workflow.runs.campaign import CampaignOptions


def run_faults(path: Path, faults: str, runs: int, output: Path, **options: Any) -> Answer:
    """Run a campaign of network faults: see `lockstep.workflow.runs.network_faults.network_campaign`."""
    from lockstep.workflow.runs.network_faults import network_campaign

    with progress_display() as tell:
        found = network_campaign(path, faults, runs, output, **options, progress=tell)
    document = found.document()
    claimed = f"{document['rho']:g} is claimed" if document["covered"] else "nothing is claimed of these runs"
    rows = {
        "runs": f"{document['runs']} of {document['horizon']:g} s each; {document['lost']:.1%} of the messages lost",
        "gain": f"{document['gain']:.4f} of {document['gain_of']}; {claimed}",
        "diverged": f"{document['diverged']} runs, {document['faulty_steps']} faulty controller steps",
        "not covered": f"{document['clipped_runs']} runs met a limit of an input, {document['runs_outside']} left the domain",
        "refused": ", ".join(f"{count} {why}" for why, count in document["refused"].items() if count)
        or "none",
        "results": document["results"],
    }
    return Answer(document, two_columns("Network faults", rows), found.ok)


def run(
    path: Path, runs: int, output: Path, scheduler: str | None, jobs: int | None, options: "CampaignOptions"
) -> Answer:
    """Run a campaign, or what is left of it: see `lockstep.workflow.runs.campaign.run_campaign`."""
    from lockstep.workflow.runs.campaign import run_campaign

    with progress_display() as tell:
        found = run_campaign(path, runs, output, options, scheduler=scheduler, jobs=jobs, progress=tell)
    return Answer(found.document(), table_of(found), found.ok)


def table_of(found: "Campaign") -> RenderableType:
    """Return a campaign's figures for people."""
    document = found.document()
    covered, worst = document["covered"], document["worst_ratio"]
    judged = f"all {covered} runs that the certificate covers are below it"
    if document["above"]:
        judged = f"{document['above']} of {covered} runs that the certificate covers are ABOVE it"
    shown = "infinite" if worst is None else f"{worst:.4f}"
    speed = f"{document['runs_per_second']:.0f} runs/s" if document["computed"] else "nothing was left to run"
    rows = {
        "runs": f"{document['runs']} of {document['horizon']:g} s each, {document['controllers']} controllers",
        "certified rho": f"{document['rho']:g}",
        "worst": f"{shown} of the bound, run {document['worst_run']}; {judged}",
        "not covered": _not_covered(document),
        "linear loop": f"{document['linear_gain']:.4f} is the largest gain of the linearised loop found",
        "diverged": f"{document['diverged']} runs, {document['faults']} faulty controller steps",
        "clipped": f"{document['clipped_runs']} runs met a limit of an input, in {document['clipped']} controller steps;"
        f" {document['clipped_inside']} of them where they are proved to converge",
        "speed": f"{document['computed']} runs in {document['seconds']:.1f} s, {speed}",
        "results": document["results"],
    }
    failed = "NOT as certified" if covered else "nothing is shown: the certificate covers none of these runs"
    verdict = "as certified" if document["ok"] else failed
    return Group(two_columns("Network tests", rows), _families(document), Text(verdict, style="bold"))


def _not_covered(document: dict[str, Any]) -> str:
    """Say what became of the runs that nothing is claimed of: lost messages, or an agent out of its domain."""
    count, worst = document["runs"] - document["covered"], document["worst_ratio_not_covered"]
    if not count:
        return "no run"
    shown = "" if worst is None else f"; the worst came to {worst:.4f} of the bound"
    return f"{count} runs, of which nothing is claimed; {document['runs_outside']} left the domain{shown}"


def _families(document: dict[str, Any]) -> RenderableType:
    rows = []
    for name, one in document["families"].items():
        ratio = "-" if one["worst_ratio"] is None else f"{one['worst_ratio']:.4f}"
        rows.append((name, str(one["runs"]), str(one["covered"]), ratio, str(one["diverged"])))
    return table(("family", "runs", "covered", "worst ratio", "diverged"), rows)


def run_replay(path: Path, index: int, output: Path | None, options: "CampaignOptions") -> Answer:
    """Run one of a campaign's runs again: see `lockstep.workflow.runs.campaign.replay`."""
    from lockstep.workflow.runs.campaign import replay

    found = replay(path, index, options, output=output)
    document = {**found.document(), "trajectory": None if output is None else str(output)}
    rows = {name: f"{value}" for name, value in document.items() if not name.startswith("x_")}
    return Answer(document, two_columns(f"Run {index} again", rows), found.ok)
