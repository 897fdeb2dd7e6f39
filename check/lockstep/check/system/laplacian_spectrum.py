"""Graphs whose Laplacian is symmetric in some metric, and exact bounds on their spectrum.

With weights w > 0 of the agents for which w_i a_ij = w_j a_ji (detailed balance), diag(w) L is symmetric, so L has a
basis of eigenvectors that is orthogonal in the metric diag(w), and a real spectrum 0 = lambda_1 < lambda_2 <= ... .
Undirected graphs have w = 1; an undirected graph whose weights are divided by the listener's in-degree has for w the
in-degrees.
"""

import numpy as np
from flint import fmpq

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import Vector, exact
from lockstep.check.psd import Definiteness, decide_positive_definite, too_many
from lockstep.check.system.graph import Digraph

REMEDY = 'use method = "certified", which takes any graph with a spanning tree'


def metric(graph: Digraph) -> Vector:
    """Return the weights w that make diag(w) L symmetric, rationals with the smallest 1: all are for an undirected graph.

    Raises:
        ProblemError: there are none: an edge has no counterpart, the spectrum is not real, or the products of weights
            around a circle differ with its direction.

    >>> metric(Digraph.from_edges(3, [[1, 2], [2, 1], [2, 3], [3, 2, 0.5]])).tolist()
    [1, 1, 2]
    """
    a = graph.adjacency
    one_way = np.argwhere((a > 0) & (a.T == 0))
    if len(one_way):
        i, j = one_way[0]
        raise _refused(graph, f"agent {i + 1} listens to agent {j + 1}, which does not listen to it")
    w, pending = {0: fmpq(1)}, [0]
    while pending:
        i = pending.pop()
        for j in (int(k) for k in np.flatnonzero(a[i])):
            # w_i a_ij = w_j a_ji fixes w_j; a second path to j must agree.
            value = w[i] * exact(a[i, j]) / exact(a[j, i])
            if j not in w:
                w[j] = value
                pending.append(j)
            elif w[j] != value:
                found = f"the weights around a circle through agents {i + 1} and {j + 1} do not balance"
                raise _refused(graph, found)
    least = min(w.values())
    return np.array([w[i] / least for i in sorted(w)], dtype=object)


def decide_spectrum(graph: Digraph, w: Vector, lower: float, upper: float) -> Definiteness:
    """Decide exactly whether lower < lambda_2 and lambda_N < upper.

    With wL = diag(w) L, on the vectors that w is orthogonal to, the invariant complement of 1: w_perp'(wL - lower diag(w))
    w_perp > 0 and w_perp'(upper diag(w) - wL)w_perp > 0. Here w_perp = [I; -v'], v = w / w_N without the last, and
    w_perp'wL w_perp = wL_11 - wL_1N v' - v wL_N1 + v wL_NN v'.
    """
    if beyond := too_many(graph.N - 1):
        return beyond
    v = w[:-1] / w[-1]
    wL = w[:, None] * graph.laplacian_in(exact_arithmetic=True)
    cross = np.outer(wL[:-1, -1], v)
    reduced = wL[:-1, :-1] - cross - cross.T + np.outer(v, v) * wL[-1, -1]
    squares = np.diag(w[:-1]) + np.outer(v, v) * w[-1]
    low, high = exact(lower), exact(upper)
    first = decide_positive_definite(reduced - low * squares)
    return first if not first.positive else decide_positive_definite(high * squares - reduced)


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
