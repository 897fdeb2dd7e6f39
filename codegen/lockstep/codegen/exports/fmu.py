"""`fmu/`: each controller as an FMI 3.0 co-simulation unit, its sources as text and the archive that tools load.

The archive holds a binary for the machine that generated it, if there was a compiler: nothing is proved of that. All
else in it is compared, since the whole archive is made again around the binary.
"""

import io
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lockstep.check.errors import ProblemError
from lockstep.check.files import read_inside
from lockstep.codegen.emission.emit import plain
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.pil import identity
from lockstep.codegen.exports.view import agent_view
from lockstep.codegen.manifest import AgentEntry, Manifest

_BINARY = re.compile(
    r"binaries/(?:x86_64|aarch64|x86)-(?:linux|darwin|windows)/(\w+)\.(?:so|dylib|dll)", re.ASCII
)


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return each agent's description and what wraps its C."""
    texts = {}
    for agent in manifest.agents:
        view = _view(agent, manifest)
        place = f"fmu/{agent.name}"
        texts[f"{place}/modelDescription.xml"] = render("exports/modelDescription.xml.j2", **view)
        for name in ("buildDescription.xml", "fmi3.c"):
            texts[f"{place}/sources/{name}"] = render(f"exports/{name}.j2", **view)
    return texts


def archives(manifest: Manifest) -> dict[str, str]:
    """Return the path of each agent's archive -> the agent's name."""
    return {f"fmu/{agent.name}.fmu": agent.name for agent in manifest.agents}


def packed(name: str, files: Mapping[str, str | bytes], binaries: Mapping[str, bytes]) -> bytes:
    """Return an agent's archive, the same bytes on every machine for the same binaries: nothing is compressed.

    Args:
        name: of the agent.
        files: of the folder.
        binaries: path in the archive -> bytes.
    """
    place = f"fmu/{name}/"
    members = {path.removeprefix(place): content for path, content in files.items() if path.startswith(place)}
    members |= {f"sources/{name}.h": files[f"include/{name}.h"], f"sources/{name}.c": files[f"src/{name}.c"]}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path, content in sorted({**members, **binaries}.items()):
            entry = zipfile.ZipInfo(path)  # dated 1980
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, content)
    return stream.getvalue()


def archives_differ(folder: Path, manifest: Manifest, files: Mapping[str, str]) -> list[str]:
    """Return a line for each archive of a folder that holds anything but its generated texts and a binary.

    Args:
        folder: the folder.
        manifest: its list of files.
        files: as they are generated.
    """
    found = []
    for path, name in archives(manifest).items():
        if path not in manifest.files:
            continue
        try:
            content = read_inside(folder, path)
            same = content == packed(name, files, _binaries(content, name))
        except (
            ProblemError,
            zipfile.BadZipFile,
            KeyError,
            ValueError,
            OSError,
            NotImplementedError,
            RuntimeError,
        ):
            same = False
        if not same:
            found.append(f"{path} is not its sources with a binary: generate the folder again")
    return found


def _binaries(content: bytes, name: str) -> dict[str, bytes]:
    """Return the binaries in an archive; nothing is unpacked, since nothing is packed."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = [entry for entry in archive.infolist() if entry.compress_type == zipfile.ZIP_STORED]
        matches = [(entry, _BINARY.fullmatch(entry.filename)) for entry in entries]
        return {e.filename: archive.read(e) for e, match in matches if match and match[1] == name}


def _view(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    q, nn = len(agent.outputs), len(agent.neighbours)
    inputs = [
        {"name": f"y[{k}]", "description": plain(y.name), "unit": plain(y.unit)}
        for k, y in enumerate(agent.outputs)
    ]
    inputs += [
        {
            "name": f"neighbour_y[{j},{k}]",
            "description": f"{plain(s.source)}: {plain(y.name)}",
            "unit": plain(y.unit),
        }
        for j, s in enumerate(agent.neighbours)
        for k, y in enumerate(agent.outputs)
    ]
    outputs = [
        {"name": f"u[{k}]", "description": plain(u.name), "unit": plain(u.unit)}
        for k, u in enumerate(agent.inputs)
    ]
    return {
        "a": agent_view(agent, manifest) | {"out": 1 + (1 + nn) * q},
        "type": manifest.real.capitalize(),
        "title": plain(manifest.title),
        "token": f"{agent.name}-{identity(manifest)}",
        "period": repr(manifest.period),
        "inputs": inputs,
        "outputs": outputs,
        "units": sorted({one["unit"] for one in inputs + outputs if one["unit"]}),
    }
