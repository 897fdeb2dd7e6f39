"""Norms of a loop with sampled parts, from L2 to L2, with what happens between the samples.

With z' = F z + G w and the output e = H z in between, the energy of e that w can force in a time h is a step

    max over w of x(h)' P x(h) + int (|e|^2 - gamma^2 |w|^2) dt:      (Phi, S, Q) as in `lockstep.check.sampled.lifting`,

and two steps after each other are one (Anderson 1978's doubling; the maximum is finite while S_1 Q_2 has its eigenvalues
below 1):

    Phi = Phi_2 R Phi_1,   S = S_2 + Phi_2 R S_1 Phi_2',   Q = Q_1 + Phi_1' Q_2 R Phi_1,   R = (I - S_1 Q_2)^-1.

Doubled until Phi vanishes, it decides whether the norm is below gamma; a bisection finds it. The H2 norm is that of Bamieh
and Pearson (1992): impulses at every time of a period, the mean of their energies.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lockstep.check.sampled.lifting import lift

ACCURACY = 1e-9
"""Of the bisection, relative."""

Piece = tuple[np.ndarray, float]
"""A jump z+ = J z, and the time in s until the next."""

MOST_DOUBLINGS = 60
"""Of the horizon: 2^60 periods."""


class _Step(NamedTuple):
    Phi: np.ndarray
    S: np.ndarray
    Q: np.ndarray


def l2_gain(F: np.ndarray, G: np.ndarray, H: np.ndarray, pieces: Sequence[Piece]) -> float:
    """Return the L2-induced norm from w to e of a stable loop, by bisection.

    Args:
        F, G, H: z' = F z + G w, e = H z between the jumps.
        pieces: of one period.

    >>> one = np.eye(1)
    >>> round(l2_gain(-one, one, one, [(one, 0.1)]), 6)          # |1/(s + 1)| at 0
    1.0
    """
    if not G.any() or not H.any():
        return 0.0
    low, high = 0.0, 1.0
    while not _below(pieces, F, G, H, high):
        low, high = high, 4 * high
        if high > 1e12:
            return float("inf")
    while high - low > ACCURACY * high:
        middle = (low + high) / 2
        low, high = (low, middle) if _below(pieces, F, G, H, middle) else (middle, high)
        if high < 1e-12:
            return 0.0
    return high


def _below(pieces: Sequence[Piece], F: np.ndarray, G: np.ndarray, H: np.ndarray, gamma: float) -> bool:
    """Whether the norm is below gamma."""
    step: _Step | None = None
    for jump, length in pieces:
        held = _held(F, G, H / gamma, length)
        if held is None:
            return False
        now = _Step(held.Phi @ jump, held.S, jump.T @ held.Q @ jump)
        step = now if step is None else _after(step, now)
        if step is None:
            return False
    for _ in range(MOST_DOUBLINGS):
        assert step is not None
        if np.linalg.norm(step.Phi) < 1e-12:
            return True
        step = _after(step, step)
        if step is None:
            return False
    return True


def _held(F: np.ndarray, G: np.ndarray, H: np.ndarray, length: float) -> _Step | None:
    """Return the step of one interval, put together from pieces too short for a conjugate point."""
    from scipy.linalg import expm

    size = np.linalg.norm(F, 2)
    gain = np.linalg.norm(G, 2) * np.linalg.norm(H, 2)
    halvings = 0
    while (h := length / 2**halvings) * size > 1 or gain * h * np.exp(size * h) > 0.5:
        halvings += 1
    lifted = lift(F, np.zeros((len(F), 0)), G @ G.T, H.T @ H, h, expm)
    step: _Step | None = _Step(lifted.A_d, lifted.BB_d, lifted.CC_d)
    for _ in range(halvings):
        step = None if step is None else _after(step, step)
    return step


def _after(first: _Step, second: _Step) -> _Step | None:
    """Return two steps as one, or None where w can force more than any bound."""
    coupling = first.S @ second.Q
    if max(np.linalg.eigvals(coupling).real, default=0.0) >= 1:
        return None
    inner = np.linalg.inv(np.eye(len(coupling)) - coupling)
    S = second.S + second.Phi @ inner @ first.S @ second.Phi.T
    Q = first.Q + first.Phi.T @ second.Q @ inner @ first.Phi
    return _Step(second.Phi @ inner @ first.Phi, (S + S.T) / 2, (Q + Q.T) / 2)


def h2(F: np.ndarray, G: np.ndarray, H: np.ndarray, pieces: Sequence[Piece]) -> float:
    """Return the H2 norm of a stable loop: root of (1/T) int_0^T |response to impulses at tau|^2 dtau; see `l2_gain`."""
    whole, cost = np.eye(len(F)), np.zeros_like(F)
    steps = [(jump, *_energy(F, G, H, length)) for jump, length in pieces]
    for jump, Phi, W, _, _ in reversed(steps):
        cost = jump.T @ (W + Phi.T @ cost @ Phi) @ jump
        whole = whole @ Phi @ jump
    from scipy.linalg import solve_discrete_lyapunov

    X = solve_discrete_lyapunov(whole.T, cost)
    total = 0.0
    for jump, Phi, W, inside, reached in reversed(steps):
        total += inside + float(np.trace(X @ reached))
        X = jump.T @ (W + Phi.T @ X @ Phi) @ jump
    return float(np.sqrt(total / sum(length for _, length in pieces)))


def _energy(
    F: np.ndarray, G: np.ndarray, H: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Return e^(F h), int e^(F't) H'H e^(F t), the energy of impulses inside the interval, and int e^(F t) G G' e^(F't)."""
    from scipy.linalg import expm

    n, zero = len(F), np.zeros_like(F)
    Phi = expm(F * h)
    # exp of [-F' H'H; 0 F] h has the last column (e^(-F'h) W, e^(F h)) (Van Loan 1978).
    seen = expm(np.block([[-F.T, H.T @ H], [zero, F]]) * h)
    W = Phi.T @ seen[:n, n:]
    nodes, weights = np.polynomial.legendre.leggauss(20)
    inside = 0.0
    for node, weight in zip((nodes + 1) * h / 2, weights * h / 2, strict=True):
        part = expm(np.block([[-F.T, H.T @ H], [zero, F]]) * node)
        inside += weight * float(np.trace(G.T @ (part[n:, n:].T @ part[:n, n:]) @ G))
    driven = expm(np.block([[-F, G @ G.T], [zero, F.T]]) * h)
    return Phi, W, inside, driven[n:, n:].T @ driven[:n, n:]
