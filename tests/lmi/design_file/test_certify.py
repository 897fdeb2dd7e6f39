"""The checker: what it must refuse however the file is dressed up, what it may not import, and the scope of its proof."""

import json
import os
import subprocess
import sys
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lmi_cases import problem, table_1_problem

from lockstep.check.errors import ProblemError
from lockstep.lmi import document
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import ClaimDecisions, certify
from lockstep.lmi.document import parse
from lockstep.model.problem import Problem


def file_of(posed: Problem) -> dict[str, Any]:
    return json.loads(json.dumps(document.design_file_of(design(posed)).document()))


@pytest.fixture(scope="module")
def table_1() -> dict[str, Any]:
    """The design file of the published Corollary 1 gains."""
    return file_of(table_1_problem())


def verdict(file: dict[str, Any]) -> ClaimDecisions:
    return certify(parse(json.loads(json.dumps(file)), "memory"))


def changed(file: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    file = deepcopy(file)
    node = file
    for key in path[:-1]:
        node = node.setdefault(key, {}) if isinstance(node, dict) else node[key]
    node[path[-1]] = value
    return file


def pendulum(D: float = -2.0, agent: str = "centre = false") -> Problem:
    """Two pendulums with u_i = D (a_i - a_j) + D (b_i - b_j)."""
    gains = "\n".join(f"[[design.gains]]\nD = [[{D}, {D}]]" for _ in range(2))
    return problem(
        dynamics={"a": "b", "b": "-a - sin(a) + u"},
        outputs={"y1": "a", "y2": "b"},
        agent=agent,
        network='agents = 2\ntopology = "path"',
        design=f'method = "given"\n{gains}',
    )


def test_the_published_gains_are_certified_for_all_states(table_1: dict[str, Any]) -> None:
    answer = verdict(table_1)
    assert answer.certified
    assert answer.scope == "global"
    assert answer.margin > 0
    assert table_1["claims"]["rho"] == pytest.approx(13.24)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("claims", "alpha"), 4.7),  # a slope of 4.6 destabilises
        (("claims", "alpha"), 3.32),  # |3.33 cos| reaches 3.33
        (("claims", "rho"), 13.23),  # just below the least
        (("gains", 0, "D", 0, 0), -0.739 * 1.5),
        (("gains", 2, "D", 0, 1), 3.0),
        (("proofs", "certificate", "m"), [0.0, 0.0, 0.0]),
        (("proofs", "certificate", "m", 0), -1e-12),
        (("problem", "agent", "parameters", "gravity"), 3.34),
        (("problem", "network", "edges", 0), [1, 3]),
        (("problem", "network", "edges", 0), [1, 2, 3.0]),
        (("problem", "design", "weights", "state"), 2.0),
        (("problem", "design", "coordinates"), "laplacian_rows"),
        (("problem", "agent", "outputs"), [["y1", "omega_m"], ["y2", "theta_m"]]),
        (("problem", "agent", "dynamics", "omega_m"), "-48.6*theta_m - 1.25*omega_m + 48.6*theta_l + 2.16*u"),
    ],
)
def test_no_certificate_for_another_loop(table_1: dict[str, Any], path: tuple[Any, ...], value: Any) -> None:
    answer = verdict(changed(table_1, path, value))
    assert not answer.certified
    assert answer.scope is None


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("alpha", -3.33),  # alpha^2 is the same
        ("rho", -13.24),  # so is rho^2
        ("rho", 0.0),
    ],
)
def test_what_cannot_be_claimed_of_any_loop_is_bad_input(
    table_1: dict[str, Any], key: str, value: float
) -> None:
    with pytest.raises(ProblemError, match=f"claims, `{key}`"):
        verdict(changed(table_1, ("claims", key), value))


@pytest.mark.parametrize("key", ["figures", "sampled", "initial_set", "title", "anything"])
def test_what_the_file_remarks_on_itself_does_not_count(table_1: dict[str, Any], key: str) -> None:
    wrong = changed(changed(table_1, ("info", key), "trust me"), ("claims", "rho"), 13.0)
    assert not verdict(wrong).certified
    assert verdict(changed(table_1, ("info", key), None)).certified


