"""Checks of the nonlinearity: its bound and where it holds, what was moved into A, and (3) at the origin."""

import casadi as ca
import numpy as np

from lockstep.check.bound.decide import decide_bound
from lockstep.check.system.domain import claimed_box
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.arguments import argument_texts, arguments_text, units_text
from lockstep.model.bound_search import BOXES, Bound, read, slopes_of
from lockstep.model.checks.report import CheckRow
from lockstep.model.graphs.graph import Graph

TIMES = np.concatenate([[0.0], np.linspace(-50.0, 50.0, 1001), np.geomspace(1e-3, 1e6, 200)])
"""Where an offset that depends on t is looked at."""


def bound(agent: Agent, proved: Bound) -> CheckRow:
    """|phi(a, t) - phi(b, t)| <= alpha |a - b|, proved; the sharpest alpha lies between the two figures."""
    units = units_text((proved.output_scale, proved.input_scale))
    named, name = ", in the units named" * bool(units), "bound of the nonlinearity"
    reason = f"|phi(a, t) - phi(b, t)| <= alpha |a - b| for any two agents{named}: the certificate is as true as this"
    if agent.lure.is_linear:
        return CheckRow(name, "ok", "alpha = 0: the agent is linear", reason)
    head = f"alpha = {proved.alpha:.10g}"
    where = arguments_text(agent) + units
    if proved.asked is not None:
        figure = f"{head} as asked, proved; {proved.lower:.10g} is reached ({where})"
        return CheckRow(name, "ok", figure, reason)
    if not proved.converged:
        figure = f"{head} proved, but not shown to be the smallest: {proved.lower:.10g} is reached ({where})"
        return CheckRow(name, "note", figure, reason)
    return CheckRow(name, "ok", f"{head} proved, {proved.lower:.10g} is reached ({where})", reason)


EVERYWHERE = BOXES // 10
"""Boxes spent on showing that a bound proved on a box holds everywhere; without success the certificate is local."""


def boxes_everywhere(agent: Agent, proved: Bound) -> int | None:
    """Return with how many boxes the checker decides alpha and the entries for every v, None where it does not.

    A certificate is global where it does: the domain of the problem file is not needed for it.
    """
    box = agent.argument_box
    if agent.lure.is_linear or box == claimed_box("global", box):
        return proved.replay if proved.proved else None
    verdict = decide_bound(
        read(agent.lure.phi),
        claimed_box("global", box),
        proved.alpha,
        proved.output_scale,
        proved.input_scale,
        proved.entries,
        boxes=EVERYWHERE,
    )
    return int(verdict.figures["boxes"]) if verdict.proved else None


def holds_everywhere(agent: Agent, proved: Bound) -> bool:
    """Whether alpha and the entries bound phi outside of the domain too: a box that constrains nothing costs nothing."""
    return boxes_everywhere(agent, proved) is not None


def entries(agent: Agent, proved: Bound) -> CheckRow:
    """A bound of its own for each slope d phi_k / d v_l, where a component of phi has several arguments."""
    reason = "one number alpha for all arguments grants the largest slope to each of them"
    slopes = slopes_of(proved.entries, (proved.output_scale, proved.input_scale))
    shown = ", ".join(
        f"|d phi{one.component + 1} / d v{one.argument + 1}| <= {slope:.6g}"
        for one, slope in zip(proved.entries, slopes, strict=True)
    )
    return CheckRow("slope bounds", "ok", f"proved: {shown} ({arguments_text(agent)})", reason)


def where_it_holds(agent: Agent, graph: Graph, *, everywhere: bool) -> CheckRow:
    """Where the certificate holds: for every state, or only while all agents stay in the box.

    With a single root the certificate gives initial states from which they stay (`lockstep.check.continuous.initial_set`).
    """
    reason = "a bound on a box says nothing about trajectories that leave it"
    if everywhere:
        aside = "; the box of [agent.domain] is not needed for it" if agent.domain else ""
        figure = f"everywhere: the certificate is global{aside}"
        return CheckRow("where the bound holds", "ok", figure, reason)
    figure = f"{_where(agent)}: the certificate is local, true while all agents stay there; {_staying(graph)}"
    return CheckRow("where the bound holds", "note", figure, reason)


