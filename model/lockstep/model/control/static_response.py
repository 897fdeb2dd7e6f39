"""What a constant disturbance does in the end: controllers may leave it more room than none do."""

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lockstep.check.numbers import as_floats, exactly, inverse
from lockstep.check.system.loop import Gains, Loop


def static_response(loop: Loop, gains: Gains, outputs: Float[np.ndarray, "q n"]) -> Float[np.ndarray, "q n"]:
    """Return how far a constant xi of each state's equation (columns) moves each output (rows) apart, over that for u = 0.

    Of the linear loop, in doubles: the gain from xi - mean to outputs (x - mean), |G(0)| = |outputs A_cl^-1|, in the norm
    over the agents. NaN where A or A_cl is not stable, where xi moves nothing for u = 0, and for xi of a state that is the
    integral of another alone (theta' = omega), which no load enters.
    """
    A, n, N, A_cl = loop.plant.A, len(loop.plant.A), loop.d.N, loop.A_cl(gains.blocks)
    if max(np.linalg.eigvals(one).real.max() for one in (A, A_cl)) < 0:
        with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError, ZeroDivisionError):
            moved = np.linalg.solve(A_cl, loop.E)[: n * (N - 1)].reshape(N - 1, n, N - 1, n)
            onto = (np.eye(N) - 1 / N) @ loop.d.right
            of_agents = np.einsum("ab,ij,bjck,cd->aidk", onto, outputs, moved, loop.d.T, optimize=True)
            closed = np.linalg.norm(of_agents, 2, axis=(0, 2))
            free = as_floats(inverse(exactly(A)))  # what moves nothing is an exact 0, or a rounding
            alone = outputs @ free
            known = np.abs(alone) > 1e-9 * np.abs(outputs) @ np.abs(free) @ np.abs(A) @ np.abs(free)
            driven = np.column_stack([A, loop.plant.G, *loop.plant.B]) != 0
            known &= (driven.sum(axis=1) > 1) | np.diag(driven[:, :n])
            times = closed / np.abs(alone)
            return np.where(known & np.isfinite(times), times, np.nan)
    return np.full((len(outputs), n), np.nan)


def softest(
    loop: Loop,
    gains: Gains,
    outputs: Sequence[str],
    states: Sequence[str],
    disturbed: Bool[np.ndarray, " n"],
) -> dict[str, Any] | None:
    """Return by how many times a load that stays moves agents further apart than u = 0 lets it: the load that does most.

    Of what a load reaches for u = 0, the output that moves least counts: what carries the load, such as a motor's current,
    has to move. Of the states, where no load reaches an output; None where none reaches these, or nothing is stable.

    Args:
        loop, gains: of the network.
        outputs, states: names.
        disturbed: which states' equations loads enter.
    """
    for names in (outputs, states):
        times = static_response(loop, gains, loop.plant.C if names is outputs else np.eye(len(states)))
        if loads := [j for j, there in enumerate(disturbed) if there and not np.isnan(times[:, j]).all()]:
            j = max(loads, key=lambda load: np.nanmin(times[:, load]))
            i = int(np.nanargmin(times[:, j]))
            return {"of": states[j], "moves": names[i], "times": float(times[i, j])}
    return None
