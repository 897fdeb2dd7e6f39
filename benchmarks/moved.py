"""What moved: the ratios of the other benchmarks, each of one run, against those that were kept.

    python benchmarks/moved.py [--only NAME]... [--rounds 3]    # exit status 1 where one moved by more than its noise
    python benchmarks/moved.py --keep                           # measure, keep, and write the table of docs/benchmarks.md

Seconds differ from machine to machine; a ratio to something that is measured beside it in the same run differs much less.
Each benchmark runs several times; the noise of a ratio is the range it was in. It moved where the range of today and the
kept one, each widened by `SLACK`, have nothing in common.
"""

import argparse
import json
import statistics
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from page import markdown, write

from designs import machine

HERE = Path(__file__).resolve().parent
KEPT, PAGE = HERE / "kept.json", HERE.parent / "docs" / "benchmarks.md"
BEGIN, END = "<!-- table: python benchmarks/moved.py --keep -->", "<!-- end of the table -->"
HEAD = ("ratio", "median", "what is measured", "least", "largest")

SLACK = 0.1
"""By which a range of a few runs is widened on either side: the next run of the same code is outside of it now and then."""


@dataclass(frozen=True)
class Ratio:
    """A ratio: less is better. Taken from what a script of this folder prints with --json."""

    name: str
    script: tuple[str, ...]
    of: Callable[[Mapping[str, Any]], float]
    what: str


def _between(above: str, below: str, key: str = "processor") -> Callable[[Mapping[str, Any]], float]:
    """Return how to take the ratio of a figure that two runs of a script have."""
    return lambda said: said[above][key] / said[below][key]


STARTUP = ("startup.py", "--json", "--design", str(HERE.parent / "examples" / "carts.toml"))
GIVEN = ("own_gains.py", "--json", "--given", "10")
OWN = tuple(word for N in ("3", "5", "10") for word in ("--design", N))

RATIOS = (
    Ratio(
        "help",
        STARTUP,
        lambda said: said["help_s"] / said["python_s"],
        "processor of `lockstep --help` beside Python that does nothing",
    ),
    Ratio(
        "certify",
        STARTUP,
        lambda said: said["certify_s"] / said["design_s"],
        "processor of `lockstep certify` beside the `lockstep design` of four carts",
    ),
    Ratio(
        "response",
        ("simulation/time_response.py", "--json"),
        lambda said: 1 / said["ratio"],
        "processor of `design.response` beside `control.input_output_response` at the same error",
    ),
    Ratio(
        "campaign",
        ("simulation/throughput.py", "--json", "--runs", "2000", "--compared", "1", "--threads", "1"),
        lambda said: 1 / said["processor_ratio"],
        "processor of a run of the campaign beside `control.input_output_response` at the same error",
    ),
    Ratio(
        "swarm",
        ("simulation/swarm.py", "--json", "--agents", "20000"),
        lambda said: said["processor_ratio"],
        "processor of 20 000 arms for 10 s beside C written by hand",
    ),
    Ratio(
        "modal",
        ("modal.py", "--json", "10", "100000"),
        _between("100000", "10", "design"),
        "processor of a modal design of 100 000 agents beside that of 10",
    ),
    Ratio(
        "proof",
        GIVEN,
        _between("proof for given gains, N = 10", "(33) in cvxpy, nothing proved, N = 10"),
        "processor of the proof for ten pendulums' given gains beside (33) in cvxpy, nothing proved",
    ),
    *(
        Ratio(
            f"paper_{N}",
            ("own_gains.py", "--json", *OWN),
            _between(f"design, sampled and rounded, N = {N}", f"the paper's LMI, recovered, N = {N}"),
            f"processor of a certified design of {N} pendulums beside the paper's LMI in cvxpy, whose recovered gains"
            " have no certificate",
        )
        for N in (3, 5, 10)
    ),
)


def measured(ratios: Sequence[Ratio], rounds: int) -> dict[str, list[float]]:
    """Run each script `rounds` times, turn and turn about, and return each ratio's figures, smallest first.

    A script that holds itself against a target ends with 1 where it misses it: its figures count all the same.
    """
    found: dict[str, list[float]] = {one.name: [] for one in ratios}
    for turn in range(rounds):
        for script in dict.fromkeys(one.script for one in ratios):
            print(f"{turn + 1} of {rounds}: {' '.join(script[:1])}", file=sys.stderr, flush=True)
            run = subprocess.run(
                [sys.executable, "-W", "ignore", str(HERE / script[0]), *script[1:]],
                check=False,
                capture_output=True,
                text=True,
            )
            if not run.stdout:
                raise SystemExit(f"{script[0]} printed nothing: {run.stderr.strip()[-300:]}")
            said = json.loads(run.stdout)
            for one in ratios:
                if one.script == script:
                    found[one.name].append(one.of(said))
    return {name: sorted(values) for name, values in found.items()}


def moved(before: Sequence[float], now: Sequence[float]) -> str | None:
    """Return by how much a ratio moved, in words; None where it is within the noise.

    >>> moved([1.0, 1.1, 1.2], [1.25, 1.3, 1.4]), moved([1.0, 1.1, 1.2], [2.1, 2.2, 2.3])
    (None, 'slower: 2.2 instead of 1.1 (x 2.00)')
    >>> moved([2.1, 2.2, 2.3], [1.0, 1.1, 1.2])
    'faster: 1.1 instead of 2.2 (x 0.50)'
    """
    wide = 1 + SLACK
    if min(now) / wide <= max(before) * wide and min(before) / wide <= max(now) * wide:
        return None
    new, old = statistics.median(now), statistics.median(before)
    return f"{'slower' if new > old else 'faster'}: {new:.3g} instead of {old:.3g} (x {new / old:.2f})"


def table_of(ratios: Sequence[Ratio], kept: Mapping[str, Sequence[float]]) -> str:
    """Return the figures as a table in Markdown."""
    ranges = ((one, kept[one.name]) for one in ratios)
    figures = ((one, (statistics.median(values), min(values), max(values))) for one, values in ranges)
    return markdown(
        HEAD,
        (
            (one.name, f"{m:.3g}", one.what, f"{least:.3g}", f"{most:.3g}")
            for one, (m, least, most) in figures
        ),
    )


def main() -> int:
    """Measure, and compare or keep."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    names = [one.name for one in RATIOS]
    parser.add_argument("--only", action="append", default=[], metavar="NAME", choices=names)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", action="store_true", help="keep what is measured, and write the table")
    asked = parser.parse_args()
    if asked.keep and asked.only:
        parser.error("--keep is for all of them: the table is of one machine and of one day")
    ratios = [one for one in RATIOS if not asked.only or one.name in asked.only]
    here, found = machine(), measured(ratios, asked.rounds)
    if asked.keep:
        KEPT.write_text(json.dumps({"machine": here, "ratios": found}, indent=1) + "\n", encoding="utf-8")
        write(PAGE, BEGIN, END, f"{here}\n\n{table_of(ratios, found)}")
        return 0
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    print(f"now:  {here}\nkept: {kept['machine']}\n")
    said = {name: moved(kept["ratios"][name], values) for name, values in found.items()}
    for name, values in found.items():
        print(f"{name:10} {statistics.median(values):10.3g}  {said[name] or 'within the noise'}")
    return int(any(said.values()))


if __name__ == "__main__":
    raise SystemExit(main())
