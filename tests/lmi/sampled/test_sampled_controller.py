"""The deltas against rounding as it happens: float32 steps beside exact integer arithmetic."""

from dataclasses import replace

import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.sampled.controller import PRECISIONS
from lockstep.lmi.sampled import HeldController

# Agent 1 of the arms at 5 ms, as it is emitted.
ARM_1 = np.array(
    [
        [1.028525, 0.10655736, 0.0030724104, -0.0019302635],
        [-0.07595759, 0.9582525, -0.02258027, -0.0018070596],
        [-44.02964, 13.34535, -15.761054, -2.2555997],
    ],
    dtype=np.float32,
)


def rounded_rows(table: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Each row from left to right in float32, for many z at once."""
    total = table[:, 0, None] * z[0]
    for k in range(1, len(z)):
        total = total + table[:, k, None] * z[k]
    assert total.dtype == np.float32
    return total


def exact_rows(table: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, float]:
    """The same as integers, exact, times a power of two."""
    unit = 2.0**-70
    integers = lambda M: np.vectorize(lambda v: int(v / unit), otypes=[object])(M.astype(float))  # noqa: E731
    return integers(table) @ integers(z), unit * unit


def rounding(table: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Random (x, r), and the rounding of a float32 step from each."""
    rng = np.random.default_rng(0)
    # Multiples of 2^-40 below 8: exact as integers, with 24 bits each.
    z = (rng.standard_normal((4, steps)) * 2.0 ** rng.integers(-6, 2, (4, steps))).astype(np.float32)
    z[np.abs(z) < 2.0**-15] = 0
    done = rounded_rows(table, z)
    exact, unit = exact_rows(table, z)
    integers = np.vectorize(lambda v: int(v / 2.0**-70) << 70, otypes=[object])(done.astype(float))
    return z, (integers - exact).astype(float) * unit


def worst_ratios(steps: int) -> dict[str, float]:
    """The largest |rounding| seen, as an error of [A B] and [C D], over what the deltas allow."""
    controller = HeldController.row_by_row(ARM_1.astype(float), 2, (1,), np.ones(1))
    z, error = rounding(ARM_1, steps)
    x, d = (np.linalg.norm(part.astype(float), axis=0) for part in (z[:2], z[2:]))
    deltas = controller.deltas
    allowed = {"state": deltas["A"] * x + deltas["B"] * d, "input": deltas["C"] * x + deltas["D"] * d}
    seen = {"state": np.linalg.norm(error[:2], axis=0), "input": np.abs(error[2])}
    kept = (x > 0) & (d > 0)
    return {name: float((seen[name] / allowed[name])[kept].max()) for name in allowed}


def test_rounding_stays_within_the_deltas_and_comes_near_them():
    for ratio in worst_ratios(5_000).values():
        assert 0.1 <= ratio <= 1


@pytest.mark.slow
def test_a_million_steps_stay_within_the_deltas_and_come_within_ten_times():
    for ratio in worst_ratios(1_000_000).values():
        assert 0.1 <= ratio <= 1


def test_rounding_in_other_units_stays_within_bounds_in_these_units_and_comes_near_them():
    """An output in units 2^-16 times as large, and an x_2 of the controller in such: each row's error in its own units."""
    rows, columns = np.array([1.0, 2.0**16, 1.0]), np.array([1.0, 2.0**-16, 1.0, 2.0**-16])
    table = (ARM_1 * np.outer(rows, columns)).astype(np.float32)
    controller = HeldController.row_by_row(table.astype(float), 2, (1,), np.ones(1))
    # The same numbers in other units: rounding is the same, times powers of two.
    z, error = rounding(ARM_1, 5_000)
    z, error = z.astype(float) / columns[:, None], error * rows[:, None]
    allowed = np.zeros_like(error)
    for letter, part in {"A": z[:2], "B": z[2:], "C": z[:2], "D": z[2:]}.items():
        bound = controller.errors[letter]
        into = slice(0, 2) if letter in "AB" else slice(2, 3)
        length = bound.delta * np.linalg.norm(bound.columns[:, None] * part, axis=0)
        allowed[into] += bound.rows[:, None] * length
    # By the norms of the blocks alone, the error of the small row of the controller is allowed 2^16 times as much.
    plain = controller.deltas["A"] * np.linalg.norm(z[:2], axis=0) + controller.deltas["B"] * np.linalg.norm(
        z[2:], axis=0
    )
    assert (plain > 100 * allowed[0]).all()
    ratio = (np.abs(error) / np.where(allowed > 0, allowed, 1.0)).max()
    assert 0.05 <= ratio <= 1


def test_deltas_are_higham_s_for_one_row():
    """One row of two: both coefficients pass a product and a sum, and the difference was rounded before."""
    u = PRECISIONS["float32"].u
    one = HeldController.row_by_row(np.array([[0.0, 0.0], [3.0, -4.0]]), 1, (1,), np.ones(1))
    assert one.deltas["C"] == pytest.approx(3 * 2 * u / (1 - 2 * u), rel=1e-12)
    assert one.deltas["D"] == pytest.approx(4 * 3 * u / (1 - 3 * u), rel=1e-12)


def test_more_roundings_and_less_precision_cost_more():
    one = HeldController.row_by_row(ARM_1.astype(float), 2, (1,), np.ones(1))
    deeper = replace(one, roundings=one.roundings + 1)
    double = replace(one, precision=PRECISIONS["float64"])
    for letter in "ABCD":
        assert deeper.deltas[letter] > one.deltas[letter] > 1e8 * double.deltas[letter]


def test_each_source_is_rounded_by_itself():
    two = HeldController.row_by_row(ARM_1.astype(float), 2, (1, 2), np.array([1.0, 0.5]))
    assert two.before.tolist() == [2, 3], "difference and sum; difference, weight and sum"
    one = HeldController.row_by_row(ARM_1.astype(float), 2, (1,), np.ones(1))
    assert two.deltas["D"] > np.sqrt(2) * one.deltas["D"]
    assert two.deltas["C"] == one.deltas["C"]


def test_bad_controllers_are_refused():
    good = HeldController.row_by_row(ARM_1.astype(float), 2, (1,), np.ones(1))
    with pytest.raises(ProblemError):
        replace(good, table=np.full((3, 4), np.nan))
    with pytest.raises(ProblemError):
        replace(good, sources=(1, 2))
