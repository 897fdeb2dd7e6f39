"""The report of a build: report.html, report.md and figures/, as content; who calls it writes the files."""

from collections.abc import Mapping
from dataclasses import dataclass

from lockstep.codegen.emission.rendering import render
from lockstep.codegen.folder.guarantee_lines import lines_of
from lockstep.lmi.document import Stored, answer_document
from lockstep.lmi.trade_off.pareto import ParetoPoint
from lockstep.model.checks import CheckReport
from lockstep.report.drawings import draw
from lockstep.report.evidence import pages
from lockstep.report.page import html
from lockstep.report.poles import spectrum_of
from lockstep.report.report_data import gather
from lockstep.verification.verify import VerifyReport

PAGE, TEXT = "report.html", "report.md"


@dataclass(frozen=True)
class Report:
    """page: the HTML;  text: the same in short;  evidence: a page for each agent;  figures: PNG or PDF by path.

    notes: what takes the run that is shown out of what is proved.
    """

    page: str
    text: str
    evidence: Mapping[str, str]
    figures: Mapping[str, bytes]
    notes: tuple[str, ...] = ()

    @property
    def texts(self) -> dict[str, str]:
        """Relative path -> text of the files that are text."""
        return {PAGE: self.page, TEXT: self.text, **self.evidence}


def make_report(
    files: Mapping[str, str],
    stored: Stored,
    checks: CheckReport,
    verified: VerifyReport,
    trade_off: tuple[ParetoPoint, ...] = (),
    source: str = "",
) -> Report:
    """Return the report of a generated folder; the same input gives the same bytes.

    Args:
        files: the folder as it will be written, relative path -> text.
        stored: its design.json.
        checks, verified: what was found of them.
        trade_off: gains around the design, if they were asked for.
        source: the text of the problem file, where there is one.
    """
    facts = gather(files, stored, checks, verified, trade_off)
    spectrum = spectrum_of(facts.network, stored.gains, stored.claim)
    drawings = draw(facts, spectrum)
    evidence = pages(facts, files, source)
    names = sorted([*files, PAGE, TEXT, *evidence, *drawings.files])
    text = render(
        "report.md.j2",
        title=facts.problem.title,
        guarantee=lines_of(facts.manifest.certificate),
        design=answer_document(stored),
        checks=checks,
        verify=verified,
    )
    return Report(html(facts, spectrum, drawings, names), text, evidence, drawings.files, facts.uncovered)
