"""`lockstep generate`: C for each agent, with the design it was proved by."""

from pathlib import Path

from lockstep.cli.console import Answer, respond, two_columns


def run(path: Path, output: Path, *, optimize: str, name: str, prefix: str, as_json: bool) -> None:
    """Generate the folder of a certified design."""
    respond(as_json, lambda: _generate(path, output, optimize, name, prefix))


def _generate(path: Path, output: Path, optimize: str, name: str, prefix: str) -> Answer:
    import lockstep

    made = lockstep.generate(path, output, optimize=optimize, name=name, prefix=prefix)
    sizes = {name: f"{len(made.files[name].encode())} bytes" for name in sorted(made.files)}
    return Answer(made.document(), two_columns(f"{made.design.title}: {output}", sizes))
