"""Modal designs of carts for 10, 1 000 and 100 000 agents: time and memory of design and certify, each in its own process.

    python benchmarks/modal.py [--json] [N ...]

Ten are on a ring; a thousand and more on a random 8-regular graph in a Matrix Market file. Printed are seconds of
processor, the largest resident memory, rho, rho of the sampled loop, and how the graph's spectrum is known.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import networkx as nx

PROBLEM = """
[agent]
name = "cart"
states = ["p", "v"]
inputs = ["f"]
dynamics = {{ p = "v", v = "f" }}
outputs = {{ y = "p" }}
[network]
{network}
[design]
method = "modal"
order = 1
[controller]
period = 0.02
"""

ONE = """
import json, resource, sys, time
import lockstep
start = time.process_time()
found = lockstep.design(sys.argv[1], output=sys.argv[2])
designed = time.process_time()
ok = lockstep.certify(sys.argv[2]).ok
said = found.document()
print(json.dumps({
    "design": designed - start, "certify": time.process_time() - designed, "ok": ok,
    "MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "rho": said["rho"],
    "sampled": said["sampled"].get("rho"), "graph_proof": said.get("graph_proof"),
}))
"""


def network(folder, N):
    """Return the table [network], having written the graph."""
    if N <= 200:
        return f'agents = {N}\ntopology = "ring"'
    edges = nx.random_regular_graph(8, N, seed=1).edges
    lines = [f"{max(i, j) + 1} {min(i, j) + 1}\n" for i, j in edges]
    head = f"%%MatrixMarket matrix coordinate pattern symmetric\n{N} {N} {len(lines)}\n"
    (folder / "graph.mtx").write_text(head + "".join(lines))
    return 'file = "graph.mtx"'


def measured(N):
    """Return the figures of one design, in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "carts.toml").write_text(PROBLEM.format(network=network(folder, N)))
        command = [sys.executable, "-c", ONE, str(folder / "carts.toml"), str(folder / "carts.json")]
        return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", type=int, default=[10, 1000, 100_000], metavar="N")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = {}
    if not asked.json:
        print(f"{'N':>8}{'design s':>10}{'certify s':>11}{'MiB':>7}{'rho':>9}{'sampled':>9}  graph")
    for N in asked.sizes:
        m = found[N] = measured(N)
        spent = f"{N:8}{m['design']:10.1f}{m['certify']:11.1f}{m['MiB']:7.0f}"
        if not asked.json:
            said = f"{m['graph_proof']}{'' if m['ok'] else ', not certified'}"
            print(f"{spent}{m['rho']:9.4g}{m['sampled']:9.4g}  {said}", flush=True)
    if asked.json:
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
