"""A trajectory as others read it: python-control's time response, a pandas table."""

from typing import Any

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.model.simulation.results.table import columns
from lockstep.model.simulation.results.trajectory import Trajectory


def to_time_response(trajectory: Trajectory) -> Any:
    """Return a run as `control.TimeResponseData`: inputs xi_i, outputs x_i, y_i, u_i, states x_i and x_C, by name.

    What `control.input_output_response` returns of `network.to_control(gains)`.
    """
    import control

    who = [f"{trajectory.agent}{i + 1}_" for i in range(trajectory.N)]
    beside = [f"y_{y}" if y in trajectory.state_names else y for y in trajectory.output_names]
    memory = [f"controller_x{k + 1}" for k in range(trajectory.x_C.shape[2])]

    def named(signals: "list[str] | tuple[str, ...]") -> list[str]:
        return [agent + signal for agent in who for signal in signals]

    states = named(trajectory.state_names)
    inputs = named([f"xi_{name}" for name in trajectory.state_names])
    outputs = states + named(beside) + named(trajectory.input_names)
    kept = states + named(memory)

    def rows(*signals: np.ndarray) -> np.ndarray:
        return np.vstack([signal.reshape(len(signal), -1).T for signal in signals])

    return control.TimeResponseData(
        trajectory.t,
        rows(trajectory.x, trajectory.y, trajectory.u),
        rows(trajectory.x, trajectory.x_C),
        rows(trajectory.xi),
        issiso=False,
        input_labels=inputs,
        output_labels=outputs,
        state_labels=kept,
        sysname=f"{trajectory.agent}_network",
        title=f"Response of {trajectory.agent}_network",
    )


def to_pandas(trajectory: Trajectory) -> Any:
    """Return a run as a `pandas.DataFrame`, indexed by t, a column for each signal, as in the CSV.

    Raises:
        ProblemError: pandas is not there.
    """
    try:
        import pandas
    except ImportError:
        raise ProblemError(
            "pandas is not installed",
            where="to_pandas",
            remedy='install it: pip install "lockstep-control[notebook]"',
        ) from None
    found = columns(trajectory)
    t = found.pop("t")
    return pandas.DataFrame(found, index=pandas.Index(t, name="t"))
