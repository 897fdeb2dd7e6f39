"""`verify_folder`: compile a generated folder, run it, and compare every bit with the reference.

Only the folder is read: the manifest's coefficients drive the reference, the C files drive the targets.
Everything else happens in temporary directories.
"""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.errors import ClaimError, demand
from lockstep.check.files import read_bytes
from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.exports import exports_of
from lockstep.codegen.exports.vectors import ADVERSARIAL, ORDINARY, vectors
from lockstep.codegen.folder.contents import refusals, strangers
from lockstep.codegen.manifest import AgentEntry, Manifest, changed_files, load_manifest
from lockstep.verification.comparison import Difference, compare
from lockstep.verification.fixed_point import FixedResult, compare_fixed
from lockstep.verification.harness import Run
from lockstep.verification.message_nodes import NodeResult, compare_nodes
from lockstep.verification.one_image import reference_of, with_nodes
from lockstep.verification.pil_log import runs
from lockstep.verification.reference import Reference
from lockstep.verification.stimulus import (
    Trace,
    adversarial_calls,
    closed_loop_calls,
    fault_calls,
    given_outputs,
    limit_calls,
    recorded_outputs,
    run_reference,
)
from lockstep.verification.targets import GROUPS, Target, targets_of

INTEGERS = 2000
"""Calls of each kind of the controllers in integers, all of them with every instruction counted, at the most."""

Progress = Callable[[str, int, int], None]
"""Called as progress(what is being done, steps done, steps in all)."""


@dataclass(frozen=True)
class AgentResult:
    """One agent on one target."""

    agent: str
    bitwise: bool
    differing_calls: int
    first_difference: str
    max_abs_error: float
    instructions_per_step: int | None
    text_bytes: int | None
    ram_bytes: int
    stack_bytes: int | None
    most_instructions: int | None


FIGURES = tuple(one.name for one in fields(AgentResult))[4:]
"""Of an agent on a target; of the target the largest."""


@dataclass(frozen=True)
class TargetResult:
    """One target over all agents: sizes and counts are those of the largest agent, None where not measured.

    bitwise            equal to the last bit; None if the target was skipped
    steps              closed-loop steps, and as many adversarial calls as `adversarial_steps` says
    fault_steps        calls with each fault once: always fed, whatever the other two are
    instructions_per_step  most instructions (never cycles) of one `<agent>_step`, of the closed loop
    most_instructions      the same over all observed calls, with faults and adversarial ones: the header bounds it
    skipped            why the target did not run; empty if it ran
    error              the compiler's or program's message if it failed
    fixed               each agent in integers (`fixed/`), if the folder has them and the target runs them
    nodes              each agent with its messages (`messages/`), if the folder has them and the target runs them
    core               group of the emulated core, whose stack, flash and instructions the header bounds; empty on the host
    """

    name: str
    bitwise: bool | None
    steps: int = 0
    adversarial_steps: int = 0
    fault_steps: int = 0
    max_abs_error: float | None = None
    instructions_per_step: int | None = None
    text_bytes: int | None = None
    ram_bytes: int | None = None
    stack_bytes: int | None = None
    most_instructions: int | None = None
    skipped: str = ""
    error: str = ""
    core: str = ""
    agents: tuple[AgentResult, ...] = ()
    nodes: tuple[NodeResult, ...] = ()
    fixed: tuple[FixedResult, ...] = ()


@dataclass(frozen=True)
class VerifyReport:
    """What was verified.

    ok             nothing changed, something ran, and all that ran is equal to the last bit
    targets        one per compiler and setting, skipped ones included
    changed_files  files whose content is not what the manifest says (missing ones included)
    problems       a sentence for each thing that keeps `ok` from being true
    """

    ok: bool
    targets: tuple[TargetResult, ...]
    changed_files: tuple[str, ...]
    problems: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)

    @property
    def fed(self) -> str:
        """What the targets that ran were fed."""
        ran = [target for target in self.targets if target.bitwise is not None]
        if not ran:
            return "nothing was run"
        calls = f"{len(ran)} targets, {ran[0].steps} closed-loop and {ran[0].adversarial_steps} adversarial calls per agent"
        if not ran[0].fault_steps:
            return calls
        return f"{calls}; in one of {ran[0].fault_steps} each a NaN, infinity, overflow, no message, no init"


