"""Section 2 and (13), (14): what the paper says about graphs and about removing a row of L."""

import numpy as np
from flint import fmpq_mat
from jaxtyping import Float

from amini.claims.claim import Finding, PaperClaim
from amini.claims.example import cycle
from lockstep.check.numbers import exactly
from lockstep.model.graphs.graph import Graph


def _rank(matrix: Float[np.ndarray, "a b"]) -> int:
    return int(fmpq_mat(exactly(np.asarray(matrix, dtype=float)).tolist()).rank())


def _direction() -> Finding:
    listens = Graph.topology("star", 4)
    other = Graph(listens.adjacency.T)
    ranks = _rank(listens.laplacian), _rank(other.laplacian)
    return Finding(
        f"star of 4: rank L = {ranks[0]} by one reading, {ranks[1]} by the other; consensus needs 3",
        ranks == (3, 1),
    )


def _simple_zero() -> Finding:
    L = cycle().laplacian
    zero_rows = not (L @ np.ones(3)).any()
    return Finding(f"L 1 = 0 and rank L = {_rank(L)} for (39), exactly", zero_rows and _rank(L) == 2)


def _positive_eigenvalues() -> Finding:
    # The cycle's L is I minus a rotation of order 3, so its eigenvalues are 1 - exp(2 pi i k / 3).
    values = np.linalg.eigvals(cycle().laplacian)
    worst = values[np.argmax(values.imag)]
    return Finding(
        f"true of undirected graphs; (39) is directed, and has {worst.real:.4g} +- {worst.imag:.3g}i",
        bool(np.abs(worst - (1.5 + 0.75**0.5 * 1j)) < 1e-12),
    )


def _relative_states() -> Finding:
    L = Graph.from_edges(4, [[1, 2], [2, 1], [3, 4], [4, 3]]).laplacian
    apart = np.array([0.0, 0.0, 1.0, 1.0])
    return Finding(
        f"two separate pairs: L x = 0 for x = (0, 0, 1, 1), rank L = {_rank(L)}; true when rank L = N - 1",
        not (L @ apart).any() and _rank(L) == 2,
    )


def _any_row() -> Finding:
    L = Graph.topology("leader_path", 3).laplacian
    ranks = [_rank(np.delete(L, row, axis=0)) for row in range(3)]
    return Finding(
        f"leader, follower, follower: rank {ranks[0]} without the leader's row, {max(ranks[1:])} without a follower's;"
        " 2 is needed",
        ranks == [2, 1, 1],
    )


CLAIMS = (
    PaperClaim(
        "edge-direction",
        "Section 2, E and N_i",
        "The edge set and the neighbour sets define one directed graph.",
        "underdetermined",
        _direction,
    ),
    PaperClaim(
        "simple-zero",
        "Section 2, (1), (39)",
        "Zero is a simple eigenvalue of the Laplacian, with the vector of ones.",
        "proved",
        _simple_zero,
    ),
    PaperClaim(
        "positive-eigenvalues",
        "Section 2, (39)",
        "All other eigenvalues are positive numbers: said of connected undirected graphs; and of (39)?",
        "refuted",
        _positive_eigenvalues,
    ),
    PaperClaim(
        "relative-states",
        "(13)",
        "When L_n x tends to zero, the agents agree, whatever the graph.",
        "refuted",
        _relative_states,
    ),
    PaperClaim(
        "any-row",
        "(14)",
        "Removing one of the rows of L leaves N - 1 independent ones.",
        "refuted",
        _any_row,
    ),
)