@pytest.mark.parametrize("key", ["certified", "proof", "sampled"])
def test_what_is_no_claim_by_its_form_is_bad_input(table_1: dict[str, Any], key: str) -> None:
    with pytest.raises(ProblemError, match=key):
        verdict(changed(table_1, ("claims", key), "trust me"))


def test_a_refusal_shows_the_vector_and_the_value(table_1: dict[str, Any]) -> None:
    answer = verdict(
        changed(
            table_1,
            ("claims", "rho"),
            13.0,
        )
    )
    z = np.array(answer.figures["vector"])
    assert np.linalg.norm(z) == pytest.approx(1.0)
    assert answer.figures["value"] < 0
    assert answer.margin < 0
    refuted = verdict(
        changed(
            table_1,
            ("claims", "alpha"),
            3.0,
        )
    )
    assert refuted.figures["slope"] > 3.0, "a slope provably reached, and where"
    assert len(refuted.figures["v"]) == 1


@pytest.mark.slow
def test_a_fragility_that_is_claimed_is_decided(table_1: dict[str, Any]) -> None:
    """More t than the witness has is bad input; with the t of another delta the inequality is decided for this one."""
    with pytest.raises(ProblemError, match="`t`"):
        verdict(changed(table_1, ("claims", "fragility", "D"), 0.1))
    posed = table_1_problem().document()
    posed["design"]["fragility"] = {"D": 0.01}
    fragile = file_of(Problem.from_document(posed))
    assert verdict(fragile).certified
    less = changed(fragile, ("claims", "fragility", "D"), 0.009)
    assert "asks for 0.01" in verdict(less).reason
    assert verdict(changed(less, ("problem", "design", "fragility", "D"), 0.009)).certified
    assert not verdict(changed(fragile, ("claims", "fragility", "D"), 0.02)).certified
    with pytest.raises(ProblemError, match="from 0 up"):
        verdict(changed(fragile, ("claims", "fragility", "D"), -0.01))


def test_a_bound_that_holds_on_a_box_only_is_local() -> None:
    """-sin(a) has slopes from -1 to 1 everywhere and from -0.54 to 1 ... on |a| <= 1: alpha below 1 is local."""
    everywhere = file_of(pendulum())
    assert everywhere["claims"]["scope"] == verdict(everywhere).scope == "global"
    boxed = pendulum(agent="centre = false\ndomain = { a = [1.0, 2.0] }")  # |cos| <= 0.5404 there
    local = file_of(boxed)
    assert local["claims"]["alpha"] == pytest.approx(np.cos(1.0), abs=1e-6)
    assert local["claims"]["scope"] == "local"
    answer = verdict(local)
    assert answer.certified
    assert answer.scope == "local"
    # The same file, its box taken away, claims too small an alpha for all states.
    assert not verdict(changed(local, ("problem", "agent", "domain"), {})).certified


def test_a_local_certificate_is_called_local_wherever_a_reader_looks(tmp_path: Path) -> None:
    """In the design's JSON, in the checker's, and in what both print for people: never global."""
    from typer.testing import CliRunner

    from lockstep.cli.main import app

    for agent, scope in (
        ("centre = false\ndomain = { a = [1.0, 2.0] }", "local"),
        ("centre = false", "global"),
    ):
        path = tmp_path / f"{scope}.json"
        path.write_text(json.dumps(file_of(pendulum(agent=agent))), encoding="utf-8")
        printed = CliRunner().invoke(app, ["certify", str(path)], terminal_width=400).stdout
        told = json.loads(CliRunner().invoke(app, ["certify", str(path), "--json"]).stdout)
        assert json.loads(path.read_text(encoding="utf-8"))["claims"]["scope"] == told["scope"] == scope
        words = " ".join(printed.split())
        assert ("while every agent stays in its domain" in words) is (scope == "local")
        assert ("for every disturbance and initial state" in words) is (scope == "global")


