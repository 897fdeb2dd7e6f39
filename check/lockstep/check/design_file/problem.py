"""The problem of a design file as the checker builds it: from tables to exact matrices, phi, a graph and weights.

Only what claims are about is read: [agent], [network], [design] and [controller]. What was chosen for the proof, slopes moved
from phi into A, comes from the file's `proofs`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any, get_args

import numpy as np

from lockstep.check import json_text as read
from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Performance
from lockstep.check.design_file.messages import messages_of
from lockstep.check.design_file.problem_part import Sizes
from lockstep.check.errors import demand
from lockstep.check.numbers import exactly
from lockstep.check.sampled.discretise import either_way, measured_offsets
from lockstep.check.sampled.links import Messages
from lockstep.check.system.agent import ExactAgent, Move
from lockstep.check.system.disagreement import Coordinates
from lockstep.check.system.domain import argument_box
from lockstep.check.system.formation import WHERE, check_formation
from lockstep.check.system.graph import Digraph
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork

DEFAULT_ORDER, MOST_DEFAULT_ORDER, MOST_ORDER = 2, 4, 64
"""n_C where a problem states none, the least and the most; and the largest that one may state."""


def default_order(states: int, *, many_graphs: bool) -> int:
    """Return n_C where a problem states none; where one P is for every graph of a spectrum, that of a reduced observer."""
    return max(DEFAULT_ORDER, min(states - 1, MOST_DEFAULT_ORDER)) if many_graphs else DEFAULT_ORDER


CONTROLLER = {"discretization": ("tustin", "zoh", "euler"), "real": ("float32", "float64")}
"""Of [controller], the words that are known."""

KEYS = {
    "agent": "name states inputs parameters dynamics outputs limits output_range domain units split centre",
    "network": "agents edges laplacian topology file spectrum max_degree leader parameters offsets messages",
    "design": "method order weights disturbances decay search_decay stable_controllers gain_limit gain_units fragility"
    " alpha objective rho coordinates for_period starts seed gains",
    "controller": "period discretization real delay",
    "simulation": "initial spread horizon seed disturbance perturbation channel reference",
}
"""What each table of a problem may hold: a key that nothing here reads is no misspelt one."""

_COMMON = ("A", "C", "G", "H", "phi", "offset")
"""What agents that differ in B only have in common."""

COORDINATES: tuple[Coordinates, ...] = get_args(Coordinates)

Scales = tuple[Sequence[float], Sequence[float]] | None


@dataclass(frozen=True, eq=False)
class ProblemTables:
    """The tables of a problem, and what they say.

    Raises:
        ProblemError: a key missing, or a value that cannot be one of its kind, with the place.
    """

    tables: Mapping[str, Any]

    @classmethod
    def from_document(cls, tables: Mapping[str, Any]) -> "ProblemTables":
        """Build the problem and look at all of it, so that what is wrong with it is told at once."""
        problem = cls(tables)
        read.only(tables, ("title", *KEYS), "problem")
        for name, known in KEYS.items():
            read.only(tables.get(name, {}), known.split(), f"[{name}]")
        for key, words in CONTROLLER.items():
            read.one_of(problem.controller.get(key), words, f"[controller] {key}")
        _ = problem.sizes, problem.box, problem.performance, problem.limits, problem.gain_units
        _ = problem.period, problem.delay, problem.messages, problem.offsets, problem.leader
        return problem

    @property
    def title(self) -> str:
        """The title, for people."""
        return str(self.tables.get("title") or self.agent.name)

    def _table(self, name: str) -> Mapping[str, Any]:
        table: Mapping[str, Any] = read.part(self.tables, name, dict)
        return table

    @property
    def design(self) -> Mapping[str, Any]:
        """The table [design]."""
        return self._table("design")

    @property
    def controller(self) -> Mapping[str, Any]:
        """The table [controller]."""
        return self._table("controller")

    @cached_property
    def agent(self) -> ExactAgent:
        """The agent as it is written: no slope is moved."""
        return self._agent({})

    def _agent(self, changed: Mapping[str, Any]) -> ExactAgent:
        table = self._table("agent")
        parameters = read.part(table, "parameters", dict)
        outputs: dict[str, str] = {}
        where = "[agent.outputs]"
        for pair in read.part(table, "outputs", list):
            new = len(_texts(pair, where)) == 2 and pair[0] not in outputs
            demand(new, f"{pair!r}", where, "pairs of a new name and a formula")
            outputs[pair[0]] = pair[1]
        where = "[network] parameters"
        demand(isinstance(changed, dict), f"{changed!r}", where, "a table for each agent")
        for name in changed:
            demand(name in parameters, f"`{name}` is no parameter of the agent", where)
        return ExactAgent.from_texts(
            str(table.get("name", "agent")),
            states=_texts(read.part(table, "states", list), "[agent] states"),
            inputs=_texts(read.part(table, "inputs", list), "[agent] inputs"),
            dynamics=read.part(table, "dynamics", dict),
            outputs=outputs,
            parameters={**parameters, **changed},
        )

    @cached_property
    def spectrum(self) -> SpectrumRange | None:
        """[network] spectrum: every connected undirected graph with its nonzero eigenvalues there; None for one graph."""
        table = self._table("network")
        return None if table.get("spectrum") is None else SpectrumRange.of(table)

    @cached_property
    def graph(self) -> Digraph:
        """Who listens to whom; with a spectrum, two agents that are one of its graphs."""
        table = self._table("network")
        if self.spectrum is not None:
            return self.spectrum.pair
        given = [key for key in ("edges", "laplacian", "topology") if table.get(key) is not None]
        expected = "exactly one of `edges`, `laplacian` and `topology`"
        demand(len(given) == 1, f"{len(given)} of them", "[network]", expected)
        agents: Any = table.get("agents")
        if given == ["laplacian"]:
            L = read.matrix()(table["laplacian"], "[network] laplacian")
            expected = f"{len(L)}, as of `laplacian`"
            demand(agents in (None, len(L)), f"{agents!r}", "[network] agents", expected)
            return Digraph.from_laplacian(L)
        if given == ["topology"]:
            return Digraph.topology(table["topology"], agents)
        edge = partial(read.each, read=read.number, name="number")
        return Digraph.from_edges(agents, read.each(table["edges"], "[network] edges", edge, "edge"))

    @cached_property
    def inputs(self) -> tuple[Annotated[np.ndarray, "n m"], ...]:
        """B_i of each agent; they differ by `[network] parameters` only, and nothing else may."""
        given, where = self._table("network").get("parameters"), "[network] parameters"
        demand(given is None or not self.spectrum, "they are given", where, "none with `spectrum`")
        if given is None:
            return (self.agent.B,) * self.graph.N
        fits = isinstance(given, list) and len(given) == self.graph.N
        demand(fits, "another number of tables", where, "one per agent")
        found = []
        for k, changed in enumerate(given, start=1):
            variant = self.agent if changed == {} else self._agent(changed)
            same_but_B = "agents that differ in B only: (2) has one A, one C and one h for all"
            for one in _COMMON:
                same = _equal(getattr(self.agent, one), getattr(variant, one))
                demand(same, f"{one} differs", f"{where}, entry {k}", same_but_B)
            found.append(variant.B)
        return tuple(found)

    @cached_property
    def offsets(self) -> Annotated[np.ndarray, "N n"] | None:
        """o_i of each agent, whose x_i - o_i are to agree and obey the equations of x_i; None where the x_i are to agree."""
        given = self._table("network").get("offsets")
        if given is None:
            return None
        demand(not self.spectrum, "they are given", WHERE, "none with `spectrum`")
        offsets: np.ndarray = read.matrix(self.graph.N, len(self.agent.states))(given, WHERE)
        check_formation(self.agent, offsets)
        return offsets

    @property
    def measured_offsets(self) -> Annotated[np.ndarray, "N q"] | None:
        """C o_i as the C has them; None where there are none."""
        return measured_offsets(self.agent, self.offsets, self.controller["real"])

    @property
    def order(self) -> int:
        """n_C, the number of states of each controller; with given gains, theirs."""
        given = self.design.get("gains")
        if given:
            first = given[0] if isinstance(given, list) and isinstance(given[0], dict) else {}
            return len(read.part(first, "A", list))
        default = default_order(len(self.agent.states), many_graphs=self.spectrum is not None)
        return read.whole(0, MOST_ORDER)(self.design.get("order", default), "[design] order")

    @property
    def sizes(self) -> Sizes:
        """N, n, m, q and n_C."""
        agent = self.agent
        N = self.graph.N if self.spectrum is None else 1
        return Sizes(N, len(agent.states), len(agent.inputs), len(agent.outputs), self.order)

    @property
    def period(self) -> float:
        """T_s of the sampled controllers, in s."""
        return read.above_zero(self.controller.get("period"), "[controller] period")

    @property
    def delay(self) -> int:
        """Periods until u acts."""
        return int(read.one_of(self.controller.get("delay"), (0, 1), "[controller] delay"))

    @property
    def messages(self) -> Messages | None:
        """What the network may do to messages, if the problem says so."""
        table = self._table("network").get("messages")
        return None if table is None else messages_of(table)

    @property
    def box(self) -> Box:
        """The box of v = H x over the domain of the states."""
        return self._arguments(self._table("agent"), "domain", "[agent.domain]")

    @property
    def leader(self) -> Box | None:
        """The box of v = H x in which [network] leader says that a single leader stays, if it does."""
        table = self._table("network")
        return None if table.get("leader") is None else self._arguments(table, "leader", "[network] leader")

    def _arguments(self, table: Mapping[str, Any], key: str, where: str) -> Box:
        intervals = _table(table, key, self.agent.states, where)
        sides = {state: read.interval(intervals[state], f"{where} {state}") for state in intervals}
        every = [sides.get(one, (-math.inf, math.inf)) for one in self.agent.states]
        return argument_box(self.agent.H, every)

    @property
    def performance(self) -> Performance:
        """What rho is a gain to and from; the certificate decides R and Q to be positive definite."""
        table, sizes = read.part(self.design, "weights", dict), self.sizes
        read.only(table, ("state", "controller", "input"), "[design.weights]")
        scales = _table(self.design, "disturbances", ("states", "outputs"), "[design.disturbances]")
        given = table.get("input")
        W = _weight(0.0 if given is None else given, sizes.m, "[design.weights] input")
        return Performance(
            _weight(table.get("state"), sizes.n, "[design.weights] state"),
            _weight(table.get("controller"), sizes.n_C, "[design.weights] controller"),
            W if W.any() else np.zeros((0, 0)),
            _scales(scales.get("states"), self.agent.states, "[design.disturbances] states"),
            _scales(scales.get("outputs"), self.agent.outputs, "[design.disturbances] outputs"),
        )

    @property
    def gain_units(self) -> tuple[Annotated[np.ndarray, " k"], Annotated[np.ndarray, " l"]]:
        """l and r, exact: `gain_limit` is of diag(l) [A B; C D] diag(r), in the units of [design.gain_units]."""
        where, agent = "[design.gain_units]", self.agent
        table = _table(self.design, "gain_units", ("time", "inputs", "outputs"), where)
        u, y = (
            _scales(table.get(key), names, f"{where} {key}", read.above_zero, 1.0)
            for key, names in (("inputs", agent.inputs), ("outputs", agent.outputs))
        )
        A = np.full(self.sizes.n_C, read.above_zero(table.get("time", 1.0), f"{where} time"))
        return np.append(exactly(A), 1 / exactly(u)), exactly(np.append(np.ones_like(A), y))

    @property
    def sides(self) -> Annotated[np.ndarray, "m 2"]:
        """The lowest and the highest value of each input, infinite where there is none."""
        names, where = self.agent.inputs, "[agent.limits]"
        table = _table(self._table("agent"), "limits", names, where)
        sides = [read.interval(table.get(name, [None, None]), f"{where} {name}") for name in names]
        for name, (low, high) in zip(names, sides, strict=True):
            demand(low < 0 < high, f"[{low}, {high}]", f"{where} {name}", "a range around 0")
        return np.array(sides)

    @property
    def limits(self) -> Annotated[np.ndarray, " m"]:
        """How far each input goes either way before the C clips it, infinite where it has no limit."""
        return either_way(self.controller["real"], self.sides)

    def network(self, moves: Sequence[Move], scales: Scales) -> tuple[ExactNetwork, ExactAgent]:
        """Return the network with slopes moved and G D_w, D_v^-1 H in place of G and H, and the agent that it is of."""
        agent = self.agent.moved(moves)
        D_w, D_v = scales or ((1.0,) * agent.G.shape[1], (1.0,) * agent.H.shape[0])
        r, v = agent.G.shape[1], agent.H.shape[0]
        found = f"scales for {len(D_w)} components and {len(D_v)} arguments"
        demand((len(D_w), len(D_v)) == (r, v), found, "claims, `scales`", f"{r} and {v}")
        G = agent.G * exactly(np.array(D_w)).reshape(1, -1)
        H = agent.H / exactly(np.array(D_v)).reshape(-1, 1)
        plant = Plant(agent.A, self.inputs, agent.C, G, H)
        given = self.design.get("coordinates")
        coordinates: Coordinates = read.one_of(given, COORDINATES, "[design] coordinates")
        ends = None if self.spectrum is None else (self.spectrum.lower, self.spectrum.upper)
        return ExactNetwork(plant, self.graph, coordinates, spectrum=ends), agent


def _equal(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b)


def _texts(value: Any, where: str) -> list[str]:
    texts = isinstance(value, list) and all(isinstance(one, str) for one in value)
    demand(texts, f"{value!r}", where, "a list of texts")
    return list(value)


def _table(tables: Mapping[str, Any], key: str, known: Sequence[str], where: str) -> Mapping[str, Any]:
    """Return a table that need not be there, of known keys."""
    table = {} if tables.get(key) is None else tables[key]
    read.only(table, known, where)
    return table


def _scales(
    value: Any, names: Sequence[str], where: str, one: read.Reader = read.not_negative, otherwise: float = 0.0
) -> Annotated[np.ndarray, " k"]:
    """Return a scale for each name, another one for those not named; nothing where there are none and that is 0."""
    if value is None:
        return np.full(len(names) if otherwise else 0, otherwise)
    if not isinstance(value, dict):
        return np.full(len(names), one(value, where))
    read.only(value, names, where)
    return np.array([one(value.get(name, otherwise), f"{where} {name}") for name in names])


def _weight(value: Any, size: int, where: str) -> Annotated[np.ndarray, "k k"]:
    """Return w I, a diagonal matrix, or a matrix by rows."""
    if not isinstance(value, list):
        return read.not_negative(value, where) * np.eye(size)
    if not any(isinstance(row, list) for row in value):
        value = np.diag([read.number(x, where) for x in value]).tolist()
    found: Annotated[np.ndarray, "k k"] = read.matrix(size, size, symmetric=True)(
        value if size else [], where
    )
    return found
