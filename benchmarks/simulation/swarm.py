"""100 000 arms on a random 8-regular graph for 10 s at 10 ms: the compiled swarm beside C written by hand for it.

Run by hand:  python benchmarks/simulation/swarm.py [--agents 100000] [--repeats 3] [--json]

Both take the same graph, start, gains, Runge-Kutta steps and threads, turn and turn about; the median of each counts. The
yardstick (swarm_by_hand.c, at -O3 for this very processor, with OpenMP) computes the states and the disagreement; the swarm
besides the eight indices of each agent, the largest inputs and the energies. The states at the end are compared.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from lockstep.check.sampled.discretise import discretise
from lockstep.model.problem import load_problem
from lockstep.swarm import NeighbourLists, SwarmLoop, simulate_swarm
from lockstep.swarm.engine import processors
from lockstep.verification.toolchain import first_compiler

HERE = Path(__file__).parent
ARMS = HERE.parents[1] / "examples" / "flexible_joint_arms.toml"
PERIOD, HORIZON, DEGREE, SUBSTEPS = 0.01, 10.0, 8, 2
TARGET_RATIO, TARGET_SECONDS = 1.3, 60.0
GAINS = (
    [[-1.818, -0.0097], [-0.0099, -1.859]],
    [[-0.0066, -0.0078], [-0.0082, -0.0088]],
    [[0.000508, 0.000639]],
    [[-0.739, -0.823]],
)
"""Of the paper's Table 1, agent 1: what is measured is the simulation, not the design."""


def swarm(agents: int) -> SwarmLoop:
    lists = NeighbourLists.random_regular(agents, DEGREE, seed=1)
    lists = NeighbourLists(lists.first, lists.source, np.full(len(lists.source), 1 / DEGREE))
    problem = load_problem(ARMS)
    table = discretise(*(np.array(M) for M in GAINS), PERIOD, "tustin").astype(np.float32)
    agent = problem.agent()
    return SwarmLoop(
        agent, lists, 2, table[None], agent.lure.B[None], PERIOD, "float32", np.eye(4), 2 * np.eye(2)
    )


def by_hand(loop: SwarmLoop, folder: Path) -> Path:
    """The yardstick, compiled with the gains as they are rounded."""
    M = loop.tables[0]

    def numbers(block: np.ndarray) -> str:
        return ",".join(
            f"{float(v):.9g}" + ("" if "." in f"{float(v):.9g}" else ".0") + "f" for v in block.ravel()
        )

    defined = {"A": M[:2, :2], "B": M[:2, 2:], "C": M[2:, :2], "D": M[2:, 2:]}
    macros = [f"-DGAIN_{name}={numbers(block)}" for name, block in defined.items()]
    program = folder / "swarm_by_hand"
    base = [*first_compiler("benchmark").command, "-std=c99", "-O3", "-march=native", "-Wno-missing-braces"]
    rest = [*macros, f"-DPERIOD={PERIOD}", str(HERE / "swarm_by_hand.c"), "-o", str(program), "-lm"]
    subprocess.run([*base, "-fopenmp", *rest], check=True)
    return program


def measure(agents: int, repeats: int, threads: int) -> dict:
    begin = time.perf_counter()
    loop = swarm(agents)
    start = np.random.default_rng(0).uniform(-1, 1, (agents, 4))
    answer = {"agents": agents, "threads": threads, "graph_s": time.perf_counter() - begin}
    lists, periods = loop.neighbours, round(HORIZON / PERIOD)
    simulate_swarm(
        loop, start, PERIOD, substeps=SUBSTEPS
    )  # compiled before the clock starts: once per design
    ours, theirs = [], []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        program, graph, out = by_hand(loop, folder), folder / "graph.bin", folder / "out.bin"
        graph.write_bytes(
            np.array([agents, len(lists.source)]).tobytes()
            + lists.first.tobytes()
            + lists.source.tobytes()
            + loop.weights.tobytes()
            + start.tobytes()
        )
        command = [str(program), str(graph), str(periods), str(SUBSTEPS), str(out)]
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads), "OMP_WAIT_POLICY": "passive"}
        for _ in range(repeats):
            said = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
            theirs.append([float(word) for word in said.split()])
            wall, processor = time.perf_counter(), time.process_time()
            run = simulate_swarm(loop, start, HORIZON, substeps=SUBSTEPS, threads=threads)
            ours.append([time.perf_counter() - wall, time.process_time() - processor])
        numbers = np.fromfile(out)
    for name, rows in (("swarm", ours), ("by_hand", theirs)):
        answer[f"{name}_s"], answer[f"{name}_processor_s"] = (
            statistics.median(c) for c in zip(*rows, strict=True)
        )
    answer["ratio"] = answer["swarm_s"] / answer["by_hand_s"]
    answer["processor_ratio"] = answer["swarm_processor_s"] / answer["by_hand_processor_s"]
    final = numbers[periods:].reshape(agents, 4)
    answer["disagreement_final"] = float(run.disagreement[-1])
    answer["largest_difference"] = float(np.abs(run.final - final).max())
    return answer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--agents", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=processors())
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(options.agents, options.repeats, options.threads)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print("\n".join(f"{name:24} {value:.6g}" for name, value in found.items()))
    sys.exit(0 if found["processor_ratio"] <= TARGET_RATIO and found["swarm_s"] <= TARGET_SECONDS else 1)


if __name__ == "__main__":
    main()
