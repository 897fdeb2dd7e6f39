"""Random small problems: no lower bound that is printed is above a rho that is certified.

    python benchmarks/floors.py [--count 1000] [--first 0] [--jobs 2] [--time-limit 3]

Problem i is drawn from the seed i alone: two or three agents of one or two states, controllers with at most one state, one
output more than is needed now and then, as in the counterexample that showed a floor of a solver's error (three agents
x' = u + x on a cycle, outputs x, 2x, -3x). The bound is decided by the checker before it is printed, so that one above a
certified rho is a wrong proof; the least ratio of rho to the bound says how sharp the test is.
"""

import argparse
import collections
import math
import sys
from typing import Any

import joblib
import numpy as np

from lockstep.check.errors import LockstepError
from lockstep.lmi.design import design
from lockstep.model.problem import Problem

TERMS = ["sin({0})", "tanh({0})", "atan({0})", "sqrt(1 + ({0})**2)", "abs({0})", "cos({0})"]
CLOSE = 1.001
"""A rho of at most so many times the bound: there the bound is put to the test."""


def draw(index: int) -> dict[str, Any]:
    """Return problem `index`."""
    rng = np.random.default_rng(index)
    n, N, order = (int(rng.integers(*span)) for span in ((1, 3), (2, 4), (0, 2)))
    states = [f"x{k + 1}" for k in range(n)]

    def row(values: Any) -> str:
        return " + ".join(f"({value:.3f})*{state}" for value, state in zip(values, states, strict=True))

    dynamics = {state: row(rng.normal(size=n)) for state in states}
    dynamics[states[-1]] += " + u"
    if rng.random() < 0.6:
        term = TERMS[int(rng.integers(len(TERMS)))].format(states[int(rng.integers(n))])
        dynamics[states[int(rng.integers(n))]] += f" + ({rng.normal(scale=0.4):.3f})*{term}"
    outputs = {f"y{k + 1}": row(rng.normal(size=n)) for k in range(int(rng.integers(1, 4)))}
    outputs |= {"y": states[0]} if rng.random() < 0.5 else {}
    return {
        "agent": {"name": "a", "states": states, "inputs": ["u"], "dynamics": dynamics, "outputs": outputs},
        "network": {"agents": N, "topology": ["cycle", "ring", "leader_path"][int(rng.integers(3))]},
        "design": {
            "order": order,
            "starts": 2,
            "gain_limit": float(10.0 ** rng.uniform(0.5, 2)),
            "weights": {"input": [0.0, 0.01, 1.0][int(rng.integers(3))]},
            "disturbances": {"states": 1.0, "outputs": [0.0, 0.01][int(rng.integers(2))]},
        },
        "controller": {"period": 0.001},
    }


def run(index: int, time_limit: float) -> tuple[int, str, float]:
    """Design one; return its index, the outcome, and rho over the bound."""
    try:
        found = design(Problem.from_document(draw(index)), jobs=1, time_limit=time_limit)
    except LockstepError as error:
        return index, type(error).__name__, math.nan
    c, floor = found.certificate, found.floor
    if c is None or floor is None:
        return index, "no bound", math.nan
    return index, "bound", c.rho / floor.rho


def main() -> int:
    """Run them, print the outcomes, and each bound that is above a certified rho."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--time-limit", type=float, default=3.0)
    options = parser.parse_args()
    indices = range(options.first, options.first + options.count)
    found = joblib.Parallel(options.jobs, return_as="generator")(
        joblib.delayed(run)(index, options.time_limit) for index in indices
    )
    outcomes, ratios, wrong = collections.Counter[str](), list[float](), 0
    for index, outcome, ratio in found:
        outcomes[outcome] += 1
        ratios += [ratio] if math.isfinite(ratio) else []
        if ratio < 1:
            wrong += 1
            print(f"problem {index}: rho is {ratio} of what is said to be a lower bound", flush=True)
        if sum(outcomes.values()) % 50 == 0:
            print(
                dict(outcomes),
                f"{wrong} wrong, least rho / bound {min(ratios, default=math.nan):.9f}",
                flush=True,
            )
    near = sum(ratio <= CLOSE for ratio in ratios)
    print(dict(outcomes), f"{wrong} wrong; rho within {CLOSE} of the bound in {near} of {len(ratios)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