@pytest.mark.slow
def test_behind_a_leader_a_local_certificate_comes_with_initial_states() -> None:
    """The path's two ends hear each other, so nothing can be said of their common motion; a leader moves by itself."""
    agent = "centre = false\ndomain = { a = [1.0, 2.0] }"
    both = file_of(pendulum(agent=agent))
    assert both["claims"]["initial_set"] is None
    assert "hear each other" in both["info"]["initial_set"]["reason"]
    posed = pendulum(D=-4.0, agent=agent).document()
    posed["network"]["topology"] = "leader_path"
    posed["design"]["gains"][0]["D"] = [[0.0, 0.0]]
    led = file_of(Problem.from_document(posed))
    answer = verdict(led)
    assert answer.scope == "local"
    assert answer.proves("initial_set")
    assert led["claims"]["initial_set"]["leader"] == 1
    larger = changed(led, ("claims", "initial_set", "radius"), 1.01 * led["claims"]["initial_set"]["radius"])
    assert not verdict(larger).certified
    # The ball by its half-axes, which are the radius.
    alike = [led["claims"]["initial_set"]["radius"]] * 2
    for half_axes, holds in ((alike, True), ([1.01 * one for one in alike], False)):
        assert verdict(changed(led, ("claims", "initial_set", "half_axes"), half_axes)).certified == holds
    for wrong in (alike * 2, alike[:1], []):
        with pytest.raises(ProblemError, match=f"{len(wrong)} half-axes; expected 2, one per state"):
            verdict(changed(led, ("claims", "initial_set", "half_axes"), wrong))
    assert not verdict(both).proves("initial_set")
    assert not verdict(file_of(pendulum())).proves("initial_set")


SET = {
    "leader": 1,
    "inner": [[1.25, 1.75]],
    "box": [[1.0, 2.0]],
    "level": 1e-9,
    "radius": 1e-9,
    "energy": 1e-9,
}


@pytest.mark.parametrize(("key", "claimed"), [("scope", "global"), ("initial_set", SET)])
def test_more_states_than_are_proved_are_a_broken_claim(key: str, claimed: Any, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from lockstep.cli.main import app

    local = file_of(pendulum(agent="centre = false\ndomain = { a = [1.0, 2.0] }"))
    path = tmp_path / "design.json"
    for content, status in ((local, 0), (changed(local, ("claims", key), claimed), 1)):
        path.write_text(json.dumps(content), encoding="utf-8")
        assert CliRunner().invoke(app, ["certify", str(path), "--json"]).exit_code == status


def test_the_scales_of_the_bound_are_in_the_file() -> None:
    """Two independent nonlinearities: the certificate is about G D_w and D_v^-1 H, whatever a slower machine finds."""
    gains = "\n".join("[[design.gains]]\nD = [[-9.0, -6.0]]" for _ in range(2))
    posed = problem(
        dynamics={"a": "b + 0.3*sin(a)", "b": "-a - 0.02*sin(5*b) + u"},
        outputs={"y1": "a", "y2": "b"},
        agent="centre = false",
        network='agents = 2\ntopology = "path"',
        design=f'method = "given"\n{gains}',
    )
    file = file_of(posed)
    assert set(file["claims"]["scales"]) == {"G", "H"}
    assert verdict(file).certified
    wrong = changed(file, ("claims", "scales", "G"), [d * 64 for d in file["claims"]["scales"]["G"]])
    assert not verdict(wrong).certified
    with pytest.raises(ProblemError, match="above 0"):
        verdict(changed(file, ("claims", "scales", "G"), [0.0] * len(file["claims"]["scales"]["G"])))


def test_a_box_that_is_not_needed_does_not_make_it_local() -> None:
    boxed = pendulum(agent="centre = false\ndomain = { b = [-1.0, 1.0] }")
    assert verdict(file_of(boxed)).scope == "global"


def test_the_checker_imports_no_solver() -> None:
    code = "import sys, lockstep.lmi.design_verdict; print(*sorted(sys.modules))"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=_environment()
    )
    loaded = set(found.stdout.split())
    assert "lockstep.check.continuous.decide" in loaded
    assert not loaded & {"cvxpy", "clarabel", "scipy.optimize", "scipy.linalg", "joblib"}
    solving = subprocess.run(
        [sys.executable, "-c", code.replace("lockstep.lmi.design_verdict", "cvxpy")],
        capture_output=True, text=True, check=True, env=_environment(),
    )  # fmt: skip
    assert "clarabel" in solving.stdout.split()  # the list does show what is imported


