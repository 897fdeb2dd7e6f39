"""What a constant disturbance does in the end: controllers may leave it more room than none do."""

import contextlib

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import as_floats, exactly, inverse
from lockstep.check.system.loop import Gains, Loop


def static_response(loop: Loop, gains: Gains) -> Float[np.ndarray, "n n"]:
    """Return how far a constant xi of each state's equation (columns) moves each state apart (rows), over that for u = 0.

    Of the linear loop, in doubles: the gain from xi - mean to x - mean, |G(0)| = |A_cl^-1|, in the norm over the agents. 0
    where either is not stable, where xi moves nothing then, and on the diagonal: what a state's own equation leaves of it is
    the rate of another (theta' = omega), but for agents of one state.
    """
    A, N, A_cl = loop.plant.A, loop.d.N, loop.A_cl(gains.blocks)
    n = len(A)
    if max(np.linalg.eigvals(one).real.max() for one in (A, A_cl)) < 0:
        with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError, ZeroDivisionError):
            moved = np.linalg.solve(A_cl, loop.E)[: n * (N - 1)].reshape(N - 1, n, N - 1, n)
            onto = (np.eye(N) - 1 / N) @ loop.d.right
            of_agents = np.einsum("ab,bjck,cd->ajdk", onto, moved, loop.d.T, optimize=True)
            closed = np.linalg.norm(of_agents, 2, axis=(0, 2))
            free = as_floats(inverse(exactly(A)))  # what moves nothing is an exact 0
            known = np.abs(free) > 1e-9 * (np.abs(free) @ np.abs(A) @ np.abs(free))  # else a rounding of 0
            known &= (n == 1) | ~np.eye(n, dtype=bool)
            return np.nan_to_num(np.where(known, closed / np.abs(free), 0.0))
    return np.zeros((n, n))
