"""In which interval the nonzero Laplacian eigenvalues of a large undirected graph lie, and how that is known.

**From above**: lambda_N <= max over edges of deg_u + deg_v, with weighted degrees (Anderson and Morley 1985): lambda_N is
at most that of D + A = R R', R having sqrt(w_e) at both ends of edge e, which is that of R'R; and R'R is similar to the
matrix of w_f for f and e sharing an end, 2 w_e for e itself, whose row of e = uv adds up to deg_u + deg_v.

**From below, by inertia.** For a > 0 the matrix M = L - a I has one negative eigenvalue, for the vector 1, and another for
each lambda_k < a. A computed factorisation P M P' = Lh Uh without pivoting has an error |dM| <= gamma |Lh| |Uh| entry by
entry (Higham 2002, theorem 9.3), gamma = k u / (1 - k u) for entries of at most k terms; with D = diag(Uh) and F = Uh - D
Lh',

    Lh D Lh' = P M P' + dM - Lh F,      e = | gamma |Lh| |Uh| + |Lh| |F| |_inf + what forming M and F loses.

D has as many negative entries as Lh D Lh' negative eigenvalues (Sylvester), and eigenvalues move by e at most (Weyl). So one
negative entry proves lambda_2 >= a - e.

**From below, at random.** Where a factor fills in: let x = (c - L) / h send [a', b] to [-1, 1], and g be uniform on the
sphere of the vectors orthogonal to 1, of dimension n = N - 1. If L has an eigenvalue in (0, a], a < a', the component of
T_k(x) g along its eigenvector, T_k being the Chebyshev polynomial, is |g_1| T_k(x_a) or more, x_a = 1 + 2 (a' - a) / (b -
a'). So if |T_k(x) g| < T_k(x_a) s |g|, then either there is none, or |g_1| < s |g|, which has the probability s sqrt(2 n /
pi) at most. Polynomials of this kind prove the bounds of Kuczynski and Wozniakowski (1992) for the Lanczos method; here one
decides by itself, so that three vectors do, and no basis has to stay orthogonal. A few Lanczos steps, from another vector,
say where to ask. Rounding: a step T_j = 2 x T_{j-1} - T_{j-2} loses f_j with |f_j| <= r max |T_j g|, and leaves sum_j
U_{k-j}(x_a) |f_j| at most on the eigenvector. With x_a = (q + 1/q) / 2, U_m <= q^m / (1 - q^-2) and T_k >= q^k / 2, so
that, divided by T_k(x_a), it is at most 2 r max |T_j g| / ((q - 1)(1 - q^-2)): that is taken off s.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.model.graphs.sparse_graph import SparseGraph

U = 2.0**-53

ERROR = 1e-9
"""The probability of a wrong answer: over the draw of g, for a graph that does not depend on it."""

TRIALS = ((120, 0.003), (240, 0.003), (120, 0.02), (60, 0.05))
"""Degrees of the polynomials tried, and by how much a' is below the lambda_2 computed: they share the probability."""

MOST_FILL, MOST_WORK = 40_000_000, 2_000_000_000
"""Of a banded factor: entries, and their products."""

WIDER = 2.0**-22
"""By how much an interval is widened where the weights have to be rounded to float32: eigenvalues follow weights."""