def _environment() -> dict[str, str]:
    roots = [str(Path(__file__).parents[3] / root) for root in ("check", "model", "lmi", "codegen")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(roots)}


def test_an_indefinite_weight_certifies_no_unstable_loop() -> None:
    """x' = A x with no gains, A's eigenvalues 4.5e-6 and -1: V' + x'R x < 0 holds because x'R x < 0 along the growth.

    R = 3e16 a a' less one unit in the last place, a = (29, 33): its determinant is negative, the double eigenvalue positive.
    """
    scale, a, b = 3e16, 29, 33
    R = np.array([[a * a * scale, a * b * scale], [a * b * scale, np.nextafter(b * b * scale, 0)]])
    growth, along, across = 4.46e-6, np.array([b, -a]), np.array([a, b])
    square = float(a * a + b * b)
    A = (growth * np.outer(along, along) - np.outer(across, across)) / square
    P = (1e8 * np.outer(along, along) + 4 * scale * square * np.outer(across, across)) / square
    assert np.linalg.eigvals(A).real.max() > 0
    file = {
        "format": "lockstep-design/1",
        "rho": 1e40,
        "alpha": 0.0,
        "fragility": dict.fromkeys("ABCD", 0.0),
        "gains": [{"A": [], "B": [], "C": [[], []], "D": [[0.0, 0.0], [0.0, 0.0]]}] * 2,
        "certificate": {"P": ((P + P.T) / 2).tolist(), "m": [0.0], "t": []},
        "problem": {
            "agent": {
                "states": ["x", "y"],
                "inputs": ["u", "w"],
                "dynamics": {
                    k: f"({r[0]})*x + ({r[1]})*y + {i}"
                    for k, r, i in zip("xy", A.tolist(), "uw", strict=True)
                },
                "outputs": {"y1": "x", "y2": "y"},
            },
            "network": {"agents": 2, "edges": [[1, 2], [2, 1]]},
            "design": {"order": 0, "weights": {"state": R.tolist()}},
        },
    }
    answer = verdict(file)
    assert not answer.certified
    assert "M = R" in answer.reason


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (("problem", "design", "alpha"), 5.0, "`alpha` is 3.33, but [design] alpha asks for 5"),
        (("problem", "design", "fragility"), {"A": 0.5}, "[design.fragility] asks for 0.5"),
    ],
)
def test_a_file_that_claims_less_than_its_problem_asks_for_is_not_certified(
    table_1: dict[str, Any], path: tuple[Any, ...], value: Any, says: str
) -> None:
    answer = verdict(changed(table_1, path, value))
    assert not answer.certified
    assert says in answer.reason


def test_a_rho_above_the_one_asked_for_is_not_certified(table_1: dict[str, Any]) -> None:
    asked = changed(
        changed(table_1, ("problem", "design", "objective"), "alpha"), ("problem", "design", "rho"), 13.24
    )
    assert verdict(asked).certified
    answer = verdict(changed(asked, ("problem", "design", "rho"), 13.23))
    assert "[design] rho asks for 13.23" in answer.reason


def test_gains_other_than_those_of_the_problem_are_not_certified(table_1: dict[str, Any]) -> None:
    """A file holds given gains once; one that repeats them in its problem must repeat the same."""
    assert "gains" not in table_1["problem"]["design"]
    repeated = changed(table_1, ("problem", "design", "gains"), deepcopy(table_1["gains"]))
    assert verdict(repeated).certified
    answer = verdict(changed(repeated, ("problem", "design", "gains", 0, "D", 0, 0), -0.740))
    assert not answer.certified
    assert "`D` of agent 1 is not the one that [[design.gains]] gives" in answer.reason


def test_gains_beyond_the_limit_are_not_what_was_asked() -> None:
    """|D| = 2 sqrt(2) = 2.83 for u = -2 (a + b)."""
    file = changed(file_of(pendulum()), ("problem", "design", "method"), "certified")
    file["problem"]["design"] |= {"gain_limit": 2.82, "order": 0}
    answer = verdict(file)
    assert not answer.certified
    assert "`gain_limit` is 2.82" in answer.reason
    assert verdict(changed(file, ("problem", "design", "gain_limit"), 2.83)).certified
