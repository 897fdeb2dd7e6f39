"""One period of the agents with their nonlinearity, as an exact discrete system.

Between two samples the disagreement obeys, with v held and E E' and F'F standing for all ways in and out,

    x' = A x + B v + E w,     z = F x.

With a = (x, v), a' = A_ a + E_ w, z = F_ a and

    Gamma(t) = exp(t [-A_', -F_'F_; E_E_', A_]) = [Gamma_11, Gamma_12; Gamma_21, Gamma_22],

the largest value of x(T)' P x(T) + int_0^T (|z|^2 - |w|^2) dt over all w, from a(0) = a, is that of one step

    x(T) = A_d a + w_d:    max over w_d of (A_d a + w_d)' P (A_d a + w_d) - w_d' S^-1 w_d + a' Q a,
    A_d = [I 0] Gamma_11^-T,   S = [I 0] Gamma_21 Gamma_11^-1 [I 0]',   Q = -Gamma_11^-1 Gamma_12,

as long as Gamma_11 is invertible on all of [0, T], which `conjugate_points` proves (Bamieh and Pearson 1992; Chen and Francis
1995, chapter 13). With an invertible multiplier M on w and z and the agents' A, B, E, F alike, everything is one
agent's matrix in a Kronecker product, S = M^-1 (x) S_1 and Q = M (x) Q_1: the inequality stays linear in M, and
one small exponential serves all agents and all M.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lockstep.check.numbers import Matrix, converter, eye, is_exact, zeros
from lockstep.check.sampled.balls import exponential, inverse, product


@dataclass(frozen=True, eq=False)
class Lifted:
    """One period: A_d (n, n + k), S (n, n) and Q (n + k, n + k), in doubles or in balls."""

    A_d: Matrix
    S: Matrix
    Q: Matrix

    @property
    def n(self) -> int:
        """The number of states."""
        return len(self.S)


def lift(
    A: Matrix,
    B: Matrix,
    EE: Matrix,
    FF: Matrix,
    period: float,
    exponential: Callable[[Matrix], Matrix] = exponential,
) -> Lifted:
    """Return one period of x' = A x + B v + E w, z = F x, given EE = E E' and FF = F'F.

    A: (n, n);  B: (n, k);  EE, FF: (n, n), or FF (n + k, n + k) where z = F a, exact, or in doubles with their own
    exponential;  period: T in s, taken as the double it is;  exponential: M to e^M, in balls unless a search brings another.

    >>> from lockstep.check.numbers import exactly
    >>> from lockstep.check.sampled.balls import midpoints
    >>> zero, one = exactly(np.zeros((1, 1))), exactly(np.ones((1, 1)))
    >>> step = lift(zero, one, one, zero, 0.5)
    >>> midpoints(step.A_d).tolist(), midpoints(step.S).tolist()
    ([[1.0, 0.5]], [[0.5]])
    """
    n, k = B.shape
    size = n + k
    A_, EE_, FF_ = (zeros(size, size, A) for _ in range(3))
    A_[:n, :n], A_[:n, n:], EE_[:n, :n], FF_[: len(FF), : len(FF)] = A, B, EE, FF
    T = converter(is_exact(A))(np.array([period]))[0]
    Gamma = exponential(T * np.block([[-A_.T, -FF_], [EE_, A_]]))
    inv = inverse(Gamma[:size, :size])
    return Lifted(
        inv.T[:n],
        _symmetric(product(Gamma[size:, :size], inv)[:n, :n]),
        _symmetric(-product(inv, Gamma[:size, size:])),
    )


def copies(one: Lifted, M: Matrix) -> Lifted:
    """Return the N - 1 copies of one agent's period that a multiplier M couples: a = (x of each, v of each)."""
    n, k = one.n, len(one.Q) - one.n
    unit = eye(len(M), M)
    Q = [[np.kron(M, one.Q[rows, columns]) for columns in _split(n, k)] for rows in _split(n, k)]
    A_d = np.hstack([np.kron(unit, one.A_d[:, :n]), np.kron(unit, one.A_d[:, n:])])
    return Lifted(A_d, np.kron(inverse(M), one.S), np.block(Q))


def _split(n: int, k: int) -> tuple[slice, slice]:
    return slice(0, n), slice(n, n + k)


def _symmetric(matrix: Matrix) -> Matrix:
    """Return a symmetric enclosure: the mean of two enclosures of the same numbers encloses them too."""
    mean: Matrix = (matrix + matrix.T) / 2
    return mean
