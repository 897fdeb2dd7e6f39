"""From a line of the problem to a line of the C: each line that is told holds what is told of it."""

import re
import tomllib

import numpy as np
import pytest

from lockstep.model.problem.tables.key_lines import lines_of_keys
from lockstep.report.evidence import coefficients, pages


@pytest.fixture(scope="module")
def source(root) -> str:
    return (root / "examples" / "flexible_joint_arms.toml").read_text()


def test_each_agent_has_a_page_with_what_is_claimed(facts, files, source):
    written = pages(facts, files, source)
    assert list(written) == [f"evidence/arm{i}.md" for i in (1, 2, 3)]
    for path, text in written.items():
        name = path.removeprefix("evidence/").removesuffix(".md")
        assert facts.manifest.files[f"src/{name}.c"] in text
        assert facts.manifest.identity.design in text
        for key in ("proved", "assumes", "remains", "where"):
            assert str(facts.manifest.certificate[key]).replace("`limits`", "No saturation") in text
        assert "host clang sanitizers: skipped" in text


def test_each_coefficient_is_on_the_line_that_is_told(facts, files):
    for agent in facts.manifest.agents:
        text = files[f"src/{agent.name}.c"]
        rows = list(coefficients(agent, text))
        assert len(rows) == (2 + 1) * (2 + 2)
        for row in rows:
            value = re.search(r"= (-?[0-9.e+-]+)f \* ", text.splitlines()[row.line - 1])
            assert value is not None
            assert np.float32(value[1]) == np.float32(row.sampled) == float.fromhex(row.hex)
        assert [row.line for row in rows] == sorted(row.line for row in rows)


def test_no_line_is_told_where_the_kernel_reads_otherwise(facts, files):
    agent = facts.manifest.agents[0]
    changed = re.sub(r"= -?[0-9.]+f \* x1;", "= 0.123f * x1;", files["src/arm1.c"], count=1)
    assert changed != files["src/arm1.c"]
    assert {row.line for row in coefficients(agent, changed)} == {0}


def test_a_line_of_the_problem_holds_its_key(facts, files, source):
    text, lines = pages(facts, files, source)["evidence/arm1.md"], source.splitlines()
    told = re.findall(r"`([a-z0-9_.]+)`, line ([0-9]+)", text)
    assert len(told) >= 7
    for keys, number in told:
        assert keys.rpartition(".")[2] in lines[int(number) - 1]
    assert not re.search(
        r"`(?:agent|network|design|controller)[a-z0-9_.]*`, line", pages(facts, files)["evidence/arm1.md"]
    )


def test_every_key_of_every_example_is_found(root):
    for path in sorted((root / "examples").glob("*.toml")):
        text = path.read_text()
        found, lines = lines_of_keys(text), text.splitlines()
        assert set(found) == set(every_key(tomllib.loads(text))), path.name
        assert all(keys[-1] in lines[number - 1] for keys, number in found.items()), path.name


def every_key(value, above=()):
    """Every key of tables in tables; those of tables in lists stand under the list's."""
    for entry in value if isinstance(value, list) else [value]:
        if isinstance(entry, dict):
            for key, inner in entry.items():
                yield (*above, key)
                yield from (
                    every_key(inner, (*above, key))
                    if not isinstance(inner, list) or above == ("design",)
                    else ()
                )
