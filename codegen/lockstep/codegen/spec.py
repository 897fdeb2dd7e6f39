"""What the code generator is asked for: controllers (9) with their Laplacian rows, a period, an arithmetic.

One agent's controller, paper (9):  x_C' = A x_C + B r,  u = C x_C + D r,  r = sum_j a_ij (y_i - y_j).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from lockstep.check.c_source.reader import MAX_NEIGHBOURS
from lockstep.check.errors import ProblemError, demand
from lockstep.check.sampled.discretise import Discretization, Real
from lockstep.codegen.cost.bound_coefficients import Optimize
from lockstep.codegen.identifiers import check_identifier
from lockstep.codegen.manifest import MOST_KEPT, FixedEntry
from lockstep.codegen.one_image import OneImage

LEAST = 1e-20
"""The nearest to 0 that an input may be clipped: its known answers have all their bits below it."""


def matrix(value: ArrayLike, shape: tuple[int, int], where: str) -> Float[np.ndarray, "rows cols"]:
    """Return a read-only float64 copy of `value`; an empty one takes the empty shape asked for."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"not a matrix of numbers ({error})", where=where) from None
    if array.size == 0 and 0 in shape:
        array = array.reshape(shape)
    found = f"the shape is {' x '.join(map(str, array.shape)) or 'a scalar'}"
    demand(array.shape == shape, found, where, f"{shape[0]} x {shape[1]}")
    demand(np.isfinite(array).all(), "an entry is NaN or infinite", where, "finite numbers")
    array += 0.0  # -0 becomes +0: a zero coefficient has one bit pattern
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Signal:
    """A named input or output: its name and its unit (both only ever printed)."""

    name: str
    unit: str = ""


@dataclass(frozen=True)
class Neighbour:
    """One source that the agent listens to: its name and the edge's weight a_ij > 0."""

    source: str
    weight: float = 1.0

    def __post_init__(self) -> None:
        found, where = f"the weight is {self.weight!r}", f"neighbour `{self.source}`"
        expected, remedy = "a finite number above 0", "leave an edge of weight 0 out"
        demand(math.isfinite(self.weight) and self.weight > 0, found, where, expected, remedy)


def _signals(given: tuple[Signal, ...], count: int, letter: str, where: str) -> tuple[Signal, ...]:
    if not given:
        return tuple(Signal(f"{letter}{k + 1}") for k in range(count))
    demand(len(given) == count, f"{len(given)} signals are named", where, f"{count}")
    return tuple(given)


