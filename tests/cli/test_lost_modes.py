"""Modes that no input moves or no output shows: designed for and proved where they decay, refused where they do not.

Each agent is a pendulum with one mode more. The proofs are the checker's, of the design file, the sampled loop included.
"""

import json

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app

PENDULUM = {"a": "b", "b": "u - 0.5*sin(a)"}
BOTH, ANGLE = ("a", "b"), ("a",)

# dynamics, outputs, the order of the controllers, (controllable, observable)
DECAYING = {
    "an input filter that nobody drives": (PENDULUM | {"b": "u + w - 0.5*sin(a)", "w": "-w"}, BOTH, 0, (False, True)),
    "a temperature that nobody measures": (PENDULUM | {"w": "a - w"}, BOTH, 0, (True, False)),
    "two tanks filled alike": ({"p": "u - p", "q": "u - q + 0.1*sin(q)"}, ("p + q",), 0, (False, False)),
    "two linear tanks filled alike": ({"p": "u - p", "q": "u - q"}, ("p + q",), 0, (False, False)),
    "a part of its own": (PENDULUM | {"w": "-w"}, BOTH, 0, (False, False)),
    "both, the angle alone measured": (
        PENDULUM | {"a": "b + w", "w": "-w", "z": "b - 2*z"}, ANGLE, 1, (False, False)
    ),
}  # fmt: skip

STAYING = {
    "a disturbance that stays": (
        PENDULUM | {"b": "u + w", "w": "0*w"},
        BOTH,
        "(A, B) is not stabilisable",
        "0",
    ),
    "a disturbance that grows": (
        PENDULUM | {"b": "u + w", "w": "0.1*w"},
        BOTH,
        "(A, B) is not stabilisable",
        "0.1",
    ),
    "an oscillation": (PENDULUM | {"w": "4*z", "z": "-w + u"}, BOTH, "(A, C) is not detectable", "0 +- 2i"),
    "a position that nobody measures": (PENDULUM, ("b",), "(A, C) is not detectable", "0"),
}


