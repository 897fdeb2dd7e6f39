"""What an agent is built from, checked part by part: columns, symbols, names, equations, the domain."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import shorten


def stack(parts: Sequence[ca.SX]) -> ca.SX:
    """Return a column of scalars; none at all give an empty one."""
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def column_of(value: ca.SX, what: str) -> ca.SX:
    """Return a dense column with at least one row, or refuse what is none."""
    try:
        column = ca.densify(ca.SX(value))
    except (NotImplementedError, TypeError):
        found = f"the {what}s are a {type(value).__name__}"
        raise ProblemError(found, expected="a casadi.SX column") from None
    found = f"the {what}s have shape {column.shape[0]} x {column.shape[1]}"
    expected = f"a column with at least one {what}"
    demand(column.shape[1] == 1 and column.shape[0] != 0, found, "", expected=expected)
    return column


def check_symbols(letter: str, column: ca.SX) -> None:
    """Refuse a column that holds anything but symbols."""
    for symbol in ca.vertsplit(column):
        found = f"`{letter}` contains `{shorten(str(symbol))}`"
        demand(symbol.is_symbolic(), found, "", expected="symbols only (casadi.SX.sym)")


def check_bounds(state: str, bounds: tuple[float, float]) -> None:
    """Refuse a side of the domain without a lower bound below an upper one."""
    low, high = bounds if len(bounds) == 2 else (np.nan, np.nan)
    found = f"`{state}` is from {low} to {high}"
    expected = "a lower bound below the upper bound"
    demand(low < high and low != np.inf and high != -np.inf, found, f"[agent.domain] {state}", expected)
