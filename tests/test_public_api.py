"""`import lockstep` as a user has it: what the functions return is what the files say, from wherever they are called."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lockstep

ROOT = Path(__file__).parents[1]
ARMS = ROOT / "generated" / "flexible_joint_arms"

PAIR = """
title = "<b>A pair</b>"
[agent]
name = "one"
states = ["x"]
inputs = ["u"]
dynamics = { x = "u - sin(x)" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{ D = [[-2.0]] }, { D = [[-2.0]] }]
[controller]
period = 0.01
"""


@pytest.fixture(scope="module")
def arms() -> lockstep.Design:
    return lockstep.load(ARMS)


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A folder away from the checkout, with a problem in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.toml").write_text(PAIR, encoding="utf-8")
    return tmp_path


def python(code: str, place: Path) -> str:
    """What a script prints that runs in a folder, with the package as it is installed here."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=place, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


LOADED = (
    "import sys; print([m for m in ('casadi', 'scipy', 'cvxpy', 'matplotlib', 'numpy') if m in sys.modules])"
)


def test_the_import_alone_loads_nothing_heavy(tmp_path):
    assert python(f"import lockstep; dir(lockstep); {LOADED}", tmp_path) == "[]"
    assert "casadi" in python(f"import lockstep; lockstep.Problem; {LOADED}", tmp_path), (
        "loads when it is used"
    )


def test_the_checker_behind_the_public_api_loads_no_solver(tmp_path):
    code = f"import lockstep; lockstep.certify; lockstep.load; {LOADED}"
    loaded = python(code, tmp_path)
    assert "cvxpy" not in loaded
    assert "matplotlib" not in loaded


def test_the_public_api_works_away_from_the_checkout(tmp_path):
    code = f"import lockstep; d = lockstep.load({str(ARMS)!r}); print(d.rho, lockstep.__name__)"
    assert (
        python(code, tmp_path)
        == f"{json.loads((ARMS / 'design.json').read_text())['claims']['rho']} lockstep"
    )


def test_every_name_is_there_and_says_what_it_is():
    for name in lockstep.__all__:
        assert name in dir(lockstep)
        assert getattr(lockstep, name).__doc__, name
    with pytest.raises(AttributeError, match="desing"):
        _ = lockstep.desing
    assert lockstep.model.__name__ == "lockstep.model", "the parts are there beside the steps"


def test_a_loaded_design_is_what_its_file_says(arms):
    content = json.loads((ARMS / "design.json").read_text(encoding="utf-8"))
    claims = content["claims"]
    assert arms.title == content["problem"]["title"]
    assert (arms.rho, arms.alpha, arms.floor) == tuple(claims[key] for key in ("rho", "alpha", "floor"))
    assert arms.certified is claims["certified"]
    rate, factor = arms.sampled["rate"], claims["sampled"]["fastest_decay"]
    assert arms.sampled == claims["sampled"] | content["info"]["sampled"] | {"rate": rate}
    # A V falls by the claimed factor from one sample to the next, |x_d| by its root: e^(-rate T), rounded to a slower one.
    assert factor < np.exp(-2 * rate * 0.005) < factor * (1 + 1e-6)
    for letter in "ABCD":
        for matrix, said in zip(getattr(arms.gains, letter), content["gains"], strict=True):
            assert matrix.tolist() == said[letter]
    said = arms.document()
    assert (said["gains"], said["rho"], said["sampled"]) == (content["gains"], arms.rho, arms.sampled)
    assert arms.stored.document() == content
    assert arms == lockstep.load(ARMS / "design.json")


def test_a_saved_design_is_the_same_file(arms, place):
    arms.save("again.json")
    assert (place / "again.json").read_bytes() == (ARMS / "design.json").read_bytes()
    assert lockstep.load(place / "again.json") == arms
    with pytest.raises(lockstep.ProblemError, match="no such folder"):
        arms.save(place / "nowhere" / "again.json")


def test_a_changed_file_is_another_design(arms, place):
    content = json.loads((ARMS / "design.json").read_text(encoding="utf-8"))
    content["claims"]["sampled"]["rho"] = 1.0
    (place / "changed.json").write_text(json.dumps(content), encoding="utf-8")
    changed = lockstep.load("changed.json")
    assert changed != arms
    assert changed.sampled["rho"] == 1.0, "a claim is what the file says"
    verdict = lockstep.certify(changed)
    assert not verdict.ok, "and no more than that"
    assert "the gain 1, but its witness does not prove it" in verdict.reason