def verify_folder(
    directory: Path | str,
    *,
    steps: int = 10_000,
    adversarial_steps: int = 10_000,
    targets: Sequence[str] | None = None,
    stimulus: Sequence[np.ndarray] | np.ndarray | None = None,
    progress: Progress | None = None,
    run_changed: bool = False,
) -> VerifyReport:
    """Check a generated folder against its manifest and its C against the reference: this compiles and runs code.

    steps              closed-loop steps: of `stimulus`, else of the manifest's plants, else of a built-in
    signal
    adversarial_steps  calls with subnormal, huge, alternating and non-finite values; each fault is fed once besides
    targets            names of target groups (see `targets.GROUPS`); default: all
    stimulus           outputs y of every agent, one S x q array each or one S x N x q array
    run_changed        compile and run C that was changed since it was generated, or that has another form; without
                       it such a folder is reported and nothing of it is compiled
    Raises `ProblemError` if there is no usable manifest or an argument is bad. Never raises for a
    mismatch: `ok` is false.
    """
    folder = Path(directory).absolute()
    found = f"steps is {steps}, adversarial_steps {adversarial_steps}"
    demand(steps >= 1 and adversarial_steps >= 0, found, "verify", "above 0")
    manifest = load_manifest(folder)
    changed = changed_files(folder, manifest)
    if not run_changed and (refused := refusals(folder, manifest)):
        said = "nothing was compiled: `--run-changed` runs changed files all the same, whatever they do"
        return VerifyReport(False, (), changed, (*refused, said))
    chosen, generated = targets_of(targets or GROUPS), manifest
    manifest = with_nodes(manifest)
    tell = _Teller(progress, len(manifest.agents) * (1 + len(chosen)))
    calls = _calls(manifest, steps, adversarial_steps, stimulus)
    faults = max(len(given) for given in calls.values()) - steps - adversarial_steps
    expected: dict[str, Trace] = {}
    for agent in manifest.agents:
        tell(f"reference of {agent.name}")
        expected[agent.name] = run_reference(reference_of(agent, manifest), calls[agent.name])
    results = tuple(
        _run_target(target, manifest, folder, calls, expected, (steps, adversarial_steps, faults), tell)
        for target in chosen
    )
    tell("done")
    problems = (*strangers(folder, generated), *_problems(results, changed, manifest))
    return VerifyReport(not problems, results, changed, problems)


def verify_log(directory: Path | str, log: Path | str) -> VerifyReport:
    """Compare what the runner in a folder's `pil/` printed, on any board, with the reference; nothing is run.

    Raises `ProblemError` if the folder has no such runner, or if the log is not one of it as a whole.
    """
    folder, log = Path(directory).absolute(), Path(log)
    manifest = load_manifest(folder)
    demand("pil" in exports_of(manifest), "it has no pil/", str(directory), remedy="generate it with `--pil`")
    changed = changed_files(folder, manifest)
    calls = {agent.name: vectors(agent, manifest) for agent in manifest.agents}
    text = read_bytes(log, expected="the log of the runner in pil/", at_most=_LARGEST_LOG).decode(
        errors="replace"
    )
    results = [
        _agent_result(
            agent, run, compare(run.trace, run_reference(Reference.of(agent, manifest), calls[agent.name]))
        )
        for agent, run in runs(text, manifest, {name: len(one) for name, one in calls.items()}, str(log))
    ]
    target = _target_result(f"log {log.name}", results, (ORDINARY, ADVERSARIAL, 0))
    problems = (*refusals(folder, manifest), *_problems([target], (), manifest))
    return VerifyReport(not problems, (target,), changed, problems)


_LARGEST_LOG = 1_000_000_000


