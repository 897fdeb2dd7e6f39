"""Write a generated folder in one step: it is there as a whole, or it is as it was before."""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from lockstep.check.errors import ProblemError, demand
from lockstep.check.files import read_inside
from lockstep.codegen.manifest import FILE_NAME, load_manifest


def write_folder(files: Mapping[str, str] | Mapping[str, str | bytes], directory: Path | str) -> Path:
    """Write relative path -> text or bytes into `directory`, replacing a folder that Lockstep wrote before.

    The files go to a temporary sibling first, which is then renamed. Raises `ProblemError` if something else
    is in the way, or if the folder holds files that Lockstep did not write there: they would be lost.
    """
    target = Path(directory).absolute()
    check_replaceable(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise ProblemError(f"cannot be written ({error.strerror})", where=str(target)) from None
    try:
        fresh = staging / "new"
        for path, content in files.items():
            (fresh / path).parent.mkdir(parents=True, exist_ok=True)
            (fresh / path).write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        _exchange(fresh, target, staging / "old")
    except OSError as error:
        raise ProblemError(f"cannot be written ({error.strerror})", where=str(target)) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return target


def _exchange(fresh: Path, target: Path, old: Path) -> None:
    """Put `fresh` in the place of `target`; if that fails, put the old folder back."""
    if not target.exists():
        fresh.rename(target)
        return
    target.rename(old)
    try:
        fresh.rename(target)
    except BaseException:
        with contextlib.suppress(OSError):
            old.rename(target)
        raise


def check_replaceable(target: Path) -> None:
    """Refuse a folder that `write_folder` would refuse, before anything is computed for it."""
    if not target.exists() and not target.is_symlink():
        return
    if target.is_symlink() or not target.is_dir():
        raise ProblemError("it is no plain folder", where=str(target), remedy="name another folder")
    present = {path.relative_to(target).as_posix() for path in target.rglob("*") if not path.is_dir()}
    if not present:
        return
    found = f"the folder is not empty and has no {FILE_NAME} of ours"
    demand(FILE_NAME in present, found, str(target), remedy="name an empty or a new folder")
    foreign = sorted(present - _written(target) - {FILE_NAME})
    if foreign:
        found = f"the folder also holds `{foreign[0]}`, which Lockstep did not write"
        raise ProblemError(found, where=str(target), remedy="move it away, or name another folder")


def _written(target: Path) -> set[str]:
    """The files that a manifest of ours lists, whichever version wrote it: an older folder can be replaced."""
    try:
        manifest = json.loads(read_inside(target, FILE_NAME))
        if str(manifest["format"]).startswith("lockstep-controllers/"):
            return set(manifest["files"])
    except (ProblemError, ValueError, TypeError, KeyError):
        pass
    return set(load_manifest(target).files)