def _where(agent: Agent) -> str:
    """Return the box of phi's arguments: in the states' own names where each argument is one of them."""
    box, texts = agent.argument_box, argument_texts(agent)
    sides = list(zip(texts, box.lower, box.upper, strict=True))
    if set(texts) <= set(agent.states):
        ends = [side for side in sides if np.isfinite(side[1:]).any()]
        return f"with {', '.join(f'{name} from {low:.4g} to {high:.4g}' for name, low, high in ends)} only"
    shown = ", ".join(f"{low:.4g} <= v{k} <= {high:.4g}" for k, (_, low, high) in enumerate(sides, start=1))
    return f"on {shown} only ({arguments_text(agent)})"


def _staying(graph: Graph) -> str:
    if len(graph.roots) == 1:
        return (
            f"with agent {graph.roots[0]} leading, it gives initial states from which they stay, as long as the leader "
            "keeps to a smaller box"
        )
    return "that they do is not proved without a leader: all of them may drift out of the box together"


def exact_numbers(agent: Agent) -> CheckRow:
    """Whether A, B, C, G, H and phi hold the file's numbers exactly, as doubles, or some rounded once: either is well."""
    reason = "the search takes coefficients rounded to doubles; what is proved is proved of the exact ones"
    rounded, said = agent.lure.rounded, "none is rounded: the matrices are the terms of the file, as doubles"
    if rounded:
        shown = ", ".join(rounded[:8]) + (", ..." if len(rounded) > 8 else "")
        said = f"rounded once, as no double holds the sum of their terms: {shown}"
    return CheckRow("numbers", "ok", said, reason)


def centring(agent: Agent) -> CheckRow:
    """What was moved from phi into A so that the slopes of phi lie around zero."""
    reason = "alpha is half the range of the slopes if they lie around zero, and up to all of it if not;"
    reason += " [agent] centre = false leaves A as written"
    name = "loop transformation"
    if not agent.centring.moves:
        return CheckRow(name, "ok", f"A is as written: {agent.centring.reason}", reason)
    moved = ", ".join(
        f"{float(move.amount):.6g} v{move.argument + 1} from phi{move.component + 1}"
        for move in agent.centring.moves
    )
    return CheckRow(name, "note", f"moved into A: {moved} ({arguments_text(agent)})", reason)


def origin(agent: Agent) -> CheckRow:
    """h(t, 0) = 0, which (3) of the paper contains and consensus does not need."""
    reason = "agreement does not need it: what all agents share cancels in the disagreement"
    reason += "; [agent.domain] has to hold where it takes them" * bool(agent.domain)
    name, (size, exact) = "h(t, 0) = 0", _offset(agent)
    if size <= 1e-12:  # what rounding leaves of terms that cancel, as 80**2 - 80**2 does of a trim
        figure = ("0" if exact else "0 at every t looked at") + ", to 1e-12" * (size > 0)
        return CheckRow(name, "ok", figure, reason)
    if not np.isfinite(size):
        return CheckRow(name, "note", "h(t, 0) is not defined: the agents never are at the origin", reason)
    figure = f"|h(t, 0)| {'=' if exact else 'reaches'} {size:.4g}: the origin is no equilibrium; the offset"
    return CheckRow(name, "note", f"{figure} cancels, and the incremental bound carries the proof", reason)


def _offset(agent: Agent) -> tuple[float, bool]:
    """Return the largest |h(t, 0)| seen and whether it is the same for all t."""
    t = ca.SX.sym("t")
    h = agent.lure.at_origin(t)
    if not ca.depends_on(h, t):
        return float(np.linalg.norm(np.asarray(agent.lure.at_origin(0.0)))), True
    values = np.asarray(agent.lure.at_origin(TIMES[None, :]))
    known = np.isfinite(values).all(axis=0)
    return float(np.linalg.norm(values[:, known], axis=0).max(initial=0.0)), False
