"""Tustin's rule and its slopes: the discrete controllers that ship as functions of the gains in a design file.

    [A_d B_d; C_d D_d] = tustin(K, T),    K = [A B; C D],    E = (I - A T/2)^-1,
    A_d = 2 E - I,   B_d = T E B,   C_d = C E,   D_d = D + T/2 C E B,

one to one wherever I - A T/2 is regular and A_d has no eigenvalue -1: any discrete controller is reached. All agents at
once, one block after the other.
"""

import numpy as np
from jaxtyping import Float

from lockstep.lmi.shapes import GainBlocks


def tustin(K: GainBlocks, order: int, period: float) -> GainBlocks:
    """Return [A_d B_d; C_d D_d] of every agent.

    >>> tustin(np.array([[[-1.0, 1.0], [1.0, 0.0]]]), 1, 0.5).round(12).tolist()
    [[[0.6, 0.4], [0.8, 0.2]]]

    Raises:
        numpy.linalg.LinAlgError: I - A T/2 is singular.
    """
    A, B, C, D = split_gains(K, order)
    E = np.linalg.inv(np.eye(order) - A * (period / 2))
    EB = E @ B
    return stacked_gains(2 * E - np.eye(order), period * EB, C @ E, D + period / 2 * C @ EB)


def pulled_back(K: GainBlocks, slope: GainBlocks, order: int, period: float) -> GainBlocks:
    """Return the slope in K of a function with the given slope in tustin(K, T)."""
    A, B, C, _ = split_gains(K, order)
    g_A, g_B, g_C, g_D = split_gains(slope, order)
    half = period / 2
    E = np.linalg.inv(np.eye(order) - A * half)
    B_t, C_t, E_t = (block.swapaxes(1, 2) for block in (B, C, E))
    g_E = 2 * g_A + period * g_B @ B_t + C_t @ g_C + half * C_t @ g_D @ B_t
    return stacked_gains(
        half * E_t @ g_E @ E_t, E_t @ (period * g_B + half * C_t @ g_D), (g_C + half * g_D @ B_t) @ E_t, g_D
    )


def split_gains(
    K: GainBlocks, n: int
) -> tuple[
    Float[np.ndarray, "N n n"],
    Float[np.ndarray, "N n q"],
    Float[np.ndarray, "N m n"],
    Float[np.ndarray, "N m q"],
]:
    """Return A, B, C, D of every agent."""
    return K[:, :n, :n], K[:, :n, n:], K[:, n:, :n], K[:, n:, n:]


def stacked_gains(
    A: Float[np.ndarray, "N n n"],
    B: Float[np.ndarray, "N n q"],
    C: Float[np.ndarray, "N m n"],
    D: Float[np.ndarray, "N m q"],
) -> GainBlocks:
    """Return [A B; C D] of every agent."""
    return np.concatenate([np.concatenate([A, B], axis=2), np.concatenate([C, D], axis=2)], axis=1)
