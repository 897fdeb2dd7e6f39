"""The log of the runner in a folder's `pil/`, from any board and compiler: read strictly, or refused with its line."""

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import shorten
from lockstep.codegen.exports.pil import LOG_FORMAT, identity
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.harness import Run, output_arrays
from lockstep.verification.stimulus import Trace

_HEAD = re.compile(rf"{LOG_FORMAT} ([0-9a-f]{{16}}) (\w+) (\d{{1,9}}) calls (\d{{1,9}}) bytes", re.ASCII)
_WORD = re.compile(r"[0-9a-f]+", re.ASCII)


def runs(
    text: str, manifest: Manifest, calls: Mapping[str, int], where: str
) -> Iterator[tuple[AgentEntry, Run]]:
    """Give each agent's trace.

    Args:
        text: the log; lines outside the agents' parts, such as a board's greeting, do not matter.
        manifest: of the folder that the runner is from.
        calls: how many each agent makes, by name; all of them must be there.
        where: the log's name, for messages.

    Raises:
        ProblemError: no log, of other C, cut short, or with a line that the runner does not print.
    """
    parts = _parts(text.splitlines(), manifest, calls, where)
    for agent in manifest.agents:
        if agent.name not in calls:
            continue
        if agent.name not in parts:
            raise ProblemError(
                f"nothing of {agent.name}" + ("" if parts else f": no line begins with {LOG_FORMAT}"),
                where=where,
                expected=f"what pil_run() of this folder prints: {', '.join(calls)}",
            )
        yield agent, parts[agent.name]


def _parts(lines: Sequence[str], manifest: Manifest, calls: Mapping[str, int], where: str) -> dict[str, Run]:
    agents = {agent.name: agent for agent in manifest.agents if agent.name in calls}
    found: dict[str, Run] = {}
    number = 0
    while number < len(lines):
        head = _HEAD.fullmatch(lines[number].strip())
        number += 1
        if head is None:
            continue
        design, name, count, size = head.groups()
        place = f"{where}, line {number}"
        if design != identity(manifest):
            raise ProblemError(
                f"the log is of other C ({design})",
                where=place,
                expected=f"of the C in this folder ({identity(manifest)})",
                remedy="build the runner of this folder's pil/, and run it again",
            )
        if name not in agents or name in found or int(count) != calls[name]:
            raise ProblemError(
                f"{count} calls of {shorten(name)}{', which was there before' if name in found else ''}",
                where=place,
                expected=" and ".join(f"{calls[agent]} of {agent}" for agent in agents) + ", each once",
            )
        rows = [_row(lines, number + k, k, agents[name], manifest, where) for k in range(calls[name])]
        number += calls[name]
        if number >= len(lines) or lines[number].strip() != f"end {name}":
            raise ProblemError(f"no `end {name}` in line {number + 1}", where=where, expected="the whole log")
        found[name] = Run(_trace(rows, agents[name], manifest), int(size))
    return found


def _row(
    lines: Sequence[str], at: int, call: int, agent: AgentEntry, manifest: Manifest, where: str
) -> list[int]:
    """Return the numbers of one call: status, u, x, held, heard, then age and misses of each neighbour."""
    demand(at < len(lines), f"the log ends in {agent.name}, before call {call}", where, "all of it")
    words = lines[at].split()
    digits = _digits(agent, manifest)
    good = len(words) == 1 + len(digits) and words[0] == str(call)
    if not good or any(
        len(word) != count or not _WORD.fullmatch(word) for word, count in zip(words[1:], digits, strict=True)
    ):
        raise ProblemError(
            f"`{shorten(lines[at])}`",
            where=f"{where}, line {at + 1}",
            expected=f"call {call} of {agent.name}: its number, then {len(digits)} hexadecimal numbers",
        )
    return [int(word, 16) for word in words[1:]]


def _digits(agent: AgentEntry, manifest: Manifest) -> list[int]:
    q, nn, wide = len(agent.outputs), len(agent.neighbours), 2 * manifest.real_type.bytes
    reals = [wide] * (len(agent.inputs) + agent.order + nn * q)
    return [1, *reals, *([16 if nn > 32 else 8] + [8] * (2 * nn) if nn else [])]


def _trace(rows: list[list[int]], agent: AgentEntry, manifest: Manifest) -> Trace:
    """Put the numbers of all calls into arrays: reals from their bits."""
    table = np.array(rows, dtype=np.uint64)
    real, m, n, nn = manifest.real_type, len(agent.inputs), agent.order, len(agent.neighbours)
    end = 1 + m + n + nn * len(agent.outputs)
    counts = table[:, end + 1 :].reshape(len(rows), nn, 2) if nn else np.zeros((len(rows), 0, 2), np.uint64)
    bits = table[:, 1:end].astype(f"u{real.bytes}").view(real.dtype)
    parts = {
        "status": table[:, 0],
        "u": bits[:, :m],
        "x": bits[:, m : m + n],
        "held": bits[:, m + n :],
        "heard": table[:, end] if nn else np.zeros(len(rows), np.uint64),
        "age": counts[:, :, 0],
        "misses": counts[:, :, 1],
    }
    return Trace(
        **{
            name: np.ascontiguousarray(parts[name].astype(dtype).reshape(shape))
            for name, dtype, shape in output_arrays(agent, manifest, len(rows))
        }
    )
