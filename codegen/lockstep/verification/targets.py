"""Where the C is run: this machine with each compiler, with sanitizers, and emulated microcontrollers."""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from lockstep.check.errors import ClaimError, ProblemError
from lockstep.codegen.cost.cores import CORES, Core
from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.harness import Run, run_on_host
from lockstep.verification.machines.emulator import missing_packages, run_on_core
from lockstep.verification.machines.qemu import M7, missing, run_on_qemu
from lockstep.verification.messages.events import Events
from lockstep.verification.messages.run import Traces, run_nodes_on_core, run_nodes_on_host
from lockstep.verification.toolchain import TO_INSTALL, Compiler, arm_gcc, host_compilers, run, zig

Runner = Callable[[Manifest, Path, Mapping[str, Calls], Path], Iterator[tuple[AgentEntry, Run]]]

NodeRunner = Callable[[Manifest, Path, Mapping[str, Events], Path], Traces]

GROUPS = ("host", "sanitizers", *CORES, M7.group)
"""host: each compiler at -O0, -O2, -O3. sanitizers: address, undefined behaviour. The rest is emulated, the last by QEMU."""

LEVELS = ("-O0", "-O2", "-O3")
CORE_LEVELS = ("-O2", "-Os")

_SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@dataclass(frozen=True)
class Target:
    """One way to compile and run the C; `skipped` says why it cannot be done here; `core` names an emulated one.

    `nodes` runs the agents with their messages, where this is possible; `built` is how other code is built for it: by which
    compiler, with which flags, for which emulated core.
    """

    name: str
    run: Runner
    skipped: str = ""
    core: str = ""
    nodes: NodeRunner | None = None
    built: tuple[Compiler, tuple[str, ...], Core | None] | None = None


def targets_of(groups: Sequence[str]) -> list[Target]:
    """The targets of the groups named, those that cannot run here marked as skipped."""
    if isinstance(groups, str):
        groups = [groups]
    if unknown := [group for group in groups if group not in GROUPS]:
        raise ProblemError(f"`{unknown[0]}`", where="targets", expected=" or ".join(GROUPS))
    makers = {"host": _host, "sanitizers": _sanitizers, M7.group: _on_qemu}
    makers |= {group: partial(_on_core, core) for group, core in CORES.items()}
    return [target for group in dict.fromkeys(groups) for target in makers[group]()]


def _host() -> Iterator[Target]:
    compilers = host_compilers()
    for compiler in compilers:
        for level in LEVELS:
            yield _on_host(f"host {compiler.name} {level}", compiler, (level,))
    if not compilers:
        yield _skipped("host", f"no C compiler: {TO_INSTALL}")


def _sanitizers() -> Iterator[Target]:
    for compiler in host_compilers():
        name = f"host {compiler.name} address and undefined-behaviour sanitizers"
        if reason := _no_sanitizers(compiler):
            yield _skipped(name, reason)
        else:
            yield _on_host(name, compiler, _SANITIZERS)


def _no_sanitizers(compiler: Compiler) -> str:
    """Why the sanitizers do not work with this compiler, found out by a program that does nothing."""
    if compiler.is_zig:
        return "zig ships no address sanitizer"
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        directory = Path(temporary)
        (directory / "nothing.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
        try:
            run([*compiler.command, *_SANITIZERS, "nothing.c", "-o", "nothing"], directory, "linking", 60)
            run([str(directory / "nothing")], directory, "starting", 60)
        except ClaimError as error:
            return f"they do not work with this compiler, and nothing claimed rests on them ({str(error).splitlines()[0]})"
    return ""


def _on_core(core: Core) -> Iterator[Target]:
    """zig always; arm-none-eabi-gcc too where it is found."""
    compiler, gcc = zig(), arm_gcc() if core.gcc else None
    missing = missing_packages() + ([] if compiler or gcc else ["ziglang"])
    if missing:
        yield _skipped(f"{core.title}, emulated", f"not installed: {', '.join(missing)} (extra `toolchain`)")
        return
    for found in filter(None, (compiler, gcc)):
        for level in CORE_LEVELS:
            name = f"{core.title} {found.name} {level}, emulated"
            yield Target(
                name,
                partial(run_on_core, core=core, compiler=found, level=level),
                core=core.group,
                nodes=partial(run_nodes_on_core, core=core, compiler=found, level=level),
                built=(found, (level,), core),
            )


def _on_qemu() -> Iterator[Target]:
    compilers = [found for found in (zig(), arm_gcc()) if found]
    absent = missing() + ([] if compilers else ["ziglang or arm-none-eabi-gcc"])
    if absent:
        yield _skipped(f"{M7.title}, QEMU", f"not installed: {', '.join(absent)}")
        return
    for found in compilers:
        for level in CORE_LEVELS:
            start = partial(run_on_qemu, compiler=found, level=level)
            yield Target(f"{M7.title} {found.name} {level}, QEMU", start)


def _on_host(name: str, compiler: Compiler, flags: tuple[str, ...]) -> Target:
    start = partial(run_on_host, compiler=compiler, flags=flags)
    nodes = partial(run_nodes_on_host, compiler=compiler, flags=flags)
    return Target(name, start, nodes=nodes, built=(compiler, flags, None))


def _skipped(name: str, reason: str) -> Target:
    def never(*_: object) -> Iterator[tuple[AgentEntry, Run]]:
        raise ClaimError(f"{name} is skipped: {reason}")

    return Target(name, never, reason)