@dataclass(frozen=True)
class Membership:
    """Nonzero eigenvalues in [lower, upper], and how that is known: graph_proof; lambda_2, if computed, is no bound."""

    agents: int
    edges: int
    lower: float
    upper: float
    most_neighbours: int
    graph_proof: str
    file: str = ""

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON types."""
        return {**vars(self), "spectrum": [self.lower, self.upper]}


def membership(graph: SparseGraph, *, seed: int = 0, below: float | None = None) -> Membership:
    """Return an interval that holds the nonzero eigenvalues of an undirected, connected graph.

    Args:
        graph: its weights symmetric.
        seed: of the random vectors.
        below: a lower end that is enough; it is asked for first.

    Raises:
        ProblemError: directed, not connected, or no lower end above 0 was shown.
    """
    _check(graph)
    upper = largest_from_degrees(graph)
    if graph.agents == 2:
        lower, how = math.nextafter(2 * float(graph.weights[0]), 0.0), "exact"
    else:
        lower, how = _smallest(graph, upper, seed, below)
    whole = np.array_equal(graph.weights, graph.weights.astype(np.float32).astype(float))
    if not whole:
        lower, upper = lower * (1 - WIDER), upper * (1 + WIDER)
    edges = len(graph.weights) // 2
    return Membership(graph.agents, edges, _down(lower), upper, graph.most_neighbours, how, graph.where)


def _check(graph: SparseGraph) -> None:
    from scipy.sparse.csgraph import connected_components

    odd = graph.one_way
    if odd is not None:
        i, j = odd
        raise ProblemError(
            f"agent {i} and agent {j} do not listen to each other with the same weight",
            where=graph.where,
            expected="an undirected graph: a directed one needs a disc around its spectrum, and a metric",
            remedy='symmetrise the weights, or give up to 200 agents and method = "certified"',
        )
    count, group = connected_components(graph.matrix, directed=False)
    if count > 1:
        other = int(np.flatnonzero(group != group[0])[0]) + 1
        found = f"the graph falls into {count} parts: agents 1 and {other} hear nothing from each other"
        raise ProblemError(found, where=graph.where, expected="a connected graph")


def largest_from_degrees(graph: SparseGraph) -> float:
    """Return an upper bound of lambda_N: the largest deg_u + deg_v of an edge, rounded up.

    >>> path = SparseGraph(3, np.array([0, 1, 1, 2]), np.array([1, 0, 2, 1]), np.ones(4))
    >>> largest_from_degrees(path)  # lambda_N = 3
    3.0
    """
    degrees = graph.degrees
    most = float((degrees[graph.listeners] + degrees[graph.sources]).max())
    exact = bool((graph.weights == np.round(graph.weights)).all()) and most < 2**53
    # A sum of k doubles is off by gamma_k at most.
    return most if exact else most * (1 + 4 * (graph.most_neighbours + 2) * U)


def _smallest(graph: SparseGraph, upper: float, seed: int, below: float | None) -> tuple[float, str]:
    order, fill, work = _banded(graph)
    if fill <= MOST_FILL and work <= MOST_WORK:
        found = _by_inertia(graph, order, upper, seed, below)
        if found is not None:
            return found, "inertia"
    chebyshev = _at_random(graph, upper, seed, below)
    if chebyshev is not None:
        return chebyshev, f"lanczos, probability of error at most {ERROR:g}"
    raise ProblemError(
        f"lambda_2 was not shown to be above 0 of {graph.agents} agents: it is too small for their number",
        where=graph.where,
        expected="a graph that is better connected, or one that is planar or banded and smaller",
    )


def _banded(graph: SparseGraph) -> tuple[Float[np.ndarray, " N"], int, int]:
    """Return an order in which the graph has a small envelope, the entries of it, and the sum of their squares by rows."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    order = np.asarray(reverse_cuthill_mckee(graph.matrix, symmetric_mode=True))
    place = np.empty(graph.agents, dtype=np.int64)
    place[order] = np.arange(graph.agents)
    reach = np.zeros(graph.agents, dtype=np.int64)
    np.maximum.at(reach, place[graph.listeners], place[graph.listeners] - place[graph.sources])
    return order, int(reach.sum()), int((reach**2).sum())


@dataclass(frozen=True)
class _Factor:
    solver: Any
    negative: int
    error: float


def _factor(graph: SparseGraph, order: Float[np.ndarray, " N"], a: float) -> _Factor | None:
    """Factorise L - a I without pivoting; None where that failed."""
    from scipy.sparse import diags, identity
    from scipy.sparse.linalg import splu

    L = graph.laplacian[order][:, order]
    M = (L - a * identity(graph.agents)).tocsc()
    try:
        solver = splu(
            M, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"Equil": False, "SymmetricMode": True}
        )
    except RuntimeError:
        return None
    plain = np.arange(graph.agents)
    if not (np.array_equal(solver.perm_r, plain) and np.array_equal(solver.perm_c, plain)):
        return None
    low, up = solver.L, solver.U
    D = up.diagonal()
    rest = (up - diags(D) @ low.T).tocsr()
    terms = 2 + int(np.diff(low.tocsr().indptr).max())
    gamma = terms * U / (1 - terms * U)
    one = np.ones(graph.agents)
    size = abs(low) @ (abs(up) @ one)
    lost = abs(low) @ (abs(rest) @ one + 2 * U * (abs(up) @ one + np.abs(D) * (abs(low.T) @ one)))
    formed = 4 * (graph.most_neighbours + 2) * U * (2 * graph.degrees.max() + a)
    # The sums here are of numbers from 0 up, each off by far less than one per cent.
    error = 1.01 * float((gamma * size + lost).max()) + formed
    return _Factor(solver, int((D < 0).sum()), error) if np.isfinite(D).all() and (D != 0).all() else None


def _by_inertia(
    graph: SparseGraph, order: Float[np.ndarray, " N"], upper: float, seed: int, below: float | None
) -> float | None:
    estimate = _estimate(graph, order, upper, seed)
    asked = [] if below is None else [below * (1 + 1e-12)]
    for a in (*asked, *(part * estimate for part in (0.9999, 0.999, 0.99, 0.9, 0.7))):
        factor = _factor(graph, order, a)
        if factor is not None and factor.negative == 1 and a > 1.0001 * factor.error:
            return (a - factor.error) * (1 - 4 * U)
    return None


def _estimate(graph: SparseGraph, order: Float[np.ndarray, " N"], upper: float, seed: int) -> float:
    """Return about lambda_2, by inverse iteration on 1-perp with L + tau I."""
    tau = -1e-10 * upper
    factor = _factor(graph, order, tau)
    x = np.random.default_rng(seed).standard_normal(graph.agents)
    L, value = graph.laplacian[order][:, order], upper
    for _ in range(60):
        x -= x.mean()
        x /= np.linalg.norm(x)
        before, value = value, float(x @ (L @ x))
        if factor is None or abs(before - value) < 1e-7 * value:
            break
        x = factor.solver.solve(x)
    return value


