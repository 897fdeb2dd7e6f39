"""`lockstep verify`: the compiled C against the Python reference."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from lockstep.check.errors import ProblemError
from lockstep.check.plain_json import plain
from lockstep.cli.console import Answer, progress_display, remark, respond
from lockstep.cli.files import seen

if TYPE_CHECKING:
    from lockstep.verification.verify import VerifyReport


def run(folder: Path, *, steps: int, targets: Sequence[str], run_changed: bool, as_json: bool) -> None:
    """Verify a generated folder."""
    respond(as_json, lambda: _verify(folder, steps, targets, run_changed))


def _verify(folder: Path, steps: int, targets: Sequence[str], run_changed: bool) -> Answer:
    with seen(folder):
        if folder.exists() and not folder.is_dir():
            raise ProblemError(
                "it is no folder", where=str(folder), expected="a folder that `lockstep generate` wrote"
            )
    remark("verify compiles the C of the folder and runs it on this machine")
    report = verified(folder, steps, targets or None, run_changed=run_changed)
    return Answer(plain(report.as_dict()), table_of(report), report.ok)


def verified(
    folder: Path, steps: int, targets: Sequence[str] | None = None, *, run_changed: bool = False
) -> "VerifyReport":
    """Verify a folder with a progress display, on the nonlinear closed loop where the design is there.

    Args:
        folder: what `generate` wrote.
        steps: of the closed loop, and as many adversarial ones.
        targets: groups of targets; all of them by default.
        run_changed: whether to compile and run files that were changed, too.
    """
    from lockstep.verification.verify import verify_folder

    with progress_display() as tell:
        tell("closing the loop around the reference", 0.0)
        stimulus = _closed_loop(folder, steps)
        return verify_folder(
            folder,
            steps=steps,
            adversarial_steps=steps,
            targets=targets,
            stimulus=stimulus,
            run_changed=run_changed,
            progress=lambda what, done, total: tell(what, done / max(total, 1)),
        )


def _closed_loop(folder: Path, steps: int) -> "list[np.ndarray] | None":
    """Return the outputs of the agents of the design in the folder; None without one: `verify` then has its own."""
    from lockstep.cli.files import DESIGN_NAME, read_design
    from lockstep.codegen.manifest import load_manifest
    from lockstep.model.network import Network
    from lockstep.verification.plant import HeldPlant
    from lockstep.verification.reference import closed_loop

    manifest = load_manifest(folder)
    if not (folder / DESIGN_NAME).is_file():
        return None
    stored = read_design(folder)
    problem = stored.problem
    network = Network(problem.agent(), problem.graph(), problem.agents_B())
    plant = HeldPlant(network, problem.initial_states(), manifest.period)
    return closed_loop(manifest, plant, np.array(plant.outputs), steps)


def table_of(report: "VerifyReport") -> RenderableType:
    """Return the targets as a table; a dash is what was not measured."""
    table = Table(title="The compiled C against its reference", title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("target", "bitwise", "steps", "instr/step", "code B", "RAM B", "stack B"):
        table.add_column(heading, justify="left" if heading == "target" else "right", overflow="fold")
    reasons = []
    for target in report.targets:
        said = (
            "skipped" if target.skipped else "failed" if target.error else "equal" if target.bitwise else "NO"
        )
        cells = (target.instructions_per_step, target.text_bytes, target.ram_bytes, target.stack_bytes)
        if why := target.skipped or target.error:
            reasons.append(f"{target.name}: {said}, {why}")
        numbers = ["-" if cell is None else str(cell) for cell in cells]
        table.add_row(Text(target.name), said, str(target.steps), *numbers)
    verdict = "every bit is equal" if report.ok else "NOT as claimed: " + "; ".join(report.problems)
    return Group(table, *map(Text, reasons), Text(verdict, style="bold"))
