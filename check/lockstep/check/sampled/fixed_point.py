"""What one agent computes at a sampling instant in integers of 32 bits, and the error bounds of that arithmetic.

One count of x_j, r_k and u_l is worth 2^-e of each. With integers a, d and shifts h, g of a row, |x| <= 2^28, |r| < 2^15,

    x = 2^14 hi + lo,  0 <= lo < 2^14,      s(v, b) = floor(v / 2^b + 1/2),
    v = s(sum_j a_j hi_j + s(sum_j a_j lo_j, 14), h) + s(sum_k d_k r_k, g),      x_i+ = x_i + v,   u_l = v.

The integers are the coefficients: nothing of them is rounded. Each s is off by at most 1/2, the inner one by 1/2^(h + 1) of
a count, h >= 1, so that a row is off by at most 5/4 counts: a bounded mu in the loop of `loop`, whatever the signals are.
r itself is exact in counts.

Nothing overflows: sum_j |a_j| <= 2^16 and sum_k |d_k| <= 2^15 keep the sums to 2^30 + 2^16 + 1, what is added before a
shift is at most 2^29, and x_i + v is below 2^28 + 2 (2^29 + 2^16). Where r, x or u meets the limits of its integers it is
held there and the step says so: what is proved is of runs in which none does, which `proves_range` shows from small
disagreements.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np
from flint import arb

from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import Matrix, exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.controller import ROW_ERROR, HeldController, Precision
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.inputs.input_limits import proves_reach
from lockstep.check.sampled.loop import SampledLoop

SPLIT, LARGEST_X, LARGEST_R = 14, 1 << 28, (1 << 15) - 1
MOST_A, MOST_D, SHIFTS, EXPONENTS = 1 << 16, 1 << 15, range(1, 31), range(-60, 61)
EXACT = Precision(0.0, 0.0)


@dataclass(frozen=True)
class FixedController:
    """The integers of one agent's step; rows are those of (x+, u).

    a: (n_C + m rows of n_C);  h: their shifts;  d: (n_C + m rows of q);  g: their shifts;  x, r, u: exponents e of their
    counts;  sides: (lowest, highest) counts of each u.
    """

    a: tuple[tuple[int, ...], ...]
    h: tuple[int, ...]
    d: tuple[tuple[int, ...], ...]
    g: tuple[int, ...]
    x: tuple[int, ...]
    r: tuple[int, ...]
    u: tuple[int, ...]
    sides: tuple[tuple[int, int], ...]

    def __post_init__(self) -> None:
        """Refuse integers that may overflow, and a value of u that none has."""
        fits = all(sum(map(abs, row)) <= MOST_A for row in self.a)
        fits = fits and all(sum(map(abs, row)) <= MOST_D for row in self.d)
        fits = fits and all(shift in SHIFTS for shift in (*self.h, *self.g))
        fits = fits and all(e in EXPONENTS for e in (*self.x, *self.r, *self.u))
        fits = fits and all(-LARGEST_R <= low < 0 < high <= LARGEST_R for low, high in self.sides)
        demand(fits, "integers that may overflow", "controller in fixed point", "as they are generated")

    @property
    def units(self) -> Annotated[np.ndarray, " rows"]:
        """What one count of each of (x+, u) is worth."""
        return np.array([math.ldexp(1.0, -e) for e in (*self.x, *self.u)])

    def held(self, sources: tuple[int, ...]) -> HeldController:
        """Return the controller whose exact step this is, up to a mu of at most 5/4 counts in each row."""
        n, rows = len(self.x), (*self.x, *self.u)
        table = np.zeros((len(rows), n + len(self.r)))
        for i, e in enumerate(rows):
            factors = [(a, SPLIT + self.h[i] + e - f) for a, f in zip(self.a[i], self.x, strict=True)]
            factors += [(d, self.g[i] + e - f) for d, f in zip(self.d[i], self.r, strict=True)]
            for j, (integer, power) in enumerate(factors):
                exact = Fraction(integer) / Fraction(2) ** power + (i == j < n)
                table[i, j] = float(exact)
                demand(Fraction(table[i, j]) == exact, "a coefficient that is no double", "integers", "one")
        nothing = np.zeros(table.shape, dtype=int)
        weights, before = np.ones(len(sources)), np.zeros(len(sources), dtype=int)
        return HeldController(n, table, sources, weights, nothing, before, EXACT, self.units)


def integers_of(
    table: Annotated[np.ndarray, "k l"],
    formats: tuple[Sequence[int], Sequence[int], Sequence[int]],
    limits: Annotated[np.ndarray, "m 2"],
    weights: Annotated[np.ndarray, " nn"],
) -> FixedController:
    """Return the step in integers whose coefficients are nearest to a table's.

    Args:
        table: (n_C + m, n_C + q), [A B; C D].
        formats: exponents of (x, r, u).
        limits: (m, 2), between which u is held.
        weights: of the neighbours.

    Raises:
        ProblemError: a gain that has no place beside the formats, or a weight that is not 1.
    """
    x, r, u = formats
    n, fits = len(x), len(x) + len(u) == len(table) and len(x) + len(r) == len(table.T)
    demand(fits, "another number of signals", "formats of integers", "one for each state, output and input")
    found, where = f"weights {weights.tolist()}", "controllers in integers"
    demand(bool((weights == 1).all()), found, where, "1 for each neighbour")
    rows = [
        _row(row[:n] - np.eye(n, len(table)).T[i] if i < n else row[:n], row[n:], e, x, r)
        for i, (row, e) in enumerate(zip(table, (*x, *u), strict=True))
    ]
    a, h, d, g = zip(*rows, strict=True)
    sides = tuple(
        (math.ceil(max(low * 2.0**e, -LARGEST_R)), math.floor(min(high * 2.0**e, LARGEST_R)))
        for (low, high), e in zip(limits.tolist(), u, strict=True)
    )
    return FixedController(a, h, d, g, tuple(x), tuple(r), tuple(u), sides)


def _row(
    A: Matrix, B: Matrix, e: int, x: Sequence[int], r: Sequence[int]
) -> tuple[tuple[int, ...], int, tuple[int, ...], int]:
    a, h = _nearest(A, [e - f + SPLIT for f in x], MOST_A)
    d, g = _nearest(B, [e - f for f in r], MOST_D)
    return a, h, d, g


def _nearest(gains: Matrix, powers: Sequence[int], most: int) -> tuple[tuple[int, ...], int]:
    """Return integers and the largest shift with gain = integer / 2^(shift + power), to the nearest."""
    for shift in reversed(SHIFTS):
        scaled = [math.ldexp(float(v), shift + p) for v, p in zip(gains, powers, strict=True)]
        if sum(abs(v) + 1 for v in scaled) <= most:
            return tuple(round(v) for v in scaled), shift
    raise ProblemError(
        "a gain too large for the formats", where="integers", expected="ranges that suit each other"
    )


def proves_range(
    loop: SampledLoop, fixed: tuple[FixedController, ...], witness: Witness, radius: float
) -> bool:
    """Decide in balls whether from |x_d(0)| <= radius, controllers at rest and undisturbed, no integer meets its limit.

    As in `input_limits`: V <= V_0 + kappa_mu |mu|^2 / (1 - decay) at every sampling instant, and |k x_cl + e| <= g sqrt(V) +
    |e|, g^2 = k P^-1 k', for the rows k of x_C, of r and of u; only those of u hold a mu.
    """
    return proves_reach(loop, witness, lambda: range_level(loop, fixed, witness), radius)


def range_level(loop: SampledLoop, fixed: tuple[FixedController, ...], witness: Witness) -> arb:
    """Return c: from V <= c on, no |x_j|, |r_k|, |u_l| meets its limit."""
    inverse, least = balls.inverse(exactly(witness.P)), arb("inf")
    for row, room in ranges_of(loop, fixed):
        if (row != 0).any():
            reach = balls.product(row[None], inverse, row[:, None])[0, 0].sqrt()
            if not reach > 0:
                return arb(-1)
            least = least.min((arb(room) / reach) ** 2)
    added = sum((arb(witness.kappa_mu) * arb(one.underflow) ** 2 for one in loop.controllers), arb(0))
    return least - added / (1 - arb(witness.decay))


def ranges_of(loop: SampledLoop, fixed: tuple[FixedController, ...]) -> Iterator[tuple[Matrix, float]]:
    """Yield each row of x_C, r and u on x_cl, and up to where it may go: u less its rounding, all exact in doubles."""
    for i, one in enumerate(fixed):
        n, m = len(one.x), len(one.u)
        rows = np.vstack([loop.seen[i], loop.computed[i * m : (i + 1) * m]])[:, : loop.n_x]
        sides = [min(-low, high) - ROW_ERROR for low, high in one.sides]
        counts = [*[LARGEST_X] * n, *[LARGEST_R] * len(one.r), *sides]
        for row, count, e in zip(rows, counts, (*one.x, *one.r, *one.u), strict=True):
            yield row, math.ldexp(count, -e)