class _Teller:
    """Counts what is done for the progress display."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self.progress, self.total, self.done = progress, total, -1

    def __call__(self, what: str) -> None:
        self.done = min(self.done + 1, self.total)
        if self.progress:
            self.progress(what, self.done, self.total)


def _calls(
    manifest: Manifest, steps: int, adversarial_steps: int, stimulus: Sequence[np.ndarray] | np.ndarray | None
) -> dict[str, Calls]:
    """Closed-loop calls first: they start from rest, as the closed loop does. Every fault once, whatever is asked for."""
    recorded = (
        recorded_outputs(manifest, steps) if stimulus is None else given_outputs(manifest, stimulus, steps)
    )
    loop = closed_loop_calls(manifest, recorded)
    return {
        a.name: loop[a.name]
        + fault_calls(manifest, a)
        + limit_calls(manifest, a)
        + adversarial_calls(manifest, a, adversarial_steps)
        for a in manifest.agents
    }


def _run_target(
    target: Target,
    manifest: Manifest,
    folder: Path,
    calls: Mapping[str, Calls],
    expected: Mapping[str, Trace],
    steps: tuple[int, int, int],
    tell: _Teller,
) -> TargetResult:
    if target.skipped:
        return TargetResult(target.name, None, skipped=target.skipped)
    results = []
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        place = Path(temporary).resolve()
        try:
            for agent, run in target.run(manifest, folder, calls, place):
                tell(f"{target.name}: {agent.name}")
                results.append(_agent_result(agent, run, compare(run.trace, expected[agent.name])))
            nodes = compare_nodes(target, manifest, folder, place, adversarial=steps[1])
            few, odd = (min(count, INTEGERS) for count in steps[:2])
            fixed = compare_fixed(target, manifest, folder, place, steps=few, adversarial=odd)
        except ClaimError as error:
            return TargetResult(
                target.name, False, *steps, error=str(error), core=target.core, agents=tuple(results)
            )
    found = _target_result(target.name, results, steps, target.core)
    same = all(one.bitwise for one in nodes) and all(one.bitwise for one in fixed)
    return replace(found, bitwise=found.bitwise and same, nodes=nodes, fixed=fixed)


def _target_result(
    name: str, results: Sequence[AgentResult], steps: tuple[int, int, int], core: str = ""
) -> TargetResult:
    return TargetResult(
        name,
        all(r.bitwise for r in results),
        *steps,
        **{figure: most_of(results, figure) for figure in FIGURES},
        core=core,
        agents=tuple(results),
    )


def _agent_result(agent: AgentEntry, run: Run, difference: Difference) -> AgentResult:
    found = difference.bitwise, difference.calls, difference.first, difference.max_abs_error
    sizes = run.instructions, run.text_bytes, run.state_bytes, run.stack_bytes, run.most_instructions
    return AgentResult(agent.name, *(found + sizes))


def most_of(results: Iterable[object], figure: str) -> Any:
    """Return the largest of a figure over results; None where none of them has it."""
    return max((x for one in results if (x := getattr(one, figure)) is not None), default=None)


def _problems(results: Sequence[TargetResult], changed: Sequence[str], manifest: Manifest) -> Iterator[str]:
    for path in changed:
        yield f"{path} is not what manifest.json says: it was changed, or is missing"
    if all(result.skipped for result in results):
        reasons = "; ".join(f"{result.name}: {result.skipped}" for result in results)
        yield f"nothing was run, so nothing is verified ({reasons})"
    stated = {agent.name: agent for agent in manifest.agents}
    for result in results:
        if result.error:
            yield f"{result.name}: {result.error}"
        for node in result.nodes:
            yield from _difference(result, node, "with its messages ")
        for one in result.fixed:
            yield from _difference(result, one, "in integers ")
            most = (stated[one.agent].integer_instruction_budget or {}).get(result.core)
            if most is not None and (one.instructions_per_step or 0) > most:
                excess = f"takes {one.instructions_per_step} instructions in a step, its header says at most {most}"
                yield f"{result.name}: {one.agent} in integers {excess}"
        for found in result.agents:
            yield from _difference(result, found)
            yield from _broken_promises(result, found, stated[found.agent])


def _difference(
    target: TargetResult, found: AgentResult | NodeResult | FixedResult, how: str = ""
) -> Iterator[str]:
    if not found.bitwise:
        calls = f"{how}differs in {found.differing_calls} calls"
        yield f"{target.name}: {found.agent} {calls}; {found.first_difference}"


def _broken_promises(target: TargetResult, found: AgentResult, stated: AgentEntry) -> Iterator[str]:
    """The header bounds RAM, stack, flash and instructions; what is measured must keep to that."""
    if found.ram_bytes != stated.state_bytes:
        ram = f"takes {found.ram_bytes} bytes of RAM, not {stated.state_bytes} as stated"
        yield f"{target.name}: {found.agent} {ram}"
    budgets = {
        "bytes of stack": (found.stack_bytes, stated.stack_budget_bytes),
        "bytes of flash": (found.text_bytes if target.core else None, stated.flash_budget_bytes),
        "instructions in a step": (found.most_instructions, stated.instruction_budget),
    }
    for what, (measured, bounds) in budgets.items():
        bound = bounds.get(target.core)
        if measured is not None and bound is not None and measured > bound:
            excess = f"takes {measured} {what}, its header says at most {bound}"
            yield f"{target.name}: {found.agent} {excess}"
