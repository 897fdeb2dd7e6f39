"""The refusal of a nonlinearity without a bound, in the names of the problem file."""

import itertools
import re
from dataclasses import replace

import numpy as np

from lockstep.check.bound.regularity import Conditions
from lockstep.check.errors import ProblemError
from lockstep.check.system.domain import argument_box
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.arguments import argument_texts
from lockstep.model.bound_search import Bound
from lockstep.model.bound_search.diagnosis import AT_ITS_END

SIZES = [digit * 10.0**power for power in range(9, -7, -1) for digit in (5, 2, 1)]
RANGES = [(-r, r) for r in SIZES] + [end for r in (1.0, 100.0, 0.01) for end in ((r / 10, r), (-r, -r / 10))]
"""Ranges of states that a message may name, the first one in which all has a value: around 0 if any is, and large."""

SHORTER = (0.05, 0.25, 0.5)
"""Parts of the ranges of the file that are cut off at one end: the first is tried before `RANGES`, the others after them."""

FAR, MOST_ENDS = 1e6, 8
"""Where a range without an end is looked at; how many arguments are looked at at both ends, the others at one."""


def no_bound(bound: Bound, agent: Agent) -> ProblemError:
    """Return the refusal of a phi whose slope has no finite bound on its domain."""
    bound = _without_value(bound, agent)
    box = _domain(bound, agent)
    local = "the certificate is then local"
    leave = f"leave that point out with a box in [agent.domain] ({local}), or"
    leave = "t is any time, those before 0 too:" if "t -> " in bound.reason else leave
    return ProblemError(
        f"the nonlinearity has no finite bound on its domain: {_in_names(bound.reason, agent)}",
        where=_equation(agent),
        expected="a nonlinearity whose slope is bounded, such as sin or tanh, or a domain where it is",
        remedy=f"give a box in [agent.domain], such as {box}: {local}"
        if box
        else f"{leave} write a term whose slope stays finite there",
    )


def _without_value(bound: Bound, agent: Agent) -> Bound:
    """Return why there is no bound: no value at a corner of the domain, where continuity was not shown beside that."""
    jumps, needs = ([c for c in agent.exact.phi.conditions if c.jumps is one] for one in (True, False))
    if not any(bound.reason.startswith(c.text) for c in jumps):
        return bound
    ends = np.clip([agent.argument_box.lower, agent.argument_box.upper], -FAR, FAR).T
    corners = np.array([*itertools.product(*ends[:MOST_ENDS], *ends[MOST_ENDS:, :1])])
    points = np.vstack([corners.T, np.zeros(len(corners))])
    missing = Conditions(needs).open_on(points, points).conditions
    return replace(bound, reason=missing[0].text) if missing else bound


def _domain(bound: Bound, agent: Agent) -> str:
    """Return ranges of states that would do, as a file has them, for what has no value or grows towards infinity; or ""."""
    H, phi = agent.lure.H, agent.exact.phi
    needs = [c for c in phi.conditions if bound.reason.startswith(c.text) and not c.jumps]
    if AT_ITS_END in bound.reason:  # a root has no slope where it is 0
        roots = (c for c in phi.conditions if not c.jumps)
        needs = [replace(c, kind="positive") if c.kind == "not negative" else c for c in roots]
    used = {k for c in needs for node in c.nodes for k in node.variables if k < phi.inputs}
    used = used or {int(k) - 1 for k in re.findall(r"\bv(\d+) -> ", bound.reason)}
    states = np.flatnonzero(H[sorted(used)].any(axis=0))
    if not needs:  # a range that the file has is none that grows
        states = states[np.isinf(agent.box[states]).any(axis=1)]
    unit = np.tile((-1.0, 1.0), (len(states), 1))
    ranges = _where_defined(agent, Conditions(needs), states) if needs else unit
    shown = [[float(f"{end:.6g}") for end in one] for one in ranges]
    named = zip((agent.states[j] for j in states), shown, strict=False)
    return ", ".join(f"{x} = {one}" + f" (in {agent.units.get(x)})" * (x in agent.units) for x, one in named)


def _where_defined(agent: Agent, needs: Conditions, states: np.ndarray) -> np.ndarray:
    """Return the first ranges of these states that are surely well inside of where the needs hold, a row each, or none."""
    own, shorter, around = agent.box[states], [], []
    for part, side in itertools.product(SHORTER if np.isfinite(own).all() else (), ([1.0, 0.0], [0.0, -1.0])):
        cut = part * np.diff(own)
        shorter.append((own + cut * side, own + cut * side + cut * [-0.5, 0.5]))
    for low, high in RANGES:  # twice as far: the slope is infinite at the end of the domain of a root
        wider = low * (2.0 if low < 0 else 0.5), high * (2.0 if high > 0 else 0.5)
        around.append((np.clip(own, low, high), np.tile(wider, (len(own), 1))))
    tried = [one for one in (*shorter[:2], *around, *shorter[2:]) if (np.diff(one[0]) > 0).all()]
    boxes = []
    for _, tested in tried:
        box = agent.box.copy()
        box[states] = tested
        of = argument_box(agent.lure.H, box)
        boxes.append(((*of.lower, -np.inf), (*of.upper, np.inf)))
    lower, upper = np.array(boxes).transpose(1, 2, 0)
    held = np.logical_and.reduce(needs.on_boxes(lower, upper))
    return tried[int(held.argmax())][0] if held.any() else np.empty((0, 2))


def _equation(agent: Agent) -> str:
    """Name the one equation that phi enters, where there is one."""
    rows = np.flatnonzero(agent.lure.G.any(axis=1))
    return f"[agent.dynamics] {agent.states[rows[0]]}" if len(rows) == 1 else "[agent.dynamics]"


def _in_names(reason: str, agent: Agent) -> str:
    """Put the states in place of v1, v2, ..., and in brackets where an argument is a sum."""
    texts = argument_texts(agent)

    def named(match: re.Match[str]) -> str:
        k = int(match.group(1)) - 1
        if k >= len(texts):
            return match.group(0)
        return texts[k] if texts[k] in agent.states else f"({texts[k]})"

    return re.sub(r"\bv(\d+)\b", named, reason)
