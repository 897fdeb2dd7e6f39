"""A page for each agent: what is proved, by what, how to repeat it, and which line of the problem became which of the C."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from lockstep.check.continuous.inequality import LETTERS
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.folder.guarantee_lines import lines_of
from lockstep.codegen.manifest import AgentEntry
from lockstep.model.problem.tables.key_lines import lines_of_keys
from lockstep.report.report_data import Facts

TOOLS = ("lockstep-control", "casadi", "cvxpy", "clarabel", "python-flint", "numpy", "scipy")
"""Packages that a figure of the design may have come from; the proof rests on python-flint alone."""

MOST_PAGES = 100
"""Pages; of more agents the manifest has the same figures."""

_PRODUCT = re.compile(r"= (?P<value>-?[0-9][0-9.e+-]*)f? \* (?P<of>[xr])(?P<index>[0-9]+);$")


@dataclass(frozen=True)
class CoefficientRow:
    """One coefficient on its way.

    entry: as in A[1,2];  continuous, sampled: its values;  hex: the sampled one to the last bit;  line: of the C, or 0.
    """

    entry: str
    continuous: float
    sampled: float
    hex: str
    line: int


def pages(facts: Facts, files: Mapping[str, str], source: str = "") -> dict[str, str]:
    """Return relative path -> text of a page for each agent.

    Args:
        facts: of the folder.
        files: its texts.
        source: the text of the problem file, for the numbers of its lines; empty: they are left out.
    """
    places = lines_of_keys(source)
    return {
        f"evidence/{agent.name}.md": render(
            "evidence.md.j2",
            agent=agent,
            facts=facts,
            guarantee=lines_of(facts.manifest.certificate),
            hashes={path: facts.manifest.files[path] for path in paths_of(agent)},
            tools=[(name, installed(name)) for name in TOOLS],
            coefficients=list(coefficients(agent, files[f"src/{agent.name}.c"])),
            at=lambda *keys: said(places, keys),
            found=finder(files, f"include/{agent.name}.h"),
        )
        for agent in facts.manifest.agents[:MOST_PAGES]
    }


def paths_of(agent: AgentEntry) -> tuple[str, str]:
    """Return the files that an agent's firmware is built from."""
    return f"include/{agent.name}.h", f"src/{agent.name}.c"


def finder(files: Mapping[str, str], path: str) -> Callable[[str], str]:
    """Return what tells the first line of a file that holds a text."""
    lines = files[path].splitlines()

    def found(what: str) -> str:
        number = next((number for number, line in enumerate(lines, start=1) if what in line), 0)
        return f"`{path}`, line {number}" if number else f"`{path}`"

    return found


def installed(package: str) -> str:
    """Return a package's version as installed here.

    >>> installed("no-such-package")
    'not installed'
    """
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def said(places: Mapping[tuple[str, ...], int], keys: tuple[str, ...]) -> str:
    """Return a key of the problem with its line, or that the default stands; of a key in an inline table the line of that.

    >>> said({("design",): 3, ("design", "order"): 4}, ("design", "order"))
    '`design.order`, line 4'
    >>> said({("design",): 3}, ("design", "seed"))
    '`design.seed`, not written: the default'
    >>> said({}, ("design", "order"))
    '`design.order`'
    """
    name = f"`{'.'.join(keys)}`"
    if not places:
        return name
    line = places.get(keys)
    return f"{name}, line {line}" if line else f"{name}, not written: the default"


def coefficients(agent: AgentEntry, text: str) -> Iterator[CoefficientRow]:
    """Return every coefficient, row by row of [A B; C D], with the line of the C that multiplies by it.

    The kernel has a product for each coefficient that is not zero, in this order; where it does not read so, no line is told.
    """
    entries = [
        (letter, i, j)
        for letters, height in ((LETTERS[:2], agent.order), (LETTERS[2:], len(agent.inputs)))
        for i in range(height)
        for letter in letters
        for j in range(agent.order if letter in "AC" else len(agent.outputs))
    ]
    sampled = {letter: getattr(agent.sampled, letter) for letter in LETTERS}
    continuous = {str(letter): rows for letter, rows in agent.continuous.items()}
    wanted = [
        (sampled[letter].decimal[i][j], "x" if letter in "AC" else "r", j)
        for letter, i, j in entries
        if sampled[letter].decimal[i][j]
    ]
    read = list(products(text))
    lines = iter(
        [line for line, *_ in read] if [what for _, *what in read] == [list(one) for one in wanted] else []
    )
    for letter, i, j in entries:
        value = sampled[letter].decimal[i][j]
        yield CoefficientRow(
            f"{letter}[{i + 1},{j + 1}]",
            continuous[letter][i][j],
            value,
            sampled[letter].hex[i][j],
            next(lines, 0) if value else 0,
        )


def products(text: str) -> Iterator[tuple[int, float, str, int]]:
    """Return (line, coefficient, "x" or "r", its index) of each product of a C text.

    >>> list(products("a\\n    const float t1 = -0.5f * x0;"))
    [(2, -0.5, 'x', 0)]
    """
    for number, line in enumerate(text.splitlines(), start=1):
        if match := _PRODUCT.search(line):
            yield number, float(match["value"]), match["of"], int(match["index"])
