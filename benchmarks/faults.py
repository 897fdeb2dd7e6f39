"""100 000 runs of the arms' nodes on bad networks, each network with what is proved of it: none above that.

Run by hand:  python benchmarks/faults.py [--runs 100000] [--networks loss burst delay jitter mixed together] [--jobs 2]

For each network the committed arms are asked to carry it ([network.messages]), which is proved anew and decided by the
checker; "together" is that of examples/lossy_arms, with its gains. Then the compiled nodes run on it, 10 s each. Every other
run starts in agreement and is disturbed: it is held against rho, in the mean square where messages are lost by chance. The
others start anywhere: they may not diverge, and how much of their disagreement is left is shown. Exit status 1 if a run
diverged or rho is exceeded.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from lockstep.codegen.sampled_design import prove_design, with_sampled
from lockstep.lmi.document import parse
from lockstep.workflow.design_file import Design
from lockstep.workflow.runs.network_faults import network_campaign

ROOT = Path(__file__).parents[1]
ARMS = ROOT / "generated" / "flexible_joint_arms" / "design.json"
LOSSY_ARMS = ROOT / "examples" / "lossy_arms" / "design.json"
NETWORKS: dict[str, tuple[dict[str, Any], str]] = {
    "loss": ({"loss": 0.5}, "loss=0.5"),
    "burst": ({"burst": 5}, "loss=0.9,burst=5"),
    "delay": ({"delay": [0, 5]}, "delay=0:5"),
    "jitter": ({"jitter": 0.1}, "jitter=0.1"),
    "mixed": (
        {"loss": 0.2, "burst": 2, "delay": [0, 2], "jitter": 0.05},
        "loss=0.2,delay=0:2,jitter=0.05,twice=0.1",
    ),
    "together": (
        {"loss": 0.5, "burst": 5, "delay": [0, 5], "jitter": 0.1},
        "loss=0.5,delay=0:5,jitter=0.1,twice=0.1",
    ),
}
"""What a problem asks for, and the faults of the runs."""


def asked(name: str) -> Design:
    """The committed arms with what is proved of them on a network."""
    path = LOSSY_ARMS if name == "together" else ARMS
    content = json.loads(path.read_text())
    content["problem"]["network"]["messages"] = NETWORKS[name][0]
    stored = parse(content, str(path))
    return Design.of(with_sampled(stored, prove_design(stored)).document(), str(path))


def measured(name: str, runs: int, seed: int, jobs: int | None) -> dict[str, Any]:
    faults, design = NETWORKS[name][1], asked(name)
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        document = network_campaign(
            design, faults, runs, folder, seed=seed, horizon=10.0, jobs=jobs
        ).document()
    wanted = (
        "ok",
        "runs",
        "seed",
        "covered",
        "rho",
        "gain",
        "gain_of",
        "diverged",
        "lost",
        "disagreement_kept",
    )
    seconds = time.process_time() - began
    return {"network": name, "faults": faults, **{key: document[key] for key in wanted}, "seconds": seconds}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100_000, help="of all networks together")
    parser.add_argument("--networks", nargs="+", choices=list(NETWORKS), default=list(NETWORKS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=None)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for name in options.networks:
        row = measured(name, options.runs // len(options.networks), options.seed, options.jobs)
        rows.append(row)
        print(
            f"{name:7} {row['runs']:6} runs  {'covered' if row['covered'] else 'NOT covered'}  gain {row['gain']:.4f}"
            f" ({row['gain_of']}) of rho = {row['rho']:g}  {row['diverged']} diverged  {row['lost']:.1%} lost"
            f"  {row['seconds']:.0f} s of processor",
            file=sys.stderr,
            flush=True,
        )
    if options.json:
        print(json.dumps(rows, indent=1))
    return 0 if all(row["ok"] and row["covered"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
