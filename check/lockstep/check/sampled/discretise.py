"""Continuous gains to the sampled controller x+ = A_d x + B_d r, u = C_d x + D_d r, correctly rounded.

With T_s the period, paper (9) becomes

    euler   A_d = I + A T_s                B_d = B T_s              C_d = C             D_d = D
    zoh     A_d = e^(A T_s)                B_d = int_0^T_s e^(A s) B ds                 C_d = C         D_d = D
    tustin  A_d = Theta^-1 (I + A T_s/2)   B_d = Theta^-1 B T_s     C_d = C Theta^-1    D_d = D + C Theta^-1 B T_s/2,
            Theta = I - A T_s/2

(Franklin, Powell, Workman, Digital Control of Dynamic Systems, chapter 6). Tustin's sampled state is Theta x
- (T_s/2) B r, not x: the trapezoidal rule needs r at both ends of a period, and this choice is the one that
needs only the present r. Note D_d != D: part of r reaches u at once.

Euler and Tustin are computed over the rationals and zoh in ball arithmetic, then rounded once to float64. So
the result is the float64 nearest to the exact one, the same on every machine: no BLAS is involved. The target's real
type is reached by one more rounding of these float64.
"""

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import numpy as np
from flint import fmpq

from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import Matrix, as_float, as_floats, exact, exactly, eye, inverse, product
from lockstep.check.sampled.balls import exponential, working_precision
from lockstep.check.sampled.controller import PRECISIONS, HeldController
from lockstep.check.system.agent import ExactAgent
from lockstep.check.system.formation import WHERE
from lockstep.check.system.loop import Gains

Discretization = Literal["tustin", "zoh", "euler"]
Real = Literal["float32", "float64"]

_PRECISIONS = (192, 768, 3072)
"""Bits tried for e^(A T_s); more are needed only where entries cancel or lie next to a rounding boundary."""

_CONDITION = 10**12
"""Above it, an error of 1e-16 in the given gains moves the sampled ones by 1e-4: they mean nothing."""


def discretise(
    A: Annotated[np.ndarray, "nc nc"],
    B: Annotated[np.ndarray, "nc q"],
    C: Annotated[np.ndarray, "m nc"],
    D: Annotated[np.ndarray, "m q"],
    period: float,
    method: Discretization = "tustin",
) -> Annotated[np.ndarray, "nc+m nc+q"]:
    """Sample x' = A x + B r, u = C x + D r with the period T_s in s; return [A_d B_d; C_d D_d], of x+ and u, in float64.

    Raises `ProblemError` if Theta = I - A T_s/2 is singular (tustin), or if a result exceeds float64; T_s > 0.

    >>> import numpy as np
    >>> one = np.ones((1, 1))
    >>> discretise(-one, one, one, 0 * one, 0.5, "tustin").tolist()
    [[0.6, 0.4], [0.8, 0.2]]
    """
    if len(A) == 0:
        return D.copy()
    if method == "zoh":
        return np.vstack([_zoh(A, B, period), np.hstack([C, D])])
    A_, B_, C_, D_ = (exactly(block) for block in (A, B, C, D))
    T_s, unit = exact(period), eye(len(A), A_)
    if method == "euler":
        return _rounded(np.block([[unit + A_ * T_s, B_ * T_s], [C_, D_]]))
    half = T_s / 2
    inverted = _inverse(unit - A_ * half, 1 + half * _largest(A_), period)
    B_d = inverted @ B_ * T_s
    return _rounded(np.block([[inverted @ (unit + A_ * half), B_d], [C_ @ inverted, D_ + C_ @ B_d / 2]]))


def rounded_to(real: Real, values: Annotated[np.ndarray, "..."], where: str) -> Annotated[np.ndarray, "..."]:
    """Round float64 values to the nearest of the type, ties to even, -0 to 0; raises if one becomes infinite."""
    target = np.dtype(real)
    with np.errstate(over="ignore", under="ignore"):
        rounded: np.ndarray = np.asarray(values, dtype=np.float64).astype(target) + target.type(0)
    found = f"{np.abs(values).max(initial=0.0):.6g} is not representable in {real}"
    demand(np.isfinite(rounded).all(), found, where, remedy="use smaller gains")
    return rounded


def clipped_at(real: Real, sides: Annotated[np.ndarray, "m 2"]) -> Annotated[np.ndarray, "m 2"]:
    """Return where C clips: the numbers nearest to the limits that are not beyond them, the largest where there is none.

    >>> clipped_at("float32", np.array([[-0.1, np.inf]])).tolist()
    [[-0.09999999403953552, 3.4028234663852886e+38]]
    """
    target = np.dtype(real).type
    with np.errstate(over="ignore", under="ignore"):
        near = sides.astype(target)
        beyond = np.isinf(near) | (np.abs(near.astype(np.float64)) > np.abs(sides))
        return np.where(beyond, np.nextafter(near, target(0)), near).astype(np.float64)