def text(dynamics: dict[str, str], outputs: tuple[str, ...], order: int) -> str:
    return "\n".join(
        [
            "[agent]",
            f"states = {json.dumps(list(dynamics))}",
            'inputs = ["u"]',
            "[agent.dynamics]",
            *[f"{state} = {json.dumps(formula)}" for state, formula in dynamics.items()],
            "[agent.outputs]",
            *[f"y{k} = {json.dumps(formula)}" for k, formula in enumerate(outputs, start=1)],
            '[network]\nagents = 2\ntopology = "path"',
            f"[design]\norder = {order}\nstarts = 2\ngain_limit = 20.0",
            "[controller]\nperiod = 0.01",
        ]
    )


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Write a problem file and run a command on it, or on what a command before has written."""
    monkeypatch.chdir(tmp_path)

    def command(*words: str, problem: str = "") -> tuple[int, dict]:
        if problem:
            (tmp_path / "problem.toml").write_text(problem, encoding="utf-8")
        result = CliRunner().invoke(app, [*words, "--json"])
        return result.exit_code, json.loads(result.stdout)

    return command


@pytest.mark.slow
@pytest.mark.parametrize("name", DECAYING)
def test_a_lost_mode_that_decays_is_designed_for_and_proved(name, run):
    dynamics, outputs, order, (controllable, observable) = DECAYING[name]
    status, found = run("check", "problem.toml", problem=text(dynamics, outputs, order))
    assert (status, found["ok"]) == (0, True)
    assert (found["controllable"], found["stabilisable"]) == (controllable, True)
    assert (found["observable"], found["detectable"]) == (observable, True)
    run("design", "problem.toml", "-o", "design.json")
    status, proved = run("certify", "design.json")
    assert (status, proved["certified"], proved["proof"]) == (0, True, "exact")
    assert proved["sampled"]["certified"]


@pytest.mark.parametrize("name", STAYING)
@pytest.mark.parametrize("command", [("check",), ("design", "-o", "design.json")])
def test_a_lost_mode_that_does_not_decay_is_refused(name, command, run, tmp_path):
    dynamics, outputs, says, mode = STAYING[name]
    first, *rest = command
    status, answer = run(first, "problem.toml", *rest, problem=text(dynamics, outputs, 0))
    assert status == 2
    assert says in answer["error"]["found"]
    assert f"the eigenvalue {mode} of A, which does not decay by itself" in answer["error"]["found"]
    assert not (tmp_path / "design.json").exists()


TANKS = ({"h": "(u - sqrt(h))/2", "k": "(sqrt(h) - sqrt(k))/2"}, ("k",), 1)


def test_where_the_slopes_that_a_mode_needs_have_no_range_a_domain_is_asked_for(run):
    """Two tanks, one after the other: A = 0 as written, and -0.5/sqrt(h) has no middle up to h = 0."""
    status, answer = run("check", "problem.toml", problem=text(*TANKS))
    assert status == 2
    assert "give [agent.domain], a box where the nonlinearity has finite slopes" in answer["error"]["remedy"]
    status, answer = run(
        "check", "problem.toml", problem=text(*TANKS) + "\n[agent.domain]\nh = [0.1, 0.6]\nk = [0.1, 0.6]\n"
    )
    assert status == 0
    status, answer = run(
        "check", "problem.toml", problem=text(*TANKS) + "\n[agent.domain]\nh = [0.0, 0.6]\nk = [0.0, 0.6]\n"
    )
    assert status == 2
    box = "such as h = [0.03, 0.6], k = [0.03, 0.6]"
    assert f"give a box in [agent.domain], {box}" in answer["error"]["remedy"], "down to h = 0 they have none"
    in_a_sphere = {"h": "(q - 0.2*sqrt(h))/(pi*(2*h - h**2))", "q": "(u - q)/5"}
    boxed = text(in_a_sphere, ("h",), 1) + "\n[agent.domain]\nh = [0.6, 1.4]\n"
    status, answer = run("check", "problem.toml", problem=boxed)
    assert status == 2
    assert "a box in [agent.domain], such as q = [" in answer["error"]["remedy"], (
        "the slope by h grows with q"
    )
    assert run("check", "problem.toml", problem=boxed + "q = [0.0, 0.5]\n")[0] == 0


def test_a_mode_that_is_lost_only_where_slopes_are_around_zero_asks_for_a_domain(run):
    """An angle whose rate alone is measured: sin(a) shows it near 0, and nowhere for certain without a domain."""
    rate = text(PENDULUM, ("b",), 1)
    status, answer = run("check", "problem.toml", problem=rate)
    assert status == 2
    assert "give [agent.domain], a box where the nonlinearity has slopes that are not around zero" in str(
        answer
    )
    assert run("check", "problem.toml", problem=f"{rate}\n[agent.domain]\na = [-1.0, 1.0]\n")[0] == 0
    # A part that no output shows, at the origin either: no domain would help.
    status, answer = run("check", "problem.toml", problem=text(PENDULUM | {"w": "sin(w)"}, ("a", "b"), 1))
    assert status == 2
    assert "[agent.domain]" not in answer["error"]["remedy"]


def test_where_nothing_may_count_in_a_no_domain_is_advised(tmp_path) -> None:
    """p' = v, v' = u - 5 sin(p), v measured: on a domain sin counts in A, but not where `alpha` is of phi as written."""
    path = tmp_path / "p.toml"
    asked = text({"p": "v", "v": "u - 5*sin(p)"}, ("v",), 0).replace(
        "[agent]", "[agent]\ndomain = { p = [-1, 1] }"
    )
    path.write_text(asked)
    assert CliRunner().invoke(app, ["check", str(path)]).exit_code == 0
    path.write_text(asked.replace("[design]", "[design]\nalpha = 6.0"))
    refused = CliRunner().invoke(app, ["check", str(path)])
    assert refused.exit_code == 2
    assert "name neither `centre = false` nor [design] alpha" in refused.stderr
    assert "give [agent.domain]" not in refused.stderr
