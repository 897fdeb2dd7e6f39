"""`lockstep generate`: C for each agent, with the design it was proved by."""

from pathlib import Path
from typing import Any

from lockstep.cli.console import Answer, two_columns


def run(path: Path, output: Path, **options: Any) -> Answer:
    """Generate the folder of a certified design; options: of `lockstep.generate`."""
    import lockstep

    made = lockstep.generate(path, output, **options)
    bytes_of = {name: text if isinstance(text, bytes) else text.encode() for name, text in made.files.items()}
    sizes = {name: f"{len(bytes_of[name])} bytes" for name in sorted(bytes_of)}
    return Answer(made.document(), two_columns(f"{made.design.title}: {output}", sizes))
