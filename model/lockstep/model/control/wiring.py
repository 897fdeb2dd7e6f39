"""Linear systems of one time base joined by the names of their signals, exactly.

`control.interconnect` joins linear systems by differencing them, which leaves an error of 1e-9; poles to 1e-12 need the
matrices. With all parts side by side, x+ = A x + B v, y = C x + D v, and v = K y + E w by names,

    x+ = (A + B K R C) x + B (E + K R D E) w,    y = R (C x + D E w),    R = (I - D K)^-1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand


@dataclass(frozen=True, eq=False)
class JoinedSystem:
    """One system: its matrices, the names of its signals, and its dt in s."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m"]
    C: Float[np.ndarray, "p n"]
    D: Float[np.ndarray, "p m"]
    states: list[str]
    inputs: list[str]
    outputs: list[str]
    dt: float


def joined_systems(parts: Sequence[Any]) -> JoinedSystem:
    """Return systems of one time base as one: inputs that none of them gives, all outputs.

    Raises:
        ProblemError: a part that is no `control.StateSpace`, or an algebraic loop without a solution.
    """
    import control
    from scipy.linalg import block_diag

    for part in parts:
        found = f"a {type(part).__name__}"
        expected = "control.StateSpace systems"
        remedy = "control.ss makes one; a nonlinear one is linearised with control.linearize"
        demand(isinstance(part, control.StateSpace), found, "linear loop", expected, remedy)
    A, B, C, D = (_diagonal(block_diag, parts, letter) for letter in "ABCD")
    into = [name for part in parts for name in part.input_labels]
    out = [name for part in parts for name in part.output_labels]
    free = list(dict.fromkeys(name for name in into if name not in out))
    K = np.array([[float(name == source) for source in out] for name in into]).reshape(len(into), len(out))
    E = np.array([[float(name == source) for source in free] for name in into]).reshape(len(into), len(free))
    loop = np.eye(len(out)) - D @ K
    found = "an algebraic loop without a solution"
    demand(np.linalg.matrix_rank(loop) >= len(out), found, "linear loop", "I - D K invertible")
    R = np.linalg.inv(loop) if (D @ K).any() else loop
    states = [f"{name}" for part in parts for name in part.state_labels]
    return JoinedSystem(
        A + B @ K @ R @ C,
        B @ (E + K @ R @ D @ E),
        R @ C,
        R @ D @ E,
        states,
        free,
        out,
        float(parts[0].dt or 0),
    )


def _diagonal(block_diag: Any, parts: Sequence[Any], letter: str) -> np.ndarray:
    rows = {"A": "nstates", "B": "nstates", "C": "noutputs", "D": "noutputs"}[letter]
    columns = {"A": "nstates", "B": "ninputs", "C": "nstates", "D": "ninputs"}[letter]
    blocks = [
        np.reshape(getattr(part, letter), (getattr(part, rows), getattr(part, columns))) for part in parts
    ]
    return np.asarray(block_diag(*blocks), dtype=float)
