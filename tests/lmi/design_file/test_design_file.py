"""The design file: every claim that is better than proved is refused, remarks change nothing, format 1 is read."""

import contextlib
import json
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lmi_cases import carts, problem, table_1_problem
from typer.testing import CliRunner

from lockstep.check.__main__ import main as check_alone
from lockstep.check.continuous.initial_set import better_than_proved
from lockstep.check.design_file.content import FORMAT
from lockstep.check.design_file.content import parse as parse_exactly
from lockstep.check.design_file.problem import KEYS, ProblemTables
from lockstep.check.errors import ClaimError, ProblemError
from lockstep.cli.main import app
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.design import design
from lockstep.lmi.design_json import initial_set_document, proofs_document
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of, parse, read
from lockstep.lmi.initial_set import InitialStates
from lockstep.lmi.scope import domain_of, initial_states
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.lmi.upgrade import FORMAT_1, upgraded
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem, parse_problem
from lockstep.model.problem.tables.schema import ProblemFile

ARMS = Path(__file__).parents[3] / "generated" / "flexible_joint_arms" / "design.json"

MODAL = carts(dynamics='{ p = "v", v = "f - 0.5*sin(v)" }', gain_limit="8.0")


def led() -> Problem:
    """Two pendulums, the first leads; the bound holds on a box only."""
    return problem(
        dynamics={"a": "b", "b": "-a - sin(a) + u"},
        outputs={"y1": "a", "y2": "b"},
        agent="centre = false\ndomain = { a = [1.0, 2.0] }",
        network='agents = 2\ntopology = "leader_path"',
        design='method = "given"\n[[design.gains]]\nD = [[0.0, 0.0]]\n[[design.gains]]\nD = [[-4.0, -4.0]]',
    )


def fragile() -> Problem:
    """The published gains, D off by up to 0.01."""
    table = table_1_problem().document()
    table["design"]["fragility"] = {"D": 0.01}
    return Problem.from_document(table)


@cache
def text_of(name: str) -> str:
    """A certified file, as text: nothing can be changed in it by mistake."""
    if name == "arms":
        return ARMS.read_text(encoding="utf-8")
    posed = {"modal": lambda: parse_problem(MODAL), "local": led, "fragile": fragile}[name]()
    return json.dumps(as_shipped(design_file_of(design(posed))).document())


NAMES = ("arms", *(pytest.param(name, marks=pytest.mark.slow) for name in ("modal", "local", "fragile")))


def leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value that holds no others."""
    if isinstance(node, dict | list) and node:
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from leaves(value, (*path, key))
    else:
        yield path


def replaced(file: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    file = deepcopy(file)
    node: Any = file
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return file


LARGER = (
    "alpha",
    "fragility",
    "floor",
    "max_period",
    "level",
    "radius",
    "limits_gain",
    "clipped_radius",
    "half_axes",
    "clipped_half_axes",
    "energy",
)
"""Claims of which more is better; of all other numbers, less."""


def better(path: tuple[Any, ...], value: Any, file: dict[str, Any]) -> Any:
    """Return a claim that is better than the one that stands there, or that contradicts the problem."""
    keys = [key for key in path if isinstance(key, str)]
    match keys[-1]:
        case "certified":
            return "yes"
        case "proof":
            return "magic"
        case "scope":
            return {"global": "everywhere", "local": "global"}[value]
        case "delay":
            return 1 - value
        case "leader":
            return value + 1
        case "inner":  # the leader may go further
            side = path[-1]
            return value + (-0.1 if side == 0 else 0.1)
        case "box":  # and all stay in less
            return value + (0.1 if path[-1] == 0 else -0.1)
        case "period":
            return 1.001 * value
        case "controllers_stable":
            return True
    if path == ("claims", "decay"):  # of every disagreement, in 1/s; that of `sampled` is a factor per period
        return 5.0 if value is None else 1.2 * value
    if value is None:
        return {"rho": 0.01, "max_period": 1e3, "floor": 0.9 * file["claims"]["rho"]}.get(keys[-1], 1e-12)
    if set(keys) & set(LARGER):
        return value * 1.01 if value else 0.05
    return 0.99 * value if value else -1e-3


def status(file: dict[str, Any], place: Path, command: str = "lockstep certify") -> int:
    """The exit status of a command: it is what counts."""
    place.write_text(json.dumps(file), encoding="utf-8")
    if command == "lockstep-check":
        code = check_alone([str(place), "--json"])
    else:
        code = CliRunner().invoke(app, ["certify", str(place), "--json"]).exit_code
    assert code in (0, 1, 2)
    return code


@pytest.mark.slow
@pytest.mark.parametrize("command", ["lockstep certify", "lockstep-check"])
@pytest.mark.parametrize("name", ["arms", "modal", "local", "fragile"])
def test_each_claim_is_refused_once_it_is_better_than_proved(name: str, command: str, tmp_path: Path) -> None:
    file = json.loads(text_of(name))
    assert file["format"] == FORMAT
    assert status(file, tmp_path / "d.json", command) == 0
    passed = []
    for path in leaves(file["claims"], ("claims",)):
        value: Any = file
        for key in path:
            value = value[key]
        if path[-1] == "controllers_stable" and value is True:
            continue  # nothing more can be claimed of them
        if value == [] or (path[-2] == "fragility" and np.size(file["gains"][0][path[-1]]) == 0):
            continue  # nothing can be claimed of no slopes, nor of the errors of gains that are not there
        tampered = replaced(file, path, better(path, value, file))
        if status(tampered, tmp_path / "d.json", command) == 0:
            passed.append((path, value))
    assert passed == []


@pytest.mark.parametrize("name", NAMES)
def test_an_unknown_or_missing_claim_is_named(name: str) -> None:
    file = json.loads(text_of(name))
    for place in (("claims",), ("claims", "sampled"), ("claims", "fragility"), ("proofs",), ()):
        with pytest.raises(ProblemError, match="the key `residue` is unknown"):
            parse(replaced(file, (*place, "residue"), 1e-30), "here.json")
    for key in ("certified", "proof", "rho", "alpha", "fragility"):
        claims = {name: value for name, value in file["claims"].items() if name != key}
        with pytest.raises(ProblemError, match=f"`{key}`"):
            parse({**file, "claims": claims}, "here.json")


@pytest.mark.parametrize(
    "place", [(), ("agent",), ("agent", "domain"), *((one,) for one in ("network", "design"))]
)
def test_an_unknown_key_of_the_problem_is_named_by_the_checker(place: tuple[str, ...]) -> None:
    file = json.loads(text_of("arms"))
    content = replaced(file, ("problem", *place, "limitz"), {"u": [-10.0, 10.0]})
    with pytest.raises(ProblemError, match="the key `limitz` is unknown; expected `") as caught:
        parse_exactly(content, "here.json", ProblemTables.from_document)
    assert caught.value.where == "here.json, " + (f"[{'.'.join(place)}]" if place else "problem")


def test_the_checker_knows_the_keys_that_a_problem_file_may_hold() -> None:
    fields = ProblemFile.model_fields
    assert ["title", *KEYS] == list(fields)
    for name, known in KEYS.items():
        table: Any = fields[name].annotation
        assert known.split() == list(table.model_fields)


REMARKS: list[Any] = [None, 1e-30, [], {"certified": True, "rho": 1e-30, "reason": "proved"}]


def test_remarks_may_be_anything_and_are_not_shown_as_proved(tmp_path: Path) -> None:
    place, file = tmp_path / "d.json", json.loads(text_of("arms"))
    said = set()
    for remark in REMARKS:
        info = dict.fromkeys((*file["info"], "rho", "new"), remark) if remark else {}
        place.write_text(json.dumps({**file, "info": info}), encoding="utf-8")
        found = CliRunner().invoke(app, ["certify", str(place)])
        assert found.exit_code == 0
        said.add(found.stdout)
    assert len(said) == 1
    assert "1e-30" not in said.pop()


def test_a_local_claim_holds_a_few_ulps_off_in_the_sound_direction_only() -> None:
    """The radius comes from an eigenvalue in doubles: a file made elsewhere may be off by an ulp, and is decided exactly."""
    stored = parse(json.loads(text_of("local")), "memory")
    claimed, c = stored.claims.initial_set, stored.proofs.initial_set or stored.proofs.certificate
    assert claimed is not None and c is not None
    network = network_of(stored.problem, reproved_bound(stored))
    domain = domain_of(stored.problem.agent())
    for name in ("level", "radius", "energy"):
        value = getattr(claimed, name)
        for factor in (1 - 1e-15, 1 - 1e-9, 0.5):
            assert (
                better_than_proved(network.matrices, c, domain, replace(claimed, **{name: value * factor}))
                is None
            )
        said = better_than_proved(network.matrices, c, domain, replace(claimed, **{name: value * (1 + 1e-9)}))
        assert said is not None and name in said
    # What the doubles lose is won back: the largest radius that holds is above the one that was written down.
    assert (
        better_than_proved(network.matrices, c, domain, replace(claimed, radius=claimed.radius * (1 + 1e-13)))
        is None
    )


@pytest.mark.parametrize("name", ["arms", pytest.param("local", marks=pytest.mark.slow)])
def test_what_is_written_is_what_is_read(name: str, tmp_path: Path) -> None:
    place = tmp_path / "d.json"
    place.write_text(text_of(name), encoding="utf-8")
    assert read(place).document() == json.loads(text_of(name))


def without_own_set() -> dict[str, Any]:
    """A file whose initial set is that of its certificate of rho."""
    file = json.loads(text_of("local"))
    stored = parse(file, "memory")
    network, c = network_of(stored.problem, reproved_bound(stored)), stored.proofs.certificate
    assert c is not None
    found = initial_states(network, c)
    assert isinstance(found, InitialStates)
    del file["proofs"]["initial_set"]
    file["claims"]["initial_set"], file["info"]["initial_set"] = initial_set_document(found), found.remarks()
    return dict(file)


def format_1() -> dict[str, Any]:
    """A file as it was written before: everything side by side."""
    file = without_own_set()
    claims, proofs, info = file["claims"], file["proofs"], file["info"]
    return {
        "format": FORMAT_1,
        "title": "two pendulums",
        "method": "given",
        "coordinates": "orthonormal",
        **{key: claims[key] for key in ("certified", "proof", "rho", "alpha", "scope", "fragility")},
        "gains": file["gains"],
        "certificate": {**proofs["certificate"], "pairs": [[1, 2]]},
        "floor": None,
        "floor_proof": "none",
        "initial_set": {"available": True, **claims["initial_set"], **info["initial_set"]},
        "sampled": {
            **claims["sampled"],
            **info["sampled"],
            "witness": proofs["sampled"],
            "rho_witness": proofs["sampled_rho"],
        },
        "figures": info["figures"],
        "problem": file["problem"],
    }


def test_a_file_of_format_1_is_read(tmp_path: Path) -> None:
    old = format_1()
    stored, now = parse(old, "memory"), parse(without_own_set(), "memory")
    assert certify(stored).certified
    assert stored.claims.initial_set == replace(now.claims.initial_set, half_axes=None), "which came later"
    assert stored.claims.sampled.rho == now.claims.sampled.rho
    now = replace(now, proofs=replace(now.proofs, sampled_decay=None))  # as did this
    assert proofs_document(stored.proofs) == {
        **proofs_document(now.proofs),
        "decay": None,
        "max_period": None,
        "bound": None,
    }
    assert stored.info["figures"] == now.info["figures"]
    assert stored.info["sampled"]["decay"] == now.claims.sampled.decay, (
        "its checker never looked at it: a remark"
    )
    assert status(old, tmp_path / "d.json") == 0
    for tampered in ({"rho": 0.9 * old["rho"]}, {"scope": "global"}, {"proof": "magic"}, {"gains": 3}):
        assert status({**old, **tampered}, tmp_path / "d.json") in (1, 2)


@pytest.mark.parametrize("value", [None, True, "", 3, [], {}, [[1.0]], {"certified": True}])
def test_a_broken_file_of_format_1_is_an_answer(value: Any) -> None:
    old = format_1()
    for key in old:
        upgraded({**old, key: value})
        with contextlib.suppress(ProblemError, ClaimError):
            certify(parse({**old, key: value}, "memory"))
