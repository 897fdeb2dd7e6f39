"""What docs/model.md shows runs: a CasADi agent to a checked problem, its file, a certified design, proved C."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from lockstep.model import load_problem


def blocks(root, language: str) -> list[str]:
    page = (root / "docs" / "model.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


def run(root, number: int, names: dict[str, object]) -> None:
    exec(compile(blocks(root, "python")[number], "docs/model.md", "exec"), names)


@pytest.fixture
def names(root, tmp_path, monkeypatch) -> dict[str, object]:
    """What the first block leaves, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    run(root, 0, names)
    return names


def test_the_example_is_checked_and_written_as_the_page_shows(root, tmp_path, names):
    assert (tmp_path / "pendulums.toml").read_text(encoding="utf-8") == blocks(root, "toml")[0]
    # The gradient of sin(v1) + 0.2 tanh(v2) is longest at 0, where it is (1, 0.2).
    assert names["alpha"] == pytest.approx(np.hypot(1, 0.2), rel=1e-9)
    assert "proved everywhere: 1.0198\n" in blocks(root, "python")[0]
    mine, theirs = names["pendulum"], load_problem("pendulums.toml").agent()
    for letter in "ABCGH":
        np.testing.assert_array_equal(getattr(theirs.lure, letter), getattr(mine.lure, letter))


@pytest.mark.slow
def test_the_example_is_designed_for_and_built(root, tmp_path, names):
    from lockstep.cli.main import app

    run(root, 1, names)
    assert names["found"].certified
    result = CliRunner().invoke(app, ["build", "pendulums.toml", "-o", "pendulums", "--json"])
    answer = json.loads(result.stdout)
    assert (result.exit_code, answer["ok"], answer["problems"]) == (0, True, [])
    assert answer["design"]["certified"]
    assert answer["design"]["sampled"]["certified"]
    assert answer["verify"]["ok"]
    assert answer["design"]["rho"] == pytest.approx(names["found"].rho, rel=1e-9)
    built = json.loads((tmp_path / "pendulums" / "design.json").read_text(encoding="utf-8"))
    assert built["problem"]["agent"]["dynamics"]["rate"] == "torque - sin(angle) - 0.2*tanh(rate)"
