"""The pages keep to the code: extras that exist, every key of a problem file with its default, examples that load and run."""

import io
import re
import shutil
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from lockstep.model.problem import Problem, load_problem
from lockstep.model.problem.tables.schema import ProblemFile
from lockstep.workflow.design_file import Design, load

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SOURCES = [path for root in ("model", "lmi", "codegen") for path in sorted((ROOT / root).rglob("*.py"))]
PAGE = (ROOT / "docs" / "problem.md").read_text(encoding="utf-8")

FOUND_LATER = {"order": 2}
"""Defaults that the schema leaves open, because they depend on the gains where these are given."""


def extras_named(text: str) -> set[str]:
    found = re.findall(r"extras? `([a-z]+)`", text)
    for several in re.findall(r"(?:lockstep-control|\.)\[([a-z,]+)\]", text):
        found += several.split(",")
    return set(found)


def test_every_extra_that_is_named_can_be_installed():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    there = set(project["optional-dependencies"])
    named = {path: extras_named(path.read_text(encoding="utf-8")) for path in [*PAGES, *SOURCES]}
    assert {path: names - there for path, names in named.items() if names - there} == {}
    assert set().union(*named.values()) >= {"campaign", "toolchain"}
    assert extras_named('(extra `emulator`), pip install "lockstep-control[campaign,oracle]"') - there == {
        "emulator",
        "oracle",
    }


def section(page: str, table: str) -> str:
    """The part of the page on one table."""
    found = re.search(rf"^## \[{table}\].*?(?=^## )", page, re.MULTILINE | re.DOTALL)
    assert found, f"docs/problem.md has no section on [{table}]"
    return found[0]


def parts_of(annotation: object) -> Iterator[object]:
    """What a key may hold, however deep: tables, and the words of a choice."""
    yield annotation
    for inner in get_args(annotation):
        yield from parts_of(inner)


def words_of(model: type[BaseModel]) -> Iterator[str]:
    """Every key of a table and of the tables in it, and every word that one can be set to."""
    for key, field in model.model_fields.items():
        yield key
        for part in parts_of(field.annotation):
            if isinstance(part, str):
                yield part
            elif isinstance(part, type) and issubclass(part, BaseModel):
                yield from words_of(part)


def missing(page: str, table: str) -> list[str]:
    code = " ".join(re.findall(r"`([^`]*)`", section(page, table)))
    return [word for word in words_of(TABLES[table]) if not re.search(rf"(?<!\w){word}(?!\w)", code)]


def rows_of(page: str, table: str) -> Iterator[tuple[list[str], list[object]]]:
    """(keys, defaults) of each row; no defaults where the page gives words."""
    for keys, default in re.findall(r"^\| (`.*?`) \| (.*?) \|", section(page, table), re.MULTILINE):
        try:
            yield re.findall(r"`(\w+)`", keys), tomllib.loads(f"x = [{default.replace('`', '')}]")["x"]
        except tomllib.TOMLDecodeError:
            yield re.findall(r"`(\w+)`", keys), []


def wrong(page: str, table: str) -> list[str]:
    """Keys that the schema does not have, or has with another default."""
    fields, found = TABLES[table].model_fields, []
    for keys, defaults in rows_of(page, table):
        found += [key for key in keys if key not in fields]
        for key, said in zip(keys, defaults, strict=False):
            default = fields[key].default if key in fields else None
            default = default.model_dump(exclude_none=True) if isinstance(default, BaseModel) else default
            found += [f"{key} = {said}"] if said != FOUND_LATER.get(key, default) else []
    return found


TABLES = {name: field.annotation for name, field in ProblemFile.model_fields.items() if name != "title"}


@pytest.mark.parametrize("table", TABLES)
def test_the_page_has_every_key_every_choice_and_the_defaults_of_the_schema(table):
    assert missing(PAGE, table) == []
    assert wrong(PAGE, table) == []


