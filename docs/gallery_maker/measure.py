"""A committed design built, compared and run: its figures and the pictures of its run."""

import json
import math
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lockstep
from lockstep.model.problem import Problem
from lockstep.workflow.init import init

FOLDER = Path(__file__).parents[1] / "gallery"
MEASURED = FOLDER / "measured.json"

CORE = "cortex-m4f"
NAME = "Cortex-M4F"
PER_UNIT = "1"
"""The unit of what fields count per unit, as power engineers do; no field has another pure number with a unit."""

STEPS = 500
"""Of the closed loop, on this machine and on the emulated core."""


def design_path(field: str) -> Path:
    """Return the committed design of a field; the arms' is that of the worked example in `generated/`."""
    if field == "arms":
        return Path(__file__).parents[2] / "generated" / "flexible_joint_arms" / "design.json"
    return FOLDER / "designs" / f"{field}.json"


def known() -> dict[str, Any]:
    """Return what was measured, by field."""
    found: dict[str, Any] = json.loads(MEASURED.read_text(encoding="utf-8")) if MEASURED.exists() else {}
    return found


def keep(field: str, figures: dict[str, Any]) -> None:
    """Write the figures of a field beside those of the others."""
    every = dict(sorted({**known(), field: figures}.items()))
    MEASURED.write_text(json.dumps(every, indent=1) + "\n", encoding="utf-8")


def measure(field: str, simulation: lockstep.Simulation) -> dict[str, Any]:
    """Return what the C of a field costs and how its run went; generating it proves the design again.

    Args:
        field: of `lockstep init`.
        simulation: of its design.

    Raises:
        ClaimError: the design is not certified, or its C differs from the reference.
    """
    with tempfile.TemporaryDirectory() as place:
        made = lockstep.generate(lockstep.load(design_path(field)), Path(place) / "c")
        verified = lockstep.verify(made.folder, steps=STEPS, targets=["host", CORE])
        headers = [
            path.read_text(encoding="utf-8") for path in sorted((made.folder / "include").glob("*[0-9].h"))
        ]
    run = [target for target in verified.targets if not target.skipped]
    if not verified.ok or not all(target.bitwise for target in run):
        raise lockstep.ClaimError(f"{field}: the C differs from its reference")
    steps = [target.instructions_per_step for target in run if target.core == CORE]
    return {"costs": costs(headers), "instructions": [min(steps), max(steps)], "run": run_figures(simulation)}


def costs(headers: Sequence[str]) -> dict[str, int]:
    """Return the most that the headers of the agents promise, for the core that is shown."""

    def most(pattern: str) -> int:
        found = [re.search(pattern, header) for header in headers]
        if not all(found):
            raise ValueError(f"a header does not say `{pattern}`")
        return max(int(one[1]) for one in found if one)

    return {
        "ram": most(r"RAM +(\d+) bytes"),
        "stack": most(rf"stack +at most (\d+) bytes on [^;]*{NAME}"),
        "flash": most(rf"flash +at most (\d+) bytes on .*{NAME}"),
        "multiplications": most(r"(\d+) multiplications?"),
        "additions": most(r"(\d+) additions?"),
    }


def run_figures(simulation: lockstep.Simulation) -> dict[str, Any]:
    """Return the figures of a run that its page shows, in short decimals."""
    said = simulation.document()
    ratio = said["l2"]["ratio"]
    return {
        "disagreement": [_short(said[f"disagreement_{when}"]) for when in ("initial", "max", "final")],
        "input": _short(max(said["largest_input"])),
        "ratio": None if ratio is None else _short(ratio),
        "covered": said["l2"]["covered"],
    }


def pictures(field: str, simulation: lockstep.Simulation) -> dict[str, bytes]:
    """Return the pictures of a run by file name: states, disagreement and, of some fields, the agents as they move."""
    from gallery_maker.scenes import SCENES
    from lockstep.report.export import png
    from lockstep.report.figures import run_figure

    drawn, units = {}, Problem.parse(init(field).text).agent().units
    shown = {name: "p.u." if unit == PER_UNIT else unit for name, unit in units.items()}
    for what in ("states", "disagreement"):
        figure = run_figure(simulation.trajectory, what, shown)
        if not units:
            figure.axes[-1].set_xlabel("t")
        drawn[f"{field}-{what}.png"] = png(figure, f"{field}-{what}")
    if field in SCENES:
        drawn[f"{field}-moving.svg"] = SCENES[field](simulation.trajectory).encode()
    return drawn


def _short(value: float) -> float:
    return float(f"{value:.3g}") if math.isfinite(value) else value
