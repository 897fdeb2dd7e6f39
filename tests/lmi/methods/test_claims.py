"""The ledger of the paper's claims: every verdict comes out, and docs/claims.md is what the command writes."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amini.claims import example
from amini.claims.claim import Finding, PaperClaim, settle
from amini.claims.fragility import PLACES, destabilising
from amini.claims.ledger import all_claims, reproduce
from amini.claims.markdown import to_markdown
from lockstep.check.errors import ProblemError
from lockstep.cli.main import app

ROOT = Path(__file__).parents[3]


def test_names_are_unique_and_every_section_is_there():
    names = [claim.name for claim in all_claims()]
    assert len(names) == len(set(names))
    places = " ".join(claim.where for claim in all_claims())
    for place in (
        "(7)",
        "(11)",
        "(14)",
        "(21)",
        "(22)",
        "(29)",
        "(30)",
        "(34)",
        "Table 1",
        "Table 2",
        "Remark 1",
        "Figure 3",
    ):
        assert place in places, place


def test_the_example_is_the_one_that_is_shipped():
    from lockstep.model.problem import load_problem

    problem = load_problem(ROOT / "examples" / "table_1.toml")
    lure = problem.agent().lure
    for ours, theirs in ((example.A, lure.A), (example.B, lure.B), (example.C, lure.C)):
        np.testing.assert_array_equal(ours, theirs)
    for i, gains in enumerate(problem.gains):
        for letter in "ABCD":
            np.testing.assert_array_equal(
                getattr(example.TABLE_1["corollary_1"], letter)[i], getattr(gains, letter)
            )


def test_a_verdict_that_does_not_come_out_is_none():
    holds = PaperClaim("x", "(1)", "It holds.", "proved", lambda: Finding("1 = 1", True))
    fails = PaperClaim("y", "(2)", "It fails.", "proved", lambda: Finding("1 = 2", False))
    assert settle(holds).verdict == "proved"
    assert settle(fails).verdict is None
    assert "NOT AS EXPECTED" in to_markdown([settle(fails)])
    assert "NOT AS EXPECTED" not in to_markdown([settle(holds)])


def test_destabilising_errors_are_within_the_bounds_and_break_the_loop():
    error, height = destabilising("theorem_1", 0.0)
    for block in error:
        for place, delta in zip(PLACES, example.DELTA, strict=True):
            assert np.linalg.norm(block[place], 2) <= delta * (1 + 1e-9)
    K = example.TABLE_1["theorem_1"].blocks
    assert example.abscissa(example.loop().A_cl(K)) < 0 < height
    assert example.abscissa(example.loop().A_cl(K + error)) == pytest.approx(height)
    # Errors a hundred times smaller do not: the nominal loop has room.
    assert example.abscissa(example.loop().A_cl(K + error / 100)) < 0


def test_an_unknown_claim_is_refused():
    with pytest.raises(ProblemError, match="bound-30"):
        reproduce(["bound-3"])


def test_command_settles_one_claim():
    result = CliRunner().invoke(app, ["reproduce", "sufficient-7", "any-row", "--json"])
    document = json.loads(result.stdout)
    assert result.exit_code == 0
    assert [row["verdict"] for row in document["claims"]] == ["refuted", "refuted"]
    assert document["claims"][0]["how"] == "lockstep reproduce sufficient-7"


def test_command_refuses_unknown_claims_and_partial_pages(tmp_path):
    assert CliRunner().invoke(app, ["reproduce", "no-such-claim"]).exit_code == 2
    page = tmp_path / "claims.md"
    assert CliRunner().invoke(app, ["reproduce", "any-row", "-o", str(page)]).exit_code == 2
    assert not page.exists()


def test_command_exits_1_where_a_verdict_does_not_come_out(monkeypatch, tmp_path):
    wrong = PaperClaim("wrong", "(0)", "It fails.", "proved", lambda: Finding("1 = 2", False))
    monkeypatch.setattr("amini.claims.ledger.all_claims", lambda: (wrong,))
    page = tmp_path / "claims.md"
    result = CliRunner().invoke(app, ["reproduce", "-o", str(page), "--json"])
    assert result.exit_code == 1
    assert json.loads(result.stdout)["ok"] is False
    assert not page.exists()


@pytest.mark.slow
def test_the_page_is_current():
    """Regenerate it with `lockstep reproduce -o docs/claims.md`."""
    rows = reproduce()
    assert [row.name for row in rows if row.verdict is None] == []
    assert to_markdown(rows) == (ROOT / "docs" / "claims.md").read_text(encoding="utf-8")
