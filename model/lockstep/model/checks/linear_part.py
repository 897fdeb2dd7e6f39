"""Checks of the linear part and the graph: who reaches whom, and which modes inputs and outputs reach."""

from collections.abc import Sequence
from fractions import Fraction
from itertools import product

import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Plant
from lockstep.model.agents.agent import Agent
from lockstep.model.checks.report import CheckRow, Outcome
from lockstep.model.control.pbh import Controllability, Observability, controllability, observability
from lockstep.model.control.zeros import Zeros, zeros_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.loop_transformation.natural_units import natural_units

ROUNDED = 1e-12
"""Of |C| |A|^k |B|: less is what rounding left of a sum that is 0."""

Matrices = Sequence[Float[np.ndarray, "n m"]]

WAYS = "direction of inputs"

NEARLY_LOST = 1e-3
"""Of the pair's distance in natural units, relative to its norm, below which a unit may have slipped: a factor of 1e5 in a
model of a jack leaves 1.8e-4 of 0.13, and the committed problems have 0.011 and more."""


def spanning_tree(graph: Graph, *, listed: bool = False) -> CheckRow:
    """Some agent's information reaches every other one, which is rank L = N - 1; a leader of `listed` edges is noted."""
    reason = "agreement needs an agent that all others hear from: L then has one zero eigenvalue only"
    if not graph.has_spanning_tree:
        groups = ", ".join(str(list(group)) for group in graph.origins[:4])
        figure = f"none: the groups {groups} hear nothing from each other"
        return CheckRow("spanning tree", "fails", figure, reason)
    leads = graph.in_degrees[graph.roots[0] - 1] == 0
    said = "hears none of the others and leads: its controller is at rest" if leads else "can be its root"
    asked = ". Are `edges` [listener, source], and each meant one way?" * bool(listed and leads)
    figure = f"{_agents(graph.roots)} {said}{asked}"
    return CheckRow("spanning tree", "note" if asked else "ok", figure, reason)


def row_sums(graph: Graph) -> CheckRow:
    """L 1 = 0, in exact arithmetic on the weights and in the doubles that L is stored in."""
    reason = "consensus must be an equilibrium of the controllers: r = 0 where all agents agree"
    worst = max(abs(sum((Fraction(float(x)) for x in row), Fraction(0))) for row in graph.laplacian)
    besides = f" with exact sums on the diagonal; to {float(worst):.1e} in doubles" if worst else ""
    return CheckRow("L 1 = 0", "ok", f"exactly{besides}", reason)


def controllable(agent: Agent, agents_B: Matrices) -> tuple[CheckRow, Controllability]:
    """(A, B_i) of the agent that has the least of it: controllable, stabilisable at least, or neither."""
    each_once = {B.tobytes(): B for B in agents_B}.values()
    checks = [(controllability(agent.lure.A, B), B) for B in each_once]
    worst, B = min(checks, key=lambda one: (one[0].controllable, one[0].stabilisable, one[0].margin))
    name = "(A, B_i) controllable" if len(checks) > 1 else "(A, B) controllable"
    near = controllability(*_in_natural_units(agent, B)[:2]).relative_margin
    row = _pair(name, worst, worst.controllable, worst.stabilisable, "stabilisable", "no input moves", near)
    return row, worst


def observable(agent: Agent) -> tuple[CheckRow, Observability]:
    """(A, C): observable, detectable at least, or neither."""
    check, name, shown = agent.observability(), "(A, C) observable", "no output shows"
    A, _, C = _in_natural_units(agent, agent.lure.B)
    near = observability(A, C).relative_margin
    return _pair(name, check, check.observable, check.detectable, "detectable", shown, near), check


def _in_natural_units(agent: Agent, B: Float[np.ndarray, "n m"]) -> Matrices:
    """Return A, B and C in units in which their entries are near one: what the file's own hide or pretend is left out."""
    A, C, none = agent.lure.A, agent.lure.C, np.zeros((agent.n, 0))
    X, S_u, S_y, tau, _ = natural_units(Plant(A, (B,), C, none, none.T), 0.0, np.zeros_like(A))
    return tau * A * np.outer(X, 1 / X), tau * B * np.outer(X, S_u), C * np.outer(S_y, 1 / X)


