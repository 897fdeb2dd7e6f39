"""[simulation.reference]: what a single leader is told to do, as formulas in t for its inputs."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.wording import nearest, shorten
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.graphs.graph import Graph
from lockstep.model.problem.tables.schema import ProblemFile

WHERE = "[simulation.reference]"


@dataclass(frozen=True, eq=False)
class LeaderReference:
    """v(t): inputs that the leader has besides its controller's, which is at rest since it has no incoming edges.

    leader: its place, counted from 0;  inputs: t -> v (m,);  sides: (m, 2), where its actuators clip.
    """

    leader: int
    inputs: ca.Function
    sides: Float[np.ndarray, "m 2"]

    def at(self, t: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M m"]:
        """Return what acts at times."""
        v = np.asarray(self.inputs(t.reshape(1, -1))).T
        return np.asarray(np.clip(v, self.sides[:, 0], self.sides[:, 1]))


def reference_of(file: ProblemFile, graph: Graph, sides: Float[np.ndarray, "m 2"]) -> LeaderReference | None:
    """Return the reference of a problem's leader; None where it has none.

    Raises:
        ProblemError: no single leader, no input of the agent, a formula that is none, or one that is not finite.
    """
    given, inputs = file.simulation.reference, file.agent.inputs
    if given is None:
        return None
    if file.network.spectrum is not None or len(graph.roots) != 1:
        roots = ", ".join(map(str, graph.roots))
        raise ProblemError(
            f"no agent leads: agents {roots} drive each other"
            if roots
            else "no agent leads: no agent reaches all others",
            where=WHERE,
            expected="a graph in which one agent has no incoming edges and reaches all others",
            remedy='topology = "leader_path" is one',
        )
    for name in given:
        if name not in inputs:
            known = ", ".join(f"`{one}`" for one in inputs)
            raise ProblemError(
                f"`{shorten(name)}` is no input", where=WHERE, expected=known, remedy=nearest(name, inputs)
            )
    t = ca.SX.sym("t")
    symbols: dict[str, ca.SX | float] = {**file.agent.parameters, "t": t}
    v = [parse_expression(given.get(name, "0"), symbols, where=f"{WHERE} {name}") for name in inputs]
    function = ca.Function("reference", [t], [ca.densify(ca.vertcat(*v))])
    found = LeaderReference(graph.roots[0] - 1, function, sides)
    times = np.linspace(0.0, file.simulation.horizon, 101)
    if not np.isfinite(np.asarray(function(times.reshape(1, -1)))).all():
        raise ProblemError(
            "it is not finite at some t within the horizon", where=WHERE, expected="finite numbers"
        )
    return found
