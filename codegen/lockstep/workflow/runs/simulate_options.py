"""What `lockstep simulate` is asked for, and which of it does not go together: nothing is passed over in silence."""

from collections.abc import Iterator
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
    rules = (*_of_faults(options, many), *_of_workers(many), *_of_runs(options, many))
    return next((error for holds, error in rules if holds), None)


Rules = Iterator[tuple[bool, ProblemError]]
"""Whether something is wrong, and what."""


def _of_faults(options: Options, many: Many) -> Rules:
    """Faults are of a campaign of the C that ships, on this machine."""
    both = many.replay is not None and many.campaign is not None
    yield both, _both("--replay", "--campaign", "a replay is one run of a campaign again")
    faults = many.faults is not None
    yield faults and many.campaign is None, _without_campaign("--faults")
    reason = "a campaign of faults runs on this machine"
    yield faults and many.scheduler is not None, _both("--scheduler", "--faults", reason)
    reason, continuous = "messages are between sampled controllers", options.controllers == "continuous"
    yield faults and continuous, _both("--controllers continuous", "--faults", reason)


def _of_workers(many: Many) -> Rules:
    """What says where a campaign is computed has no meaning without one, and may not say so twice."""
    for name, value in (("--jobs", many.jobs), ("--scheduler", many.scheduler)):
        alone = value is not None and many.campaign is None
        yield (
            alone and many.replay is not None,
            _both(name, "--replay", "a replay is one run, in one process"),
        )
        yield alone, _without_campaign(name, ": a single run is in one process")
    twice = many.jobs is not None and many.scheduler is not None
    yield twice, _both("--jobs", "--scheduler", "the scheduler's workers have threads of their own")


def _of_runs(options: Options, many: Many) -> Rules:
    """What is for a run of its own has no meaning in a campaign, nor in one of its runs again."""
    mode = "--replay" if many.campaign is None else "--campaign"
    some = many.campaign is not None or many.replay is not None
    for name in ("disturbance", "perturbation", "plot", "figures", "integrator", "send_on_change"):
        option = f"--{name.replace('_', '-')}"
        given = getattr(options, name) != getattr(Options(), name)
        yield some and given, _both(option, mode, f"`{option}` is for a single run")
    found, expected = (
        f"`--controllers {options.controllers}` with `{mode}`",
        "continuous or sampled in a campaign",
    )
    other = options.controllers not in (None, "continuous", "sampled")
    yield some and other, ProblemError(found, where=COMMAND, expected=expected)
    found, expected = "`--campaign` without `-o`", "`-o FOLDER`, which keeps the results"
    nowhere = many.campaign is not None and many.output is None
    yield nowhere, ProblemError(found, where=COMMAND, expected=expected)


def _without_campaign(name: str, reason: str = "") -> ProblemError:
    expected = f"`--campaign N` beside it{reason}"
    return ProblemError(f"`{name}` without `--campaign`", where=COMMAND, expected=expected)


def _both(one: str, other: str, reason: str) -> ProblemError:
    return ProblemError(f"`{one}` with `{other}`", where=COMMAND, expected=f"one or the other: {reason}")
