"""What one agent computes at a sampling instant, and the error bounds of its floating-point arithmetic.

    (x+, u) = K (x, r),  K = [A B; C D],  r = sum_j d_j,  d_j = a_j (y - y_j),

coefficients exact as they stand in the code. A coefficient behind k roundings acts as one that is off by at most
gamma_k = k u / (1 - k u) of itself (Higham 2002, lemma 3.1), so the rounded step is the exact step of a controller
(9) with

    |Delta A| <= |gamma o |A||,  and likewise C;     |Delta B| <= |[gamma_j o |B|]_j|,  and likewise D,

Delta B and Delta D acting on the stacked differences d_j, since each of these is rounded by itself. A norm adds what has
different units: m and Pa. So the loop counts Delta = D_r Delta' D_c, with powers of two D_r of the rows and D_c of the
columns that make the entries of D_r^-1 K D_c^-1 alike, and |Delta'| <= delta. What underflow adds is not relative to
anything: it is bounded apart, as is the error of the messages y themselves.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from flint import fmpq

from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, Vector, as_float, converter, exact, exactly, is_exact, zeros
from lockstep.check.sampled.sector import Sector
from lockstep.check.system.disagreement import Disagreement
from lockstep.check.system.loop import Plant


class Precision(NamedTuple):
    """A binary format: its unit roundoff u, and half its smallest subnormal, which an underflow may cost."""

    u: float
    underflow: float


PRECISIONS = {
    "float32": Precision(2.0**-24, 2.0**-150),
    # Half of float64's smallest subnormal is no double: the subnormal itself bounds it.
    "float64": Precision(2.0**-53, 2.0**-1074),
}


class ErrorBound(NamedTuple):
    """Of the errors of one block of K: Delta = diag(rows) Delta' diag(columns), |Delta'| <= delta.

    rows, columns: powers of two up to 1;  columns of B and D are those of each d_j.
    """

    rows: Annotated[np.ndarray, " k"]
    columns: Annotated[np.ndarray, " l"]
    delta: float


ALIKE = 8
"""Bits of which scales of rows and columns are multiples: what is within a factor of 2^8 stays as it is."""

SMALL = fmpq(1, 2**900)
"""A square below has a root that doubles do not take of it."""

ROW_ERROR = 1.25
"""Counts by which a row of `fixed_point` is off at most: exact in doubles, with room for the product."""


@dataclass(frozen=True, eq=False)
class HeldController:
    """One agent's sampled controller as it is computed.

    order: n_C;  table: (n_C + m, n_C + q), K as it stands in the code;  sources: the agents it listens to, from 0;
    weights: (nn,) their a_j;  roundings: (n_C + m, n_C + q), how many roundings each product of K passes through;
    before: (nn,) how many each d_j has passed through already;  precision: of the arithmetic;  counts: (n_C + m,) or none:
    what a count of each of (x+, u) is worth in integers (`fixed_point`), mu being then in counts.
    """

    order: int
    table: Annotated[np.ndarray, "k l"]
    sources: tuple[int, ...]
    weights: Annotated[np.ndarray, " nn"]
    roundings: Annotated[np.ndarray, "k l"]
    before: Annotated[np.ndarray, " nn"]
    precision: Precision
    counts: Annotated[np.ndarray, " k"] | None = None

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        fits = self.roundings.shape == self.table.shape and np.isfinite(self.table).all()
        demand(fits, "its table holds no finite numbers, or another shape", "controller")
        found = f"{len(self.sources)} sources, {len(self.weights)} weights"
        demand(len(self.sources) == len(self.weights) == len(self.before), found, "controller", "as many")
        deepest = int(self.roundings.max(initial=0)) + int(self.before.max(initial=0))
        few = deepest * self.precision.u < 0.5
        demand(few, f"{deepest} roundings on one path", "controller", "fewer")

    @classmethod
    def row_by_row(
        cls,
        table: Annotated[np.ndarray, "k l"],
        order: int,
        sources: tuple[int, ...],
        weights: Annotated[np.ndarray, " nn"],
        precision: Precision = PRECISIONS["float32"],
    ) -> "HeldController":
        """Return the controller whose rows and sums run from left to right, counted without looking for savings.

        >>> HeldController.row_by_row(np.ones((1, 3)), 1, (1,), np.ones(1)).roundings.tolist()
        [[3, 3, 2]]
        """
        rows, columns = table.shape
        # The product itself, and the additions that follow: columns - 1 after the first two, then one fewer each.
        path = 1 + np.minimum(columns - 1, columns - np.arange(columns))
        nn = len(sources)
        additions = np.minimum(max(nn - 1, 0), nn - np.arange(nn))
        before = 1 + (np.asarray(weights) != 1).astype(int) + additions
        return cls(order, table, sources, weights, np.tile(path, (rows, 1)), before.astype(int), precision)

    @property
    def outputs(self) -> int:
        """The number q of measured outputs."""
        return int(self.table.shape[1]) - self.order

    @property
    def inputs(self) -> int:
        """The number m of inputs of the plant."""
        return int(self.table.shape[0]) - self.order

    @cached_property
    def deltas(self) -> dict[str, float]:
        """The bounds on |Delta A|, |Delta B|, |Delta C|, |Delta D| that cover every rounding of a step.

        B and D act on the stacked differences, so their Delta has as many blocks as there are sources.
        """
        return {letter: spectral_bound(self._gamma_times(letter, self._block(letter))) for letter in LETTERS}

    @cached_property
    def errors(self) -> dict[str, ErrorBound]:
        """The same, as the loop counts them: in units of the rows and columns of K."""
        found = {}
        for letter in LETTERS:
            rows, columns = _scales(self._block(letter))
            block = exactly(self._block(letter)) / exactly(rows)[:, None] / exactly(columns)
            found[letter] = ErrorBound(rows, columns, spectral_bound(self._gamma_times(letter, block)))
        return found

    def _block(self, letter: str, of: str = "table") -> Annotated[np.ndarray, "k l"]:
        first, second = slice(0, self.order), slice(self.order, None)
        rows, columns = first if letter in "AB" else second, first if letter in "AC" else second
        return np.asarray(getattr(self, of)[rows, columns])

    def _gamma_times(self, letter: str, block: Annotated[np.ndarray, "k l"]) -> Annotated[np.ndarray, "k l"]:
        """Return gamma o |block|, as rationals; of B and D once per source."""
        sizes, roundings = abs(exactly(block)), self._block(letter, "roundings")
        before = [0] if letter in "AC" else self.before
        parts = [sizes * gamma(roundings + k, self.precision.u) for k in before]
        return np.hstack([sizes[:, :0], *parts])

    def message_noise(self, message_error: float) -> float:
        """Return a bound on the length of all errors of d_j = a_j (y - y_j), every y being off by at most so much.

        Underflow of a product a_j (y - y_j) is in it; y - y_j itself never underflows inexactly.
        """
        lost = [2 * self.precision.underflow if weight != 1 else 0.0 for weight in self.weights]
        entries = [2 * float(a) * message_error + e for a, e in zip(self.weights, lost, strict=True)]
        length: float = math.sqrt(self.outputs) * math.hypot(*entries, 0.0)
        return length

    @property
    def underflow(self) -> float:
        """A bound on the length of what underflow of the products adds to (x+, u); in integers, of their rounding in counts.

        At most n_C + q products per row; the factor of 2 covers the roundings that follow, each less than 1 + u.
        """
        rows, columns = self.table.shape
        if self.counts is not None:
            return ROW_ERROR * math.nextafter(math.sqrt(rows), math.inf)
        return float(2 * columns * math.sqrt(rows) * self.precision.underflow)


@dataclass(frozen=True, eq=False)
class SampledNetwork:
    """What the controllers are in a loop with: the agents' matrices, the coordinates, alpha, period and delay.

    plant, d: in rationals, as `lockstep.model.network.Network.loop(order, exact_arithmetic=True)` has them;  alpha:
    the incremental bound of phi;  period: T_s in s;  delay: periods between sampling y and applying u, 0 or 1;  sector: what
    takes the place of alpha where single slopes have bounds of their own.
    """

    plant: Plant
    d: Disagreement
    alpha: float
    period: float
    delay: int = 0
    sector: Sector | None = None

    @property
    def squares(self) -> tuple[Matrix, Matrix]:
        """G Pi_w^-1 G' and H'Pi_z H of one agent, in its kind of number; without a sector I and alpha^2 I.

        Both are 0 where alpha is: phi is then the same for all agents, and no part of the disagreement.
        """
        A, G, H = self.plant.A, self.plant.G, self.plant.H
        number = converter(is_exact(A))
        if self.sector is not None:
            return (G / number(self.sector.Pi_w)) @ G.T, (H.T * number(self.sector.Pi_z)) @ H
        if self.alpha == 0:
            return zeros(len(A), len(A), A), zeros(len(A), len(A), A)
        alpha = number(np.array([self.alpha]))[0]
        return G @ G.T, alpha * alpha * (H.T @ H)


def gamma(k: Annotated[np.ndarray, "..."], u: float) -> Annotated[np.ndarray, "..."]:
    """Return k u / (1 - k u), as rationals.

    >>> gamma(np.array([2]), 0.125).tolist()
    [1/3]
    """
    ku = exactly(k) * exact(u)
    return np.asarray(ku / (1 - ku))


def spectral_bound(matrix: Annotated[np.ndarray, "k l"]) -> float:
    """Return a double that is no less than |M| for a matrix of rationals >= 0: the root of |M|_1 |M|_inf, or |M|_F.

    |Delta| <= |M| entry by entry implies that |Delta|_2 <= |M|_2, which is below both.
    """
    if not matrix.size:
        return 0.0
    # The root of |M|_1 |M|_inf, or the Frobenius norm.
    square = min(max(matrix.sum(axis=0)) * max(matrix.sum(axis=1)), (matrix * matrix).sum())
    if square == 0:
        return 0.0
    # By a power of two, where the square itself is no double; then up until the square of the root is no less.
    shift = 1000 if square < SMALL else -500 if square > 1 / SMALL else 0
    root = math.ldexp(math.sqrt(as_float(square * fmpq(4) ** shift)), -shift)
    while exact(root) ** 2 < square:
        root = math.nextafter(root, math.inf)
    return root


def _scales(block: Matrix) -> tuple[Vector, Vector]:
    """Return scales of the rows of a block, and of the columns of what is left.

    >>> rows, columns = _scales(np.array([[3.0, 1e-4], [1e-6, 0.0]]))
    >>> np.log2(rows).tolist(), np.log2(columns).tolist()
    ([0.0, -16.0], [0.0, -8.0])
    """
    rows = _powers(abs(block).max(axis=1, initial=0.0))
    return rows, _powers(abs(block / rows[:, None]).max(axis=0, initial=0.0))


def _powers(sizes: Vector) -> Vector:
    """Return sizes over the largest, up to the next power of 2^ALIKE, so that none grows beyond it."""
    bits = np.where(sizes > 0, np.frexp(sizes)[1], -2000)
    steps = (bits.max(initial=-2000) - bits) // ALIKE
    return np.asarray(np.ldexp(1.0, -ALIKE * np.minimum(steps, 100)))
