"""The recipes in containers/ keep to pyproject.toml, and the paper cites what its list has."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ELSEWHERE = {"cvxpy": "cvxpy-base", "matplotlib": "matplotlib-base"}
"""Names on conda-forge that are others: there, these come without what draws or solves besides."""


def recipe() -> str:
    return (ROOT / "containers" / "conda" / "meta.yaml").read_text(encoding="utf-8")


def test_the_recipe_for_conda_has_the_same_needs_version_and_commands():
    run = recipe().split("  run:")[1].split("test:")[0]
    wanted = {f"python {PROJECT['requires-python']}"}
    for one in PROJECT["dependencies"]:
        name, lowest = one.split(">=")
        wanted.add(f"{ELSEWHERE.get(name, name)} >={lowest}")
    assert set(re.findall(r"- (.+)", run)) == wanted
    assert f'version: "{PROJECT["version"]}"' in recipe()
    for name, place in PROJECT["scripts"].items():
        assert f"- {name} = {place}" in recipe()


def test_the_container_installs_an_extra_that_exists():
    text = (ROOT / "containers" / "Containerfile").read_text(encoding="utf-8")
    (extra,) = re.findall(r"/src\[(\w+)\]", text)
    assert extra in PROJECT["optional-dependencies"]
    version = re.findall(r"python:(3\.\d+)-slim", text)[0]
    assert f"Programming Language :: Python :: {version}" in PROJECT["classifiers"]


def test_the_citation_has_the_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {PROJECT['version']}" in text


@pytest.mark.parametrize("key", re.findall(r"@(\w+)", (ROOT / "docs/paper/paper.md").read_text("utf-8")))
def test_what_the_paper_cites_is_in_its_list(key):
    listed = re.findall(r"^@\w+\{(\w+),", (ROOT / "docs/paper/paper.bib").read_text("utf-8"), re.MULTILINE)
    assert key in listed
