"""The limit of the gains: |K_i / L| <= 1 for each agent, entry by entry and in the spectral norm.

L is a number, which is the limit of |K_i|, or holds one for each entry: its unit times how many of it are allowed. The
unit is then L over that norm which gains have whose entries are all one.
"""

import numpy as np

from lockstep.lmi.shapes import GainBlocks, GainLimit


def limit_in_units(limit: GainLimit) -> float:
    """Return how many units a limit is: its number; where each entry has its own, the norm of gains that are all one."""
    return float(limit) if np.ndim(limit) == 0 else float(np.sqrt(np.size(limit)))


def limit_text(limit: GainLimit) -> str:
    """Return what a limit is, for people."""
    return f"gain_limit {limit:g}" if np.ndim(limit) == 0 else "gain_limit, in [design.gain_units],"


def limited(K: GainBlocks, limit: GainLimit) -> GainBlocks:
    """Return gains of which those of agents that exceed the limit are scaled down to it."""
    norms = np.linalg.norm(K / limit, 2, axis=(1, 2))
    return np.asarray(K * np.minimum(1.0, 1 / np.maximum(norms, 1e-300))[:, None, None])


def limit_barrier(K: GainBlocks, limit: GainLimit) -> tuple[float, GainBlocks] | None:
    """Return - sum_i log det (I - (K_i / L) (K_i / L)') and its slope; None outside."""
    scaled = K / limit
    room = np.eye(K.shape[1]) - scaled @ scaled.swapaxes(1, 2)
    try:
        root = np.linalg.cholesky(room)
    except np.linalg.LinAlgError:
        return None
    value = -2 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
    return value, 2 * np.linalg.solve(room, scaled) / limit
