"""Continuous gains to the sampled controller x+ = A_d x + B_d r, u = C_d x + D_d r, correctly rounded.

With T the period, paper (9) becomes

    euler   A_d = I + A T            B_d = B T              C_d = C         D_d = D
    zoh     A_d = e^(A T)            B_d = int_0^T e^(A s) B ds             C_d = C         D_d = D
    tustin  A_d = E^-1 (I + A T/2)   B_d = E^-1 B T         C_d = C E^-1    D_d = D + C E^-1 B T/2,   E = I -
    A T/2

(Franklin, Powell, Workman, Digital Control of Dynamic Systems, chapter 6). Tustin's sampled state is xi = E x
- (T/2) B r, not x: the trapezoidal rule needs r at both ends of a period, and this choice is the one that
needs only the present r. Note D_d != D: part of r reaches u at once.

Euler and Tustin are computed over the rationals and zoh in ball arithmetic, then rounded once to float64. So
the result is the float64 nearest to the exact one, the same on every machine: no BLAS is involved.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.codegen.spec import Discretization, check_period

_PRECISIONS = (192, 768, 3072)
"""Bits tried for e^(A T); more are needed only where entries cancel or lie next to a rounding boundary."""

_CONDITION = 1e12
"""Above it, an error of 1e-16 in the given gains moves the sampled ones by 1e-4: they mean nothing."""


@dataclass(frozen=True, eq=False)
class SampledGains:
    """x+ = A x + B r, u = C x + D r in float64."""

    A: Float[np.ndarray, "nc nc"]
    B: Float[np.ndarray, "nc q"]
    C: Float[np.ndarray, "m nc"]
    D: Float[np.ndarray, "m q"]

    def stacked(self) -> Float[np.ndarray, "nc+m nc+q"]:
        """[A B; C D], the one table that maps (x, r) to (x+, u)."""
        return np.block([[self.A, self.B], [self.C, self.D]])


def discretize(
    A: Float[np.ndarray, "nc nc"],
    B: Float[np.ndarray, "nc q"],
    C: Float[np.ndarray, "m nc"],
    D: Float[np.ndarray, "m q"],
    period: float,
    method: Discretization = "tustin",
) -> SampledGains:
    """Sample x' = A x + B r, u = C x + D r with the period T in s.

    Raises `ProblemError` if E = I - A T/2 is singular (tustin), if a result exceeds float64, or if T <= 0.

    >>> import numpy as np
    >>> one = np.ones((1, 1))
    >>> g = discretize(-one, one, one, 0 * one, 0.5, "tustin")
    >>> [float(M[0, 0]) for M in (g.A, g.B, g.C, g.D)]
    [0.6, 0.4, 0.8, 0.2]
    """
    check_period(period)
    if len(A) == 0 or method == "euler":
        T = float(period)
        exact = _euler(A, B, T) if len(A) else (np.zeros_like(A), np.zeros_like(B))
        return SampledGains(*exact, C.copy(), D.copy())
    if method == "zoh":
        return SampledGains(*_zoh(A, B, period), C.copy(), D.copy())
    if method == "tustin":
        return _tustin(A, B, C, D, period)
    raise ProblemError(f"`{method}`", where="discretization", expected="tustin, zoh or euler")


def _euler(A: np.ndarray, B: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray]:
    A_, B_, h = _exact(A), _exact(B), Fraction(T)
    return _rounded(_add(_scale(A_, h), _identity(len(A)))), _rounded(_scale(B_, h))


def _tustin(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, T: float) -> SampledGains:
    half = Fraction(T) / 2
    A_, B_, C_, D_ = (flint.fmpq_mat(_fmpq(_exact(M))) for M in (A, B, C, D))
    eye = flint.fmpq_mat(_fmpq(_identity(len(A))))
    step = flint.fmpq(half.numerator, half.denominator)
    E = eye - A_ * step
    inverse = _inverse(E, 1 + half * _largest(A_), T)
    B_d = inverse * B_ * (2 * step)
    return SampledGains(
        *(
            _rounded(_fractions(M))
            for M in (inverse * (eye + A_ * step), B_d, C_ * inverse, D_ + C_ * B_d * flint.fmpq(1, 2))
        )
    )


def _inverse(E: Any, scale: Fraction, T: float) -> Any:
    """E^-1, or an error when E is singular up to the rounding of T: 2/T is rarely exact in binary.

    scale  the size of the terms of E before they cancel
    """
    try:
        inverse = E.inv()
    except ZeroDivisionError:
        inverse = None
    if inverse is None or scale * _largest(inverse) > _CONDITION:
        raise ProblemError(
            "I - A T/2 is singular, so Tustin's rule does not exist",
            where=f"discretization with the period {T!r} s",
            expected="no eigenvalue of A at 2/T",
            remedy='use another period or discretization = "zoh"',
        )
    return inverse


def _largest(M: Any) -> Fraction:
    return max(abs(value) for row in _fractions(M) for value in row)


def _zoh(A: np.ndarray, B: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray]:
    """exp of [A B; 0 0] T: its upper blocks are A_d and B_d (Van Loan 1978)."""
    n, q = B.shape
    augmented = _scale(_exact(np.block([[A, B], [np.zeros((q, n + q))]])), Fraction(T))
    result = np.full((n, n + q), np.nan)
    previous = flint.ctx.prec
    try:
        for precision in _PRECISIONS:
            flint.ctx.prec = precision
            exponential = flint.arb_mat(_arb(augmented)).exp()
            result = np.array([[_nearest(exponential[i, j]) for j in range(n + q)] for i in range(n)])
            if not np.isnan(result).any():
                break
    finally:
        flint.ctx.prec = previous
    if not np.isfinite(result).all():
        raise ProblemError(
            "e^(A T) is not representable in float64",
            where=f"discretization with the period {T!r} s",
            remedy="use a shorter period or smaller gains",
        )
    return result[:, :n].copy(), result[:, n:].copy()


def _nearest(ball: Any) -> float:
    """The float64 that every point of the ball rounds to; NaN if there is none at this precision.

    An exact zero that the ball cannot separate from its neighbours comes out as 0 once the radius is below
    half the smallest float64, which the last precision sees to.
    """
    if not ball.is_finite():
        return math.nan
    low, high = (_float(_dyadic(end)) for end in (ball.lower(), ball.upper()))
    if low == high:
        return low + 0.0
    return math.nan


def _dyadic(exact: Any) -> Fraction:
    mantissa, exponent = (int(part) for part in exact.man_exp())
    return Fraction(mantissa) * Fraction(2) ** exponent


def _float(value: Fraction) -> float:
    try:
        return value.numerator / value.denominator  # integer division rounds correctly
    except OverflowError:
        return math.inf if value > 0 else -math.inf


Exact = list[list[Fraction]]


def _exact(M: np.ndarray) -> Exact:
    return [[Fraction(float(value)) for value in row] for row in M]


def _identity(n: int) -> Exact:
    return [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def _scale(M: Exact, factor: Fraction) -> Exact:
    return [[value * factor for value in row] for row in M]


def _add(M: Exact, N: Exact) -> Exact:
    return [[a + b for a, b in zip(r, s, strict=True)] for r, s in zip(M, N, strict=True)]


def _convert(M: Exact, make: Callable[[Fraction], Any]) -> list[list[Any]]:
    return [[make(value) for value in row] for row in M]


def _fmpq(M: Exact) -> list[list[Any]]:
    return _convert(M, lambda value: flint.fmpq(value.numerator, value.denominator))


def _arb(M: Exact) -> list[list[Any]]:
    return _convert(M, lambda value: flint.arb(flint.fmpq(value.numerator, value.denominator)))


def _fractions(M: Any) -> Exact:
    return [[Fraction(int(M[i, j].p), int(M[i, j].q)) for j in range(M.ncols())] for i in range(M.nrows())]


def _rounded(M: Exact) -> np.ndarray:
    result = np.array([[_float(value) for value in row] for row in M])
    if not np.isfinite(result).all():
        raise ProblemError(
            "a sampled gain is not representable in float64",
            where="discretization",
            remedy="use smaller gains",
        )
    return result
