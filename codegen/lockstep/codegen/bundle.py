"""A generated folder with its design beside the C: the proof travels with the code."""

from collections.abc import Mapping

from lockstep.codegen.manifest import FILE_NAME, Manifest, sha256


def bundle(files: Mapping[str, str], extras: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a folder with others added, all of them listed and hashed in the manifest.

    Args:
        files: what `emit` returns: relative path -> text.
        extras: more of the same; a path that is there already is replaced.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    together = {**{path: text for path, text in files.items() if path != FILE_NAME}, **extras}
    hashes = {path: sha256(text) for path, text in together.items()}
    return {**together, FILE_NAME: manifest.model_copy(update={"files": hashes}).sealed().text()}
