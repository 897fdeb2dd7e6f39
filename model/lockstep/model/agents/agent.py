"""One agent, x' = f(x, u, t) and y = C x, from text or CasADi expressions, split as (2) has it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.expression.exact import Exact, Value
from lockstep.check.system.agent import ExactAgent, Move
from lockstep.check.system.domain import argument_box
from lockstep.model.agents.parts import check_bounds, check_symbols, column_of, stack
from lockstep.model.bound_search import Box
from lockstep.model.bound_search.casadi_graph import read_value
from lockstep.model.bound_search.casadi_operations import RULES
from lockstep.model.control.pbh import Controllability, Observability, controllability, observability
from lockstep.model.formulas.exact_text import formula_text
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.formulas.names import (
    check_agent_name,
    check_formulas,
    check_known,
    check_names,
    check_parameters,
)
from lockstep.model.loop_transformation.centring import Centring, centred
from lockstep.model.loop_transformation.linearise import linearised
from lockstep.model.loop_transformation.lure import Lure, lure_form

Split = Literal["terms", "jacobian"]
UNBOUNDED = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False, kw_only=True)
class Agent:
    """An agent of the network: its symbols, its right-hand side and its outputs.

    The inputs enter linearly with constant coefficients, and the outputs are linear in the states: this is
    the paper's (2). Everything else may be nonlinear and may depend on t.

    Args:
        name: a C identifier of at most 20 characters; it prefixes the generated code.
        x: the n states, an SX column of symbols.
        u: the m inputs, likewise.
        rhs: f(x, u, t), an SX column of n expressions.
        y: the q outputs, an SX column of expressions.
        t: the time, an SX symbol; needed if `rhs` mentions it.
        states: the names of the states; by default those of the symbols.
        inputs: the names of the inputs, likewise.
        outputs: the names of the outputs; by default y1, y2, ...
        domain: the box the bound is proved on, (lower, upper) by state, open-ended where not given. It need
            not contain 0: the incremental bound is about differences.
        units: unit by name of a state, input or output, for documents.
        split: "terms" takes A and B from the terms linear in x and u; "jacobian" adds the slope of h at the
            origin to A.
        centre: whether the middle of the slopes of phi is moved into A where that shrinks their bound: see
            `lockstep.model.loop_transformation.centring`.

    Raises:
        ProblemError: a shape or a name that does not fit, an input that enters nonlinearly, an output that is
            not linear in the states, a symbol from elsewhere, or a coefficient that is not finite.

    >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    >>> rhs = ca.vertcat(x[1], -2 * x[0] - 9.81 * ca.sin(x[0]) + u)
    >>> pendulum = Agent(name="pendulum", x=x, u=u, rhs=rhs, y=x[0])
    >>> pendulum.lure.A
    array([[ 0.,  1.],
           [-2.,  0.]])
    >>> pendulum.lure.phi
    Function(phi:(v,t)->(w) SXFunction)
    """

    name: str
    x: ca.SX
    u: ca.SX
    rhs: ca.SX
    y: ca.SX
    t: ca.SX = field(default_factory=lambda: ca.SX.sym("t"))
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    split: Split = "terms"
    centre: bool = False
    as_written: ExactAgent | None = None
    """The agent over the rationals before any slope is moved: read from the texts, else from `rhs` and `y`."""

    def __post_init__(self) -> None:
        expected = '"terms" or "jacobian"'
        demand(self.split in get_args(Split), f"`split` is {self.split!r}", "[agent] split", expected)
        for letter, what in (("x", "state"), ("u", "input"), ("rhs", "right-hand side"), ("y", "output")):
            object.__setattr__(self, letter, column_of(getattr(self, letter), what))
        for letter in ("x", "u", "t"):
            check_symbols(letter, ca.SX(getattr(self, letter)))
        self._take_names()
        found = f"`rhs` has {self.rhs.shape[0]} rows, but there are {self.n} states"
        demand(self.rhs.shape[0] == self.n, found, "", expected="one right-hand side per state")
        for letter in ("domain", "units"):
            object.__setattr__(self, letter, MappingProxyType(dict(getattr(self, letter))))
        check_known(
            "[agent.domain]",
            self.domain,
            self.states,
            lambda name: "it is an input: its limits go into [agent.limits]" if name in self.inputs else "",
        )
        check_known("[agent.units]", self.units, (*self.states, *self.inputs, *self.outputs))
        for state, bounds in self.domain.items():
            check_bounds(state, bounds)
        _ = self.lure

    @classmethod
    def from_expressions(
        cls,
        name: str,
        *,
        states: Sequence[str],
        inputs: Sequence[str],
        dynamics: Mapping[str, str],
        outputs: Mapping[str, str],
        parameters: Mapping[str, float] | None = None,
        domain: Mapping[str, tuple[float, float]] | None = None,
        units: Mapping[str, str] | None = None,
        split: Split = "terms",
        centre: bool = False,
    ) -> "Agent":
        """Build an agent from the texts of a problem file; `dynamics` and `outputs` give a formula by name.

        >>> cart = Agent.from_expressions("cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p"},
        ...                               dynamics={"p": "v", "v": "f - tanh(v)"})
        >>> cart.lure.H
        array([[0., 1.]])
        """
        parameters = dict(parameters or {})
        check_agent_name(name)
        check_names(states=states, inputs=inputs, outputs=tuple(outputs), parameters=tuple(parameters))
        check_formulas(states, dynamics)
        check_parameters(parameters)
        symbols = {key: ca.SX.sym(key) for key in (*states, *inputs, "t")}
        numbers = {key: float(value) for key, value in parameters.items()}
        known: dict[str, ca.SX | float] = {**symbols, **numbers}
        rhs = [parse_expression(dynamics[key], known, where=f"[agent.dynamics] {key}") for key in states]
        y = [parse_expression(text, known, where=f"[agent.outputs] {key}") for key, text in outputs.items()]
        as_written = ExactAgent.from_texts(
            name,
            states=states,
            inputs=inputs,
            dynamics=dynamics,
            outputs=outputs,
            parameters=parameters,
            show=formula_text,
        )
        return cls(
            name=name,
            x=stack([symbols[key] for key in states]),
            u=stack([symbols[key] for key in inputs]),
            rhs=stack(rhs),
            y=stack(y),
            t=symbols["t"],
            states=tuple(states),
            inputs=tuple(inputs),
            outputs=tuple(outputs),
            domain=domain or {},
            units=units or {},
            split=split,
            centre=centre,
            as_written=as_written,
        )

    @property
    def n(self) -> int:
        """The number of states."""
        return int(self.x.shape[0])

    @property
    def m(self) -> int:
        """The number of inputs."""
        return int(self.u.shape[0])

    @property
    def q(self) -> int:
        """The number of outputs."""
        return int(self.y.shape[0])

    @property
    def lure(self) -> Lure:
        """The split x' = A x + B u + G phi(H x, t) + offset(t), y = C x."""
        return self._split[0]

    @property
    def centring(self) -> Centring:
        """What `centre` moved from phi into A."""
        return self._split[1]

    @cached_property
    def exact(self) -> ExactAgent:
        """The agent over the rationals, with the slopes moved that `split` and `centre` chose to move."""
        return self._written.moved(self.moves)

    @property
    def moves(self) -> tuple[Move, ...]:
        """What `split` and `centre` moved from phi into A."""
        return self._split[2]

    @cached_property
    def _split(self) -> tuple[Lure, Centring, tuple[Move, ...]]:
        lure, moves = lure_form(self._written), tuple[Move, ...]()
        if self.split == "jacobian":
            lure, moves = linearised(lure)
        if not self.centre:
            return (
                lure,
                Centring(reason="[agent] centre is false, or [design] alpha is of phi as it is written"),
                moves,
            )
        lure, found = centred(lure, argument_box(lure.H, self.box))
        return lure, found, (*moves, *(Move(m.component, m.argument, m.amount) for m in found.moves))

    @cached_property
    def _written(self) -> ExactAgent:
        if self.as_written is not None:
            return self.as_written
        algebra = Exact(self.n + self.m, RULES)
        names = (self.states, self.inputs, self.outputs)

        def values(table: str, names: tuple[str, ...], column: ca.SX) -> list[Value]:
            each = zip(names, ca.vertsplit(column), strict=True)
            return [self.value(one, algebra, where=f"[agent.{table}] {name}") for name, one in each]

        rhs, y = values("dynamics", self.states, self.rhs), values("outputs", self.outputs, self.y)
        return ExactAgent.from_values(self.name, *names, rhs, y, algebra.seen, formula_text)

    @cached_property
    def dynamics(self) -> ca.Function:
        """The right-hand side as a function (x, u, t) -> (dx)."""
        rhs = ca.densify(self.rhs)
        return ca.Function("dynamics", [self.x, self.u, self.t], [rhs], ["x", "u", "t"], ["dx"])

    @property
    def shown_units(self) -> dict[str, str]:
        """Units as they stand behind a number or a name: none for a pure number, whose unit in the file is "1"."""
        return {name: unit for name, unit in self.units.items() if unit != "1"}

    @property
    def box(self) -> Float[np.ndarray, "n 2"]:
        """The domain as lower and upper bounds by state, infinite where none is given."""
        return np.array([self.domain.get(state, UNBOUNDED) for state in self.states], dtype=float)

    @property
    def argument_box(self) -> Box:
        """The domain of phi's arguments v = H x: the box the bound is proved on."""
        return argument_box(self.lure.H, self.box)

    def controllability(self) -> Controllability:
        """Test (A, B): see `lockstep.model.control.pbh`."""
        return controllability(self.lure.A, self.lure.B)

    def observability(self) -> Observability:
        """Test (A, C): see `lockstep.model.control.pbh`."""
        return observability(self.lure.A, self.lure.C)

    def to_control(self, *, linear: bool = False) -> Any:
        """Return the agent for python-control, from its inputs to its states and outputs; `linear`: without phi."""
        from lockstep.model.control.bridge import agent_to_control

        return agent_to_control(self, linear=linear)

    def trim(self, **given: Any) -> Any:
        """Return an equilibrium f(x, u, t) = 0, as states and inputs.

        Args:
            given: `states`, `inputs`: numbers by name;  `start`: states (n,) that the search begins at;  `t`: in s.
        """
        from lockstep.model.control.operating_points import trim

        return trim(self, **given)

    def linearise(self, x: Sequence[float], u: Sequence[float], t: float = 0.0) -> Any:
        """Return the agent linearised at states x (n,), inputs u (m,) and a time t in s, as a `control.ss`."""
        from lockstep.model.control.operating_points import linearised_agent

        return linearised_agent(self, x, u, t)

    def value(self, expression: ca.SX, algebra: Exact | None = None, *, where: str) -> Value:
        """Return an expression in this agent's symbols as an exact value over the variables (x, u, t).

        Raises:
            ProblemError: a symbol from elsewhere, or what `read_value` refuses.
        """
        own = [*ca.vertsplit(self.x), *ca.vertsplit(self.u)]
        known = {symbol.element_hash() for symbol in (*own, self.t)}
        for symbol in ca.symvar(expression):
            found = f"the symbol `{symbol}` is neither a state, nor an input, nor the time"
            remedy = "substitute a number for it, or declare it"
            demand(symbol.element_hash() in known, found, where, remedy=remedy)
        try:
            return read_value(expression, ca.vertcat(*own), self.t, algebra or Exact(len(own), RULES))
        except ProblemError as error:
            raise error.within(where) from None

    def _take_names(self) -> None:
        for kind, symbols in (("states", self.x), ("inputs", self.u)):
            names = tuple(getattr(self, kind)) or tuple(str(symbol) for symbol in ca.vertsplit(symbols))
            object.__setattr__(self, kind, names)
        outputs = tuple(self.outputs) or tuple(f"y{k + 1}" for k in range(self.q))
        object.__setattr__(self, "outputs", outputs)
        check_agent_name(self.name)
        check_names(states=self.states, inputs=self.inputs, outputs=self.outputs)
        for kind, count in (("states", self.n), ("inputs", self.m), ("outputs", self.q)):
            found = f"{len(getattr(self, kind))} names for {count} {kind}"
            demand(len(getattr(self, kind)) == count, found, f"[agent] {kind}", "one name each")
