"""Graphs whose Laplacian is symmetric in some metric, and exact bounds on their spectrum.

With weights w > 0 of the agents for which w_i a_ij = w_j a_ji (detailed balance), W L is symmetric, so L has a basis
of eigenvectors that is orthogonal in the metric W = diag(w), and a real spectrum 0 = lambda_1 < lambda_2 <= ... .
Undirected graphs have w = 1; an undirected graph whose weights are divided by the listener's in-degree has for w the
in-degrees.
"""

from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np
from flint import fmpq

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import exactly
from lockstep.check.psd import Definiteness, decide_positive_definite
from lockstep.check.system.graph import Digraph

REMEDY = 'use method = "certified", which takes any graph with a spanning tree'


@dataclass(frozen=True)
class Metric:
    """The weights w, rationals with the smallest 1."""

    w: Annotated[np.ndarray, " N"]

    @property
    def spread(self) -> fmpq:
        """max w / min w: 1 for an undirected graph."""
        ratio: fmpq = max(self.w) / min(self.w)
        return ratio


def metric(graph: Digraph) -> Metric:
    """Return the weights that make W L symmetric, exactly.

    Raises:
        ProblemError: there are none: an edge has no counterpart, the spectrum is not real, or the products of weights
            around a circle differ with its direction.

    >>> metric(Digraph.from_edges(3, [[1, 2], [2, 1], [2, 3], [3, 2]])).spread
    1
    """
    a = graph.adjacency
    one_way = np.argwhere((a > 0) & (a.T == 0))
    if len(one_way):
        i, j = one_way[0]
        raise _refused(graph, f"agent {i + 1} listens to agent {j + 1}, which does not listen to it")
    w, pending = {0: Fraction(1)}, [0]
    while pending:
        i = pending.pop()
        for j in (int(k) for k in np.flatnonzero(a[i])):
            # w_i a_ij = w_j a_ji fixes w_j; a second path to j must agree.
            value = w[i] * Fraction(float(a[i, j])) / Fraction(float(a[j, i]))
            if j not in w:
                w[j] = value
                pending.append(j)
            elif w[j] != value:
                found = f"the weights around a circle through agents {i + 1} and {j + 1} do not balance"
                raise _refused(graph, found)
    least = min(w.values())
    known = [w[i] / least for i in sorted(w)]
    return Metric(np.array([fmpq(v.numerator, v.denominator) for v in known], dtype=object))


def decide_spectrum(graph: Digraph, known: Metric, lower: float, upper: float) -> Definiteness:
    """Decide exactly whether lower < lambda_2 and lambda_N < upper.

    With Z a basis of the vectors z with w'z = 0, the invariant complement of 1: Z'(W L - lower W)Z > 0 and
    Z'(upper W - W L)Z > 0.
    """
    N, w = graph.N, known.w
    WL = w[:, None] * graph.laplacian_in(exact_arithmetic=True)
    Z = np.vstack([exactly(np.eye(N - 1)), [-(w[i] / w[-1]) for i in range(N - 1)]])
    on_Z, squares = Z.T @ WL @ Z, Z.T @ (w[:, None] * Z)
    low, high = exactly(np.array([lower, upper]))
    first = decide_positive_definite(on_Z - low * squares)
    return first if not first.positive else decide_positive_definite(high * squares - on_Z)


def _refused(graph: Digraph, found: str) -> ProblemError:
    values = np.linalg.eigvals(graph.laplacian)
    worst = values[int(np.argmax(np.abs(values.imag)))]
    real = abs(worst.imag) < 1e-9 * max(1.0, float(np.abs(values).max()))
    why = "" if real else f"; L has the eigenvalue {worst.real:.4g} {worst.imag:+.4g}i, which is not real"
    return ProblemError(
        f"{found}{why}",
        where='[design] method = "modal"',
        expected="an undirected graph, or one whose weights are symmetric up to a factor for each listener: the design"
        " splits along real eigenvectors of L",
        remedy=REMEDY,
    )
