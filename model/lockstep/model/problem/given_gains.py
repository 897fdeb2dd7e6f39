"""The controllers of (9) that a problem file gives: `[[design.gains]]`, for method "given"."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.model.problem.tables.schema import GainsTable, Matrix


@dataclass(frozen=True, eq=False)
class GivenGains:
    """One agent's controller, x_C' = A x_C + B y_rel, u = C x_C + D y_rel, with y_rel the relative output."""

    A: Float[np.ndarray, "nc nc"]
    B: Float[np.ndarray, "nc q"]
    C: Float[np.ndarray, "m nc"]
    D: Float[np.ndarray, "m q"]


def given_gains(tables: Sequence[GainsTable], agents: int, m: int, q: int) -> tuple[GivenGains, ...]:
    """Check the shapes of the gains of `agents` controllers with q inputs and m outputs.

    Raises:
        ProblemError: not one table per agent, a shape that does not fit, or controllers of different orders.
    """
    found = f"{len(tables)} tables of gains for {agents} agents"
    demand(len(tables) == agents, found, "[[design.gains]]", "one per agent")
    gains = tuple(_gains(table, f"[[design.gains]] {k}", m, q) for k, table in enumerate(tables, start=1))
    orders = [g.A.shape[0] for g in gains]
    for k, order in enumerate(orders, start=1):
        found = f"`A` is {order} x {order}, but that of agent 1 is {orders[0]} x {orders[0]}"
        demand(order == orders[0], found, f"[[design.gains]] {k}", "controllers of one order")
    return gains


def _gains(table: GainsTable, where: str, m: int, q: int) -> GivenGains:
    order = len(table.A)
    a, needed = f"`A` is {order} x {order}", "a {} x {} matrix is needed"
    return GivenGains(
        _shaped("A", table.A, order, order, where, f"`A` has {order} rows: it must be square"),
        _shaped("B", table.B, order, q, where, f"{a} and there are {q} outputs: {needed.format(order, q)}"),
        _shaped("C", table.C, m, order, where, f"{a} and there are {m} inputs: {needed.format(m, order)}"),
        _shaped("D", table.D, m, q, where, f"there are {m} inputs and {q} outputs: {needed.format(m, q)}"),
    )


def _shaped(
    name: str, rows: Matrix, height: int, width: int, where: str, reason: str
) -> Float[np.ndarray, "a b"]:
    if height * width == 0 and not any(rows):
        return np.zeros((height, width))
    demand(rows, f"`{name}` is missing or empty", where, reason)
    lengths = sorted({len(row) for row in rows})
    found = f"`{name}` has rows of {lengths[0]} and of {lengths[-1]} numbers"
    demand(len(lengths) == 1, found, where, reason)
    found = f"`{name}` is {len(rows)} x {lengths[0]}"
    demand((len(rows), lengths[0]) == (height, width), found, where, reason)
    return np.array(rows, dtype=float)
