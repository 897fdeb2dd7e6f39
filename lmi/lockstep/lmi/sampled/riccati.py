"""The discrete Riccati equation  P = A' (P^-1 - S)^-1 A + Q,  by doubling: candidates for P, in doubles.

With G = -S it is P = A' P (I + G P)^-1 A + Q, and structure-preserving doubling (Chu, Fan, Lin and Wang 2004)
finds its stabilising solution quadratically fast:

    A <- A (I + G P)^-1 A,   G <- G + A (I + G P)^-1 G A',   P <- P + A' P (I + G P)^-1 A.

It needs S alone and no factor of it. P grows towards the solution, if there is one: P^-1 > S till then, each step is positive
semidefinite, and one that is not tells that there is none. Nothing is believed: what comes back is decided elsewhere.
"""

import numpy as np
from jaxtyping import Float

DOUBLINGS = 60
"""2^60 periods: whatever has not settled by then does not settle."""

SETTLED, NEGATIVE, TOO_LARGE = 1e-12, 1e-9, 1e200
"""Of a step against P; of the least entry of its diagonal against the largest, what no rounding is, some 1e-16 times the
condition of I + G P; and where numbers end."""


def smallest_storage(
    A: Float[np.ndarray, "n n"], S: Float[np.ndarray, "n n"], Q: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"] | None:
    """Return P > 0 with P = A' (P^-1 - S)^-1 A + Q and P^-1 > S, or None where the iteration finds none.

    >>> smallest_storage(np.array([[0.5]]), np.zeros((1, 1)), np.array([[3.0]])).tolist()
    [[4.0]]
    >>> smallest_storage(np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1))) is None
    True
    """
    G, P, unit = -S, Q, np.eye(len(A))
    for _ in range(DOUBLINGS):
        try:
            middle = np.linalg.solve(unit + G @ P, np.hstack([A, G]))
        except np.linalg.LinAlgError:
            return None
        step = A.T @ P @ middle[:, : len(A)]
        largest = np.abs(step).max()
        if not largest < TOO_LARGE or step.diagonal().min() < -NEGATIVE * largest:
            return None
        G, A = G + A @ middle[:, len(A) :] @ A.T, A @ middle[:, : len(A)]
        P, G = P + (step + step.T) / 2, (G + G.T) / 2
        if largest <= SETTLED * np.abs(P).max():
            return P if _is_storage(P, S) else None
    return None


def _is_storage(P: Float[np.ndarray, "n n"], S: Float[np.ndarray, "n n"]) -> bool:
    """Tell whether P > 0 and P^-1 > S, the latter as I - L' S L > 0 with P = L L'."""
    try:
        L = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return False
    return bool(np.linalg.eigvalsh(L.T @ S @ L)[-1] < 1)