@dataclass(frozen=True, eq=False)
class Controller:
    """One agent's continuous controller (9) and its row of the Laplacian.

    name        prefix of everything generated for this agent (a C identifier)
    A, B, C, D  continuous gains: nc x nc, nc x q, m x nc, m x q (nc = 0: static output feedback, Remark 1)
    neighbours  the sources j with a_ij > 0, in the order of the mask bits; none: the relative output is 0
    outputs, inputs  the plant's measured outputs y (q) and inputs u (m): names and units for the header
    limits      the lowest and the highest value of each u (m x 2), infinite where there is none; empty: u is not clipped
    offsets     of a formation: what is taken from own outputs, then from those of each neighbour (1 + nn x q); empty: nothing
    """

    name: str
    A: Float[np.ndarray, "nc nc"]
    B: Float[np.ndarray, "nc q"]
    C: Float[np.ndarray, "m nc"]
    D: Float[np.ndarray, "m q"]
    neighbours: tuple[Neighbour, ...] = ()
    outputs: tuple[Signal, ...] = ()
    inputs: tuple[Signal, ...] = ()
    limits: Float[np.ndarray, "m 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    offsets: Float[np.ndarray, "nn+1 q"] | None = None

    def __post_init__(self) -> None:
        where = f"controller `{self.name}`"
        check_identifier(self.name, where)
        D = np.array(self.D, dtype=np.float64)
        found = f"D has the shape {D.shape}"
        demand(D.ndim == 2 and 0 not in D.shape, found, where, "inputs x outputs, one or more each")
        m, q = D.shape
        nc = len(self.A)
        for letter, shape in {"A": (nc, nc), "B": (nc, q), "C": (m, nc), "D": (m, q)}.items():
            object.__setattr__(self, letter, matrix(getattr(self, letter), shape, f"{where}, {letter}"))
        self._check_neighbours(where)
        object.__setattr__(self, "outputs", _signals(self.outputs, q, "y", f"{where}, outputs"))
        object.__setattr__(self, "inputs", _signals(self.inputs, m, "u", f"{where}, inputs"))
        limits = np.array(self.limits, dtype=np.float64).reshape(-1, 2)
        around = len(limits) in (0, m) and ((limits[:, 0] <= -LEAST) & (limits[:, 1] >= LEAST)).all()
        expected = f"{m} ranges around 0, at least from -{LEAST:g} to {LEAST:g}"
        demand(around, f"{limits.tolist()}", f"{where}, limits", expected)
        object.__setattr__(self, "limits", limits if np.isfinite(limits).any() else np.zeros((0, 2)))

        if self.offsets is not None:
            rows = (1 + len(self.neighbours), q)
            object.__setattr__(self, "offsets", matrix(self.offsets, rows, f"{where}, offsets"))

    def _check_neighbours(self, where: str) -> None:
        object.__setattr__(self, "neighbours", tuple(self.neighbours))
        sources = [neighbour.source for neighbour in self.neighbours]
        found = f"{len(sources)} neighbours"
        demand(len(sources) <= MAX_NEIGHBOURS, found, where, f"at most {MAX_NEIGHBOURS}: one mask bit each")
        remedy = "add the weights into one edge"
        demand(len(set(sources)) == len(sources), "a neighbour appears twice", where, remedy=remedy)

    @property
    def order(self) -> int:
        """The number nc of controller states."""
        return int(self.A.shape[0])


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """The linear part x' = A x + B u, y = C x of one agent, and a start x0: for closed-loop test data."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m"]
    C: Float[np.ndarray, "q n"]
    x0: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        n, m, q = len(self.A), np.shape(self.B)[-1], len(self.C)
        for letter, shape in {"A": (n, n), "B": (n, m), "C": (q, n)}.items():
            object.__setattr__(self, letter, matrix(getattr(self, letter), shape, f"plant, {letter}"))
        object.__setattr__(self, "x0", matrix(np.reshape(self.x0, (1, -1)), (1, n), "plant, x0")[0])


@dataclass(frozen=True)
class MessageLimits:
    """What the message layer in C is told of a network.

    kept    own readings that a node keeps, a power of 2 so that instants count modulo 2^32: a message older than
            kept - 1 periods is refused
    limit   periods after which what is held of a neighbour is said to be stale
    ranges  by output, lowest and highest plausible value (None: no bound): other messages are refused
    """

    kept: int = 16
    limit: int = 15
    ranges: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        found, expected = f"{self.kept} kept readings", f"a power of 2, from 2 to {MOST_KEPT}"
        power = 2 <= self.kept <= MOST_KEPT and not self.kept & (self.kept - 1)
        demand(power, found, "messages", expected)
        demand(1 <= self.limit < 2**31, f"{self.limit}", "messages, limit", "1 period or more")


@dataclass(frozen=True, eq=False)
class CodegenSpec:
    """Everything the generated folder depends on.

    agents          the controllers, in the network's order
    period          sampling period in s
    discretization  "tustin" (default), "zoh" or "euler"
    real            arithmetic of the C code
    optimize        "speed" (unrolled, gains as literals) or "size" (a loop over a table)
    name            the CMake target, the umbrella header and its table of descriptors; no agent's name
    messages        what the message layer is told; None: its defaults
    fixed           formats of the controllers in integers, and what is claimed of them; None where nothing is
    prefix          what the agents' names begin with besides their design's: so that two folders fit one program
    title           one line for headers and README
    certificate     figures for the datasheet (alpha, rho, fragility, certified, proof, ...); printed, never
    interpreted,
                    except that anything but `certified: True` is printed as NOT CERTIFIED
    design_hash     identifies the design that the gains come from
    delay           periods after its sample at which u acts, 0 or 1: what the caller is told to do
    plants          optional, one per agent: `verify` then closes the loop around the reference
    image           one image for all nodes: the agents are then the controllers by number, without edges of their own
    """

    agents: tuple[Controller, ...]
    period: float
    discretization: Discretization = "tustin"
    real: Real = "float32"
    optimize: Optimize = "speed"
    name: str = "controllers"
    title: str = "Consensus controllers"
    certificate: Mapping[str, str | float | bool | None] = field(default_factory=dict)
    design_hash: str = ""
    plants: tuple[LinearPlant, ...] = ()
    delay: int = 0
    prefix: str = ""
    image: OneImage | None = None
    messages: MessageLimits | None = None
    fixed: FixedEntry | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "agents", tuple(self.agents))
        object.__setattr__(self, "plants", tuple(self.plants))
        check_identifier(self.name, "name")
        timely = not isinstance(self.period, bool) and math.isfinite(self.period) and self.period > 0
        demand(timely, f"the period is {self.period!r}", "period", "a finite number of seconds above 0")
        demand(self.delay in (0, 1), f"`{self.delay}`", "delay", "0 or 1 periods")
        _choice(self.discretization, ("tustin", "zoh", "euler"), "discretization")
        _choice(self.real, ("float32", "float64"), "real")
        _choice(self.optimize, ("speed", "size"), "optimize")
        self._check_agents()
        self._check_plants()
        self._check_image()

    def _check_image(self) -> None:
        if self.image is None:
            return
        check_identifier(self.image.name, "one image")
        shapes = {(agent.order, *agent.D.shape, len(agent.limits)) for agent in self.agents}
        found = "controllers of several sizes, or with neighbours of their own"
        demand(len(shapes) <= 1 and not any(agent.neighbours for agent in self.agents), found, "one image")
        if self.image.name.lower() in {self.name.lower(), *(agent.name.lower() for agent in self.agents)}:
            raise ProblemError(f"`{self.image.name}` is a controller's name too", where="one image")

    def _check_agents(self) -> None:
        names = [agent.name.lower() for agent in self.agents]
        demand(names, "no agent", "agents", "one or more controllers")
        found = "two agents have one name (letter case aside)"
        demand(len(set(names)) == len(names), found, "agents", remedy="give each its own prefix")
        remedy = "give the folder another name"
        demand(self.name.lower() not in names, f"`{self.name}` names an agent too", "name", remedy=remedy)

        by_name = {agent.name: agent for agent in self.agents}
        for agent in self.agents:
            for neighbour in agent.neighbours:
                source = by_name.get(neighbour.source, agent)
                count, own = len(source.D[0]), len(agent.D[0])
                found = f"`{source.name}` has {count} outputs, `{agent.name}` {own}"
                demand(count == own, found, f"controller `{agent.name}`", "as many: y_i - y_j is formed")

    def _check_plants(self) -> None:
        if not self.plants:
            return
        found = f"{len(self.plants)} plants"
        demand(len(self.plants) == len(self.agents), found, "plants", f"{len(self.agents)}, or none")
        names = {agent.name for agent in self.agents}
        for agent, plant in zip(self.agents, self.plants, strict=True):
            found = "inputs or outputs differ from the controller's"
            demand((plant.B.shape[1], plant.C.shape[0]) == agent.D.shape, found, f"plant of `{agent.name}`")
            for source in (n.source for n in agent.neighbours):
                found = f"the source `{source}` is no agent"
                demand(source in names, found, f"controller `{agent.name}`")


def _choice(value: str, allowed: tuple[str, ...], where: str) -> None:
    demand(value in allowed, f"`{value}`", where, " or ".join(allowed))
