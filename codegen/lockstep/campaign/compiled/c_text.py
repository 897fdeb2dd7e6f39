"""C files to be compiled together."""

import hashlib
from dataclasses import dataclass


@dataclass(frozen=True)
class CFiles:
    """C files by name."""

    files: tuple[tuple[str, str], ...]

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the files."""
        digest = hashlib.sha256()
        for name, text in self.files:
            digest.update(f"{name}\0{text}\0".encode())
        return digest.hexdigest()
