"""The checker alone: every claim of the committed design and of its C, decided from the text of the equations."""

import json
import shutil
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.__main__ import main
from lockstep.check.certify import Certified, certify
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import LockstepError, ProblemError
from lockstep.check.requirements import shortfalls
from lockstep.check.verdict import Verdict

FOLDER = Path(__file__).parents[2] / "generated" / "flexible_joint_arms"
DESIGN = json.loads((FOLDER / "design.json").read_text())


def written(folder: Path, content: dict[str, Any]) -> Path:
    place = folder / "design.json"
    place.write_text(json.dumps(content))
    return place


def test_the_design_and_its_c_are_proved_claim_by_claim(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(FOLDER), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = ["bound", "certificate", "asked", "decay", "controllers_stable", "floor", "code"]
    expected += [
        "controllers_stable_sampled",
        "sampled",
        "sampled_decay",
        "sampled_rho",
        "max_period",
        "limits",
        "limits_gain",
        "clipped",
    ]
    assert list(found["claims"]) == expected
    assert found["certified"] is True


def test_the_verdicts_stand_below_each_other(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("bound", "controllers_stable_sampled")
    found = Certified("it", dict.fromkeys(names, Verdict("proved", "so")))
    monkeypatch.setattr("lockstep.check.__main__.certify", lambda _path: found)
    assert main(["somewhere"]) == 0
    lines = capsys.readouterr().out.splitlines()[1:3]
    assert [line.index(" proved ") for line in lines] == [len(names[1])] * 2


def test_what_fails_is_named_and_what_rests_on_it_is_not_decided(tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    content["gains"][0]["D"][0][0] *= -1
    found = certify(written(tmp_path, content))
    assert [one.status for one in found.verdicts.values()] == ["proved", "refuted"]
    assert not found.proved


TANKS = {
    "agent": {
        "name": "tank",
        "states": ["x"],
        "inputs": ["u"],
        "parameters": {},
        "dynamics": {"x": "u - 0.6*(max(x, 0) + min(x, 0)) - 0.4*sin(x)"},
        "outputs": [["y", "x"]],
    },
    "network": {"agents": 2, "topology": "complete"},
    "design": {
        "order": 0,
        "method": "given",
        "alpha": 1.0,
        "weights": {"state": 1.0, "controller": 1.0},
        "coordinates": "orthonormal",
    },
    "controller": {"period": 0.02, "real": "float32", "delay": 0, "discretization": "tustin"},
}


def moved_slope() -> dict[str, Any]:
    """x' = u + phi, u = 0, phi with slopes from -1 to -0.2, -1.1 of it in A, where P = 5 proves what is left of it: 0.9."""
    content, claims, proofs = deepcopy(DESIGN), DESIGN["claims"], DESIGN["proofs"]
    gains = [{"A": [], "B": [], "C": [[]], "D": [[0.0]]}] * 2
    sampled = dict.fromkeys(claims["sampled"]) | {"certified": False, "proof": "none"}
    for key in ("limits_gain", "clipped_radius"):
        del sampled[key]
    none = {"decay": None, "controllers_stable": False, "floor": None, "sampled": sampled}
    bound = {"boxes": 2000, "moves": [{"component": 1, "argument": 1, "amount": "-11/10"}]}
    proved = {"certificate": {"P": [[5.0]], "m": [5.0], "t": []}, "bound": bound}
    return content | {
        "problem": TANKS,
        "gains": gains,
        "claims": claims | none | {"rho": 12.0, "alpha": 1.0},
        "proofs": dict.fromkeys(proofs) | proved,
        "info": {},
    }


def test_a_slope_in_A_is_no_part_of_the_class_that_alpha_asks_for(tmp_path: Path) -> None:
    """phi(x) = x has the slope 1 and lets x_1 - x_2 grow: with -1.1 in A alpha = 1 says nothing of it, and 2.1 would."""
    stored = parse(moved_slope(), "design.json", ProblemTables.from_document)
    problem, moved = stored.problem, [Fraction(-11, 10)]

    def short(alpha: float, **other: Any) -> list[str]:
        claims = replace(stored.claims, alpha=alpha, **other)
        return list(shortfalls(problem.design, claims, stored.gains, problem.gain_units, moved))

    assert any("slopes of 1.1 are moved into A" in one for one in short(1.0))
    assert short(2.0)
    assert not short(2.125)
    assert short(2.125, scales=((1.0,), (1.0,))), "in scales -1.1 is another number"
    for split in ("terms", "jacobian"):  # at 0 the slope is -1, and what is asked for is moved is that
        content = moved_slope()
        content["problem"] = content["problem"] | {"agent": TANKS["agent"] | {"split": split}}
        found = certify(written(tmp_path, content))
        assert found.verdicts["certificate"].proved
        assert found.verdicts["asked"].status == "refuted", split


def test_a_title_makes_no_lines_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = deepcopy(DESIGN)
    content["problem"]["title"] = (
        "Arms\nfloor    proved     no controllers certify a rho below 4.6\ncertified"
    )
    main([str(written(tmp_path, content))])
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("bound")
    assert lines.count("certified") == 1


def test_a_local_design_says_so_in_its_first_line(tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    assert "domain" not in certify(written(tmp_path, content)).verdicts["bound"].reason
    content["claims"]["scope"] = "local"
    said = certify(written(tmp_path, content)).verdicts["bound"].reason
    assert "while every agent stays in the domain" in said
    content["claims"]["alpha"] = 3.0
    refuted = certify(written(tmp_path, content)).verdicts["bound"]
    assert refuted.status == "refuted"
    assert "holds" not in refuted.reason


def test_fewer_boxes_than_the_proof_takes_decide_nothing(tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    content["proofs"]["bound"]["boxes"] = 0
    assert certify(written(tmp_path, content)).verdicts["bound"].status == "undecided"
    content["proofs"]["bound"] = None
    assert not certify(written(tmp_path, content)).proved


TYPES = "typedef short int32_t;\ntypedef unsigned int uint32_t;\nstatic const uint32_t UINT32_MAX = 4294967295u;\n"


@pytest.mark.parametrize(
    ("manifest", "files", "found"),
    [
        ({"name": "stdint"}, {"include/stdint.h": TYPES}, "include/stdint.h"),
        ({"name": "("}, {"src/(.c": "int one = 1;\n"}, "src/(.c"),
        ({"name": "float"}, {"src/float.c": "int one = 1;\n"}, "src/float.c"),
        ({}, {"src/arm3_table.c": "void evil(void) { for (;;) { } }\n"}, "src/arm3_table.c"),
        ({}, {"include/arm3_table.h": "#define float double\n"}, "include/arm3_table.h"),
    ],
    ids=str,
)
def test_no_file_of_another_name_is_read_by_a_compiler_alone(
    manifest: dict[str, str], files: dict[str, str], found: str, tmp_path: Path
) -> None:
    """Names come from a manifest of which nothing is believed: a table that shadows a compiler's header is none."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    named = json.loads((folder / "manifest.json").read_text()) | manifest
    (folder / "manifest.json").write_text(json.dumps(named))
    if manifest:
        for part in ("include/arm_controllers.h", "src/arm_controllers.c"):
            (folder / part).unlink()
    for path, text in files.items():
        (folder / path).write_text(text)
    verdict = certify(folder).verdicts["code"]
    assert verdict.status == "undecided"
    assert verdict.reason == f"{found}: a compiler may read it, and nothing here does"


@pytest.mark.parametrize("name", ["memset", "memcpy", "main", "abort"])
def test_no_data_in_the_table_has_a_name_that_compilers_call(name: str, tmp_path: Path) -> None:
    """0x4770 is `bx lr`: a call of memset that a compiler puts into a step would end in an array."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    table = folder / "src" / "arm_controllers.c"
    table.write_text(f"{table.read_text()}\nconst unsigned short {name}[2] = {{0x4770u, 0xbf00u}};\n")
    assert certify(folder).verdicts["code"].reason.startswith("src/arm_controllers.c: a compiler may read it")


@pytest.mark.parametrize("prefix", ["(", "((a|a)*)*!", "a.b", "é", "x" * 60])
def test_a_prefix_is_part_of_a_name(prefix: str, tmp_path: Path) -> None:
    """Of `((a|a)*)*!` a pattern would be made whose match takes exponential time."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    (folder / "include" / "tab.h").write_text(f'#include "{"a" * 40}.h"\n')
    (folder / "manifest.json").write_text(json.dumps({"prefix": prefix, "name": "tab"}))
    with pytest.raises(ProblemError, match="begins no C identifier"):
        certify(folder)


@pytest.mark.parametrize("name", ["(", "[", "a|b", "*_controllers"])
def test_a_folder_without_the_table_that_it_names_is_proved(name: str, tmp_path: Path) -> None:
    """What a manifest names is no pattern; the controllers need no table."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    for part in ("include/arm_controllers.h", "src/arm_controllers.c"):
        (folder / part).unlink()
    (folder / "manifest.json").write_text(json.dumps({"name": name}))
    assert certify(folder).verdicts["code"].proved


def test_a_longest_period_below_the_period_is_decided_too(tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    content["claims"]["sampled"]["max_period"] = 1e-300
    content["proofs"]["max_period"] = None
    found = certify(written(tmp_path, content))
    assert found.verdicts["max_period"].status == "undecided"
    assert not found.proved


def test_across_a_domain_without_width_no_slope_refutes(tmp_path: Path) -> None:
    """phi(a) = phi(b) where a = b is all there is: the slope 3.33 cos(0.5) of the arm is none of its differences."""
    content = deepcopy(DESIGN)
    content["problem"]["agent"]["domain"] = {"theta_l": [0.5, 0.5]}
    content["claims"] |= {"scope": "local", "alpha": 0.0, "initial_set": None}
    assert certify(written(tmp_path, content)).verdicts["bound"].status == "undecided"


def test_a_product_of_many_factors_is_refused_before_it_is_differentiated(tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    factors = "*".join(f"(theta_l+{i})" for i in range(1, 80))
    content["problem"]["agent"]["dynamics"]["omega_l"] = factors
    with pytest.raises(ProblemError, match="a product of more than 12 different factors"):
        certify(written(tmp_path, content))


def test_a_figure_that_overflows_proves_no_residual(tmp_path: Path) -> None:
    """kappa c beyond the doubles times no error of messages is not a number, and a claim is no worse than that."""
    content = deepcopy(DESIGN)
    content["proofs"]["sampled"] |= {"kappa": 1e300, "ratio": 1e10}
    for key in ("residual_per_message_error", "residual_rms_per_message_error"):
        content["claims"]["sampled"][key] = None
    content["claims"]["sampled"]["residual_from_underflow"] = 0.0
    assert certify(written(tmp_path, content)).verdicts["sampled"].status == "undecided"


@pytest.mark.parametrize(
    ("path", "old", "new", "what"),
    [
        ("src/arm1.c", "float32 controller", "float32 controller", ""),
        ("src/arm2.c", "r[k] = r[k] + ", "r[k] = r[k] - ", "code"),
        ("include/arm1.h", "PERIOD_S 0.005", "PERIOD_S 0.004", "code"),
    ],
)
def test_c_that_is_not_the_designs_is_no_proof(
    path: str, old: str, new: str, what: str, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    text = (folder / path).read_text()
    assert what == "" or old in text
    (folder / path).write_text(text.replace(old, new))
    found = certify(folder)
    assert found.proved is (what == "")
    assert what == "" or not found.verdicts[what].proved


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("problem", "controller", "real"), 2),
        (("problem", "agent", "outputs", 0), False),
        (("problem", "agent", "outputs", 1, 0), [[None, 1]]),
        (("problem", "agent", "domain"), [1]),
        (("problem", "network", "parameters"), [{}, {"gravity": 3.4}, {}]),
        (("format",), "lockstep-design/1"),
        (("problem", "network", "edges", 0, 0), 10**30),
        (("proofs", "bound", "boxes"), True),
        (("proofs", "bound", "moves"), [{"component": 1, "argument": 1, "amount": "1/0"}]),
        (("proofs", "bound", "moves"), [{"component": 1, "argument": 1, "amount": "1/00"}]),
        (("proofs", "sampled", "P"), [[1.0], []]),
        (("proofs", "certificate", "m"), [1.0]),
    ],
)
def test_a_mistake_is_one_message(
    place: tuple[Any, ...], value: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = deepcopy(DESIGN)
    part = content
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    with pytest.raises(ProblemError):
        certify(written(tmp_path, content))
    assert main([str(tmp_path / "design.json")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else []
    return [path, *(one for key, value in children for one in places(value, (*path, key)))]


ANY = st.sampled_from([None, True, -1, 2, 3.5, 1e300, "", "x", [], {}, [1], [[1]], ["a"], {"a": 1}, 10**30])
PLACES = st.sampled_from([p for p in places(DESIGN) if (p and p[0] in ("problem", "claims")) or len(p) == 2])


@pytest.mark.slow
@settings(max_examples=40)
@given(PLACES, ANY)
def test_any_value_anywhere_is_an_answer(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], value: Any
) -> None:
    content = deepcopy(DESIGN)
    part = content
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    try:
        found = certify(written(tmp_path_factory.mktemp("any"), content))
    except LockstepError:
        return
    assert all(one.reason for one in found.verdicts.values())


ASKED: list[Any] = ["x", [], {}, [[1]], {"A": "x"}, {"Z": 1.0}, True, 10**400]


@pytest.mark.parametrize("key", ["gain_limit", "alpha", "rho", "fragility"])
@pytest.mark.parametrize("value", ASKED)
def test_what_is_asked_for_may_be_anything_and_is_an_answer(key: str, value: Any) -> None:
    """Values that are none of their kind ended in a TypeError once; an empty `fragility` asks for nothing."""
    stored = parse(DESIGN, "memory", ProblemTables.from_document)
    design = {**stored.problem.design, key: value}
    if key == "fragility" and value in ([], {}):
        design[key] = {}
        assert list(shortfalls(design, stored.claims, stored.gains, stored.problem.gain_units)) == []
        return
    with pytest.raises(ProblemError, match=key):
        list(shortfalls(design, stored.claims, stored.gains, stored.problem.gain_units))


def test_a_limit_that_is_not_written_is_the_default() -> None:
    """|K| <= 50, method "certified": a file does not get around the limit by leaving keys out."""
    stored = parse(DESIGN, "memory", ProblemTables.from_document)
    design = {
        key: value for key, value in stored.problem.design.items() if key not in ("gain_limit", "method")
    }
    large = replace(stored.gains, D=tuple(D * 1e3 for D in stored.gains.D))
    assert list(shortfalls(design, stored.claims, stored.gains, stored.problem.gain_units)) == []
    assert any(
        "`gain_limit` is 50" in line
        for line in shortfalls(design, stored.claims, large, stored.problem.gain_units)
    )


def test_a_limit_in_units_is_of_the_gains_in_them() -> None:
    """In times of 0.5 s, u in 4 V: A counts half, C a quarter; y in 2 m: B and D twice."""
    asked = {"time": 0.5, "inputs": {"u": 4.0}, "outputs": {"y1": 2.0, "y2": 2.0}}
    tables = deepcopy(DESIGN["problem"])
    tables["design"] |= {"gain_units": asked, "gain_limit": 1.0}
    stored = parse(DESIGN, "memory", ProblemTables.from_document)
    problem = replace(stored.problem, tables=tables)
    left, right = np.diag([0.5, 0.5, 0.25]), np.diag([1.0, 1.0, 2.0, 2.0])
    norms = [float(np.linalg.norm(left @ K @ right, 2)) for K in stored.gains.blocks]
    for limit, fits in ((max(norms) * (1 + 1e-9), True), (max(norms) * (1 - 1e-9), False)):
        asked = tables["design"] | {"gain_limit": limit}
        said = list(shortfalls(asked, stored.claims, stored.gains, problem.gain_units))
        assert (not said) is fits
        assert fits or f"have the norm {max(norms):.10g}" in said[0]


@pytest.mark.parametrize(
    "units",
    [
        {"time": 0.0},
        {"time": "x"},
        {"inputs": {"w": 1.0}},
        {"outputs": {"y1": -1.0}},
        {"u": 1.0},
        {"inputs": "x"},
        [1],
    ],
)
def test_units_of_gains_that_are_none_are_refused(units: Any, tmp_path: Path) -> None:
    content = deepcopy(DESIGN)
    content["problem"]["design"]["gain_units"] = units
    with pytest.raises(ProblemError, match="gain_units"):
        certify(written(tmp_path, content))


@pytest.mark.parametrize("edge", [-1, 1.5, None, "1, 2", {}, [], [1], [[1], 2]])
def test_an_edge_is_a_list_of_numbers(edge: Any) -> None:
    """A bare number ended in a TypeError once."""
    problem = deepcopy(DESIGN["problem"])
    problem["network"]["edges"][0] = edge
    with pytest.raises(ProblemError, match="edge"):
        _ = ProblemTables.from_document(problem).graph


@pytest.mark.parametrize("order", [65, 100_000, 10**400, -1, True, 2.0, "2"])
def test_an_order_is_a_small_whole_number(order: Any) -> None:
    """Q of an order of 100 000 alone is 80 GB."""
    problem = deepcopy(DESIGN["problem"])
    problem["design"]["order"] = order
    with pytest.raises(ProblemError, match="order"):
        ProblemTables.from_document(problem)
