"""Agents that differ in B only: what else differs, in words."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Annotated, NoReturn

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import Node, linear, variable
from lockstep.check.expression.traversal import substitute
from lockstep.check.numbers import as_fraction
from lockstep.check.system.agent import ExactAgent
from lockstep.check.wording import shorten
from lockstep.model.formulas.exact_text import formula_text

_SAME_BUT_B = (
    "agents that differ in B only: (2) has one A, one C and one h for all, or agreement does not last"
)
_CHANGE_INPUTS = "change a parameter that multiplies inputs only"


def nonlinearity(agent: ExactAgent) -> list[Node]:
    """Return h(x, t) = G phi(H x, t) + offset(t) as n nodes over the states and, as variable n, the time."""
    values = {variable(agent.phi.inputs): variable(len(agent.states))}
    values |= {variable(j): linear(0, _terms(row)) for j, row in enumerate(agent.H)}
    nodes = substitute([*agent.phi.outputs, *agent.offset], values)
    w, drive = nodes[: agent.G.shape[1]], nodes[agent.G.shape[1] :]
    return [
        linear(0, [(1, c), *((as_fraction(g), x) for g, x in zip(row, w, strict=True))])
        for row, c in zip(agent.G, drive, strict=True)
    ]


def check_same_but_B(common: ExactAgent, variant: ExactAgent, *, where: str) -> None:
    """Refuse a variant of an agent that differs from it in A, in C, in h or in what h needs.

    Raises:
        ProblemError: names the first entry or equation that differs, with both values.
    """
    for letter in "AC":
        _check_equal(letter, getattr(common, letter), getattr(variant, letter), common.states, where)
    names = (*common.states, "t")
    for state, mine, theirs in zip(common.states, nonlinearity(common), nonlinearity(variant), strict=True):
        if mine is not theirs:
            h = [shorten(formula_text(node, names), 50) for node in (mine, theirs)]
            _refuse_variant(f"h differs in d/dt {state}: `{h[0]}` and `{h[1]}`", where)
    if common.H.tolist() != variant.H.tolist() or set(common.phi.conditions) != set(variant.phi.conditions):
        _refuse_variant("what h needs to have a value differs", where)


def _terms(row: Annotated[np.ndarray, " n"]) -> list[tuple[Fraction, Node]]:
    return [(as_fraction(value), variable(j)) for j, value in enumerate(row)]


def _check_equal(
    letter: str,
    a: Annotated[np.ndarray, "rows n"],
    b: Annotated[np.ndarray, "rows n"],
    states: Sequence[str],
    where: str,
) -> None:
    for i, j in np.argwhere(a != b)[:1].tolist():
        row = f"d/dt {states[i]}" if letter == "A" else f"output {i + 1}"
        mine, theirs = (float(as_fraction(one[i, j])) for one in (a, b))
        _refuse_variant(
            f"{letter} differs: {row} has {mine!r}*{states[j]}, and {theirs!r}*{states[j]} here", where
        )


def _refuse_variant(found: str, where: str) -> NoReturn:
    raise ProblemError(found, where=where, expected=_SAME_BUT_B, remedy=_CHANGE_INPUTS)
