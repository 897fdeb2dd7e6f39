"""A trajectory as others read it: python-control's time response, a pandas table."""

from typing import Any

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.model.simulation.results.table import columns, signals
from lockstep.model.simulation.results.trajectory import Trajectory


def to_time_response(trajectory: Trajectory) -> Any:
    """Return a run as `control.TimeResponseData`: inputs xi_i, outputs x_i, y_i, u_i, states x_i and x_C, by name.

    What `control.input_output_response` returns of `network.to_control(gains)`.
    """
    import control

    groups, who = signals(trajectory), [f"{trajectory.agent}{i + 1}_" for i in range(trajectory.N)]

    def labels(*letters: str) -> list[str]:
        return [agent + name for letter in letters for agent in who for name in groups[letter][1]]

    def rows(*letters: str) -> np.ndarray:
        return np.vstack([groups[letter][0].reshape(len(trajectory.t), -1).T for letter in letters])

    return control.TimeResponseData(
        trajectory.t,
        rows("x", "y", "u"),
        rows("x", "x_C"),
        rows("xi"),
        issiso=False,
        input_labels=labels("xi"),
        output_labels=labels("x", "y", "u"),
        state_labels=labels("x", "x_C"),
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
    return pandas.DataFrame(found, index=pandas.Index(found.pop("t"), name="t"))
