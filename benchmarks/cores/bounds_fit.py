"""Fit the coefficients of `codegen/cost/bound_coefficients.py` to what `bounds.py` measured; hold measurements to the bounds.

    python benchmarks/cores/bounds_fit.py fit FILE.jsonl...     prints the tables
    python benchmarks/cores/bounds_fit.py raise FILE.jsonl...   the tables with constants raised to what leaders measured need
    python benchmarks/cores/bounds_fit.py hold FILE.jsonl...    measured over bound; exits with 1 above a bound

A linear program: coefficients >= 0, every measurement with its head room at most the bound, and the sum of the bounds,
each over its measurement, smallest. The routines of soft arithmetic are a table of their own (`bounds.py library`).
"""

import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.optimize import linprog

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import FLASH, STACK
from lockstep.codegen.cost.bounds import INTEGER_PARTS, OWN_PARTS, bounds, integer_budgets, operations
from lockstep.codegen.cost.budget import (
    ALIKE,
    FLASH_PARTS,
    SOFT_ALIKE,
    STACK_PARTS,
    Extent,
    fixed_flash,
    fixed_stack,
)

ROOM = {"stack": (1.15, 16), "flash": (1.3, 64), "own": (1.3, 0)}
INTEGER_ROOM = 1.5
TABLES = {"stack": STACK, "flash": FLASH}
PARTS = {"stack": STACK_PARTS, "flash": FLASH_PARTS, "own": OWN_PARTS}


def extent_of(row):
    """The dimensions of a row."""
    return Extent(Shape(*row["shape"]), row["limited"], row["shifted"])


def declared(row, what):
    """What the C itself says, which is no part of the fit."""
    if what == "own":
        return 0
    real = RealType(row["real"])
    return (
        fixed_stack(extent_of(row), real)
        if what == "stack"
        else fixed_flash(extent_of(row), real, row["optimize"])
    )


def key_of(row):
    """The table's row that a measurement counts for."""
    alike = ALIKE if row["real"] == "float32" else SOFT_ALIKE
    return alike.get(row["core"], row["core"]), row["real"], row["optimize"]


def smallest(parts, rows, most, fixed):
    """Tenths, rounded up: parts @ tenths / 10 + fixed >= most, and the sum of (parts @ tenths) / most least."""
    X = np.array([[float(part(extent_of(row))) for part in parts] for row in rows])
    found = linprog((X / most[:, None]).sum(0), A_ub=-X, b_ub=fixed - most, method="highs").x
    return tuple(int(np.ceil(10 * c - 1e-6)) for c in found)


def fit(rows):
    """Print each table."""
    floats, integers = (
        [r for r in rows if r["real"] != "integers"],
        [r for r in rows if r["real"] == "integers"],
    )
    for what, (part, more) in ROOM.items():
        print(f"{what.upper()}: Table = {{")
        by = defaultdict(list)
        for row in floats:
            if what in row:  # instructions are not counted in every run
                by[key_of(row)].append(row)
        for key, some in sorted(by.items()):
            most = np.array([part * row[what] + more for row in some])
            print(
                f"    {key}: {smallest(PARTS[what], some, most, np.array([declared(r, what) for r in some]))},"
            )
        print("}")
    print("INTEGERS: dict[str, tuple[int, ...]] = {")
    for core in sorted({row["core"] for row in integers} - set(SOFT_ALIKE)):
        some = [row for row in integers if SOFT_ALIKE.get(row["core"], row["core"]) == core]
        most = np.array([INTEGER_ROOM * row["own"] for row in some])
        print(f'    "{core}": {smallest(INTEGER_PARTS, some, most, np.zeros(len(some)))},')
    print("}")


def raised(rows):
    """Print the lines of the tables that measurements of leaders change: their constant alone, neighbours' bounds kept.

    Of stack it is that of all, less what a first neighbour adds; of flash there is a part for no neighbour.
    """
    for what, at, less in (("stack", 0, 4), ("flash", 9, None)):
        most = defaultdict(float)
        for row in rows:
            key, (part, more), extent = key_of(row), ROOM[what], extent_of(row)
            tenths = zip(TABLES[what][key], PARTS[what], strict=True)
            have = declared(row, what) + sum(a * part_of(extent) for a, part_of in tenths) / 10
            most[key] = max(most[key], part * row[what] + more - have)
        for key, missing in sorted(most.items()):
            line, tenths = list(TABLES[what][key]), int(np.ceil(10 * missing - 1e-6))
            line[at] += tenths
            if less is not None:
                line[less] = max(0, line[less] - tenths)
            if tenths:
                print(f"{what.upper()} {key}: {tuple(line)},")


def hold(rows):
    """Print, per core and arithmetic, the largest and the mean of measured over bound; whether none is above."""
    found, fine = defaultdict(list), True
    for row in rows:
        extent = extent_of(row)
        if row["real"] == "integers":
            found[row["core"], row["real"], "instructions"].append(
                row["own"] / integer_budgets(extent.shape)[row["core"]]
            )
            continue
        real, most = RealType(row["real"]), bounds(extent, RealType(row["real"]), row["optimize"])
        for what in ("stack", "flash"):
            found[row["core"], real.name, what].append(row[what] / most[what][row["core"]])
        if "total" not in row:
            continue
        found[row["core"], real.name, "instructions"].append(row["total"] / most["instructions"][row["core"]])
        sums, itself, nothing, products, compared = operations(extent)
        calls = defaultdict(int, row["calls"])
        counted = calls["add"] + calls["sub"] <= sums + itself + nothing, calls["mul"] <= products
        if not all(counted) or calls["compare"] > compared:
            fine, _ = False, print("more operations than counted:", row)
    for (core, real, what), ratios in sorted(found.items()):
        fine &= max(ratios) <= 1
        ends = f"measured / bound at most {max(ratios):.3f}, mean {np.mean(ratios):.3f}"
        print(f"{core:12} {real:9} {what:13} {len(ratios):5} compiles: {ends}")
    return fine


if __name__ == "__main__":
    read = [json.loads(line) for name in sys.argv[2:] for line in Path(name).read_text().splitlines()]
    sys.exit(0 if {"fit": fit, "raise": raised, "hold": hold}[sys.argv[1]](read) in (None, True) else 1)
