"""Hold the imports to the contracts in pyproject.toml.

    python3 .ci/imports.py

import-linter takes the parts of `lockstep` as roots only where `lockstep` is a namespace. Its parts are in several
folders, as those of one are, and the one `__init__`, the door, imports none of them before a name is used: for
import-linter it may pass as one.
"""

import sys

from importlinter.cli import lint_imports

import lockstep

if __name__ == "__main__":
    assert lockstep.__spec__ is not None
    lockstep.__spec__.has_location = False
    sys.exit(lint_imports())
