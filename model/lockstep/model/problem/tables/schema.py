"""The tables of a problem file as pydantic models: which keys, which types, which ranges. docs/problem.md says what they do.

Strict: an unknown key is an error, text is no number, `true` is no 1, and nan and inf are refused, except that a side
of a box of the domain may be infinite. Each `description` completes the sentence "expected ..." of a message.
"""

from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, Strict
from pydantic_core import PydanticCustomError

from lockstep.check.design_file.problem import MOST_ORDER
from lockstep.check.system.graph_family import MOST_NEIGHBOURS

T = TypeVar("T")
Many = Annotated[tuple[T, ...], Strict(False)]
"""A TOML array, kept as a tuple; its items stay strict."""

Numbers = Many[float]
Matrix = Many[Numbers]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]

LONGEST_LINE = 200
Line = Annotated[str, Field(max_length=LONGEST_LINE, pattern=r"^[^\t\r\n]*$")]

MOST_STATES, MOST_INPUTS, MOST_OUTPUTS = 64, 32, 32
"""Of one agent. The agents' matrices are derived in exact arithmetic, and C is written for each entry."""

SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 3600.0
"""In s. Beyond them a period is a slip of the pen: it is 0 in float32, or a run has more steps than fit into memory."""


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _pairs(value: Any) -> Any:
    """Keep the order of the outputs, the order of y, where a JSON writer might sort a table's keys."""
    if not isinstance(value, dict):
        return value
    for name, formula in value.items():
        if not isinstance(formula, str):
            raise PydanticCustomError("output", "not a formula", {"name": name, "value": formula})
    return list(value.items())


def _interval(value: Any) -> Any:
    """Read [lower, upper]; an infinite side becomes None, which JSON can hold."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise PydanticCustomError("interval", "not an interval")
    low, high = value
    return (None if low == float("-inf") else low, None if high == float("inf") else high)


def _weight(value: Any) -> Any:
    """Read a number, a list of numbers or a list of such lists; nothing but whole numbers is converted."""
    try:
        return _numbers(value)
    except OverflowError:
        raise PydanticCustomError("weight", "not a weight") from None


def _numbers(value: Any) -> Any:
    if _is_number(value):
        return float(value)
    if isinstance(value, list | tuple) and value and all(_is_number(x) for x in value):
        return tuple(float(x) for x in value)
    if (
        isinstance(value, list | tuple)
        and value
        and all(isinstance(row, list | tuple) and row and all(_is_number(x) for x in row) for row in value)
    ):
        return tuple(tuple(float(x) for x in row) for row in value)
    raise PydanticCustomError("weight", "not a weight")


def _edge_out(edge: tuple[float, ...]) -> list[int | float]:
    """Write agents as whole numbers."""
    return [int(x) if x.is_integer() and k < 2 else x for k, x in enumerate(edge)]


Edge = Annotated[Numbers, PlainSerializer(_edge_out)]
Interval = Annotated[tuple[float | None, float | None], BeforeValidator(_interval)]
Weight = Annotated[Any, BeforeValidator(_weight)]
Scales = NotNegative | dict[str, NotNegative] | None
Units = Positive | dict[str, Positive] | None
Outputs = Annotated[Many[Annotated[tuple[str, str], Strict(False)]], BeforeValidator(_pairs)]


def _optional(description: str, **limits: Any) -> Any:
    """Return a key that is None where the file leaves it out."""
    return Field(default=None, description=description, **limits)


class ProblemTable(BaseModel):
    """What all tables of the file share."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class AgentTable(ProblemTable):
    """[agent]: the agent all nodes of the network share."""

    name: str = Field(default="agent", description='a C identifier, such as "arm"')
    states: Many[str] = Field(
        max_length=MOST_STATES,
        description=f'a list of names, such as ["position", "speed"] (at most {MOST_STATES})',
    )
    inputs: Many[str] = Field(
        max_length=MOST_INPUTS, description=f'a list of names, such as ["u"] (at most {MOST_INPUTS})'
    )
    parameters: dict[str, float] = Field(default={}, description="a finite number by name")
    dynamics: dict[str, str] = Field(
        description='a formula as text by state, such as speed = "-k*position + u"'
    )
    outputs: Outputs = Field(
        max_length=MOST_OUTPUTS, description='a formula as text by name, such as y1 = "position"'
    )
    limits: dict[str, Interval] | None = _optional(
        "[lowest, highest] of an actuator by input, as two numbers around 0"
    )
    output_range: dict[str, Interval] | None = _optional(
        "[lowest, highest] plausible value by output, as two numbers"
    )
    domain: dict[str, Interval] = Field(default={}, description="[lower, upper] by state, as two numbers")
    units: dict[str, Line] = Field(
        default={}, description='a unit as text by state, input, output or parameter, such as "rad"'
    )
    split: Literal["terms", "jacobian"] = Field(default="terms", description='"terms" or "jacobian"')
    centre: bool = Field(
        default=True, description="true or false: move the middle of the nonlinearity's slopes into A"
    )