def zeros(agent: Agent, agents_B: Matrices) -> tuple[CheckRow, tuple[tuple[complex, ...], ...]]:
    """The zeros from u to y, per agent; those in the right half-plane limit every controller."""
    found = [zeros_of(agent.lure.A, B, agent.lure.C) for B in agents_B]
    reason = "no controller moves them: one at Re s > 0 limits the rho and the speed that any gains can reach"
    worst = max(found, key=lambda z: len(z.right_half_plane))
    right = tuple(z.right_half_plane for z in found)
    if worst.right_half_plane:
        figure = f"{_listed(worst.right_half_plane)} in the right half-plane"
        return CheckRow("zeros from u to y", "note", figure, reason), right
    return CheckRow("zeros from u to y", "ok", _no_right(worst), reason), right


def directions(agent: Agent) -> CheckRow:
    """Which way each input moves each output at first, from rest: the sign of the first C A^k B that is not 0."""
    lure, said = agent.lure, []
    with np.errstate(all="ignore"):
        powers = [np.linalg.matrix_power(A, k) for A in (lure.A, np.abs(lure.A)) for k in range(agent.n)]
        steps = [lure.C @ power @ lure.B for power in powers[: agent.n]]
        sizes = [ROUNDED * np.abs(lure.C) @ power @ np.abs(lure.B) for power in powers[agent.n :]]
    for (k, y), (l, u) in product(enumerate(agent.outputs), enumerate(agent.inputs)):
        first = next(
            (step[k, l] for step, size in zip(steps, sizes, strict=True) if abs(step[k, l]) > size[k, l]), 0.0
        )
        said += [f"{u} {'raises' if first > 0 else 'lowers'} {y}"] if first else []
    reason = "hold it against the machine: a wrong sign in the file is wrong in the C, and in no figure"
    figure = f"at first {', '.join(said)}" if said else "no input moves an output"
    return CheckRow(WAYS, "ok", figure, reason)


def _no_right(zeros: Zeros) -> str:
    if zeros.imaginary_axis:
        return f"none in the right half-plane; {_listed(zeros.imaginary_axis)} on the imaginary axis"
    return "none in the right half-plane" if zeros.values else "none"


def _pair(
    name: str,
    check: Controllability | Observability,
    holds: bool,
    enough: bool,
    weaker: str,
    what: str,
    near: float,
) -> CheckRow:
    reason = "an uncontrollable or unobservable mode agrees only if it is stable"
    if holds:
        said = f"the nearest that is not is {check.margin:.3g} away, at s = {_number(check.eigenvalue)}"
        verdict: Outcome = "ok" if near > NEARLY_LOST else "note"
        if verdict == "note":
            said += f", a relative change of {near:.1g} in natural units: a slip in a unit?"
        return CheckRow(name, verdict, said, reason)
    lost = check.unstable_eigenvalue if check.unstable_eigenvalue is not None else check.eigenvalue
    state = f"{weaker}, the mode decays by itself, which is enough" if enough else f"not {weaker} either"
    return CheckRow(
        name, "note" if enough else "fails", f"{what} the mode at s = {_number(lost)}: {state}", reason
    )


def _agents(numbers: Sequence[int]) -> str:
    shown = ", ".join(map(str, numbers[:8])) + (", ..." if len(numbers) > 8 else "")
    return f"agent {shown}" if len(numbers) == 1 else f"each of the agents {shown}"


def _listed(values: Sequence[complex]) -> str:
    """Return zeros as text, a conjugate pair once."""
    upper = [z for z in values if z.imag >= 0]
    return ", ".join(f"{_number(z)}" for z in upper[:6]) + (", ..." if len(upper) > 6 else "")


def _number(s: complex) -> str:
    # `0.0 +` turns -0 into 0; an imaginary part this small is what a search left over.
    real = abs(s.imag) <= 1e-6 * abs(s)
    return f"{0.0 + s.real:.4g}" if real else f"{0.0 + s.real:.4g} +- {abs(s.imag):.4g}i"
