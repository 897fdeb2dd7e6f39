"""What the README and the page of the functions show runs, and the figures are those that appear."""

import json
import re

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app
from lockstep.lmi.proposal import proved_bound
from lockstep.model.problem import parse_problem


def test_the_python_examples_run(root, tmp_path, monkeypatch):
    (tmp_path / "generated").symlink_to(root / "generated")
    monkeypatch.chdir(tmp_path)
    page = (root / "docs" / "api.md").read_text(encoding="utf-8")
    steps, agent = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(steps, "api.md", "exec"), names)
    saved = json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))
    assert names["rho"] == saved["claims"]["sampled"]["rho"]
    assert names["A_1"].tolist() == saved["gains"][0]["A"]
    assert names["run"].ok
    assert names["loop"].ninputs == 3 * 4, "a disturbance on every state of three arms"
    names = {}
    exec(compile(agent, "api.md", "exec"), names)
    assert names["loop"].A_0.shape == (2 * 3 + 2 * 4,) * 2


def test_the_problem_it_begins_with_is_whole(root):
    (text,) = re.findall(
        r"```toml\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL
    )
    problem = parse_problem(text, "README.md")
    assert proved_bound(problem).alpha == pytest.approx(9.81), "the largest slope of 9.81 sin"


def test_what_certify_says_is_what_the_page_shows(root, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    result = CliRunner().invoke(app, ["certify", str(root / "generated" / "flexible_joint_arms")])
    (shown,) = re.findall(
        r"```text\n(.*?)\n```", (root / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL
    )
    assert [line.rstrip() for line in result.stdout.splitlines()[1:]] == shown.splitlines()


def test_ci_finds_its_two_commands(root):
    commands = re.findall(r"```sh\n(.*?)\n```", (root / "README.md").read_text(), flags=re.DOTALL)
    assert "lockstep build" in commands[0]
    assert "pytest" in commands[1]
    installed = re.findall(r"```sh\n(.*?)\n```", (root / "docs" / "install.md").read_text(), flags=re.DOTALL)
    in_one = [block.replace("\n", " && ") for block in installed]
    assert in_one == commands[:1], "the site shows the README's first command, a line for each part"


SAME_DESIGN = 0.02
"""The contract: the same file and seed give a design as good on every machine, to 2 % of rho."""

SHOWN = {
    # what is said, the figure that it is of, by which part it may differ
    r"disturbance gain is rho = (\d+\.\d+)": (lambda design: design["sampled"]["rho"], SAME_DESIGN),
    # 13.23 was measured apart from this code (issue tracker); three digits are printed.
    r"gains of the example reach (\d+\.\d+)": (lambda _: 13.23, 0.005),
    # Proved by bisection, whose end depends on the solver's last digits; three digits are printed.
    r"can be certified below (\d+\.\d+)": (lambda design: design["floor"], 0.01),
}


def drifted(page: str, design: dict) -> list[str]:
    """What the page says that is not so for a design of its example."""
    text, found = " ".join(page.split()), []
    for pattern, (figure, tolerance) in SHOWN.items():
        said = re.search(pattern, text)
        assert said, f"the README does not say {pattern}"
        if float(said[1]) != pytest.approx(figure(design), rel=tolerance):
            found.append(said[0])
    return found


def test_the_figures_are_those_of_the_committed_design(root):
    page = (root / "README.md").read_text(encoding="utf-8")
    design = json.loads(
        (root / "generated" / "flexible_joint_arms" / "design.json").read_text(encoding="utf-8")
    )
    assert drifted(page, design["claims"]) == []
    design["claims"]["sampled"]["rho"] *= 1.03
    (told,) = drifted(page, design["claims"])
    assert "rho" in told, "a design that is 3 % worse is another design"


@pytest.mark.slow
def test_the_figures_are_those_that_appear_on_this_machine(root, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["design", str(root / "examples" / "flexible_joint_arms.toml"), "-o", "design.json", "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0
    assert drifted((root / "README.md").read_text(encoding="utf-8"), json.loads(result.stdout)) == []


def test_no_time_is_promised(root):
    """It would be that of one machine."""
    page = (root / "README.md").read_text(encoding="utf-8")
    assert not re.search(r"(?i)\b(\d+|a|an|one|two|half a) (second|minute|hour)s?\b", page)
