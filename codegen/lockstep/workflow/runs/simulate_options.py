"""What `lockstep simulate` is asked for, and which of it does not go together: nothing is passed over in silence."""

from dataclasses import dataclass
from pathlib import Path

from lockstep.check.errors import ProblemError

COMMAND = "lockstep simulate"


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    controllers: str | None = None
    horizon: float | None = None
    seed: int | None = None
    disturbance: str | None = None
    integrator: str = "rk4"
    plot: bool = False
    perturbation: str | None = None
    figures: Path | None = None
    send_on_change: float | None = None


@dataclass(frozen=True)
class Many:
    """A campaign of random runs, or one of them again; neither for a run of its own."""

    campaign: int | None = None
    replay: int | None = None
    output: Path | None = None
    scheduler: str | None = None
    jobs: int | None = None
    faults: str | None = None


def conflict(options: Options, many: Many) -> ProblemError | None:
    """Return why options do not go together, with both their names; None if they do.

    A campaign draws its disturbances itself and runs an engine of its own; all else is one run, in one process.

    >>> print(conflict(Options(plot=True), Many(campaign=5, output=Path("there"))))
    lockstep simulate: `--plot` with `--campaign`; expected one or the other: `--plot` is for a single run
    """
    if many.campaign is not None and many.replay is not None:
        return _both("--replay", "--campaign", "a replay is one run of a campaign again")
    return _about_faults(options, many) or _about_workers(many) or _about_runs(options, many)


def _about_faults(options: Options, many: Many) -> ProblemError | None:
    """Faults are of a campaign of the C that ships, on this machine."""
    if many.faults is None:
        return None
    if many.campaign is None:
        return _without_campaign("--faults")
    if many.scheduler is not None:
        return _both("--scheduler", "--faults", "a campaign of faults runs on this machine")
    if options.controllers == "continuous":
        return _both("--controllers continuous", "--faults", "messages are between sampled controllers")
    return None


def _about_workers(many: Many) -> ProblemError | None:
    """What says where a campaign is computed has no meaning without one, and may not say so twice."""
    for name, value in (("--jobs", many.jobs), ("--scheduler", many.scheduler)):
        if value is None or many.campaign is not None:
            continue
        if many.replay is not None:
            return _both(name, "--replay", "a replay is one run, in one process")
        return _without_campaign(name, ": a single run is in one process")
    if many.jobs is not None and many.scheduler is not None:
        return _both("--jobs", "--scheduler", "the scheduler's workers have threads of their own")
    return None


def _about_runs(options: Options, many: Many) -> ProblemError | None:
    """What is for a run of its own has no meaning in a campaign, nor in one of its runs again."""
    if many.campaign is None and many.replay is None:
        return None
    mode = "--replay" if many.campaign is None else "--campaign"
    single = {
        "--disturbance": options.disturbance is not None,
        "--perturbation": options.perturbation is not None,
        "--plot": options.plot,
        "--figures": options.figures is not None,
        "--integrator": options.integrator != "rk4",
        "--send-on-change": options.send_on_change is not None,
    }
    for name, given in single.items():
        if given:
            return _both(name, mode, f"`{name}` is for a single run")
    if options.controllers not in (None, "continuous", "sampled"):
        found = f"`--controllers {options.controllers}` with `{mode}`"
        return ProblemError(found, where=COMMAND, expected="continuous or sampled in a campaign")
    if many.campaign is not None and many.output is None:
        expected = "`-o FOLDER`, which keeps the results"
        return ProblemError("`--campaign` without `-o`", where=COMMAND, expected=expected)
    return None


def _without_campaign(name: str, reason: str = "") -> ProblemError:
    expected = f"`--campaign N` beside it{reason}"
    return ProblemError(f"`{name}` without `--campaign`", where=COMMAND, expected=expected)


def _both(one: str, other: str, reason: str) -> ProblemError:
    return ProblemError(f"`{one}` with `{other}`", where=COMMAND, expected=f"one or the other: {reason}")
