"""Hold the import contracts of pyproject.toml, with lint-imports, on the package as a wheel holds it.

    python .ci/imports.py

In the checkout the package `lockstep` is spread over the source roots; import-linter reads one folder.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PORTIONS = ("check", "model", "lmi", "codegen")


def main() -> int:
    """Put the portions together in a temporary folder and run lint-imports on them."""
    with tempfile.TemporaryDirectory() as whole:
        for portion in PORTIONS:
            shutil.copytree(ROOT / portion / "lockstep", Path(whole, "lockstep"), dirs_exist_ok=True)
        shutil.copytree(ROOT / "studies" / "amini", Path(whole, "amini"))
        command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache", "--config"]
        environment = {**os.environ, "PYTHONPATH": whole}
        return subprocess.run(
            [*command, str(ROOT / "pyproject.toml")], cwd=whole, env=environment, check=False
        ).returncode


if __name__ == "__main__":
    raise SystemExit(main())
