"""A problem: one agent, one graph, what is asked of the controllers, and how they will run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Performance
from lockstep.check.design_file.messages import messages_of
from lockstep.check.design_file.problem import default_order
from lockstep.check.design_file.problem_part import Sizes
from lockstep.check.errors import ProblemError, demand
from lockstep.check.sampled.discretise import either_way
from lockstep.check.sampled.links import Messages
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.state_sizes import random_range
from lockstep.model.formulas.confusables import DECIMAL_POINT
from lockstep.model.graphs.graph import Graph
from lockstep.model.graphs.membership import Membership
from lockstep.model.graphs.sparse_graph import SparseGraph
from lockstep.model.problem.assumptions import check_assumptions
from lockstep.model.problem.consistency import check_tables, input_sides, output_ranges
from lockstep.model.problem.formation import formation_of
from lockstep.model.problem.from_agent import plain, tables_of
from lockstep.model.problem.from_tables import build_agent, build_graph, build_variants
from lockstep.model.problem.given_gains import GivenGains, given_gains
from lockstep.model.problem.graph_file import network_of_graph, with_graph
from lockstep.model.problem.leader import leader_box
from lockstep.model.problem.leader_reference import LeaderReference, reference_of
from lockstep.model.problem.tables.load import parse_tables, parse_toml, read_problem
from lockstep.model.problem.tables.schema import (
    ControllerTable,
    DesignTable,
    DisturbancesTable,
    NetworkTable,
    ProblemFile,
    SimulationTable,
)
from lockstep.model.problem.tables.toml_text import ASKED_FOR, toml_text
from lockstep.model.problem.weights import amplitudes, input_weight, scale_of_each, weight_matrix

SEARCHED = ("certified", "modal")
"""Methods that look for gains, and take specifications beside rho."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem file, checked as a whole on construction: agent, graph, weights and gains fit together.

    Args:
        file: the tables.
        membership: how a large graph that was read from a file is known to have the spectrum in them.

    Raises:
        ProblemError: whatever the agent, the graph, the weights or the gains refuse.
        TypeError: a path; `load` takes one.

    Whether the network can agree at all is asked by `validate`, so that `lockstep check` can describe one
    that cannot.
    """

    file: ProblemFile
    membership: Membership | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.file, ProblemFile):
            raise TypeError(f"Problem takes tables, not {self.file!r:.60}; Problem.load(path) reads a file")
        check_tables(self.file)
        _ = self._agent, self._graph, self._variants, self.gains
        _ = self.performance, self.gain_limit, self.sides, self.messages, self.output_range, self.fragility
        _ = self.offsets, self.reference, self.leader
        self.initial_states()
        if self.spectrum is None:  # else the run says how many agents there are
            given = self._graph.agents, self._agent.states, self.controller.period
            amplitudes(self.simulation.disturbance, *given)
            _ = self.sensor_noise

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the tables, without what was made of them."""
        return Problem, (self.file, self.membership)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Problem":
        """Build a problem from the plain tables that `document` returns, or that a TOML parser does."""
        return cls(parse_tables(document))

    @classmethod
    def load(cls, path: str | Path) -> "Problem":
        """Read a problem file.

        Raises:
            ProblemError: anything wrong with it, with the file's name and the place in it.
        """
        path = Path(path)
        return cls.parse(read_problem(path), str(path), path.parent)

    @classmethod
    def parse(cls, text: str, name: str = "", folder: Path | None = None) -> "Problem":
        """Parse the text of a problem file; `name` is put before the place in messages, a graph is read from the folder.

        >>> Problem.parse('''
        ... [agent]
        ... states = ["x"]
        ... inputs = ["u"]
        ... dynamics = { x = "u - tanh(x)" }
        ... outputs = { y = "x" }
        ... [network]
        ... agents = 3
        ... topology = "cycle"
        ... ''').graph().roots
        (1, 2, 3)
        """
        try:
            file = parse_tables(parse_toml(text))
            return cls(file) if folder is None else cls(*with_graph(file, folder))
        except ProblemError as error:
            raise (error.within(name) if name else error) from None

    @classmethod
    def of(
        cls,
        agent: Agent,
        graph: Any,
        *,
        B: Sequence[Float[np.ndarray, "n m"]] = (),
        title: str = "",
        design: Mapping[str, Any] | None = None,
        controller: Mapping[str, Any] | None = None,
        simulation: Mapping[str, Any] | None = None,
    ) -> "Problem":
        """Build a problem from an agent and a graph made in Python; `toml` makes a file of it.

        Args:
            agent: its expressions become the formulas of [agent]: the same operations, digit by digit.
            graph: who listens to whom: a `Graph`, or a graph of networkx, that of a large one by its spectrum. An edge of a
                `DiGraph` goes from the agent that is heard to the one that hears; `Graph.from_edges` has the listener first.
            B: the input matrix of each agent, as in `Network`; by default the agent's own for all.
            title: for people.
            design: the table of this name, with the keys of a problem file; matrices may be NumPy's.
            controller: the table of this name, likewise.
            simulation: the table of this name, likewise.

        Raises:
            ProblemError: an expression that the language of problem files cannot say, with the equation it is in,
                or whatever a problem file with these tables is refused for.

        >>> import casadi as ca
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> pendulum = Agent(name="pendulum", x=x, u=u, rhs=ca.vertcat(x[1], u - ca.sin(x[0])), y=x[0])
        >>> Problem.of(pendulum, Graph.topology("ring", 4), design={"order": 1}).file.agent.dynamics
        {'x_0': 'x_1', 'x_1': 'u - sin(x_0)'}
        """
        tables = {"design": design, "controller": controller, "simulation": simulation}
        given = {name: plain(table) for name, table in tables.items() if table is not None}
        if isinstance(graph, Graph):
            return cls.from_document({"title": title, **tables_of(agent, graph, B), **given})
        pair = tables_of(agent, Graph.topology("complete", 2), B)
        file = parse_tables({"title": title, **pair, **given})
        sparse, where = SparseGraph.from_networkx(graph), file.design
        network, found = network_of_graph(sparse, NetworkTable(), method=where.method, seed=where.seed)
        return cls(file.model_copy(update={"network": network}), found)

    def toml(self) -> str:
        """Return the text of a problem file that is this problem, without the keys that have their defaults."""
        return toml_text(self.file)

    def document(self) -> dict[str, Any]:
        """Return the problem as plain JSON types, defaults filled in; `from_document` gives a problem of the same tables.

        Outputs are pairs in a list, because their order is the order of y and JSON writers may sort keys. Where the
        file leaves `weights`, but for the inputs', and `gain_limit` out, more is asked for than their defaults, and they stay
        out.
        """
        tables = self.file.model_dump(mode="json", exclude_none=True)
        if self.has_defaults:
            weights, _ = (tables["design"].pop(key) for key in ASKED_FOR)
            tables["design"] |= {"weights": {"input": weights["input"]}} if "input" in weights else {}
        return tables

    @property
    def has_defaults(self) -> bool:
        """Whether `specification.defaults` says what is asked for: no `weights` but the input's, no `gain_limit`, no rho."""
        named = self.design.model_fields_set
        others = "weights" in named and self.design.weights.model_fields_set != {"input"}
        named = named & {"gain_limit", "gain_units", "rho"}
        return self.design.method in SEARCHED and not others and not named

    @property
    def sizes(self) -> Sizes:
        """N, n, m, q and n_C."""
        agent, N = self._agent, 1 if self.spectrum else self._graph.agents
        return Sizes(N, agent.n, agent.m, agent.q, self.order)

    @property
    def title(self) -> str:
        """The title, for people."""
        return self.file.title or self.file.agent.name

    @property
    def design(self) -> DesignTable:
        """The table [design]."""
        return self.file.design

    @property
    def controller(self) -> ControllerTable:
        """The table [controller]."""
        return self.file.controller

    @property
    def simulation(self) -> SimulationTable:
        """The table [simulation]."""
        return self.file.simulation

    def agent(self) -> Agent:
        """Return the agent; the same object each time, so that its symbols are the same."""
        return self._agent

    def graph(self) -> Graph:
        """Return the communication graph; with `spectrum`, two agents that are one of its graphs."""
        return self._graph

    @cached_property
    def spectrum(self) -> SpectrumRange | None:
        """[network] spectrum, every connected undirected graph with its nonzero eigenvalues there; None for one graph."""
        table = self.file.network
        return None if table.spectrum is None else SpectrumRange.of(table.model_dump(exclude_none=True))

    def demand_one_graph(self, what: str) -> None:
        """Refuse a problem with `spectrum` where one graph is needed.

        Raises:
            ProblemError: there is no one graph.
        """
        found = "`spectrum` stands for many graphs"
        remedy = "name `edges`, a `topology`, or a `file` of up to 200 agents"
        demand(self.spectrum is None, found, "[network]", f"one graph {what}", remedy)

    def agents_B(self) -> tuple[Float[np.ndarray, "n m"], ...]:
        """Return B_i for each agent; they differ only by `[network] parameters`."""
        return tuple(agent.lure.B for agent in self._variants)

    @cached_property
    def gains(self) -> tuple[GivenGains, ...] | None:
        """The controllers of method "given", one per agent; None for every other method."""
        if self.design.gains is None:
            return None
        gains = given_gains(self.design.gains, self._graph.agents, self._agent.m, self._agent.q)
        order = gains[0].A.shape[0]
        found = f"`order` is {self.design.order}, but the gains have `A` of {order} x {order}"
        expected = f"{order}, or no `order` for given gains"
        demand(self.design.order in (None, order), found, "[design] order", expected)
        return gains

    @property
    def order(self) -> int:
        """n_C, the number of states of each controller; with given gains, theirs."""
        if self.gains is not None:
            return int(self.gains[0].A.shape[0])
        if self.design.order is not None:
            return self.design.order
        return default_order(len(self.file.agent.states), many_graphs=self.file.network.spectrum is not None)

    @property
    def fragility(self) -> dict[str, float]:
        """delta_A, delta_B, delta_C, delta_D of (11), by letter; all 0 for certain controllers.

        Raises:
            ProblemError: A, B or C of static gains, which have none.
        """
        table = self.design.fragility
        found = {letter: float(getattr(table, letter)) if table else 0.0 for letter in "ABCD"}
        absent = ", ".join(f"{letter} = {found[letter]:g}" for letter in "ABC" if found[letter])
        remedy = "leave A, B and C out, or take `order` = 1 or more"
        expected = "D alone: controllers of order 0 are a matrix D"
        demand(bool(self.order or not absent), absent, "[design] fragility", expected, remedy)
        return found

    def state_weight(self, n: int) -> Float[np.ndarray, "n n"]:
        """Return R of one agent, n x n; (N - 1) copies of it weigh the disagreement."""
        return weight_matrix(self.design.weights.state, n, where="[design.weights] state", per="state")

    def controller_weight(self, nc: int) -> Float[np.ndarray, "nc nc"]:
        """Return Q of one controller, nc x nc."""
        where = "[design.weights] controller"
        return weight_matrix(self.design.weights.controller, nc, where=where, per="controller state")

    @cached_property
    def performance(self) -> Performance:
        """What rho is a gain to and from: R, Q, W, and the scales of the disturbances and the noise."""
        agent, n, m = self.file.agent, self._agent.n, self._agent.m
        scales, where = self.design.disturbances or DisturbancesTable(), "[design.disturbances]"
        states = scale_of_each(scales.states, agent.states, where=f"{where} states", per="state")
        names = [name for name, _ in agent.outputs]
        outputs = scale_of_each(scales.outputs, names, where=f"{where} outputs", per="output")
        some = not len(states) or states.any() or outputs.any()
        demand(some, "every scale is 0", where, "one above 0: rho is a gain from it")
        W = input_weight(self.design.weights.input or 0.0, m)
        return Performance(self.state_weight(n), self.controller_weight(self.order), W, states, outputs)

    @cached_property
    def gain_limit(self) -> Float[np.ndarray, "k l"] | float:
        """L of |[A B; C D] / L| <= 1, entry by entry and in the spectral norm: `gain_limit` in the units that are named."""
        units, agent, where = self.design.gain_units, self.file.agent, "[design.gain_units]"
        if units is None:
            return self.design.gain_limit
        outputs = [name for name, _ in agent.outputs]
        each = partial(scale_of_each, rest=1.0)
        S_u = each(units.inputs or {}, agent.inputs, where=f"{where} inputs", per="input")
        S_y = each(units.outputs or {}, outputs, where=f"{where} outputs", per="output")
        rows, columns = np.full(self.order, 1 / units.time), np.ones(self.order)
        with np.errstate(over="ignore", under="ignore"):
            found = self.design.gain_limit * np.outer(np.append(rows, S_u), np.append(columns, 1 / S_y))
        sized = np.isfinite(found).all() and found.min() > 0
        demand(sized, "a limit that is no finite number above 0", where, "units nearer to 1")
        return float(found[0, 0]) if np.ptp(found) == 0 else found

    def gain_norms(self, K: Float[np.ndarray, "N k l"]) -> list[float]:
        """Return the norm of each agent's [A B; C D] in the units of `gain_limit`."""
        return [self.design.gain_limit * float(np.linalg.norm(one / self.gain_limit, 2)) for one in K]

    @cached_property
    def sides(self) -> Float[np.ndarray, "m 2"]:
        """The lowest and the highest value of each input, infinite where there is none."""
        return input_sides(self.file.agent)

    @property
    def has_limits(self) -> bool:
        """Whether some input has a limit at which it is clipped."""
        return bool(np.isfinite(self.sides).any())

    @property
    def limits(self) -> Float[np.ndarray, " m"]:
        """How far each input goes either way before the C clips it, (m,), infinite where it has no limit."""
        return either_way(self.controller.real, self.sides)

    @cached_property
    def offsets(self) -> Float[np.ndarray, "N n"] | None:
        """o_i of each agent: x_i - o_i are to agree; None where the x_i are.

        Raises:
            ProblemError: offsets that some term of an agent's equation sees, or on a state that has a domain.
        """
        return formation_of(self.file, self._agent.exact, self._graph.agents)

    @cached_property
    def reference(self) -> LeaderReference | None:
        """The inputs of the leader's own in a run; None where it has none."""
        return reference_of(self.file, self._graph, self.sides)

    @cached_property
    def messages(self) -> Messages | None:
        """What the network may do to messages, if the problem says so."""
        table = self.file.network.messages
        return None if table is None else messages_of(table.model_dump(exclude_none=True))

    @cached_property
    def leader(self) -> Box | None:
        """The box of v = H x that a single leader keeps to, by `[network] leader`; None where that is not said."""
        return leader_box(self.file, self._agent)

    @cached_property
    def output_range(self) -> dict[str, tuple[float | None, float | None]]:
        """Lowest and highest plausible value by output, where one is given: messages beyond are refused."""
        return output_ranges(self.file.agent)

    @property
    def sensor_noise(self) -> Float[np.ndarray, " q"]:
        """The standard deviation of the noise of each output at each reading of a run; nothing where there is none.

        Raises:
            ProblemError: a name that is no output.
        """
        channel, names = self.simulation.channel, [name for name, _ in self.file.agent.outputs]
        given = None if channel is None else channel.noise
        return scale_of_each(given, names, where="[simulation.channel] noise", per="output")

    def initial_states(self, seed: int | None = None) -> Float[np.ndarray, "N n"]:
        """Return the states the simulation starts from, one row per agent; the seed is by default that of the file."""
        N, n = self._graph.agents, self._agent.n
        given = self.simulation.initial
        if given == "random":
            return self.random_states(N, self.simulation.seed if seed is None else seed)
        where = "[simulation] initial"
        for k, row in enumerate(given, start=1):
            found, remedy = f"row {k} has {len(row)} numbers", DECIMAL_POINT * (len(row) > n)
            demand(len(row) == n, found, where, f"{n}, one per state", remedy)
        demand(len(given) == N, f"{len(given)} rows for {N} agents", where, "one row per agent")
        return np.array(given, dtype=float)

    def random_states(self, agents: int, seed: int) -> Float[np.ndarray, "agents n"]:
        """Return states within `spread` of 0, or of the middle of a domain, and at most half-way to its sides."""
        about, reach = random_range(self._agent, self.simulation.spread)
        drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(agents, self._agent.n))
        return np.asarray(about + reach * drawn)

    def validate(self) -> None:
        """Refuse a network that cannot agree, or that the method's assumptions do not cover.

        Raises:
            ProblemError: no spanning tree; (A, B_i) not stabilisable or (A, C) not detectable, with the mode.
        """
        check_assumptions(self._graph, self._agent, self.agents_B())

    @cached_property
    def _agent(self) -> Agent:
        return build_agent(self._posed.agent)

    @cached_property
    def _posed(self) -> ProblemFile:
        """Return the file; where `alpha` is asked for, of phi as it is written, no slope is centred."""
        centre = self.file.agent.centre and self.design.alpha is None
        return self.file.model_copy(update={"agent": self.file.agent.model_copy(update={"centre": centre})})

    @cached_property
    def _graph(self) -> Graph:
        return build_graph(self.file.network)

    @cached_property
    def _variants(self) -> tuple[Agent, ...]:
        return build_variants(self._agent, self._posed, self._graph.agents)


load_problem = Problem.load
parse_problem = Problem.parse
