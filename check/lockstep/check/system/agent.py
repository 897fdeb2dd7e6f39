"""One agent, exactly: x' = A x + B u + G phi(H x, t) + offset(t), y = C x, over the rationals.

The right-hand side f(x, u, t) of (2) is split term by term: A x + B u is linear with constant coefficients, phi holds
every term that depends on a state in any other way, and offset(t) holds what depends on no state. Nothing is rounded
but elementary functions of constants (`expression.exact`): a number in a formula is the IEEE double nearest to it, and
what is computed with it is exact.

A linear part J v may be moved out of phi and into A, which changes no agent:
A x + G phi(H x, t) = (A + G J H) x + G (phi(H x, t) - J H x). Which J is a choice of whoever designs (`Move`).
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Annotated, NoReturn

import numpy as np
from flint import fmpq

from lockstep.check.bound.phi import ExactPhi
from lockstep.check.errors import ProblemError, demand
from lockstep.check.expression.condition import Condition, changed
from lockstep.check.expression.exact import Exact, Value
from lockstep.check.expression.node import Node, linear, linear_terms, variable
from lockstep.check.expression.text import RESERVED, parse
from lockstep.check.expression.traversal import order
from lockstep.check.json_text import number
from lockstep.check.system.nonlinearity import Arguments, Row, Terms, arguments, columns, forms_seen
from lockstep.check.wording import shorten

Show = Callable[[Node, Sequence[str]], str]
_NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,59}")


@dataclass(frozen=True)
class Move:
    """J_kj, to be taken from phi and given to A: `component` k and `argument` j count from 0."""

    component: int
    argument: int
    amount: Fraction


@dataclass(frozen=True, eq=False)
class ExactAgent:
    """One agent over the rationals: object arrays of `flint.fmpq`, and phi as exact expressions."""

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: Annotated[np.ndarray, "n n"]
    B: Annotated[np.ndarray, "n m"]
    C: Annotated[np.ndarray, "q n"]
    G: Annotated[np.ndarray, "n r"]
    H: Annotated[np.ndarray, "v n"]
    phi: ExactPhi
    """(v, t) -> w: v numbers and the time in, r numbers out, and what must hold for them to have a value."""
    offset: tuple[Node, ...]
    """n expressions in the time, which is the variable `phi.inputs` as in phi; common to all agents."""
    offset_needs: ExactPhi
    """phi(v, t) = v with what offset(t) needs to have a value."""

    def __post_init__(self) -> None:
        for letter in "ABCGH":
            getattr(self, letter).flags.writeable = False

    @classmethod
    def from_texts(
        cls,
        name: str,
        *,
        states: Sequence[str],
        inputs: Sequence[str],
        dynamics: Mapping[str, str],
        outputs: Mapping[str, str],
        parameters: Mapping[str, float] | None = None,
        show: Show | None = None,
    ) -> "ExactAgent":
        """Read the formulas of a problem file; `dynamics` and `outputs` give one by name, `show` writes terms for messages.

        Raises:
            ProblemError: a name or formula that is none, an input that enters other than linearly with a constant
                coefficient, an output that is not linear in the states, a nonlinearity that cancels.

        >>> cart = ExactAgent.from_texts("cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p"},
        ...                              dynamics={"p": "v", "v": "f - tanh(v)/3"})
        >>> cart.H.tolist(), cart.G.tolist()
        ([[0, 1]], [[0], [1]])
        """
        parameters = dict(parameters or {})
        _check_names(name, states, inputs, tuple(outputs), tuple(parameters))
        if set(dynamics) != set(states):
            odd = sorted(set(dynamics) ^ set(states))[0]
            raise ProblemError(
                f"`{shorten(odd)}`", where="[agent.dynamics]", expected="one equation per state"
            )
        symbols = (*states, *inputs, "t")
        known: dict[str, Value | float] = {key: Value(variable(k)) for k, key in enumerate(symbols)}
        known |= {key: number(value, f"[agent.parameters] {key}") for key, value in parameters.items()}
        algebra = Exact(len(symbols) - 1)
        rhs = [parse(dynamics[key], known, algebra, where=f"[agent.dynamics] {key}") for key in states]
        y = [parse(outputs[key], known, algebra, where=f"[agent.outputs] {key}") for key in outputs]
        return cls.from_values(name, states, inputs, tuple(outputs), rhs, y, algebra.seen, show)

    @classmethod
    def from_values(
        cls,
        name: str,
        states: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        rhs: Sequence[Value],
        y: Sequence[Value],
        places: Mapping[Node, int],
        show: Show | None = None,
    ) -> "ExactAgent":
        """Split right-hand sides and outputs, as nodes over the variables (x, u, t).

        Args:
            name: a C identifier.
            states: n names.
            inputs: m names.
            outputs: q names.
            rhs: n values, variables 0 to n - 1 being the states, n to n + m - 1 the inputs, n + m the time.
            y: q values.
            places: the order in which nonlinear terms are taken: a node in it comes before one of a larger number.
            show: writes a term in the names of its variables, for messages.
        """
        names = _Names(tuple(states), tuple(inputs), show)
        rows = [_split(names, state, value, places) for state, value in zip(states, rhs, strict=True)]
        chosen = columns([row.of_states for row in rows])
        components = [linear(0, [(c, node) for node, c in part.items()]) for _, part in chosen]
        needs = list(dict.fromkeys(c for value in rhs for c in _needs_of(value, names.n, components)))
        seen = forms_seen([*components, *(node for c in needs for node in c.nodes)], names.n)
        if seen and not components:
            _refuse_cancelled(next(c for c in needs if c.args))
        found = arguments(seen)
        # What jumps in time is an input like any other; what has no value is none.
        apart = [c for value in rhs for c in value.conditions if c not in needs and not c.jumps]
        return cls(
            name=name,
            states=names.states,
            inputs=names.inputs,
            outputs=tuple(outputs),
            A=_matrix([row.states for row in rows], names.n),
            B=_matrix([row.inputs for row in rows], len(inputs)),
            C=_matrix(
                [_output_row(names, key, value) for key, value in zip(outputs, y, strict=True)], names.n
            ),
            G=_matrix([column for column, _ in chosen], names.n).T,
            H=_matrix(found.rows, names.n),
            phi=_phi(found, components, needs, names),
            offset=tuple(found.restated([row.drive for row in rows], names.n, names.time)),
            offset_needs=replace(_phi(Arguments(((),), {}), [], apart, names), outputs=(variable(0),)),
        )

    def moved(self, moves: Sequence[Move]) -> "ExactAgent":
        """Return the same agent with J taken from phi and given to A: A + G J H and phi - J v.

        Raises:
            ProblemError: a component or an argument that phi does not have.
        """
        r, v = self.G.shape[1], self.H.shape[0]
        taken: list[list[tuple[Fraction, Node]]] = [[] for _ in range(r)]
        A = self.A.copy()
        for move in moves:
            k, j = move.component, move.argument
            found = f"a slope is moved from component {k + 1} and argument {j + 1} of phi"
            wanted = f"components 1 to {r} and arguments 1 to {v}"
            demand(0 <= k < r and 0 <= j < v, found, f"the agent `{self.name}`", wanted)
            amount = fmpq(move.amount.numerator, move.amount.denominator)
            A = A + amount * np.outer(self.G[:, k], self.H[j])
            taken[k].append((-move.amount, variable(j)))
        outputs = tuple(linear(0, [(1, w), *parts]) for w, parts in zip(self.phi.outputs, taken, strict=True))
        return replace(self, A=A, phi=replace(self.phi, outputs=outputs))


def _check_names(name: str, *kinds: Sequence[str]) -> None:
    """Refuse names that no expression could mention, or that mean two things; outputs may have the name of a state."""
    states, inputs, outputs, parameters = kinds
    meant = [*states, *inputs, *parameters]
    odd = [one for one in {name, *meant, *outputs} if not isinstance(one, str) or not _NAME.fullmatch(one)]
    odd += [one for one in (*meant, *outputs) if one in RESERVED or meant.count(one) > 1]
    if odd or not (states and inputs and outputs):
        raise ProblemError(
            f"`{shorten(str(odd[0]))}`" if odd else "no states, no inputs or no outputs",
            where="the names of [agent]",
            expected="at least one of each, all different: a letter, then at most 59 letters, digits and _; no function",
        )


@dataclass(frozen=True)
class _Names:
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    show: Show | None

    @property
    def n(self) -> int:
        return len(self.states)

    @property
    def time(self) -> int:
        return len(self.states) + len(self.inputs)

    def text(self, node: Node) -> str:
        """Return a term for a message, if there is something to write it with."""
        return f"`{shorten(self.show(node, (*self.states, *self.inputs, 't')))}`" if self.show else "a term"

    def inputs_of(self, node: Node) -> list[str]:
        return [self.inputs[j - self.n] for j in sorted(node.variables) if self.n <= j < self.time]


@dataclass(frozen=True)
class _Split:
    """One right-hand side: its rows of A and B, the terms that depend on states otherwise, and the rest."""

    states: Row
    inputs: Row
    of_states: Terms
    drive: Node


def _split(names: _Names, state: str, value: Value, places: Mapping[Node, int]) -> _Split:
    offset, terms = linear_terms(value.node)
    terms = tuple(sorted(terms, key=lambda term: places.get(term[1], len(places))))
    own = [(x.data, c) for c, x in terms if x.op == "variable"]
    others = [(c, x) for c, x in terms if x.op != "variable" or x.data == names.time]
    for c, x in others:
        _check_no_input(names, state, x, names.text(linear(0, [(c, x)])))
    for condition in value.conditions:
        for node in condition.nodes:
            _check_no_input(names, state, node, names.text(node))
    return _Split(
        states=tuple(sorted((j, c) for j, c in own if j < names.n)),
        inputs=tuple(sorted((j - names.n, c) for j, c in own if names.n <= j < names.time)),
        of_states={x: c for c, x in others if not x.variables <= {names.time}},
        drive=linear(offset, [(c, x) for c, x in others if x.variables <= {names.time}]),
    )


def _check_no_input(names: _Names, state: str, node: Node, text: str) -> None:
    """(2) has B_i u_i with a constant B_i."""
    for name in names.inputs_of(node):
        raise ProblemError(
            f"the input `{name}` enters through {text}",
            where=f"[agent.dynamics] {state}",
            expected="inputs that enter linearly, with constant coefficients: x' = ... + B u",
            remedy="make the nonlinear actuator a state of the agent, or its output the input",
        )


def _needs_of(value: Value, n: int, components: Sequence[Node]) -> list[Condition]:
    """Return the conditions of phi: all that depend on states, others where their arguments are part of phi."""
    inside, states, all_of = set(order(components)), frozenset(range(n)), value.conditions
    return [
        c for c in all_of if any(one.variables & states for one in c.nodes) or inside.intersection(c.args)
    ]


def _refuse_cancelled(condition: Condition) -> NoReturn:
    raise ProblemError(
        f"all nonlinear terms cancel, or have the factor 0, and {condition.name} among them may have no value",
        where="[agent.dynamics]",
        expected="a nonlinear term that remains, or none",
        remedy="leave them out",
    )


def _phi(found: Arguments, components: Sequence[Node], needs: Sequence[Condition], names: _Names) -> ExactPhi:
    restate = partial(found.restated, states=names.n, time=names.time)
    conditions = dict.fromkeys(changed(needs, restate))
    return ExactPhi(tuple(restate(components)), tuple(conditions), len(found.rows))


def _output_row(names: _Names, output: str, value: Value) -> Row:
    """Return a row of C: linear in the states, and nothing else."""
    where, kind = f"[agent.outputs] {output}", "a sum of states with constant coefficients, y = C x"
    offset, terms = linear_terms(value.node)
    others = [(c, x) for c, x in terms if x.op != "variable" or x.data == names.time]
    if others or value.conditions:
        text = names.text(linear(0, others[:1]) if others else value.conditions[0].args[0])
        remedy = "make what is measured a state, or measure the states it is made of"
        raise ProblemError(f"{text} is not linear in the states", where=where, expected=kind, remedy=remedy)
    if offset:
        remedy = "leave it out: relative outputs do not see it"
        found = f"the output has the constant {float(offset):.6g}"
        raise ProblemError(found, where=where, expected=kind, remedy=remedy)
    demand(terms, "the output depends on no state", where, kind)
    for name in names.inputs_of(value.node):
        remedy = "leave the feedthrough out: the controller knows its own input"
        raise ProblemError(f"the input `{name}` is in an output", where=where, expected=kind, remedy=remedy)
    return tuple(sorted((x.data, c) for c, x in terms))


def _matrix(rows: Sequence[Row], width: int) -> Annotated[np.ndarray, "rows width"]:
    matrix = np.full((len(rows), width), fmpq(0), dtype=object)
    for i, row in enumerate(rows):
        for j, value in row:
            matrix[i, j] = fmpq(value.numerator, value.denominator)
    return matrix
