"""Seconds of processor that the command takes to begin, and to certify a design beside designing it.

Run by hand:  python benchmarks/startup.py [--repeats 9] [--design PROBLEM] [--json]

`--help` and `--version` are medians of several runs, beside Python that imports nothing and Python that imports numpy, in the
same minute. With `--design` a problem is designed once and its file certified, by `lockstep` and by the checker alone.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

TARGET = 0.2
"""Seconds of processor for `lockstep --help`."""

LOCKSTEP = "from lockstep.cli.main import main; main()"


def processor_seconds(*command: str) -> float:
    """Seconds of processor, user's and system's, of a Python process."""
    process = subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return used.ru_utime + used.ru_stime


def measure(repeats: int, problem: Path | None) -> dict[str, float]:
    commands = {
        "python_s": ("-c", "pass"),
        "import_numpy_s": ("-c", "import numpy"),
        "version_s": ("-c", LOCKSTEP, "--version"),
        "help_s": ("-c", LOCKSTEP, "--help"),
        "help_of_design_s": ("-c", LOCKSTEP, "design", "--help"),
    }
    # Turn and turn about, so that a busy minute is busy for all; the first round fills the caches and is not counted.
    rounds = [
        {name: processor_seconds(*command) for name, command in commands.items()} for _ in range(repeats + 1)
    ]
    found = {name: statistics.median(one[name] for one in rounds[1:]) for name in commands}
    if problem is not None:
        with tempfile.TemporaryDirectory() as temporary:
            file = str(Path(temporary) / "design.json")
            found["design_s"] = processor_seconds(
                "-c", LOCKSTEP, "design", str(problem), "-o", file, "--fresh"
            )
            found["certify_s"] = processor_seconds("-c", LOCKSTEP, "certify", file)
            found["check_alone_s"] = processor_seconds("-m", "lockstep.check", file)
        found["ratio"] = found["design_s"] / found["certify_s"]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--design", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(options.repeats, options.design)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print("\n".join(f"{name:18} {value:.3f}" for name, value in found.items()))
    sys.exit(0 if found["help_s"] <= TARGET else 1)


if __name__ == "__main__":
    main()
