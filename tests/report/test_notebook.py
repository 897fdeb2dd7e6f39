"""What a notebook shows: tables whose texts are escaped, figures, sentences; and that docs/analysis.md says what happens."""

import json
import re
from pathlib import Path

import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.model.checks import check_problem

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "analysis.md").read_text(encoding="utf-8")

WHITE = (1.0, 1.0, 1.0, 1.0)
"""Behind a figure: its dark letters have to be read in a dark notebook too."""


@pytest.fixture(scope="module")
def arms() -> lockstep.Design:
    return lockstep.load(ROOT / "generated" / "flexible_joint_arms")


@pytest.fixture(scope="module")
def run(arms):
    return lockstep.simulate(arms, horizon=0.5)


@pytest.mark.parametrize("what", ["graph", "poles", "margins"])
def test_a_design_is_drawn(arms, what):
    figure = arms.plot(what)
    assert isinstance(figure, Figure)
    assert figure.axes
    assert figure.get_facecolor() == WHITE


@pytest.mark.parametrize("what", ["states", "disagreement", "effort", "phase"])
def test_a_run_is_drawn(run, what):
    figure = run.plot(what)
    assert isinstance(figure, Figure)
    assert figure.get_facecolor() == WHITE


def test_the_poles_that_are_drawn_are_the_loop_s(arms):
    drawn = arms.plot("poles", sampled=False).axes[0].lines[-1]
    assert sorted(drawn.get_xdata()) == pytest.approx(sorted(arms.loop(sampled=False).closed().poles().real))


def test_another_word_is_refused(arms, run):
    for one in (arms, run):
        with pytest.raises(ProblemError, match="bode"):
            one.plot("bode")


def test_tables_hold_the_figures_and_escape_what_they_show(run):
    refuted = lockstep.decide_lmi({"constraints": [{"name": "<b>", "constant": [["-1"]]}]})
    assert "&lt;b&gt;" in refuted._repr_html_()
    assert "refuted" in refuted._repr_html_()
    assert "refuted" in repr(refuted)
    assert "sampled" in run._repr_html_()
    assert run.design.title in repr(run)


def test_a_report_of_checks_is_a_table():
    text = 'dynamics = { x = "u - x - x**3" }\noutputs = { y = "x" }\ndomain = { x = [-1.0, 1.0] }'
    agent = f'[agent]\nstates = ["x"]\ninputs = ["u"]\n{text}\n'
    network = '[network]\nagents = 2\ntopology = "path"\n'
    shown = check_problem(lockstep.Problem.parse(agent + network), every=True)._repr_html_()
    assert "<th>contraction</th><td>proved</td>" in shown
    assert shown.count("<tr>") == shown.count("</tr>") > 15


def test_the_explanation_is_what_the_checker_decides(arms):
    found = lockstep.explain(arms)
    said, shown = repr(found), found._repr_html_()
    for figure in (
        f"{arms.rho:.4g}",
        f"{arms.sampled['rho']:.4g}",
        "0.005 s",
        "float32",
        "Assumed: model",
        "Not proved: the C",
    ):
        assert figure in said
    assert shown.count("<tr>") == len(said.splitlines()) - 1


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def names(tmp_path, monkeypatch) -> dict:
    """What all blocks leave, run with the page's own problem."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for number, block in enumerate(blocks("python"), start=1):
        exec(compile(block, f"docs/analysis.md, block {number}", "exec"), names)
    pyplot.close("all")
    return names


def test_the_page_does_what_it_says(names):
    """Equations to Bode plot, margins, phase plane and time response in under 30 lines; verdicts as the text has them."""
    assert len([line for line in blocks("python")[0].splitlines() if line.strip()]) < 30
    assert names["loop"].closed().dt == 0.01
    assert names["period"] == 0.2
    assert names["one_input"].proved <= names["one_input"].above
    assert names["rank_one"].upper == pytest.approx(5)
    assert names["raised"].u[0] == pytest.approx(9.81 * 0.479425538604203)
    assert len(names["systems"]) == len(names["instants"])
    assert names["lyapunov"].ok
    assert names["plain"].ok
    assert names["moved"].ok
    assert not names["as_it_comes"].ok
    assert "p - m' Q m" in names["as_it_comes"].reason


def test_the_file_on_the_page_is_proved():
    assert lockstep.decide_lmi(json.loads(blocks("json")[0])).ok
