"""A trajectory as a table of text: one row per instant, one named column per signal, numbers that read back."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.model.simulation.results.trajectory import Trajectory


def columns(trajectory: Trajectory) -> dict[str, Float[np.ndarray, " K"]]:
    """Return every signal by name: `<agent><i>_<signal>`, as for python-control; `y_` before an output named as a state.

    The time comes first, then the disagreement |x_d|, then agent by agent x, x_C, u, y, xi.
    """
    found = {"t": trajectory.t, "disagreement": trajectory.disagreement()}
    for i in range(trajectory.N):
        for signal, names in signals(trajectory).values():
            found |= {f"{trajectory.agent}{i + 1}_{name}": signal[:, i, k] for k, name in enumerate(names)}
    return found


def signals(trajectory: Trajectory) -> dict[str, tuple[Float[np.ndarray, "K N k"], Sequence[str]]]:
    """Return x, x_C, u, y and xi of all agents, each with the names of one agent's."""
    states = trajectory.state_names
    outputs = [f"y_{name}" if name in states else name for name in trajectory.output_names]
    memory = [f"controller_x{k + 1}" for k in range(trajectory.x_C.shape[2])]
    return {
        "x": (trajectory.x, states),
        "x_C": (trajectory.x_C, memory),
        "u": (trajectory.u, trajectory.input_names),
        "y": (trajectory.y, outputs),
        "xi": (trajectory.xi, [f"xi_{name}" for name in states]),
    }


def to_csv(trajectory: Trajectory) -> str:
    """Return the table as CSV, each number in the shortest form that reads back to the same double."""
    found = columns(trajectory)
    rows = (",".join(map(repr, row)) for row in np.column_stack(list(found.values())).tolist())
    return "\n".join([",".join(found), *rows, ""])
