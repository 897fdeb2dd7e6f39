"""`lockstep generate`: C for each agent, with the design it was proved by."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lockstep.cli.console import Answer, respond, two_columns


def run(path: Path, output: Path, *, as_json: bool, **options: Any) -> None:
    """Generate the folder of a certified design; options: of `lockstep.generate`."""
    respond(as_json, lambda: _generate(path, output, options))


def _generate(path: Path, output: Path, options: Mapping[str, Any]) -> Answer:
    import lockstep

    made = lockstep.generate(path, output, **options)
    bytes_of = {name: text if isinstance(text, bytes) else text.encode() for name, text in made.files.items()}
    sizes = {name: f"{len(bytes_of[name])} bytes" for name in sorted(bytes_of)}
    return Answer(made.document(), two_columns(f"{made.design.title}: {output}", sizes))
