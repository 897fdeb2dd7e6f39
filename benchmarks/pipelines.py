"""Random problems through the whole pipeline: every failure has a type, and no certified loop diverges.

    python benchmarks/pipelines.py [--count 1000] [--first 0] [--jobs 2] [--time-limit 10]

Problem i is drawn from the seed i alone: random agents (linear parts, nonlinear terms, boxes, scales of time from hours to
milliseconds), graphs, specifications, controllers; one in four has a mistake in it. It is written as a file, designed, proved
again by the checker, written as C, verified on the host (one in ten), and simulated without a disturbance and with noise.
The outcome is one of

    refused      the file is bad: a ProblemError        none found   no gains, or no certificate: a ClaimError
    certified    the continuous loop                    ships        the sampled loop, too

and fails with an exception of any other type, a design that the checker refuses, C that differs from its reference, a run
above what is proved, or a certified loop that does not come to agree. `--count 1 --first I` repeats one.
"""

import argparse
import collections
import json
import math
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import tomlkit

import lockstep

Document = dict[str, Any]

TERMS = [
    "sin({0})", "tanh({0})", "atan({0})", "cos({0})", "{0}/(1 + ({0})**2)", "sqrt(1 + ({0})**2)", "abs({0})",
    "min(max({0}, -1), 1)", "sin({0})*cos(3*t)", "sin({0} + {1})", "tanh({0} - {1})", "1/(1 + exp(-{0}))",
    "log(1 + ({0})**2)", "if_else({0} > 0, {0}, {0}/2)",
]  # fmt: skip
ON_A_BOX = ["({0})**2", "({0})**3", "{0}*{1}", "exp({0})", "sin({0})*{1}", "sqrt(2 + {0})"]
NAMES = ["x", "v_1", "theta", "omega_dot", "E1", "int_", "q", "I", "phi", "Re"]
HALVINGS = 12
"""Of a horizon, at most: to 24 of `MOST_STEPS`, through which a leader that is unstable alone stays in the range of a run."""

MOST_STEPS = 100_000
"""Of a run: a slow plant drawn with a fast one's period takes millions, an hour of them."""

PARTS_OF_A_PERIOD = 0.02, 0.3
"""The period times the fastest rate of the plant."""


def draw(index: int) -> Document:
    """Return problem `index`."""
    rng = np.random.default_rng(index)

    def one_of(options: Any) -> Any:
        return options[int(rng.integers(len(options)))]

    def some(size: int, scale: float = 1.0) -> list[float]:
        return [round(float(value), 3) for value in scale * rng.standard_normal(size)]

    n, m, q = (int(rng.integers(1, top)) for top in (5, 3, 3))
    q = min(q, n)
    rate = 10.0 ** float(rng.uniform(-3.5, 2.5))  # 1/s
    states = [f"{name}{k}" for k, name in enumerate(rng.permutation(NAMES)[:n])]
    inputs, outputs = [f"u{k}" for k in range(m)], [f"y{k}" for k in range(q)]
    boxed = rng.random() < 0.25
    terms = [*TERMS, *ON_A_BOX] if boxed else TERMS
    dynamics = {}
    for k, state in enumerate(states):
        linear = some(n)
        # A chain of integrators below a full row, or full rows.
        if rng.random() < 0.6 and k + 1 < n:
            text = states[k + 1]
        else:
            text = " + ".join(f"({a})*{x}" for a, x in zip(linear, states, strict=True))
        if rng.random() < 0.5:
            text += f" + ({some(1, 0.5)[0]})*({one_of(terms).format(*rng.permutation(states * 2)[:2])})"
        if k == n - 1 or rng.random() < 0.4:
            text += "".join(f" + ({b})*{u}" for b, u in zip(some(m), inputs, strict=True))
        dynamics[state] = f"rate*({text})"
    if rng.random() < 0.5:
        C = {y: states[k] for k, y in enumerate(outputs)}
    else:
        C = {y: " + ".join(f"({c})*{x}" for c, x in zip(some(n), states, strict=True)) for y in outputs}
    agent: Document = {
        "name": one_of(["a", "agent", "unit", "Cell"]),
        "states": states, "inputs": inputs, "parameters": {"rate": rate}, "dynamics": dynamics, "outputs": C,
    }  # fmt: skip
    if boxed:
        agent["domain"] = {x: [-0.8, 0.8] for x in states}
    if rng.random() < 0.2:
        agent["limits"] = {u: [-3.0, 3.0] for u in inputs}
    N = int(rng.integers(2, 5))
    network: Document = {"agents": N}
    if rng.random() < 0.7:
        network["topology"] = (
            "leader_path" if boxed else one_of(["cycle", "ring", "path", "complete", "star", "leader_path"])
        )
    else:  # a random spanning tree, and some more edges
        tree = [
            [int(i), int(rng.integers(1, i)), round(float(rng.uniform(0.2, 2)), 2)] for i in range(2, N + 1)
        ]
        more = [[1, N]] if rng.random() < 0.5 and not boxed else []
        network["edges"] = tree + more
    if rng.random() < 0.1:
        network["messages"] = {"loss": 0.1, "delay": [0, 1]}
    design: Document = {"order": int(rng.integers(0, 3)), "starts": 1}
    for key, value, chance in (
        ("gain_limit", 30.0, 0.3), ("method", "modal", 0.1), ("decay", 0.05 * rate, 0.1),
        ("fragility", {"D": 0.001}, 0.1), ("for_period", True, 0.1), ("weights", {"input": 0.01}, 0.1),
    ):  # fmt: skip
        if rng.random() < chance:
            design[key] = value
    period = float(f"{rng.uniform(*PARTS_OF_A_PERIOD) / rate:.3g}")
    controller: Document = {"period": period}
    if rng.random() < 0.3:
        controller["delay"] = 1
    if rng.random() < 0.3:
        controller["real"] = "float64"
    drawn: Document = {
        "title": f"random {index}", "agent": agent, "network": network, "design": design, "controller": controller,
        "simulation": {
            "horizon": 400 * period,
            "initial": [some(n, 0.01 if boxed else 1.0) for _ in range(N)],
        },
    }  # fmt: skip
    if rng.random() < 0.25:
        mistaken(drawn, rng)
    return drawn