def either_way(real: Real, sides: Annotated[np.ndarray, "m 2"]) -> Annotated[np.ndarray, " m"]:
    """Return how far each input goes either way before C clips it, infinite where it has no limit."""
    nearer = np.abs(clipped_at(real, sides)).min(axis=1)
    return np.where(np.isinf(sides).all(axis=1), np.inf, nearer)


def sampled_controllers(
    gains: Gains, edges: Iterable[tuple[int, int, float]], period: float, method: Discretization, real: Real
) -> tuple[HeldController, ...]:
    """Return the gains sampled with a period and rounded to a type, rows and sums running from left to right.

    Args:
        gains: continuous, of every agent;  edges: (listener, source, weight), agents from 1, in the order of the sums.
        period: T_s in s;  method: of sampling;  real: the type of the arithmetic.

    Raises:
        ProblemError: a gain has no value in the type, or cannot be sampled.
    """
    heard: list[list[tuple[int, float]]] = [[] for _ in range(gains.N)]
    for listener, source, weight in edges:
        heard[listener - 1].append((source - 1, weight))
    controllers, tables = [], dict[bytes, Annotated[np.ndarray, "k l"]]()
    for i, own in enumerate(heard):
        where, key = f"controller {i + 1}", gains.blocks[i].tobytes()
        if key not in tables:
            tables[key] = sampled_table(gains, i, period, method, real)
        table = tables[key]
        weights = rounded_to(real, np.array([a for _, a in own], dtype=float), where).astype(float)
        sources = tuple(source for source, _ in own)
        controllers.append(HeldController.row_by_row(table, gains.order, sources, weights, PRECISIONS[real]))
    return tuple(controllers)


def sampled_table(
    gains: Gains, i: int, period: float, method: Discretization, real: Real
) -> Annotated[np.ndarray, "k l"]:
    """Return [A B; C D] of agent i sampled with a period and rounded to a type.

    Raises:
        ProblemError: a gain has no value in the type, or cannot be sampled.
    """
    sampled = discretise(gains.A[i], gains.B[i], gains.C[i], gains.D[i], period, method)
    return rounded_to(real, sampled, f"controller {i + 1}").astype(float)


def _inverse(Theta: Matrix, scale: fmpq, period: float) -> Matrix:
    """Theta^-1, or an error when Theta is singular up to the rounding of T_s: 2/T_s is rarely exact in binary.

    scale  the size of the terms of Theta before they cancel
    """
    try:
        found = inverse(Theta)
    except ZeroDivisionError:
        found = None
    if found is None or scale * _largest(found) > _CONDITION:
        raise ProblemError(
            "I - A T_s/2 is singular, so Tustin's rule does not exist",
            where=f"discretization with the period {period!r} s",
            expected="no eigenvalue of A at 2/T_s",
            remedy='use another period or discretization = "zoh"',
        )
    return found


def _largest(matrix: Matrix) -> fmpq:
    largest: fmpq = max(abs(value) for value in matrix.ravel())
    return largest


def _zoh(A: Matrix, B: Matrix, period: float) -> Matrix:
    """Return [A_d B_d], the upper rows of exp([A B; 0 0] T_s) (Van Loan 1978)."""
    n, q = B.shape
    augmented = exactly(np.block([[A, B], [np.zeros((q, n + q))]])) * exact(period)
    for precision in _PRECISIONS:
        with working_precision(precision):
            upper = exponential(augmented)[:n]
            result = np.array([_nearest(ball) for ball in upper.ravel()]).reshape(upper.shape)
        if not np.isnan(result).any():
            break
    where, remedy = f"discretization with the period {period!r} s", "use a shorter period or smaller gains"
    demand(np.isfinite(result).all(), "e^(A T_s) is not representable in float64", where, remedy=remedy)
    return result


def _nearest(ball: Any) -> float:
    """The float64 that every point of the ball rounds to; NaN if there is none at this precision.

    An exact zero that the ball cannot separate from its neighbours comes out as 0 once the radius is below
    half the smallest float64, which the last precision sees to.
    """
    if not ball.is_finite():
        return math.nan
    ends = (end.man_exp() for end in (ball.lower(), ball.upper()))
    low, high = (as_float(fmpq(mantissa) * fmpq(2) ** int(exponent)) + 0.0 for mantissa, exponent in ends)
    return low if low == high else math.nan


def _rounded(matrix: Matrix) -> Annotated[np.ndarray, "k l"]:
    result = as_floats(matrix) + 0.0
    said, remedy = "a sampled gain is not representable in float64", "use smaller gains"
    demand(np.isfinite(result).all(), said, "discretization", remedy=remedy)
    return result


def measured_offsets(
    agent: ExactAgent, offsets: Annotated[np.ndarray, "N n"] | None, real: Real
) -> Annotated[np.ndarray, "N q"] | None:
    """Return C o_i as the C has them, each rounded to the type; None where none is other than 0.

    y_i - C o_i takes the place of the reading y_i: rounding C o_i, and the difference, are errors of a reading.
    """
    if offsets is None:
        return None
    seen: np.ndarray = rounded_to(real, as_floats(product(agent.C, exactly(offsets).T)).T, WHERE).astype(
        float
    )
    return seen if seen.any() else None