class MessagesTable(ProblemTable):
    """[network.messages]: what the network may do to messages, part of what is proved."""

    loss: float | None = _optional(
        "a probability from 0 up, below 1, by which a link at most loses the message of a period", ge=0, lt=1
    )
    burst: int | None = _optional(
        "a whole number up to 1000: at most so many messages lost in a row", ge=0, le=1000
    )
    delay: Annotated[tuple[int, int], Strict(False)] | None = _optional(
        "[least, most] periods, whole numbers from 0 up, such as [0, 2]"
    )
    jitter: float | None = _optional(
        "a part of the period, from 0 up and below 1, by which sampling instants may be off", ge=0, lt=1
    )


class NetworkTable(ProblemTable):
    """[network]: the graph, as exactly one of edges, laplacian, topology and file; or a spectrum, which names many."""

    agents: int | None = _optional("a whole number of agents, 2 or more")
    edges: Many[Edge] | None = _optional("a list of [listener, source] or [listener, source, weight]")
    laplacian: Matrix | None = _optional("the matrix (1) as a list of rows of numbers")
    topology: Literal["cycle", "path", "ring", "complete", "star", "leader_path"] | None = _optional(
        '"cycle", "path", "ring", "complete", "star" or "leader_path"'
    )
    file: Line | None = _optional(
        'the name of a file beside the problem, Matrix Market (.mtx), GraphML or CSV, such as "graph.mtx"'
    )
    spectrum: Many[Positive] | None = _optional(
        "two numbers [a, b], 0 < a <= b: every connected undirected graph whose nonzero Laplacian eigenvalues lie there",
        min_length=2,
        max_length=2,
    )
    max_degree: int | None = _optional(
        f"a whole number from 1 to {MOST_NEIGHBOURS}: the most neighbours of an agent, with `spectrum`",
        ge=1,
        le=MOST_NEIGHBOURS,
    )
    leader: dict[str, Interval] | None = _optional(
        "[lower, upper] by state of [agent.domain], as two numbers inside its own; who hears nobody leads"
    )
    parameters: Many[dict[str, float]] | None = _optional(
        "one table of finite numbers per agent, such as [{ k = 1.0 }, {}]"
    )
    offsets: Matrix | None = _optional("one list of n numbers per agent, such as [[0.0, 0.0], [1.0, 0.0]]")
    messages: MessagesTable | None = _optional(
        "a table, such as { loss = 0.1, burst = 2, delay = [0, 2], jitter = 0.1 }"
    )


class WeightsTable(ProblemTable):
    """[design] weights: R on the disagreement of the states, Q on the controller states, W on the inputs."""

    state: Weight = Field(default=1.0, description="a number, a list of numbers or a symmetric matrix")
    controller: Weight = Field(default=1.0, description="a number, a list of numbers or a symmetric matrix")

    input: Weight | None = _optional("a number, 0 or more, a list of such numbers or a symmetric matrix")


class DisturbancesTable(ProblemTable):
    """[design.disturbances]: what rho is a gain from."""

    states: Scales = _optional(
        "a scale, 0 or more, for all states or by state: those not named are not disturbed"
    )
    outputs: Scales = _optional(
        "a scale, 0 or more, for all outputs or by output: those not named are not noisy"
    )


