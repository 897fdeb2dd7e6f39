"""Gains of their own for 3 to 50 agents: design, proof of given gains, and two inequalities written plainly for a solver.

    python benchmarks/own_gains.py [--design N]... [--given N]... [--limit SECONDS] [--json]

Pendulums on a random 4-regular graph (fewer than five: each hears all). Each figure is of its own process, one core. Beside
a design stands the paper's: its LMI (34) in cvxpy, solved by Clarabel, the gains recovered by (22), and what is true of the
loop with them. Beside the proof of given gains stands (33) with a full P as a control engineer would type it into cvxpy:
least rho^2 over P and the pair weights, nothing rounded and nothing proved. Printed are seconds on the clock, seconds of
processor, the largest resident memory, and rho; a run that is over the limit is stopped and says so.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import networkx as nx

AGENT = """
[agent]
name = "pendulum"
states = ["angle", "rate"]
inputs = ["u"]
dynamics = { angle = "rate", rate = "-2*sin(angle) - 0.3*rate + u" }
outputs = { y1 = "angle", y2 = "rate" }
"""

START = """
import json, resource, sys, time
began, used = time.monotonic(), time.process_time()
def say(rho):
    print(json.dumps({"rho": rho, "s": time.monotonic() - began, "processor": time.process_time() - used,
                      "MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))
"""

DESIGN = """
import lockstep
found = lockstep.design(sys.argv[1], output=sys.argv[2])
assert found.certified and found.sampled["certified"]
say(found.rho)
"""

PROBLEM = """
from lockstep.lmi.proposal import claim_of, given_gains, proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.problem import load_problem
problem = load_problem(sys.argv[1])
bound = proved_bound(problem)
network, claim, gains = network_of(problem, bound), claim_of(problem, bound), given_gains(problem)
"""

PROVE = """
from lockstep.lmi.analysis.rounding import prove
say(prove(network, gains, claim).rho)
"""

PAPER = """
import numpy as np
from lockstep.check.errors import NotCertified
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.methods.paper import solve_as_printed
audit = solve_as_printed(network, 0, claim.R, claim.Q, None)
spent = time.monotonic() - began, time.process_time() - used
try:
    said = prove(network, audit.gains, claim).rho
except NotCertified:
    said = f"none: abscissa {audit.abscissa:.2g} with the gains recovered"
began, used = time.monotonic() - spent[0], time.process_time() - spent[1]
say(said)
"""

PEER = """
import cvxpy as cp, numpy as np
loop, alpha, (N, n) = network.loop(0), claim.alpha, (network.N, network.agent.n)
A, E, d = loop.A_cl(gains.blocks), loop.E, loop.d
G = np.kron(np.eye(N - 1), loop.plant.G)
differences = np.array([d.right[i] - d.right[j] for i, j in d.pairs()])
P, m, square = cp.Variable((len(A), len(A)), symmetric=True), cp.Variable(len(differences)), cp.Variable()
M = differences.T @ cp.diag(m) @ differences
HH, S = loop.plant.H.T @ loop.plant.H, d.S
F = cp.bmat([
    [A.T @ P + P @ A + np.kron(S, claim.R) + alpha**2 * cp.kron(M, HH), P @ E, P @ G],
    [E.T @ P, -square * np.kron(S, np.eye(n)), np.zeros((E.shape[1], G.shape[1]))],
    [G.T @ P, np.zeros((G.shape[1], E.shape[1])), -cp.kron(M, np.eye(loop.plant.G.shape[1]))],
])
program = cp.Problem(cp.Minimize(square), [P >> 0, F << 0, m >= 0])
program.solve(solver=cp.CLARABEL)
say(float(square.value) ** 0.5 if program.status in ("optimal", "optimal_inaccurate") else program.status)
"""


def problem(N: int, *, given: bool) -> str:
    """Return a problem of N pendulums, to be designed or with gains of their own."""
    links = (nx.random_regular_graph(4, N, seed=1) if N > 4 else nx.complete_graph(N)).edges
    edges = {(i + 1, j + 1) for i, j in links} | {(j + 1, i + 1) for i, j in links}
    text = f"{AGENT}[network]\nagents = {N}\nedges = {sorted(map(list, edges))}\n[design]\norder = 0\n"
    if not given:
        return f"{text}starts = 1\n"
    rows = (f"[[design.gains]]\nD = [[{-4 - 0.01 * i:.2f}, {-4 - 0.01 * i:.2f}]]\n" for i in range(N))
    return f'{text}method = "given"\n' + "".join(rows)


def measured(code: str, N: int, limit: float) -> dict[str, float | str]:
    """Run a script on a problem in a process of its own; return its figures, or what came in their way as `rho`."""
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "pendulums.toml"
        file.write_text(problem(N, given=code is not DESIGN), encoding="utf-8")
        script = ["-W", "ignore", "-c", START + code, str(file), str(Path(place) / "design.json")]
        began = time.monotonic()
        try:
            run = subprocess.run(
                [sys.executable, *script], check=False, capture_output=True, text=True, timeout=limit
            )
        except subprocess.TimeoutExpired:
            return {"rho": f"stopped after {limit:g} s"}
    spent = f"after {time.monotonic() - began:.0f} s"
    if run.returncode < 0:
        return {"rho": f"killed by signal {-run.returncode} {spent}"}
    if run.returncode:
        return {"rho": f"failed {spent}: {run.stderr.strip().splitlines()[-1][:100]}"}
    return json.loads(run.stdout.splitlines()[-1])


DESIGNS = {"design, sampled and rounded": DESIGN, "the paper's LMI, recovered": PROBLEM + PAPER}
PROOFS = {"proof for given gains": PROBLEM + PROVE, "(33) in cvxpy, nothing proved": PROBLEM + PEER}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--design", type=int, action="append", default=[], metavar="N")
    parser.add_argument("--given", type=int, action="append", default=[], metavar="N")
    parser.add_argument("--limit", type=float, default=1800.0, help="s for each run")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if not asked.design and not asked.given:
        asked.design, asked.given = [3, 5, 10, 20], [10, 20, 50]
    rows = [(N, DESIGNS) for N in asked.design] + [(N, PROOFS) for N in asked.given]
    found: dict[str, dict[str, float | str]] = {}
    if not asked.json:
        print(f"{'N':>4}  {'what':<30}{'s':>9}{'processor s':>12}{'MiB':>8}  rho")
    for N, scripts in rows:
        for what, code in scripts.items():
            m = found[f"{what}, N = {N}"] = measured(code, N, asked.limit)
            rho = f"{m['rho']:.4g}" if isinstance(m["rho"], float) else m["rho"]
            spent = f"{m['s']:9.1f}{m['processor']:12.1f}{m['MiB']:8.0f}" if "s" in m else f"{'':29}"
            if not asked.json:
                print(f"{N:4}  {what:<30}{spent}  {rho}", flush=True)
    if asked.json:
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
