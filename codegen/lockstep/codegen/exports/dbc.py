"""`dbc/`: the messages of `messages/` as a DBC, the description of CAN frames that bus analysers read.

A message is one CAN FD frame: its bytes as they are packed, then zeros up to the next length that a frame can have
(ISO 11898-1). Identifiers have 29 bits: 65536 + the sender's number.
"""

import re
from collections.abc import Mapping
from typing import Any

from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.emit import plain
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.messages import HEAD, TAIL, limits_of, message_bytes, senders
from lockstep.codegen.manifest import Manifest, Named

LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes of a CAN FD frame."""
FIRST = 0x10000
"""The identifier before that of the first sender."""
EXTENDED = 1 << 31
"""How a DBC marks an identifier of 29 bits."""
NAME = re.compile(r"(?!message_|VERSION$|Vector__XXX$|[A-Z_]+_$)[A-Za-z_][A-Za-z0-9_]{0,31}")
"""None of DBC's own words, and none of the names of what precedes and follows the outputs."""


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return the description.

    Raises:
        ProblemError: a message longer than a frame, or a name that a DBC cannot hold.
    """
    whole = message_bytes(manifest)
    if whole > LENGTHS[-1]:
        most = (LENGTHS[-1] - HEAD - TAIL) // manifest.real_type.bytes
        raise ProblemError(
            f"a message has {whole} bytes",
            where="--dbc",
            expected=f"at most {LENGTHS[-1]}, the longest CAN FD frame: {most} outputs in {manifest.real}",
        )
    frames = _frames(manifest)
    _check_names(frames)
    bits = 8 * manifest.real_type.bytes
    text = render(
        "exports/messages.dbc.j2",
        frames=frames,
        length=next(one for one in LENGTHS if one >= whole),
        bytes=whole,
        bits=bits,
        crc_bit=8 * (whole - TAIL),
        value_type={32: 1, 64: 2}[bits],
        title=_quoted(manifest.title),
        identity=manifest.identity.design,
        period=repr(manifest.period),
        formation=any(agent.offsets for agent in manifest.agents),
    )
    return {f"dbc/{manifest.name}.dbc": text}


def _frames(manifest: Manifest) -> list[dict[str, Any]]:
    """Return the frame of each sender; one outside of the folder has the outputs of its first listener."""
    own = {agent.name: agent.outputs for agent in manifest.agents}
    hears = {agent.name: [one.source for one in agent.neighbours] for agent in manifest.agents}
    frames = []
    for name, number in senders(manifest).items():
        listeners = [listener for listener, sources in hears.items() if name in sources]
        outputs = own[name] if name in own else own[listeners[0]]
        frames.append(
            {
                "name": name,
                "id": EXTENDED + FIRST + number,
                "listeners": ",".join(listeners) or "Vector__XXX",
                "outputs": [_signal(one, k, manifest) for k, one in enumerate(outputs)],
            }
        )
    return frames


def _signal(output: Named, k: int, manifest: Manifest) -> dict[str, Any]:
    """Return a signal; where only one end of its range is given a DBC has no word for it, and 0|0 says that there is none."""
    bit = 8 * (HEAD + manifest.real_type.bytes * k)
    ends = limits_of(manifest).ranges.get(output.name, (None, None))
    span = (0, 0) if None in ends else ends
    return {"name": output.name, "unit": _quoted(output.unit), "bit": bit, "span": span}


def _quoted(text: str) -> str:
    """Return text for a string of a DBC, whose characters are not said to be of any one set.

    >>> _quoted('5 "µm"')
    "5 '?m'"
    """
    return plain(text).replace('"', "'").encode("ascii", "replace").decode()


def _check_names(frames: list[dict[str, Any]]) -> None:
    for frame in frames:
        outputs = [one["name"] for one in frame["outputs"]]
        wrong = [name for name in (frame["name"], *outputs) if not NAME.fullmatch(name)]
        if found := wrong + [name for name in outputs if outputs.count(name) > 1]:
            raise ProblemError(
                f"`{found[0]}` is no name in it",
                where="--dbc",
                expected="identifiers of at most 32 characters, all different, none of DBC's own, nor with `message_` first",
            )
