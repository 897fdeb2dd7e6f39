"""The weights R and Q of the paper as matrices, W of the inputs, and the scales of disturbances."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.problem.tables.schema import DisturbanceTable

Weight = float | tuple[float, ...] | tuple[tuple[float, ...], ...]


def weight_matrix(weight: Weight, size: int, *, where: str, per: str) -> Float[np.ndarray, "size size"]:
    """Return a weight as a symmetric positive definite matrix.

    Args:
        weight: w for w I, a list for a diagonal matrix, or a matrix by rows.
        size: the number of rows.
        where: the place in the file, for messages.
        per: what there is one number of, such as "state".

    Raises:
        ProblemError: a wrong shape, an entry that is not finite, not symmetric, or not positive definite.

    >>> weight_matrix((1.0, 4.0), 2, where="[design.weights] state", per="state")
    array([[1., 0.],
           [0., 4.]])
    """
    square = f"{size} x {size}"
    expected = f"a number above 0, {size} of them (one per {per}), or a symmetric {square} matrix"
    if isinstance(weight, tuple) and len({len(row) if isinstance(row, tuple) else 0 for row in weight}) > 1:
        raise ProblemError("rows of different lengths", where=where, expected=expected)
    given = np.asarray(weight, dtype=float)
    matrix = given if given.ndim == 2 else np.diag(given if given.ndim else np.full(size, given))
    written = " x ".join(map(str, given.shape))
    shape = f"a {written} matrix" if given.ndim == 2 else f"{written} numbers"
    demand(matrix.shape == (size, size), f"{shape} for {size} {per}s", where, expected)
    demand(np.isfinite(matrix).all(), "an entry is not a finite number", where, expected)
    for i, j in np.argwhere(matrix != matrix.T)[:1]:
        found = f"row {i + 1}, column {j + 1} is {matrix[i, j]}, but row {j + 1}, column {i + 1} is {matrix[j, i]}"
        raise ProblemError(found, where=where, expected="a symmetric matrix")
    least = float(np.linalg.eigvalsh(matrix)[0]) if size else 1.0
    demand(least > 0, f"its smallest eigenvalue is {least:.6g}", where, "a positive definite weight")
    return np.array(matrix)


def input_weight(weight: Weight, m: int) -> Float[np.ndarray, "m m"]:
    """Return W of the m inputs, 0 x 0 where it weighs nothing.

    Raises:
        ProblemError: a wrong shape, a negative number, or a matrix that is not positive definite.

    >>> input_weight(0.0, 1).shape, input_weight((0.5, 0.0), 2).tolist()
    ((0, 0), [[0.5, 0.0], [0.0, 0.0]])
    """
    where = "[design.weights] input"
    if isinstance(weight, tuple) and any(isinstance(row, tuple) for row in weight):
        return weight_matrix(weight, m, where=where, per="input")
    given = np.asarray(weight, dtype=float)
    demand(given.shape in ((), (m,)), f"{given.size} numbers for {m} inputs", where, "one per input")
    if not np.isfinite(given).all() or (given < 0).any():
        raise ProblemError(f"{float(given.min()):g}", where=where, expected="finite numbers, 0 or more")
    return np.diag(np.broadcast_to(given, m)).copy() if given.any() else np.zeros((0, 0))


def scale_of_each(
    scales: float | Mapping[str, float] | None,
    names: Sequence[str],
    *,
    where: str,
    per: str,
    rest: float = 0.0,
) -> Float[np.ndarray, " k"]:
    """Return a scale for each name, another one for those not named; nothing where there are none at all.

    Raises:
        ProblemError: a name that is not one of these.

    >>> scale_of_each({"v": 2.0}, ["p", "v"], where="here", per="state").tolist()
    [0.0, 2.0]
    """
    if scales is None:
        return np.zeros(0)
    if not isinstance(scales, Mapping):
        return np.full(len(names), float(scales))
    for name in scales:
        if name not in names:
            known = ", ".join(f"`{one}`" for one in names)
            raise ProblemError(f"`{name}` is no {per}", where=where, expected=f"one of {known}")
    return np.array([float(scales.get(name, rest)) for name in names])


def amplitudes(
    table: DisturbanceTable, N: int, states: Sequence[str], period: float
) -> Float[np.ndarray, "N n"]:
    """Return the amplitude of [simulation.disturbance] on each state of each of N agents, 0 on what is not named.

    Of noise of a given intensity S it is the standard deviation (S / period)^1/2, being held for a period, in s.

    Raises:
        ProblemError: a name that is no state, or an agent that there is not.

    >>> amplitudes(DisturbanceTable(amplitude={"v": -2.0}, agents=[2]), 2, ["p", "v"], 0.1).tolist()
    [[0.0, 0.0], [0.0, -2.0]]
    """
    where = "[simulation.disturbance]"
    each = scale_of_each(table.amplitude, states, where=f"{where} amplitude", per="state")
    if table.kind == "noise" and table.intensity is not None:
        named = np.array([not isinstance(table.amplitude, dict) or one in table.amplitude for one in states])
        each = np.where(named, np.sqrt(table.intensity / period), 0.0)
    agents = range(1, N + 1) if table.agents is None else table.agents
    for one in agents:
        demand(1 <= one <= N, f"agent {one}", f"{where} agents", f"numbers from 1 to {N}")
    sizes = np.zeros((N, len(states)))
    sizes[[one - 1 for one in agents]] = each
    return sizes
