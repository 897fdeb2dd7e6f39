"""Print the lowest versions that pyproject.toml allows, as requirements of pip: `name==version`, a line each.

    python3 .ci/lowest.py [EXTRA ...]

What the packages themselves need is left to pip: these are the versions that our own bounds promise.
"""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def lowest(requirement: str) -> str:
    """Return `casadi==3.7` for `casadi>=3.7`."""
    found = re.fullmatch(r"([A-Za-z0-9._-]+)>=([0-9.]+)", requirement)
    if found is None:
        sys.exit(f"pyproject.toml asks for {requirement!r}; expected name>=version")
    return f"{found[1]}=={found[2]}"


requirements = list(PROJECT["dependencies"])
for extra in sys.argv[1:]:
    requirements += PROJECT["optional-dependencies"][extra]
print("\n".join(map(lowest, requirements)))