VALUES: list[tuple[str, Any]] = [
    ("agent.states", []), ("agent.name", "int"), ("agent.name", "a b"), ("agent.inputs", ["t"]), ("agent.stats", ["x"]),
    ("agent.parameters", {"rate": 1e300}), ("agent.parameters", {"rate": math.inf}), ("agent.parameters", {"rate": 0.0}),
    ("agent.limits", {"u0": [1.0, 2.0]}), ("agent.domain", {"nobody": [0, 1]}), ("title", "\u202e\x1b[2J"),
    ("network.agents", 1), ("network.agents", -3), ("network.agents", "three"), ("network.topology", "rign"),
    ("network.edges", [[1, 9]]), ("network.edges", [[1, 1]]), ("design.order", -1), ("design.order", 1.5),
    ("design.order", 200), ("design.alpha", math.nan), ("design.alpha", -1.0), ("design.gain_limit", 0.0),
    ("design.gain_limit", 1e-9), ("design.rho", 1e-9), ("design.decay", 1e6), ("design.weights", {"input": -1.0}),
    ("controller.period", 0.0), ("controller.period", 1e9), ("controller.period", 1e-30), ("controller.real", "float16"),
    ("simulation.horizon", -1.0), ("simulation.horizon", 1e300), ("agent.states", None), ("agent.dynamics", None),
    ("agent.outputs", None), ("agent.parameters", None), ("network", None), ("controller", None),
    ("simulation.initial", None),
]  # fmt: skip
"""A key and what it is set to by mistake; None: it is missing."""

FORMULAS: list[Callable[[str], str]] = [
    lambda text: text + " +", lambda text: text.replace("rate", "raet"), lambda text: f"({text})**2",
    lambda text: f"1/({text})", lambda text: f"sin{text}", lambda text: f"log({text})", lambda _: "0",
    lambda text: f"exp({text})", lambda text: f"__import__('os') + {text}", lambda text: text.replace("*", "\u2217"),
]  # fmt: skip


def mistaken(document: Document, rng: np.random.Generator) -> None:
    """Put a mistake into a problem."""
    which = int(rng.integers(len(VALUES) + len(FORMULAS)))
    if which >= len(VALUES):
        dynamics = document["agent"]["dynamics"]
        state = list(dynamics)[int(rng.integers(len(dynamics)))]
        dynamics[state] = FORMULAS[which - len(VALUES)](dynamics[state])
        return
    (*path, key), value = VALUES[which][0].split("."), VALUES[which][1]
    for part in path:
        document = document[part]
    document[key] = value
    if value is None:
        del document[key]


