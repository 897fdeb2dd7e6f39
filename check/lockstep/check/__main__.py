"""`lockstep-check PATH`: decide every claim of a design file, or of a folder of generated C with its design.

Exit status 0: every claim is proved; 1: one is not; 2: the input is bad, and one message says what was found and where.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from lockstep.check.certify import Certified, certify
from lockstep.check.errors import ProblemError
from lockstep.check.wording import visible


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(prog="lockstep-check", description=__doc__.split("\n\n")[0])
    parser.add_argument("path", type=Path, help="design.json, or a folder that holds it beside its C")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args(arguments)
    try:
        found = certify(asked.path)
    except (ProblemError, OSError) as error:
        print(f"lockstep-check: {visible(str(error))}", file=sys.stderr)
        if asked.json:
            print(json.dumps({"certified": False, "error": {"kind": "ProblemError", "message": str(error)}}))
        return 2
    with suppress(BrokenPipeError):
        _print(found, as_json=asked.json)
        sys.stdout.flush()
        return 0 if found.proved else 1
    # Whoever read has had enough; what is left in the buffer has to go somewhere.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0 if found.proved else 1


def _print(found: Certified, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(found.document(), indent=1))
        return
    print(visible(found.title).replace("\n", "\\n"))
    width = max(map(len, found.verdicts))
    for name, verdict in found.verdicts.items():
        print(f"{name:{width}} {verdict.status:10} {visible(verdict.reason)}")
    print("certified" if found.proved else "NOT certified")


if __name__ == "__main__":
    raise SystemExit(main())
