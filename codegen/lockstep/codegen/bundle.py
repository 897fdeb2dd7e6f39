"""A generated folder with its design beside the C: the proof travels with the code."""

from collections.abc import Mapping
from typing import TypeVar

from lockstep.codegen.manifest import FILE_NAME, Manifest, sha256

Content = TypeVar("Content", str, str | bytes)


def bundle(files: Mapping[str, str], extras: Mapping[str, Content]) -> dict[str, Content]:
    """Return the files of a folder with others added, all of them listed and hashed in the manifest.

    Args:
        files: what `emit` returns: relative path -> text.
        extras: more of the same, or the bytes of figures; a path that is there already is replaced.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    kept: dict[str, Content] = {path: text for path, text in files.items() if path != FILE_NAME}
    together: dict[str, Content] = {**kept, **extras}
    hashes = {path: sha256(content) for path, content in together.items()}
    return {**together, FILE_NAME: manifest.model_copy(update={"files": hashes}).sealed().text()}
