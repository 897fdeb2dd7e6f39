"""The compiled loop against `control.input_output_response` on the arms: the same data, at the same error, in what time."""

import argparse
import json
import statistics
import sys
import time
from pathlib import Path

import control
import numpy as np

import lockstep

ARMS = Path(__file__).parents[2] / "generated" / "flexible_joint_arms"
HORIZON, STEP = 5.0, 0.005


def timed(run, repeats: int) -> tuple[float, object]:
    """The median of the processor's seconds that a run takes, and what it returns."""
    seconds = []
    for _ in range(repeats):
        begin = time.process_time()
        found = run()
        seconds.append(time.process_time() - begin)
    return statistics.median(seconds), found


def measure(repeats: int) -> dict[str, float]:
    design = lockstep.load(ARMS)
    start = np.linspace(-0.8, 0.9, 12).reshape(3, 4)
    system, state = design.to_control(), np.concatenate([start.ravel(), np.zeros(6)])
    begin = time.perf_counter()
    design.response(HORIZON, start, step=STEP)
    first = time.perf_counter() - begin
    ours, found = timed(lambda: design.response(HORIZON, start, step=STEP), repeats)
    t = found.time
    xi = np.zeros((12, len(t)))

    def theirs(rtol: float):
        options = {"rtol": rtol, "atol": rtol}
        return control.input_output_response(system, t, xi, state, solve_ivp_kwargs=options)

    exact = theirs(1e-11).states
    answer = {"compile_and_run_s": first, "run_s": ours, "error": float(abs(found.states - exact).max())}
    for rtol in 10.0 ** -np.arange(3, 11, 0.5):
        seconds, other = timed(lambda rtol=rtol: theirs(rtol), 3)
        answer |= {
            "control_s": seconds,
            "control_rtol": rtol,
            "control_error": float(abs(other.states - exact).max()),
        }
        if answer["control_error"] <= answer["error"]:
            break
    return answer | {"ratio": answer["control_s"] / ours}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(options.repeats)
    said = (
        json.dumps(found)
        if options.json
        else "\n".join(f"{name:20} {value:.4g}" for name, value in found.items())
    )
    sys.stdout.write(said + "\n")


if __name__ == "__main__":
    main()
