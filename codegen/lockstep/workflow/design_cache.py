"""Designs that were made before: kept in the user's cache folder, and proved again before they are used.

The key is the problem, without its title, its [simulation], and units and ranges of outputs, which no design depends on, but
for the initial states, which by default size the gains of limited actuators; with the versions of what searches: Lockstep's
own sources and the packages that compute. A file that is damaged, or that the checker refuses for the problem at hand, is
ignored: nothing of what is kept is believed.
"""

import hashlib
import json
import math
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from lockstep.check.errors import LockstepError
from lockstep.lmi.specification.defaults import KEYS
from lockstep.model.problem import Problem
from lockstep.workflow.certify import certify
from lockstep.workflow.design_file import Design
from lockstep.workflow.output_files import write_text

SEARCHED = ("certified", "modal")
"""Methods whose gains are searched for: with the others there is nothing to spare."""

PACKAGES = ("casadi", "clarabel", "cvxpy", "numpy", "python-flint", "scipy")

MOST = 200
"""Designs that are kept; the oldest go first."""


def recall(problem: Problem) -> Design | None:
    """Return the design that was kept of a problem, proved again, or None."""
    try:
        content = json.loads(_place(problem).read_text(encoding="utf-8"))
        content["problem"] = _of_the_kept(problem, content["problem"])
        found = Design.of(content, "the kept design")
        return found if certify(found).ok else None
    except (OSError, ValueError, TypeError, KeyError, AttributeError, LockstepError):
        return None


def keep(problem: Problem, design: Design) -> None:
    """Keep the design of a problem as it was posed; where that is not possible, it is not kept, and nothing is said."""
    if problem.design.method not in SEARCHED or {"time_limit", "interrupted"} & set(_figures(design)):
        return
    try:
        place = _place(problem)
        place.parent.mkdir(parents=True, exist_ok=True)
        write_text(place, design.text())
        for old in sorted(place.parent.glob("*.json"), key=lambda path: path.stat().st_mtime)[:-MOST]:
            old.unlink(missing_ok=True)
    except (OSError, LockstepError):
        return


def _of_the_kept(problem: Problem, kept: dict[str, Any]) -> dict[str, Any]:
    """Return the problem as posed, with what defaults wrote into the kept one's [design] where it named nothing."""
    posed, mine = problem.document(), kept["design"]
    if not problem.has_defaults:
        return posed
    written = {*KEYS, "weights", "disturbances", *({"order"} - posed["design"].keys())}
    if any(posed["design"].get(key) != mine.get(key) for key in {*posed["design"], *mine} - written):
        raise ValueError("the kept design was asked for something else")
    return {**posed, "design": mine}


def _figures(design: Design) -> dict[str, Any]:
    return dict(design.stored.info.get("figures") or {})


def _place(problem: Problem) -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("lockstep", appauthor=False) / "designs" / f"{key(problem)}.json"


def key(problem: Problem) -> str:
    """Return what a design is kept under: the same for files that differ in comments, order, title, units, ranges of outputs
    or simulation only, but for the initial states where they size the gains."""
    posed = {name: part for name, part in problem.document().items() if name not in ("title", "simulation")}
    posed["agent"] = {k: v for k, v in posed["agent"].items() if k not in ("units", "output_range")}
    if problem.has_defaults and any(map(math.isfinite, problem.limits)):
        posed["initial"] = problem.document().get("simulation", {}).get("initial")
    content = {"problem": posed, "sources": sources(), "packages": {one: version(one) for one in PACKAGES}}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@cache
def sources() -> str:
    """Return the SHA-256 of Lockstep's own sources: a version number does not tell of a checkout that changes."""
    found = hashlib.sha256()
    for path in _modules():
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _modules() -> Iterator[Path]:
    # The path of the package as it is extended over the roots: its spec knows one of them only.
    for part in ("check", "model", "lmi", "codegen"):
        for root in dict.fromkeys(map(str, sys.modules["lockstep"].__path__)):
            yield from sorted(Path(root, part).rglob("*.py"))