def _at_random(graph: SparseGraph, upper: float, seed: int, below: float | None) -> float | None:
    """Return a lower bound of lambda_2 that holds but for `ERROR`; None where none was shown."""
    L, generator = graph.laplacian, np.random.default_rng([seed, 1992])
    estimate = _lanczos(L, upper, generator)
    share = ERROR / len(TRIALS)
    for degree, room in TRIALS:
        inside = estimate * (1 - room)
        a = _lower_end(degree, share, graph, inside, upper)
        if below is not None and a < below:
            continue
        if a > 0 and _none_below(graph, L, a, inside, upper, degree, share, generator):
            return a
    return None


def _sharpness(share: float, graph: SparseGraph) -> float:
    """Return s with P(|g_1| < s |g|) <= share."""
    return share / math.sqrt(2 * graph.agents / math.pi) * (1 - 1e-9)


def _lower_end(degree: int, share: float, graph: SparseGraph, inside: float, upper: float) -> float:
    """Return a with T_k(x_a) s = 8: twice what is needed, and as much again for rounding."""
    x_a = math.cosh(math.acosh(8 / _sharpness(share, graph)) / degree)
    return inside - (x_a - 1) * (upper - inside) / 2


def _none_below(
    graph: SparseGraph,
    L: Any,
    a: float,
    inside: float,
    upper: float,
    degree: int,
    share: float,
    generator: np.random.Generator,
) -> bool:
    """Decide at random whether no eigenvalue but 0 is at a or below; true in error with the probability `share`."""
    middle, half = (upper + inside) / 2, (upper - inside) / 2
    start = generator.standard_normal(graph.agents)
    start -= start.mean()
    last, now = start, (middle * start - L @ start) / half
    largest = max(float(np.linalg.norm(last)), float(np.linalg.norm(now)))
    for _ in range(degree - 1):
        last, now = now, 2 * (middle * now - L @ now) / half - last
        now -= now.mean()
        largest = max(largest, float(np.linalg.norm(now)))
    x_a = (middle - a) / half * (1 - 8 * U)
    q = x_a + math.sqrt(x_a * x_a - 1)
    # L v loses gamma |L| |v|, a row having most_neighbours + 1 products and | |L| |_2 <= 2 max deg; then come
    # 2 (c v - L v) / h, the difference to the vector before, and the mean, which takes nothing from the eigenvector
    # but by rounding.
    size = 2 * float(graph.degrees.max())
    step = 1.01 * U * (((graph.most_neighbours + 6) * size + 3 * (middle + size)) * 2 / half + 6)
    carried = 2 / ((q - 1) * (1 - q**-2))
    s = _sharpness(share, graph) - carried * step * largest / float(np.linalg.norm(start))
    return s > 0 and float(np.linalg.norm(now)) * (1 + 1e-9) < _chebyshev(degree, x_a) * s * float(
        np.linalg.norm(start)
    )


def _chebyshev(degree: int, x: float) -> float:
    return math.cosh(degree * math.acosh(x)) * (1 - 1e-9)


def _lanczos(L: Any, upper: float, generator: np.random.Generator, steps: int = 80) -> float:
    """Return about lambda_2, from above: the smallest Ritz value on 1-perp of upper I - L, without reorthogonalisation."""
    from scipy.linalg import eigvalsh_tridiagonal

    x = generator.standard_normal(L.shape[0])
    x -= x.mean()
    x /= np.linalg.norm(x)
    last, beta, alphas, betas = np.zeros_like(x), 0.0, [], []
    for _ in range(min(steps, L.shape[0] - 2)):
        y = upper * x - L @ x - beta * last
        alphas.append(float(x @ y))
        y -= alphas[-1] * x
        y -= y.mean()
        beta = float(np.linalg.norm(y))
        betas.append(beta)
        if beta < 1e-12 * upper:
            break
        last, x = x, y / beta
    return upper - float(eigvalsh_tridiagonal(np.array(alphas), np.array(betas[:-1]))[-1])


def _down(value: float) -> float:
    """Round down to six digits, so that an interval is short to write.

    >>> _down(2.6400139)
    2.64001
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 5)
    found = float(f"{math.floor(value / unit) * unit:.6g}")
    return found if found <= value else float(f"{(math.floor(value / unit) - 1) * unit:.6g}")


def within_interval(found: Membership, lower: float, upper: float) -> Membership:
    """Return the membership of a graph in a wider interval that was asked for.

    Raises:
        ProblemError: the graph is not shown to have its spectrum there.
    """
    if lower <= found.lower and found.upper <= upper:
        return replace(found, lower=lower, upper=upper)
    raise ProblemError(
        f"the graph is shown to have its nonzero eigenvalues in [{found.lower:.6g}, {found.upper:.6g}] ({found.graph_proof})",
        where="[network] spectrum",
        expected=f"within [{lower:g}, {upper:g}]",
        remedy="widen `spectrum`, or leave it out: then it is what the graph has",
    )
