"""`lockstep reproduce` where the study of the paper is, and where it is not: in an environment with the wheel alone."""

import json
import sys

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app


@pytest.mark.parametrize("words", [[], ["any-row"], ["--figures", "there"], ["-o", "page.md"]])
def test_without_the_study_one_message_says_where_it_is(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "amini", None)  # as if it were not installed
    result = CliRunner().invoke(app, ["reproduce", *words, "--json"])
    error = json.loads(result.stdout)["error"]
    assert result.exit_code == 2
    assert "studies/" in error["expected"]
    assert "pip install -e ." in error["remedy"]
    assert list(tmp_path.iterdir()) == []


def test_with_the_study_a_claim_is_settled():
    result = CliRunner().invoke(app, ["reproduce", "any-row", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["ok"]