def run(index: int, time_limit: float) -> tuple[int, str, str]:
    """Take one problem through; return its index, the outcome, and what is wrong with it, if anything is."""
    document = draw(index)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "problem.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
        try:
            return index, *through(index, folder, time_limit)
        except lockstep.ProblemError as error:
            return index, "refused", "" if str(error) else "a ProblemError without a message"
        except lockstep.ClaimError as error:
            if (folder / "design.json").exists():
                return index, "failed", f"after the design: {error}"
            return index, "none found", "" if str(error) else "a ClaimError without a message"
        except Exception:
            return index, "failed", traceback.format_exc()


def through(index: int, folder: Path, time_limit: float) -> tuple[str, str]:
    """Design, prove, write, verify, simulate."""
    design = lockstep.design(
        folder / "problem.toml", output=folder / "design.json", jobs=1, time_limit=time_limit
    )
    proved = lockstep.certify(folder / "design.json")
    carries = design.document().get("messages", {"certified": True})["certified"]
    if not carries and not proved.ok:  # as it says itself: the command exits with 1
        return "certified", ""
    if not proved.ok:
        return "failed", f"refused by the checker: {json.dumps(proved.document())[:400]}"
    if not design.sampled["certified"]:
        return "certified", ""
    lockstep.generate(design, folder / "c")
    if index % 10 == 0 and not (report := lockstep.verify(folder / "c", targets=["host"], steps=200)).ok:
        return "failed", f"the C differs: {report.problems}"
    return "ships", comes_to_agree(design) or stays_below(design)


def comes_to_agree(design: lockstep.Design) -> str:
    """Say what is wrong with a run without disturbance; V decays by `decay` each step, and its residual is rounding's."""
    claims, horizon = design.sampled, design.problem.simulation.horizon
    if design.stored.claims.scope == "local":
        return ""  # the initial states may be outside of the set that is claimed
    found, horizon = simulated(design, disturbance="none", horizon=horizon)
    d = found.trajectory.disagreement()
    steps = horizon / claims["period"]
    P = np.asarray(design.stored.proofs.sampled.P) if hasattr(design.stored.proofs.sampled, "P") else None
    if not np.isfinite(d).all():
        return "a certified loop diverges"
    if P is None or found.trajectory.clipped:
        return ""
    values = np.linalg.eigvalsh(P)
    shrinks = math.sqrt(values[-1] / values[0]) * claims["decay"] ** (steps / 2)
    # The metric of V's disagreement is that of the coordinates; between samples it may grow by a little.
    most = 10 * shrinks * d[0] + 1e-3 * max(float(np.abs(found.trajectory.y).max()), 1e-30)
    return "" if d[-1] <= most else f"disagreement {d[0]:g} -> {d[-1]:g}, at most {most:g} expected"


def simulated(
    design: lockstep.Design, *, horizon: float, **options: Any
) -> tuple[lockstep.Simulation, float]:
    """Return a run and its horizon: shorter where unstable agents, agreeing with each other, leave the range of the run.

    A loop whose agents do not agree shows in the shorter run as well: what is left of their disagreement is bounded there.
    """
    horizon = min(horizon, MOST_STEPS * design.sampled["period"])
    for _ in range(HALVINGS):
        try:
            return lockstep.simulate(design, horizon=horizon, **options), horizon
        except lockstep.ClaimError:
            horizon = max(horizon / 2, design.sampled["period"])
    return lockstep.simulate(design, horizon=horizon, **options), horizon


def stays_below(design: lockstep.Design) -> str:
    """Say what is wrong with a run under noise, against what is proved of it."""
    try:
        found, _ = simulated(design, disturbance="noise", seed=1, horizon=design.problem.simulation.horizon)
    except lockstep.ClaimError as error:
        if design.stored.claims.scope == "local" and "left the domain" in str(error):
            return ""  # noise that drives an agent off its domain is outside of what is claimed
        raise
    return "" if found.ok else f"above what is proved: {found.measured.excess}"


def main() -> int:
    """Run them, print the outcomes, and what is wrong with any."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--time-limit", type=float, default=10.0)
    args = parser.parse_args()
    outcomes: collections.Counter[str] = collections.Counter()
    wrong = 0
    tasks = (joblib.delayed(run)(i, args.time_limit) for i in range(args.first, args.first + args.count))
    for index, outcome, fault in joblib.Parallel(n_jobs=args.jobs, return_as="generator_unordered")(tasks):
        outcomes[outcome] += 1
        if fault:
            wrong += 1
            print(f"{index}: {outcome}: {fault}", flush=True)
        if sum(outcomes.values()) % 50 == 0:
            print(dict(outcomes), flush=True)
    print(f"{dict(outcomes)}, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