@pytest.mark.parametrize(
    ("table", "old", "new", "told"),
    [
        ("agent", "| `split` |", "| |", "split"),
        ("design", '`"laplacian_rows"`', "the paper's", "laplacian_rows"),
        ("simulation", "full_scale = 10.0", "", "full_scale"),
        ("network", "`leader_path`", "a path", "leader_path"),
        ("controller", "| 0.005 |", "| 0.05 |", "period = 0.05"),
        ("design", "controller = 1.0 }", "controller = 2.0 }", "weights = {'state': 1.0, 'controller': 2.0}"),
        ("design", "| 4, 0 |", "| 4, 1 |", "seed = 1"),
        ("design", "| `alpha` |", "| `alfa` |", "alfa"),
    ],
)
def test_a_page_that_drifts_is_told(table, old, new, told):
    assert old in section(PAGE, table)
    drifted = PAGE.replace(old, new)
    assert told in missing(drifted, table) + wrong(drifted, table)


def toml_blocks() -> Iterator[tuple[str, str]]:
    for path in PAGES:
        for block in re.findall(
            r"^```toml\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
        ):
            yield path.name, block


@pytest.mark.parametrize(("page", "block"), list(toml_blocks()))
def test_what_is_shown_as_toml_is_toml_and_loads_where_it_is_whole(page, block, tmp_path):
    content = tomllib.loads(block)
    assert page != "problem.md" or {"agent", "network"} <= set(content)
    if {"agent", "network"} <= set(content):
        (tmp_path / page).write_text(block, encoding="utf-8")
        problem = load_problem(tmp_path / page)
        problem.validate()
        assert problem.order == content.get("design", {}).get("order", FOUND_LATER["order"])


def python_blocks(path: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


WITH_PYTHON = [path for path in PAGES if python_blocks(path)]
DESIGN = ROOT / "generated" / "flexible_joint_arms" / "design.json"


def run_blocks(blocks: list[str], name: str) -> dict[str, object]:
    """Run the blocks of a page one after the other, as a reader would, and return what they leave."""
    names: dict[str, object] = {}
    for number, block in enumerate(blocks, start=1):
        exec(compile(block, f"{name}, block {number}", "exec"), names)
    return names


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> None:
    """A folder with what the pages speak of: the examples, the generated folder, and a design file."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    shutil.copytree(DESIGN.parent, tmp_path / "generated" / DESIGN.parent.name)
    shutil.copy(DESIGN, tmp_path)
    monkeypatch.chdir(tmp_path)


def kept_design(_problem: Problem | str) -> Design:
    """A design without a search: the committed one."""
    return load(DESIGN)


@pytest.mark.usefixtures("checkout")
@pytest.mark.parametrize("path", WITH_PYTHON, ids=lambda path: path.name)
def test_every_python_block_of_a_page_runs(path, monkeypatch):
    monkeypatch.setattr("lockstep.design", kept_design)
    assert run_blocks(python_blocks(path), path.name)


@pytest.mark.slow
@pytest.mark.usefixtures("checkout")
@pytest.mark.parametrize("path", WITH_PYTHON, ids=lambda path: path.name)
def test_every_python_block_of_a_page_runs_with_its_own_design(path):
    names = run_blocks(python_blocks(path), path.name)
    if path.name == "problem.md":
        # The position and the speed that all carts share: a double pole at 0, off by the root of a rounding.
        assert sorted(abs(names["linear"].poles()))[:2] == pytest.approx([0, 0], abs=1e-4)
        assert names["found"].certified


@pytest.mark.usefixtures("checkout")
def test_a_block_that_does_not_run_is_told():
    good, bad = python_blocks(ROOT / "docs" / "problem.md"), "kept.agent.to_control()\n"
    with pytest.raises(AttributeError, match="agent"):
        run_blocks([good[1], bad], "a page")


def code_in_comments(block: str) -> list[str]:
    """Comments that hold a call: code that is shown and that nothing runs."""
    tokens = tokenize.generate_tokens(io.StringIO(block).readline)
    return [t.string for t in tokens if t.type == tokenize.COMMENT and re.search(r"\w\(", t.string)]


@pytest.mark.parametrize("path", WITH_PYTHON, ids=lambda path: path.name)
def test_no_code_hides_in_a_comment(path):
    assert [code_in_comments(block) for block in python_blocks(path)] == [[]] * len(python_blocks(path))
    assert code_in_comments('x = f()  # or, of a file: parse(load_json(y), "y")\n') != []


def test_the_architecture_page_is_that_of_the_code():
    """`python docs/make_architecture.py` writes it anew: a row for each module, and the arrows of the picture."""
    made = subprocess.run([sys.executable, ROOT / "docs" / "make_architecture.py", "--check"], check=False)
    assert made.returncode == 0
