"""The published JSON Schemas: they are current, what is committed obeys them, and they refuse what the readers refuse."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from lockstep.check.design_file.claims import claims_of
from lockstep.check.design_file.proofs import Proofs
from lockstep.check.errors import ProblemError
from lockstep.codegen.manifest import Manifest, load_manifest
from lockstep.lmi.design_json import LATER, claims_document, proofs_document, sampled_document
from lockstep.lmi.document import parse
from lockstep.model.problem.tables.load import parse_tables
from lockstep.workflow.init import init

ROOT = Path(__file__).parents[1]

sys.path.insert(0, str(ROOT / "docs"))
from key_meanings import MEANINGS  # noqa: E402
from problem_schema import DIALECT, draft_07, problem_schema  # noqa: E402

ARMS = ROOT / "generated" / "flexible_joint_arms"
PROBLEM = ROOT / "model" / "lockstep" / "model" / "problem" / "schemas"
SCHEMAS = {
    "problem": PROBLEM / "problem.json",
    "problem.draft-07": PROBLEM / "problem.draft-07.json",
    "manifest": ROOT / "codegen" / "lockstep" / "codegen" / "schemas" / "manifest.json",
    "design": ROOT / "check" / "lockstep" / "check" / "design_file" / "schemas" / "design.json",
}
VALIDATORS = {"problem.draft-07": jsonschema.Draft7Validator}


def validator(name: str) -> Any:
    kind = VALIDATORS.get(name, jsonschema.Draft202012Validator)
    schema = json.loads(SCHEMAS[name].read_text(encoding="utf-8"))
    kind.check_schema(schema)
    return kind(schema)


def obeys(name: str, content: Any) -> bool:
    return bool(validator(name).is_valid(content))


def test_those_that_follow_from_a_type_are_current(update):
    made = {
        "problem": problem_schema(),
        "problem.draft-07": draft_07(problem_schema()),
        "manifest": {"$schema": DIALECT, **Manifest.model_json_schema()},
    }
    for name, schema in made.items():
        text = json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
        if update:
            SCHEMAS[name].write_text(text, encoding="utf-8")
        assert SCHEMAS[name].read_text(encoding="utf-8") == text, (
            "pytest tests/test_schemas.py --update accepts it"
        )


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.toml")), ids=lambda path: path.stem)
def test_every_example_obeys_the_schema_of_problems(path):
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    for name in ("problem", "problem.draft-07"):
        assert list(validator(name).iter_errors(content)) == []
        assert obeys(name, parse_tables(content).model_dump(mode="json", exclude_none=True)), (
            "as in a design file"
        )


def keys_of(schema: dict[str, Any]) -> dict[str, str]:
    """Every key of every table with what an editor shows of it."""
    tables = {"ProblemFile": schema, **schema["$defs"]}
    return {
        f"{name}.{key}": value.get("description", "")
        for name, table in tables.items()
        for key, value in table["properties"].items()
    }


def test_every_key_says_what_it_is_its_unit_and_what_is_expected():
    shown = keys_of(problem_schema())
    assert [
        key for key, text in shown.items() if "Expected: " not in text or text.startswith("Expected")
    ] == []
    assert "Unit: s." in shown["ControllerTable.period"]
    assert "Unit: 1/s." in shown["DesignTable.decay"]
    meant = {f"{table}.{key}" for table, keys in MEANINGS.items() for key in keys}
    assert meant == set(shown), "no key is left out, and none is described that there is not"


SCHEMA_LINE = re.compile(r"#:schema (\S+)\n")


@pytest.mark.parametrize("path", sorted((ROOT / "examples").rglob("*.toml")), ids=lambda path: path.stem)
def test_editors_find_the_schema_from_the_first_line_of_an_example(path):
    found = SCHEMA_LINE.match(path.read_text(encoding="utf-8"))
    assert found, "Taplo and Even Better TOML read `#:schema` from the first line"
    assert (path.parent / found[1]).resolve() == SCHEMAS["problem.draft-07"]


@pytest.mark.skipif(shutil.which("taplo") is None, reason="Taplo is not installed")
def test_taplo_reads_it(tmp_path):
    """The engine of Even Better TOML accepts a begun file, and names the key that the schema does not know."""
    path = tmp_path / "problem.toml"
    init("platoon", output=path)
    command = ["taplo", "lint", str(path)]
    good = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert good.returncode == 0, good.stderr
    path.write_text(
        path.read_text(encoding="utf-8").replace("period = 0.02", 'period = "fast"'), encoding="utf-8"
    )
    bad = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert bad.returncode != 0
    assert "fast" in bad.stderr


def test_the_committed_folder_obeys_the_schemas():
    design = json.loads((ARMS / "design.json").read_text())
    assert list(validator("design").iter_errors(design)) == []
    assert obeys("problem", design["problem"])
    assert list(validator("manifest").iter_errors(json.loads((ARMS / "manifest.json").read_text()))) == []


def changed(content: Any, path: tuple[Any, ...], value: Any) -> Any:
    content = deepcopy(content)
    node = content
    for key in path[:-1]:
        node = node[key]
    if value is ...:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return content


BROKEN_DESIGNS = [
    (("format",), "lockstep-design/3"),
    (("new",), 1),
    (("info",), ...),
    (("info",), []),
    (("claims",), ...),
    (("claims", "certified"), ...),
    (("claims", "certified"), 1),
    (("claims", "certified"), False),
    (("claims", "rho"), None),
    (("claims", "rho"), "3.3"),
    (("claims", "rho"), 0.0),
    (("claims", "alpha"), -1.0),
    (("claims", "proof"), "magic"),
    (("claims", "scope"), "everywhere"),
    (("claims", "residue"), 1e-30),
    (("claims", "fragility", "A"), ...),
    (("claims", "fragility", "E"), 0.0),
    (("claims", "entries"), {}),
    (("claims", "entries"), [{"component": 0, "argument": 1, "bound": 1.0}]),
    (("claims", "initial_set"), {"leader": 1}),
    (("claims", "sampled", "proof"), "exact"),
    (("claims", "sampled", "certified"), False),
    (("claims", "sampled", "delay"), 2),
    (("claims", "sampled", "rounding", 0, "A"), None),
    (("claims", "sampled", "rounding", 0, "E"), 1.0),
    (("claims", "sampled", "max_period"), -1.0),
    (("claims", "sampled", "gain"), 0.5),
    (("proofs", "certificate", "pairs"), []),
    (("proofs", "certificate", "m"), ...),
    (("proofs", "floor", "pieces", 0, "Z"), 3),
    (("proofs", "sampled", "kappa"), "1"),
    (("proofs", "new"), 1),
    (("gains", 0, "E"), []),
    (("gains", 0, "D"), [1.0]),
]


@pytest.mark.parametrize(("path", "value"), BROKEN_DESIGNS, ids=str)
def test_what_the_schema_of_designs_refuses_the_reader_refuses_too(path, value):
    broken = changed(json.loads((ARMS / "design.json").read_text()), path, value)
    assert not obeys("design", broken)
    with pytest.raises(ProblemError):
        parse(broken, "here.json")


def test_the_schema_of_designs_and_the_reader_have_the_same_keys():
    """Of each table of claims; so a claim that is added to one alone is seen."""
    tables = json.loads(SCHEMAS["design"].read_text())["$defs"]
    claims = claims_of(json.loads((ARMS / "design.json").read_text())["claims"])
    assert set(tables["claims"]["properties"]) == {*claims_document(claims), "messages", "fixed"}
    assert set(tables["sampled"]["properties"]) == {*sampled_document(claims.sampled), *LATER}
    seldom = {
        "limits_gain",
        "clipped",
        "sampled_decay",
        "messages",
        "messages_rho",
        "fixed",
        "initial_set",
    }  # where they are claimed alone
    assert set(tables["proofs"]["properties"]) == {*proofs_document(Proofs()), *seldom}


BROKEN_PROBLEMS = [
    (("agent", "state"), ["x"]),
    (("agent", "states"), ...),
    (("agent", "states"), "x"),
    (("agent", "outputs"), 3),
    (("design", "order"), -1),
    (("design", "gain_limit"), 0.0),
    (("design", "method"), "best"),
    (("design", "weights", "state"), "1"),
    (("controller", "delay"), 2),
    (("controller", "period"), 1e9),
]


@pytest.mark.parametrize(("path", "value"), BROKEN_PROBLEMS, ids=str)
def test_what_the_schema_of_problems_refuses_the_reader_refuses_too(path, value):
    problem = json.loads((ARMS / "design.json").read_text())["problem"]
    broken = changed(problem, path, value)
    assert not obeys("problem", broken)
    assert not obeys("problem.draft-07", broken)
    with pytest.raises(ProblemError):
        parse_tables(broken)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("new",), 1),
        (("period",), ...),
        (("period",), 0.0),
        (("agents", 0, "order"), -1),
        (("real",), "half"),
    ],
    ids=str,
)
def test_what_the_schema_of_manifests_refuses_the_reader_refuses_too(path, value, tmp_path):
    broken = changed(json.loads((ARMS / "manifest.json").read_text()), path, value)
    assert not obeys("manifest", broken)
    (tmp_path / "manifest.json").write_text(json.dumps(broken))
    with pytest.raises(ProblemError):
        load_manifest(tmp_path)
