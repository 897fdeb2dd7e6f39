"""Files made to take hours, gigabytes or the terminal: each ends with one message and exit status 2 or 1.

What is counted is processor time and address space, both limited in a process of its own, so that a busy machine fails
nothing.
"""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROBLEM = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = { x = "u - tanh(x)" }
outputs = { y = "x" }
[network]
agents = 3
topology = "cycle"
"""
SECONDS = 60
"""Of processor time."""
BYTES = 2_000_000_000
"""Of addresses; memory in use is asked for apart, at most 1 GB."""


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))


def lockstep(*words: str) -> tuple[int, str, str, int]:
    """Exit status, standard output, standard error, and the most memory in use in bytes."""
    code = (
        "import resource, sys\nfrom lockstep.cli.main import main\n"
        "try:\n    main()\nfinally:\n"
        "    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    *said, most = done.stderr.strip().splitlines()
    return done.returncode, done.stdout, "\n".join(said), int(most)


def parameters(count: int) -> str:
    return PROBLEM.replace(
        "[network]", "[agent.parameters]\n" + "".join(f"k{i} = 1\n" for i in range(count)) + "[network]"
    )


BOMBS = {
    "dotted keys of 40 kB": ("a" + ".a" * 20_000 + " = 1\n" + PROBLEM, "too many parts"),
    "a table of 40 kB": ("[a" + ".a" * 20_000 + "]\n", "too many parts"),
    "dotted keys in quotes": ('"a"' + " . 'a'" * 7_000 + " = 1\n", "too many parts"),
    "many keys of some length": ("\n".join(f"a{i}{'.b' * 14} = 1" for i in range(250_000)), "keys and tables"),
    "many tables of some length": ("\n".join(f"[a{i}{'.b' * 14}]" for i in range(250_000)), "keys and tables"),
    "a million unknown keys": ("\n".join(f"k{i}=1" for i in range(1_000_000)), "keys and tables"),
    "as many unknown keys as are read": ("\n".join(f"k{i}=1" for i in range(49_000)), "unknown key `k0`"),
    "one key of 9 MB": ("a" * 9_000_000, "not TOML"),
    "lists in a list": ("a = [" + "[]," * 3_300_000 + "]", "3300001 lists"),
    "as many lists as are read": ("a = [" + "[]," * 299_000 + "]", "unknown key `a`"),
    "a million edges": (PROBLEM + "edges = [" + "[1,2]," * 1_000_000 + "]", "1000005 lists"),
    "a number of 9 MB": (PROBLEM + "[agent.parameters]\nk = 0." + "1" * 9_000_000, "has too many digits; expected at most"),
    "numbers of many digits": ("a = [" + ("1" * 9_999 + ",") * 900 + "]", "too many digits"),
    "tables in tables": ("a = " + "{a=" * 2_000 + "1" + "}" * 2_000, "nested too deeply"),
    "a thousand states": (PROBLEM.replace('["x"]', json.dumps([f"x{i}" for i in range(1_000)])), "at most 64"),
    "a million agents": (PROBLEM.replace("agents = 3", "agents = 1_000_000"), "from 2 to 2000"),
    "a title that moves the cursor": ('title = "\\u001b[2A\\u001b[2Kcertified yes"\n' + PROBLEM, "U+001B"),
    "a title that is read backwards": ('title = "\u202edeifitrec"\n' + PROBLEM, "U+202E"),
    "a title of two lines": ('title = "arms\\ncertified yes"\n' + PROBLEM, "text on one line"),
    "a unit that moves the cursor": (PROBLEM.replace("[network]", 'units = { x = "\\u009b2A" }\n[network]'), "U+009B"),
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_a_problem_that_is_a_bomb(name: str, tmp_path: Path) -> None:
    text, expected = BOMBS[name]
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    status, _, said, most = lockstep("check", str(tmp_path / "p.toml"))
    assert (status, len(said.splitlines())) == (2, 1), said
    assert expected in said
    assert said.isprintable()
    assert most < 1_000_000_000


def test_what_is_near_the_limits_is_read(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(f'title = "{"三 a.b" * 40}"\n{parameters(3_000)}', encoding="utf-8")
    status, _, said, _ = lockstep("check", str(tmp_path / "p.toml"))
    assert status == 0, said


def changed(*place: Any) -> Callable[[dict[str, Any], Any], None]:
    def put(content: dict[str, Any], value: Any) -> None:
        *way, last = place
        part: Any = content
        for key in way:
            part = part[key]
        part[last] = value

    return put


def wide(content: dict[str, Any], _value: Any) -> None:
    """Entries from 1e-150 to 1e150, symmetric, with a diagonal that says nothing against it."""
    P = content["proofs"]["certificate"]["P"]
    for i, row in enumerate(P):
        for j, entry in enumerate(row):
            row[j] = 1e150 if i == j else entry * 10.0 ** ((i * 37 + j * 37) % 300 - 150)


DESIGNS: dict[str, tuple[Callable[[dict[str, Any], Any], None], Any, int, str]] = {
    "one entry of P of 1e150": (changed("proofs", "certificate", "P", 0, 0), 1e150, 1, ""),
    "a P of wild scales": (wide, None, 1, ""),
    "lists in lists": (changed("x"), json.loads("[" * 500 + "]" * 500), 2, "nested too deeply"),
    "unknown keys": (changed("x"), {f"k{i}": 1 for i in range(700_000)}, 2, "too many keys"),
    "a title that moves the cursor": (changed("problem", "title"), "\x1b[2A\x1b[2Kyes", 2, "U+001B"),
    "half a character": (changed("problem", "title"), "\ud800", 2, "U+D800"),
    "half a character somewhere": (changed("figures"), {"\udfff": 1}, 2, "U+DFFF"),
}


@pytest.mark.parametrize("name", DESIGNS)
def test_a_design_that_is_a_bomb(name: str, tmp_path: Path) -> None:
    change, value, expected_status, expected = DESIGNS[name]
    content = json.loads((ROOT / "generated" / "flexible_joint_arms" / "design.json").read_text())
    change(content, value)
    (tmp_path / "d.json").write_text(json.dumps(content))
    status, answer, said, most = lockstep(
        "certify", str(tmp_path / "d.json"), *(["--json"] * (expected_status == 1))
    )
    assert status == expected_status
    assert expected in said
    assert said.isprintable() and len(said.splitlines()) <= 1
    assert most < 1_000_000_000
    if status == 1:
        found = json.loads(answer)
        assert not found["certified"]
        stated = content["claims"]["sampled"]["max_period"]
        assert found["sampled"]["max_period"] in (None, stated), "no search for a design that is refused"
