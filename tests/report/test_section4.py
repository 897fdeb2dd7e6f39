"""Section 4 again: the claims of the issue on the runs, and what the files say."""

import csv
import io

import numpy as np
import pytest

from amini.claims.example import TABLE_1, TABLE_2, arm, cycle
from amini.section4.contestants import CERTIFIED, CERTIFIED_UNCERTAIN, Contestant
from amini.section4.figures import figures
from amini.section4.runs import AGREED, all_runs, runs_of
from amini.section4.table import to_csv, to_markdown
from lockstep.check.system.loop import Gains
from lockstep.model.network import Network

slow = pytest.mark.slow
"""Proving, simulating and drawing all five loops takes most of a minute."""


@pytest.fixture(scope="module")
def runs():
    return list(all_runs(lambda _what, _part: None))


@slow
def test_all_loops_agree_without_a_disturbance(runs):
    assert [one.contestant.key for one in runs] == [
        "theorem_1",
        "corollary_1",
        "certified_uncertain",
        "certified",
        "reference_25",
    ]
    for one in runs:
        d = one.quiet.disagreement()
        assert d[-1] < 1e-3 * d[0], one.contestant.name
    assert AGREED == 1e-3


def test_the_published_gains_agree_and_a_loop_without_control_does_not():
    ours = Network(arm(), cycle())
    published = Contestant("corollary_1", "", ours, TABLE_1["corollary_1"], None, None, 0.0)
    found = runs_of(published)
    assert found.left < 1e-3
    assert found.agrees
    none = Gains(*(tuple(0 * M for M in getattr(CERTIFIED, letter)) for letter in "ABCD"))
    assert not runs_of(Contestant("none", "", ours, none, None, None, 0.0)).agrees


@slow
def test_what_is_proved(runs):
    """rho as in the examples; Theorem 1's published gains without gain errors, as the ledger refutes them with."""
    proved = {one.contestant.key: one.contestant.rho for one in runs}
    assert proved["corollary_1"] == pytest.approx(13.24)
    assert proved["certified"] <= 3.35
    assert proved["certified_uncertain"] <= 35.5
    assert proved["reference_25"] is not None
    for one in runs:
        if one.contestant.rho is not None and one.contestant.perturbation is None:
            assert one.gain < one.contestant.rho


def test_the_certified_gains_keep_to_their_limit():
    assert np.linalg.norm(CERTIFIED.blocks, 2, axis=(1, 2)).max() <= 50
    assert np.linalg.norm(CERTIFIED_UNCERTAIN.blocks, 2, axis=(1, 2)).max() <= 50


@slow
def test_the_uncertain_loops_run_with_the_errors_as_printed(runs):
    by_key = {one.contestant.key: one for one in runs}
    assert by_key["theorem_1"].contestant.gains is TABLE_1["theorem_1"]
    assert not by_key["theorem_1"].contestant.perturbation.scaled
    assert by_key["corollary_1"].contestant.perturbation is None


@slow
def test_the_table_holds_ours_and_theirs(runs):
    rows = list(csv.reader(io.StringIO(to_csv(runs))))
    assert rows[0] == ["method", "disturbance", "signal", "agent", "ISE", "IAE", "ITSE", "ITAE"]
    printed = [row for row in rows if "as printed" in row[0]]
    assert np.array_equal(
        np.array([[float(x) for x in row[4:]] for row in printed]),
        np.vstack([TABLE_2["theorem_1"], TABLE_2["reference_25"]]),
    )
    assert len(rows) == 1 + 5 * 2 * 2 * 3 + 6
    values = np.array([[float(x) for x in row[4:]] for row in rows[1:]])
    assert np.isfinite(values).all()
    assert (values > 0).all()


@slow
def test_the_page_says_what_cannot_be_compared(runs):
    page = to_markdown(runs)
    assert "gives neither its initial states" in page
    assert "seen, not proved" in page
    for one in runs:
        assert one.contestant.name in page


@slow
def test_the_figures_are_there_and_the_same_each_time(runs):
    files = figures(runs)
    names = {
        f"{name}.{ending}"
        for name in ("figure_3", "figure_4", "figure_5", "disagreement")
        for ending in ("png", "pdf")
    }
    assert set(files) == names
    for name, content in files.items():
        assert content.startswith(b"\x89PNG" if name.endswith("png") else b"%PDF"), name
        assert b"CreationDate" not in content
    assert figures(runs)["figure_4.png"] == files["figure_4.png"]