class GainUnitsTable(ProblemTable):
    """[design.gain_units]: what the gains are counted in for `gain_limit`; 1 where nothing is said."""

    time: Positive = Field(default=1.0, description="a number of seconds above 0")
    inputs: Units = _optional("a number above 0 for all inputs or by input, in the units of the file")
    outputs: Units = _optional("a number above 0 for all outputs or by output, in the units of the file")


class FragilityTable(ProblemTable):
    """[design.fragility]: the bounds delta of (11), as spectral norms; 0 is certain."""

    A: NotNegative = Field(default=0.0, description="a finite number, 0 or more")
    B: NotNegative = Field(default=0.0, description="a finite number, 0 or more")
    C: NotNegative = Field(default=0.0, description="a finite number, 0 or more")
    D: NotNegative = Field(default=0.0, description="a finite number, 0 or more")


class GainsTable(ProblemTable):
    """[[design.gains]]: one agent's controller (9); at order 0 there is D alone."""

    A: Matrix = Field(default=(), description="a list of rows of finite numbers")
    B: Matrix = Field(default=(), description="a list of rows of finite numbers")
    C: Matrix = Field(default=(), description="a list of rows of finite numbers")
    D: Matrix = Field(description="a list of rows of finite numbers")


class DesignTable(ProblemTable):
    """[design]: what is asked of the controllers."""

    method: Literal["certified", "modal", "theorem1", "corollary1", "lipschitz", "given"] = Field(
        default="certified",
        description='"certified", "modal", "theorem1", "corollary1", "lipschitz" or "given"',
    )
    order: int | None = _optional(
        f"a whole number from 0 (static output feedback) to {MOST_ORDER}", ge=0, le=MOST_ORDER
    )
    weights: WeightsTable = Field(
        default=WeightsTable(), description="a table, such as { state = 1.0, controller = 2.0 }"
    )
    disturbances: DisturbancesTable | None = _optional("a table, such as { outputs = { y1 = 0.001 } }")
    decay: Positive | None = _optional("a number of 1/s above 0")
    search_decay: Positive | None = _optional(
        "a number of 1/s above 0: a decay that the search keeps to beside rho, and nobody is promised"
    )
    stable_controllers: bool | None = _optional(
        "true or false: whether each controller is to be stable by itself"
    )
    gain_limit: Positive = Field(default=50.0, description="a finite number above 0")
    gain_units: GainUnitsTable | None = _optional("a table, such as { inputs = { u = 4000.0 } }")
    fragility: FragilityTable | None = _optional("a table, such as { A = 0.5 }")
    alpha: Positive | None = _optional("a finite number above 0")
    objective: Literal["rho", "alpha", "decay", "initial_set"] = Field(
        default="rho", description='"rho", "alpha", "decay" or "initial_set"'
    )
    rho: Positive | None = _optional("a finite number above 0")
    coordinates: Literal["orthonormal", "laplacian_rows"] = Field(
        default="orthonormal", description='"orthonormal" or "laplacian_rows"'
    )
    for_period: bool = Field(default=False, description="true or false")
    starts: int = Field(default=4, ge=1, le=10_000, description="a whole number from 1 to 10000")
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="a whole number, 0 or more")
    gains: Many[GainsTable] | None = _optional("one [[design.gains]] table per agent")


class ControllerTable(ProblemTable):
    """[controller]: how the controller runs on the target."""

    period: float = Field(
        default=0.005,
        ge=SHORTEST_PERIOD,
        le=LONGEST_PERIOD,
        description=f"a number of seconds above 0, from {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g}",
    )
    discretization: Literal["tustin", "zoh"] = Field(default="tustin", description='"tustin" or "zoh"')
    real: Literal["float32", "float64"] = Field(default="float32", description='"float32" or "float64"')
    delay: Literal[0, 1] = Field(default=0, description="0 or 1 periods")


