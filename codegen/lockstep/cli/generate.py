"""`lockstep generate`: C for each agent, with the design it was proved by."""

from collections.abc import Collection
from pathlib import Path

from lockstep.cli.console import Answer, respond, two_columns


def run(path: Path, output: Path, *, optimize: str, doors: Collection[str], as_json: bool) -> None:
    """Generate the folder of a certified design."""
    respond(as_json, lambda: _generate(path, output, optimize, doors))


def _generate(path: Path, output: Path, optimize: str, doors: Collection[str]) -> Answer:
    import lockstep

    made = lockstep.generate(path, output, optimize=optimize, doors=doors)
    bytes_of = {name: text if isinstance(text, bytes) else text.encode() for name, text in made.files.items()}
    sizes = {name: f"{len(bytes_of[name])} bytes" for name in sorted(bytes_of)}
    return Answer(made.document(), two_columns(f"{made.design.title}: {output}", sizes))
