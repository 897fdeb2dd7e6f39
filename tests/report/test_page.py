"""The page: complete, self-contained, the same every time, and honest about what does not hold."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest

import lockstep
from lockstep.codegen.sampled_design import HeldVerdict, with_sampled
from lockstep.lmi.sampled import SampledVerdict
from lockstep.model.problem import Problem
from lockstep.report.drawings import draw
from lockstep.report.page import html
from lockstep.report.report import make_report
from lockstep.report.report_data import gather

VOID = {"meta", "link", "br", "img", "input", "hr"}


class Page(HTMLParser):
    """Elements of a page in order: (tag, attributes); raises for a tag that is closed and not open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self._open: list[str] = []
        self.text = ""
        self.feed(text)
        assert not self._open, self._open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if "style" not in self._open:
            self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(report):
    return Page(report.page)


def test_the_same_facts_give_the_same_bytes(files, stored, checks, verified, report):
    assert make_report(files, stored, checks, verified) == report


def test_it_asks_for_nothing_from_anywhere(page, report):
    for _, attributes in page.elements:
        for key in ("src", "href", "xlink:href", "srcset", "action"):
            assert attributes.get(key, "#").startswith(("#", "data:,")), attributes
    assert not page.all("script")
    # what is left are the names of XML's vocabularies, which nothing loads
    assert set(re.findall(r"https?://[^\"'\s)]+", report.page)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    assert "@import" not in report.page
    assert "default-src 'none'" in page.all("meta")[3]["content"]


def test_it_is_small(report):
    assert len(report.page.encode()) < 2_000_000
    assert sum(map(len, report.figures.values())) < 2_000_000


def test_no_place_and_no_date(page):
    assert "/usr" not in page.text
    assert "/tmp" not in page.text
    assert not re.search(r"\b20\d\d-\d\d", page.text)
    assert "they do not work with this compiler" in page.text, "the reason itself is there"


def test_every_figure_has_words_and_files(page, report):
    drawn = [a for a in page.all("svg") if "drawing" in a.get("class", "")]
    assert len(drawn) == len(page.all("figure")) == 6
    assert all(a["role"] == "img" and len(a["aria-label"]) > 20 for a in drawn)
    assert set(report.figures) == {
        f"figures/{name}.{kind}"
        for name in ("graph", "states", "disagreement", "effort", "poles", "singular-values")
        for kind in ("png", "pdf")
    }
    told = " ".join(a["aria-label"] for a in drawn)
    assert "agent 1 hears agent 2; agent 2 hears agent 3; agent 3 hears agent 1" in told


def test_ids_are_unique_and_links_lead_somewhere(page):
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    wanted = [a["href"][1:] for a in page.all("a")]
    wanted += [name for _, a in page.elements for name in a.get("aria-labelledby", "").split()]
    assert wanted
    assert set(wanted) <= set(ids)


def test_headings_and_tables_are_ordered_and_named(page):
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert all(a.get("scope") in ("row", "col") for a in page.all("th"))
    assert all("aria-labelledby" in a for a in page.all("table"))
    assert page.all("html")[0]["lang"] == "en"


def test_the_four_lines_are_the_manifests(page, files, report):
    certificate = json.loads(files["manifest.json"])["certificate"]
    for key in ("proved", "assumes", "remains", "where"):
        # A page names another line by its heading.
        line = certificate[key].replace("`limits`", "No saturation")
        assert line in page.text
        assert line in report.text
        header = " ".join(files["include/arm1.h"].replace("\n *", " ").split())
        assert " ".join(certificate[key].split()) in header, "and the header's"


def test_what_is_proved_of_the_model_is_told(page, checks):
    said = " ".join(page.text.split())
    assert {finding.status for finding in checks.findings} == {"proved", "refuted", "undecided"}
    for finding in checks.findings:
        row = rf"{re.escape(finding.name)}\s*{finding.status}\s*{re.escape(finding.figure)}"
        assert re.search(row, said)


def test_an_unstable_controller_is_said_to_be_one(page, facts, spectrum):
    """Those of the committed design are stable; a pole moved to the right is told of its controller."""
    assert "To be known" not in page.text
    poles = list(spectrum.controllers)
    poles[1] = poles[1] + 100.0
    moved = replace(spectrum, controllers=tuple(poles))
    assert "unstable by itself" in Page(html(facts, moved, draw(facts, moved), [])).text


def test_what_is_not_proved_is_not_called_proved(facts, page_of):
    held = HeldVerdict(SampledVerdict(False, "the gain is 1.2", 0.005, 0))
    text = page_of(
        manifest=facts.manifest.model_copy(update={"certificate": {"certified": False}}),
        stored=with_sampled(facts.stored, held),
    )
    said = Page(text).text
    assert "NOT CERTIFIED" in said
    assert "not proved" in said
    assert "the gain is 1.2" in said
    assert "all agents come to agree" not in said
    assert "all agents come to agree" in Page(page_of()).text


def test_bits_that_differ_are_said_to_differ(page_of, failing):
    said = Page(page_of(verified=failing)).text
    assert "NOT EQUAL" in said
    assert "NOT as claimed: host gcc -O2: 3 calls differ" in said
    assert "Every bit is equal" not in said


def test_a_bound_on_a_box_is_said_to_be_local(facts, page_of):
    certificate = {**facts.manifest.certificate, "scope": "local"}
    said = Page(page_of(manifest=facts.manifest.model_copy(update={"certificate": certificate}))).text
    assert "Of the sampled ones nothing here proves that they do" in said
    assert "Of the sampled ones nothing here proves that they do" not in Page(page_of()).text


def test_text_of_the_problem_cannot_become_markup(facts, page_of):
    document = {**facts.problem.document(), "title": "<script>alert(1)</script>"}
    text = page_of(stored=replace(facts.stored, problem=Problem.from_document(document)))
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_a_run_that_diverges_is_reported_as_one(files, stored, checks, verified, page_of, monkeypatch):
    import lockstep.report.report_data as module
    from lockstep.model.simulation import Diverged

    def diverges(*_):
        raise Diverged("the loop diverges: theta_m of arm1 is beyond 1e+09 at t = 1 s")

    monkeypatch.setattr(module, "run_shipped", diverges)
    facts = gather(files, stored, checks, verified)
    assert facts.trajectory is None
    said = Page(page_of(trajectory=None, no_run=facts.no_run)).text
    assert "There is no run to show: the loop diverges" in said


def test_the_run_is_that_of_the_c(facts, files):
    """The first inputs by the header's own formula: x = 0, so u = D r with r = y - y_j, in float32."""
    manifest = json.loads(files["manifest.json"])
    y = np.array([[0.8, 0.0], [-0.5, 0.0], [0.2, 0.0]], np.float32)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        D = np.array(manifest["agents"][i]["sampled"]["D"]["decimal"], np.float32)
        r = y[i] - y[j]
        expected = np.float32(D[0, 0] * r[0]) + np.float32(D[0, 1] * r[1])
        assert facts.trajectory.u[0, i, 0] == expected


def test_a_long_run_is_cut_short_and_says_so(files, checks, verified, stored, page_of, monkeypatch):
    import lockstep.report.report_data as module

    monkeypatch.setattr(module, "MOST_STEPS", 300)
    short = gather(files, stored, checks, verified).trajectory
    assert short.t[-1] == pytest.approx(0.5)
    assert "the beginning of what was asked for" in page_of(trajectory=short)
    assert "the beginning of what was asked for" not in page_of()


def test_gain_errors_and_a_searched_disturbance_are_left_out_of_the_run(facts):
    from lockstep.report.report_data import run_shipped

    simulation = {
        **facts.problem.document()["simulation"],
        "horizon": 0.05,
        "disturbance": {"kind": "worst"},
        "perturbation": {"kind": "paper"},
    }
    problem = Problem.from_document({**facts.problem.document(), "simulation": simulation})
    run = run_shipped(problem, facts.manifest)
    np.testing.assert_array_equal(run.x, facts.trajectory.x[: len(run.t)])


def test_a_run_outside_of_what_is_proved_is_said(facts, page_of):
    assert facts.uncovered == ()
    assert "Not covered by the certificate" not in page_of()
    saturated = replace(facts, trajectory=replace(facts.trajectory, clipped=15))
    said, start, *_ = saturated.uncovered
    assert "15 controller steps met a limit of an input" in said
    assert re.search(
        r"no saturation is proved from 1\.2\d times this start, agreement with .* from 4\.5\d times it", start
    )
    assert "gain_limit" in start
    for fallen, named in ((0.1, False), (1.0, True)):
        x = facts.trajectory.x * np.linspace(1.0, fallen, len(facts.trajectory.t))[:, None, None]
        x[-1] = fallen * facts.trajectory.x[0]
        run = replace(saturated.trajectory, x=x)
        far = replace(facts, trajectory=run)
        assert not any("it may settle" in one for one in far.uncovered), (
            "the clipped loop is proved to agree from there"
        )
        claims = facts.stored.claims
        sampled = replace(claims.sampled, radius=1e-3, clipped_radius=None)
        open_ = replace(far, stored=replace(facts.stored, claims=replace(claims, sampled=sampled)))
        assert any("it may settle" in one for one in open_.uncovered) is named
    assert any("theta_m is" in one and "rad apart at its end" in one for one in open_.uncovered), "its unit"
    x = facts.trajectory.x.copy()
    x[1:, :, 0] *= 1e9
    x[-1] = 1e-6 * x[1]
    in_pascals = replace(open_, trajectory=replace(saturated.trajectory, x=x))
    assert not any("it may settle" in one for one in in_pascals.uncovered), "a millionth of what it was"
    assert "Not covered by the certificate" in page_of(trajectory=saturated.trajectory)


def test_an_agent_that_leaves_its_domain_in_the_run_is_named(facts, root):
    """The cart's run starts 0.381 from agreement, (p, theta) = (0, 0.1) and (0.5, -0.1), where 0.0606 is claimed."""
    carts = lockstep.load(root / "docs" / "gallery" / "designs" / "carts.json")
    run = lockstep.simulate(carts, horizon=0.1).trajectory
    (start,) = replace(facts, stored=carts.stored, trajectory=run).uncovered
    assert "that agents stay in their domain is proved from 0.159 times this start only" in start
    x = run.x.copy()
    x[2, 1, 2] = 2.0
    left, _ = replace(facts, stored=carts.stored, trajectory=replace(run, x=x)).uncovered
    assert "cart2 left the domain: theta = 2" in left