@pytest.mark.slow
@pytest.mark.usefixtures("place")
def test_from_a_problem_to_c_that_is_equal_to_the_last_bit():
    found = lockstep.design("pair.toml", output="design.json")
    assert found == lockstep.load("design.json")
    assert found.problem.title == "<b>A pair</b>"
    assert found.certified
    verdict = lockstep.certify(found)
    assert verdict.ok
    assert verdict.rho == found.rho
    assert verdict.document() == lockstep.certify("design.json").document()
    # x_d' = -cos(.) x_d - 4 x_d + xi_d, -1 <= cos <= 1: at worst a gain of 1/3, and no certificate can say less.
    assert found.rho >= 1 / 3
    made = lockstep.generate(found, "c")
    assert sorted(p.relative_to("c").as_posix() for p in Path("c").rglob("*") if p.is_file()) == sorted(
        made.files
    )
    assert lockstep.load("c") == made.design
    assert lockstep.certify("c").ok
    assert lockstep.certify("c").document()["proof"] == "ball"
    report = lockstep.verify("c", steps=50, targets=["host"])
    assert report.ok, report.problems


@pytest.mark.slow
@pytest.mark.usefixtures("place")
def test_problems_are_taken_as_objects_too():
    problem = lockstep.Problem.load("pair.toml")
    assert problem.document() == lockstep.Problem.parse(PAIR).document()
    assert lockstep.design(problem) == lockstep.design("pair.toml")


def test_what_does_not_hold_is_raised_and_nothing_is_written(place):
    problem = lockstep.Problem.parse(PAIR.replace("-2.0", "2.0"))
    with pytest.raises(lockstep.ClaimError):
        lockstep.design(problem, output="d.json")
    with pytest.raises(lockstep.ProblemError, match=r"pair\.toml"):
        lockstep.design("pair.toml", output="pair.toml")
    with pytest.raises(lockstep.ProblemError, match="no such file"):
        lockstep.build("none.toml", "out")
    assert [path.name for path in place.iterdir()] == ["pair.toml"]


def test_c_changed_by_one_literal_is_not_certified(place):
    lockstep.generate(lockstep.design("pair.toml"), "c")
    source = place / "c" / "src" / "one1.c"
    text = source.read_text(encoding="utf-8")
    assert "2.0f" in text
    source.write_text(text.replace("2.0f", "-2.0f"), encoding="utf-8")
    found = lockstep.certify("c")
    assert not found.ok
    assert found.differences


def test_a_design_is_a_system_of_python_control(arms):
    loop = arms.to_control()
    assert (loop.ninputs, loop.nstates) == (3 * 4, 3 * (4 + 2))
    linear = arms.to_control(linear=True)
    assert np.linalg.eigvals(linear.A).real.max() < 0, "a certified loop is stable"
    assert [one.nstates for one in arms.controllers_to_control(period=0.005)] == [2, 2, 2]


@pytest.mark.usefixtures("place")
def test_a_notebook_shows_claims_as_claims_and_texts_as_texts():
    found = lockstep.design("pair.toml")
    page = found._repr_html_()
    assert f"{found.rho:.6g}" in page
    assert "claimed" in page
    assert "&lt;b&gt;A pair&lt;/b&gt;" in page
    assert "<b>" not in page
    assert "A pair" in repr(found)


def test_a_run_is_held_against_what_is_proved(arms, place):
    run = lockstep.simulate(arms, horizon=0.5, output="run.csv")
    assert run.ok
    document = run.document()
    assert document["horizon"] == 0.5
    assert document["l2"]["rho"] == arms.sampled["rho"]
    assert len((place / "run.csv").read_text().splitlines()) == len(run.trajectory.t) + 1
    with pytest.raises(lockstep.ProblemError, match="--controllers"):
        lockstep.simulate(arms, controllers="none")


@pytest.mark.slow
@pytest.mark.usefixtures("place")
def test_a_design_that_is_no_folder_has_no_c_to_run():
    found = lockstep.design("pair.toml")
    with pytest.raises(lockstep.ProblemError, match="no C to compile"):
        lockstep.simulate(found, controllers="compiled", horizon=0.1)
    lockstep.generate(found, "c")
    assert lockstep.simulate(lockstep.load("c"), controllers="compiled", horizon=0.1).ok


def test_nothing_below_the_public_api_goes_through_it():
    """import-linter sees the parts of the package, and `import lockstep` is none of them."""
    parts = [*ROOT.glob("*/lockstep/*/**/*.py"), *ROOT.glob("studies/**/*.py")]
    assert {"check", "workflow", "cli", "amini"} <= {name for path in parts for name in path.parts}
    through = {path for path in parts if goes_through(path.read_text(encoding="utf-8"))}
    assert {path.parent.name for path in through} == {"cli"}
    assert goes_through("def f():\n    import lockstep\n")
    assert goes_through("from lockstep import design\n")
    assert not goes_through("import lockstep.check.errors\nfrom lockstep.model import Agent\n")


def goes_through(source: str) -> bool:
    """Tell whether a text imports `lockstep` itself, within functions too."""
    return any(
        (isinstance(node, ast.Import) and any(alias.name == "lockstep" for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and node.module == "lockstep")
        for node in ast.walk(ast.parse(source))
    )
