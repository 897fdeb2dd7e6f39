"""A file that is there as a whole, or as it was before; importing this costs nothing."""

import os
from pathlib import Path

from lockstep.check.errors import ProblemError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file as a whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        raise ProblemError(f"it cannot be written ({error.strerror})", where=str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)
