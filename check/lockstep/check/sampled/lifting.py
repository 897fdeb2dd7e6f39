"""One period of the agents with their nonlinearity, as an exact discrete system.

Between two samples the disagreement obeys, with u_d held and E E' and C_z'C_z standing for all ways in and out,

    x' = A x + B u_d + E w,     z = C_z x.

With a = (x, u_d), a' = A_ a + E_ w, z = C_ a and

    Gamma(t) = exp(t [-A_', -C_'C_; E_E_', A_]) = [Gamma_11, Gamma_12; Gamma_21, Gamma_22],

the largest value of x(T_s)' P x(T_s) + int_0^T_s (|z|^2 - |w|^2) dt over all w, from a(0) = a, is that of one step

    x(T_s) = A_d a + w_d:    max over w_d of (A_d a + w_d)' P (A_d a + w_d) - w_d' (B_d B_d')^-1 w_d + a' C_d'C_d a,
    A_d = [I 0] Gamma_11^-T,   B_d B_d' = [I 0] Gamma_21 Gamma_11^-1 [I 0]',   C_d'C_d = -Gamma_11^-1 Gamma_12,

as long as Gamma_11 is invertible on all of [0, T_s], which `conjugate_points` proves (Bamieh and Pearson 1992; Chen and
Francis 1995, chapter 13). With an invertible multiplier M on w and z and the agents' A, B, E, C_z alike, everything is one
agent's matrix in a Kronecker product, B_d B_d' of M^-1 and C_d'C_d of M: the inequality stays linear in M, and
one small exponential serves all agents and all M.

Beside a mode lambda that is fast against T_s nothing is left of the others in Gamma, which holds e^(2 |lambda| T_s). So Gamma
is taken of a part of the period, and two equal parts are made one: the largest value over both, of (A, S, Q) = (A_d,
B_d B_d', C_d'C_d) each, inputs counted among the states, is that of

    A W A,    S + A W S A',    Q + A' Q W A,    W = (I - S Q)^-1

(the doubling algorithm: Anderson 1978), and nothing grows.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lockstep.check.numbers import Matrix, as_floats, converter, eye, is_exact, zeros
from lockstep.check.sampled.balls import exponential, inverse, product

FAST = 4.0
"""|lambda| T_s of a part of a period: doubles lose e^8 of sixteen digits. With a shorter one they lose digits of A_d - I, so
that the modes count, and not a norm of A, which is large in m and Pa. Of no example is a whole period above it."""


@dataclass(frozen=True, eq=False)
class Lifted:
    """One period: A_d (n, n + k), BB_d = B_d B_d' (n, n) and CC_d = C_d'C_d (n + k, n + k), in doubles or in balls."""

    A_d: Matrix
    BB_d: Matrix
    CC_d: Matrix

    @property
    def n(self) -> int:
        """The number of states."""
        return len(self.BB_d)

    def twice(self) -> "Lifted":
        """Return two such periods, one after the other."""
        n, unit = self.n, eye(len(self.CC_d), self.CC_d)
        A, S = unit.copy(), zeros(len(unit), len(unit), unit)
        A[:n], S[:n, :n] = self.A_d, self.BB_d
        W = inverse(unit - product(S, self.CC_d))
        reached, cost = product(A, W, S, A.T)[:n, :n], product(A.T, self.CC_d, W, A)
        return Lifted(product(A, W, A)[:n], self.BB_d + _symmetric(reached), self.CC_d + _symmetric(cost))


def lift(
    A: Matrix,
    B: Matrix,
    EE: Matrix,
    CC: Matrix,
    period: float,
    exponential: Callable[[Matrix], Matrix] = exponential,
) -> Lifted:
    """Return one period of x' = A x + B u_d + E w, z = C_z x, given EE = E E' and CC = C_z'C_z.

    A: (n, n);  B: (n, k);  EE, CC: (n, n), or CC (n + k, n + k) where z = C_z a, exact, or in doubles with their own
    exponential;  period: T_s in s, taken as the double it is;  exponential: of a matrix, in balls unless a search brings its
    own.

    >>> from lockstep.check.numbers import exactly
    >>> from lockstep.check.sampled.balls import midpoints
    >>> zero, one = exactly(np.zeros((1, 1))), exactly(np.ones((1, 1)))
    >>> step = lift(zero, one, one, zero, 0.5)
    >>> midpoints(step.A_d).tolist(), midpoints(step.BB_d).tolist()
    ([[1.0, 0.5]], [[0.5]])
    """
    n, k = B.shape
    size = n + k
    A_, EE_, CC_ = (zeros(size, size, A) for _ in range(3))
    A_[:n, :n], A_[:n, n:], EE_[:n, :n], CC_[: len(CC), : len(CC)] = A, B, EE, CC
    halvings = halvings_to(FAST, np.abs(np.diag(np.linalg.eigvals(as_floats(A)))), period)
    T_s = converter(is_exact(A))(np.array([period]))[0] / 2**halvings
    Gamma = exponential(T_s * np.block([[-A_.T, -CC_], [EE_, A_]]))
    inv = inverse(Gamma[:size, :size])
    BB_d, CC_d = product(Gamma[size:, :size], inv)[:n, :n], -product(inv, Gamma[:size, size:])
    one = Lifted(inv.T[:n], _symmetric(BB_d), _symmetric(CC_d))
    for _ in range(halvings):
        one = one.twice()
    return one


def halvings_to(most: float, sizes: Annotated[np.ndarray, "n n"], period: float) -> int:
    """Return how often a period is halved until the largest sum of a row of sizes, times what is left, is at most `most`.

    Raises:
        numpy.linalg.LinAlgError: a sum that is no double.
    """
    with np.errstate(over="ignore"):
        fast = float(sizes.sum(axis=1).max(initial=0.0)) * period / most
    if not math.isfinite(fast):
        raise np.linalg.LinAlgError("entries beyond all doubles")
    return max(0, math.ceil(math.log2(fast))) if fast > 0 else 0


def copies(one: Lifted, M: Matrix) -> Lifted:
    """Return the N - 1 copies of one agent's period that a multiplier M couples: a = (x of each, u_d of each)."""
    n, k = one.n, len(one.CC_d) - one.n
    unit = eye(len(M), M)
    parts = slice(0, n), slice(n, n + k)
    CC_d = [[np.kron(M, one.CC_d[rows, columns]) for columns in parts] for rows in parts]
    A_d = np.hstack([np.kron(unit, one.A_d[:, :n]), np.kron(unit, one.A_d[:, n:])])
    return Lifted(A_d, np.kron(inverse(M), one.BB_d), np.block(CC_d))


def _symmetric(matrix: Matrix) -> Matrix:
    """Return a symmetric enclosure: the mean of two enclosures of the same numbers encloses them too."""
    mean: Matrix = (matrix + matrix.T) / 2
    return mean
