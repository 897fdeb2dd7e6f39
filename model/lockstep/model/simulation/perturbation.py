"""Gain errors Delta(t) of (11), one block [Delta A_C, Delta B_C; Delta C_C, Delta D_C] per agent.

The paper simulates (Section 4, the same for all agents)

    Delta A_C = 0.5 [sin 3t, sin 5t; sin 2t, cos 2t],   Delta B_C = 0.2 [sin 2t; cos 2t],
    Delta C_C = 0.2 [cos t, sin 4t],                    Delta D_C = 0.2 sin t.

Delta B_C and Delta D_C are printed for one output; for q outputs their column is repeated here, as the claims ledger
does. As printed they exceed (11): |Delta A_C| reaches 0.83 with delta_A = 0.5. `scaled` divides each block by what it
exceeds its bound by, at each instant, so that a certificate for delta covers the run.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand

PAPER_DELTA: Mapping[str, float] = {"A": 0.5, "B": 0.2, "C": 0.2, "D": 0.2}
"""(delta_A, delta_B, delta_C, delta_D) of Section 4."""


class Perturbation(Protocol):
    """What a run asks of a perturbation: Delta at times t, each within the step of the run that begins at `since`."""

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N k l"]:
        """Return [Delta A, Delta B; Delta C, Delta D] of every agent."""
        ...


@dataclass(frozen=True)
class PaperPerturbation:
    """Delta(t) of Section 4 for N agents with two controller states, one input and q outputs."""

    N: int
    q: int
    scaled: bool = False

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N k l"]:  # noqa: ARG002
        """Return the errors; `since` does not matter."""
        sin, cos = np.sin, np.cos
        block = np.zeros((len(t), 3, 2 + self.q))
        both = np.array([[sin(3 * t), sin(5 * t)], [sin(2 * t), cos(2 * t)]])
        block[:, :2, :2] = 0.5 * both.transpose(2, 0, 1)
        block[:, :2, 2:] = 0.2 * np.array([sin(2 * t), cos(2 * t)]).T[:, :, None]
        block[:, 2, :2] = 0.2 * np.array([cos(t), sin(4 * t)]).T
        block[:, 2:, 2:] = 0.2 * sin(t)[:, None, None]
        if self.scaled:
            _scale_to(block, 2, PAPER_DELTA)
        return np.repeat(block[:, None], self.N, axis=1)


@dataclass(frozen=True, eq=False)
class HeldPerturbation:
    """Given errors (M, N, k, l), each held for `interval` s, the last one for good."""

    values: Float[np.ndarray, "M N k l"]
    interval: float = math.inf

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N k l"]:  # noqa: ARG002
        """Return the errors that are held during the step."""
        index = np.floor(since / self.interval + 1e-9).astype(int)
        return np.asarray(self.values[np.clip(index, 0, len(self.values) - 1)])


def random_perturbation(
    N: int,
    sizes: tuple[int, int, int],
    delta: Mapping[str, float],
    seed: int,
    *,
    interval: float = math.inf,
    horizon: float = 0.0,
) -> HeldPerturbation:
    """Return errors drawn at the bound (11): every singular value of every block is its delta.

    Args:
        N: agents.
        sizes: (n_C, m, q).
        delta: delta_A, delta_B, delta_C, delta_D by letter.
        seed: of NumPy's default generator.
        interval, horizon: draw anew every `interval` s of `horizon` s; by default once.
    """
    n_C, m, q = sizes
    draws = 1 if math.isinf(interval) else max(1, math.ceil(horizon / interval - 1e-9))
    generator = np.random.default_rng(seed)
    gaussian = generator.standard_normal((draws, N, n_C + m, n_C + q))
    for letter, place in places(n_C).items():
        block = gaussian[:, :, *place]
        if block.size:
            u, _, v = np.linalg.svd(block, full_matrices=False)
            gaussian[:, :, *place] = delta[letter] * u @ v
    return HeldPerturbation(gaussian, interval)


def places(n_C: int) -> dict[str, tuple[slice, slice]]:
    """Return where A, B, C and D are in a gain block."""
    first, rest = slice(0, n_C), slice(n_C, None)
    return {"A": (first, first), "B": (first, rest), "C": (rest, first), "D": (rest, rest)}


def norms(block: Float[np.ndarray, "*rest k l"], n_C: int) -> dict[str, float]:
    """Return the largest spectral norm of each part of a stack of errors."""
    found = {letter: block[..., rows, columns] for letter, (rows, columns) in places(n_C).items()}
    return {
        letter: float(np.linalg.norm(part, 2, axis=(-2, -1)).max()) if part.size else 0.0
        for letter, part in found.items()
    }


def check_sizes(perturbation: Perturbation, N: int, shape: tuple[int, int]) -> None:
    """Refuse a perturbation for other controllers."""
    zero = np.zeros(1)
    found = perturbation.at(zero, zero).shape[1:]
    expected = f"{N} x {shape[0]} x {shape[1]}: agents, n_C + m, n_C + q"
    demand(found == (N, *shape), f"gain errors of {' x '.join(map(str, found))}", "perturbation", expected)


def _scale_to(block: Float[np.ndarray, "M k l"], n_C: int, delta: Mapping[str, float]) -> None:
    for letter, (rows, columns) in places(n_C).items():
        part = block[:, rows, columns]
        excess = np.maximum(np.linalg.norm(part, 2, axis=(1, 2)) / delta[letter], 1.0)
        part /= excess[:, None, None]