class DisturbanceTable(ProblemTable):
    """[simulation.disturbance]: xi of (2), acting on each state of each agent on its own, or on those that are named."""

    kind: Literal["none", "noise", "sine", "step", "worst"] = Field(
        default="none",
        description='"none", "noise" (Gaussian, held over a period), "sine", "step", or "worst" (searched for)',
    )
    amplitude: NotNegative | dict[str, float] = Field(
        default=1.0,
        description="a finite number, 0 or more (the standard deviation of noise), for all states or by state, which may be"
        " negative there: those not named are not disturbed",
    )
    agents: list[int] | None = _optional(
        "a list of one agent or more by number, from 1; without it all are disturbed", min_length=1
    )
    frequency: Positive = Field(default=1.0, description="a finite number of Hz above 0")
    start: NotNegative = Field(default=0.0, description="a finite number of seconds, 0 or more")
    stop: Positive | None = _optional("a finite number of seconds above 0")
    intensity: NotNegative | None = _optional(
        "a finite number, 0 or more: of noise, its variance times the time it is held"
    )

    @property
    def size(self) -> str:
        """How large it is, and on what, for people."""
        if isinstance(self.amplitude, dict):
            each, unit = self.amplitude, "units"
        else:
            each, unit = {"every state": self.amplitude}, "its unit"
        sized = ", ".join(f"{value:g} on {name}" for name, value in each.items())
        whom = "" if self.agents is None else f" of agent {', '.join(map(str, self.agents))}"
        if self.kind == "noise" and self.intensity is not None:
            return f"intensity {self.intensity:g} on {', '.join(each)}{whom}"
        return f"amplitude {sized}{whom}, in {unit} per second"


class PerturbationTable(ProblemTable):
    """[simulation.perturbation]: gain errors Delta(t) of (11), for continuous controllers."""

    kind: Literal["none", "paper", "paper_scaled", "random"] = Field(
        default="none",
        description='"none", "paper" (Section 4 as printed), "paper_scaled" (cut to its bounds) or "random"'
        " (at the bounds of [design.fragility])",
    )
    interval: Positive | None = _optional(
        "a finite number of seconds above 0: draw random errors anew that often"
    )


class ChannelTable(ProblemTable):
    """[simulation.channel]: what happens to measurements and messages of sampled controllers."""

    noise: Scales = _optional(
        "a standard deviation, 0 or more, of Gaussian noise at each reading, for all outputs or by output"
    )
    delay: int = Field(default=0, ge=0, le=1000, description="a whole number of periods from 0 to 1000")
    drop: float = Field(default=0.0, ge=0, le=1, description="a probability from 0 to 1")
    bits: int | None = _optional("a whole number of bits from 2 to 53", ge=2, le=53)
    full_scale: Positive = Field(
        default=10.0, description="a finite number above 0: the largest output the converter gives"
    )


class SimulationTable(ProblemTable):
    """[simulation]: the run of the nonlinear closed loop."""

    initial: Matrix | Literal["random"] = Field(
        default="random", description='"random", or one list of n numbers per agent'
    )
    spread: NotNegative = Field(
        default=1.0,
        description="a finite number, 0 or more: random states are within +-spread of 0 or the middle of a domain",
    )
    horizon: Positive = Field(default=20.0, description="a finite number of seconds above 0")
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="a whole number, 0 or more")
    disturbance: DisturbanceTable = Field(
        default=DisturbanceTable(), description='a table, such as { kind = "noise" }'
    )
    # Absent rather than filled in, so that a design file made before them reads and hashes as it did.
    perturbation: PerturbationTable | None = _optional('a table, such as { kind = "random" }')
    channel: ChannelTable | None = _optional("a table, such as { drop = 0.1 }")
    reference: dict[str, str] | None = _optional(
        'a formula in t as text by input, such as u = "0.5*sin(0.3*t)"'
    )


class ProblemFile(ProblemTable):
    """The whole file."""

    title: Line = Field(default="", description=f"text on one line, of at most {LONGEST_LINE} characters")
    agent: AgentTable = Field(description="the table [agent]")
    network: NetworkTable = Field(description="the table [network]")
    design: DesignTable = Field(default=DesignTable(), description="the table [design]")
    controller: ControllerTable = Field(default=ControllerTable(), description="the table [controller]")
    simulation: SimulationTable = Field(default=SimulationTable(), description="the table [simulation]")
