"""The compiled C against the Python reference, on the nonlinear closed loop."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lockstep.check.errors import demand
from lockstep.workflow.design_file import DESIGN_NAME, Design, load
from lockstep.workflow.output_files import seen
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.codegen.manifest import Manifest
    from lockstep.verification.verify import VerifyReport

STEPS = 10_000
"""Of the closed loop, and as many adversarial ones."""


def verify(
    folder: Path | str,
    *,
    steps: int = STEPS,
    targets: Sequence[str] | None = None,
    run_changed: bool = False,
    log: Path | str | None = None,
    progress: Progress = silent,
) -> "VerifyReport":
    """Compile and run the C of a folder, and compare it, bit by bit, with the Python reference.

    Args:
        folder: what `lockstep.generate` or `build` wrote.
        steps: of the nonlinear closed loop where the design is there, and as many adversarial ones.
        targets: "host", "sanitizers" or a core; by default all of them.
        run_changed: whether to compile and run files that were changed, too.
        log: of the runner in the folder's `pil/`, from any board: it is compared instead, and nothing is run.
        progress: told what is being done and the part of it that is done.

    Raises:
        ProblemError: no folder of ours, or no such target. A difference is not raised: `ok` and `problems` say it.
    """
    from lockstep.verification.verify import verify_folder, verify_log

    folder = Path(folder)
    with seen(folder):
        expected = "a folder that `lockstep generate` wrote"
        demand(not folder.exists() or folder.is_dir(), "it is no folder", str(folder), expected)
    if log is not None:
        return verify_log(folder, log)
    progress("simulating the closed loop with the reference", 0.0)
    return verify_folder(
        folder,
        steps=steps,
        adversarial_steps=steps,
        targets=targets,
        stimulus=_closed_loop(folder, steps),
        run_changed=run_changed,
        progress=lambda what, done, total: progress(f"comparing every bit: {what}", done / max(total, 1)),
    )


def _closed_loop(folder: Path, steps: int) -> list[np.ndarray] | None:
    """Return the outputs of the agents of the design in the folder; None without one: `verify` then has its own."""
    from lockstep.codegen.manifest import load_manifest
    from lockstep.model.network import Network
    from lockstep.verification.closed_loop.plant import HeldPlant
    from lockstep.verification.reference import closed_loop

    manifest = load_manifest(folder)
    if not (folder / DESIGN_NAME).is_file():
        return None
    design = load(folder)
    if manifest.image is not None:
        return _nodes(design, manifest, steps)
    problem = design.problem
    network = Network(problem.agent(), problem.graph(), problem.agents_B())
    plant = HeldPlant(network, problem.initial_states(), manifest.period)
    return closed_loop(manifest, plant, np.array(plant.outputs), steps)


def _nodes(design: Design, manifest: "Manifest", steps: int) -> list[np.ndarray]:
    """Return outputs of the loop of all nodes, some agent's for each controller and each node of one image."""
    from lockstep.swarm import simulate_swarm, swarm_of_design
    from lockstep.verification.one_image import with_nodes
    from lockstep.verification.toolchain import host_compilers

    loop, compiled = swarm_of_design(design.stored), bool(host_compilers())
    start, horizon = design.problem.initial_states(), steps * manifest.period
    y = simulate_swarm(loop, start, horizon, compiled=compiled).trajectory.y
    return [y[:steps, k % y.shape[1]] for k in range(len(with_nodes(manifest).agents))]
