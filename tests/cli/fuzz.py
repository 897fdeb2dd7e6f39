"""Fuzz the readers for longer than the tests do: `python tests/cli/fuzz.py TARGET [MINUTES of processor time] [SEED]`.

TARGET is one of problem, expression, design, c_reader. The edits are those of `test_fuzz`; whatever comes out of the
library and is no error of ours is printed once for each place, with what brought it, and the exit status is then 1.
"""

import copy
import json
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from test_fuzz import DESIGN, FORMULA, HEADER, PLACES, SOURCE, TOML, VALUES, edited

from lockstep.check.c_source.reader import read_controller
from lockstep.check.certify import decide
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import LockstepError
from lockstep.check.json_text import parse_json
from lockstep.lmi.document import parse as parse_design
from lockstep.model.problem import Problem, parse_problem

BATCH = 200
"""Examples between two looks at the processor's time."""


def problem(text: str) -> None:
    """Read a problem file, build its agent, and read what it is written as."""
    read = parse_problem(text)
    document = read.document()
    read.agent()
    ProblemTables.from_document(document)


def expression(formula: str) -> None:
    """Read an equation as the model and as the checker do."""
    table = copy.deepcopy(DESIGN["problem"])
    table["agent"]["dynamics"]["omega_l"] = formula
    Problem.from_document(table).agent()
    ProblemTables.from_document(table).agent  # noqa: B018 - derived on request


def design(change: tuple[tuple[Any, ...], Any]) -> None:
    """Read a design file, and decide what it claims."""
    place, value = change
    content = copy.deepcopy(DESIGN)
    part = content
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    text = json.dumps(content)
    parse_design(parse_json(text, "design.json"), "design.json")
    for _, verdict in decide(
        parse(parse_json(text, "design.json"), "design.json", ProblemTables.from_document)
    ):
        if not verdict.proved:
            break


def c_reader(texts: tuple[str, str]) -> None:
    """Read a controller out of C."""
    read_controller("arm1", *texts, ["arm1", "arm2", "arm3"])


TARGETS: dict[str, tuple[Callable[[Any], None], st.SearchStrategy[Any]]] = {
    "problem": (problem, edited(TOML)),
    "expression": (expression, edited(FORMULA)),
    "design": (design, st.tuples(PLACES, VALUES)),
    "c_reader": (
        c_reader,
        st.one_of(st.tuples(edited(HEADER), st.just(SOURCE)), st.tuples(st.just(HEADER), edited(SOURCE))),
    ),
}


def fuzz(name: str, minutes: float, first: int) -> int:
    """Run one target; return how many places of the library let something untyped out."""
    target, examples = TARGETS[name]
    found: dict[tuple[str, str, int | None], str] = {}
    tried = 0

    def body(example: Any) -> None:
        nonlocal tried
        tried += 1
        try:
            target(example)
        except LockstepError:
            return
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = (type(error).__name__, last.filename, last.lineno)
            if where not in found:
                found[where] = repr(example)
                print(*where, str(error)[:200], repr(example)[:4000], sep="\n  ", flush=True)

    once = settings(
        max_examples=BATCH,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    number = first
    while time.process_time() < 60 * minutes:
        once(seed(number)(given(examples)(body)))()
        number += 1
    print(f"{name}: {tried} examples in {time.process_time() / 60:.1f} min, {len(found)} places untyped")
    return len(found)


if __name__ == "__main__":
    _, name, *more = sys.argv
    raise SystemExit(fuzz(name, float(more[0]) if more else 10, int(more[1]) if len(more) > 1 else 0) > 0)
