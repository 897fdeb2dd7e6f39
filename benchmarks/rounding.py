"""Rounding of float32 steps as it happens, beside exact integer arithmetic and what the certificate claims of it.

Run by hand:  python benchmarks/rounding.py [DIR] [--steps 1000000] [--json]

The controllers are those of the C in DIR (`lockstep generate`), in the order of its operations. They run in a loop with
their agents, many runs at once, each from states of its own size and struck now and then, so that differences of
messages cancel as they do on the way to consensus. Of each step its own inputs are exact, and the step is made twice:
in float32, and in integers times a power of two. The claim is

    |error of x_C+| <= delta_A |x_C| + delta_B |d|,    |error of u| <= delta_C |x_C| + delta_D |d|.

`worst` is the largest part of the claim that was used: above 1 the claim is false, below 0.1 it is of little use.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm

from lockstep.check.c_source.reader import read_controller
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.sampled_design import sampled_network
from lockstep.lmi.document import read
from lockstep.lmi.sampled import HeldController
from lockstep.lmi.sampled.witnesses import plant_in_doubles

DEFAULT = Path(__file__).parents[1] / "generated" / "flexible_joint_arms"
LENGTH = 200
"""Periods of one run."""

EXPONENT = 140
"""Numbers are taken as integers times 2^-140, and those below 2^-110 as zero: no underflow is met, nor any claim of it."""


@dataclass(frozen=True)
class Row:
    """One agent and one part of its step: how many steps, and the largest part of the claim seen."""

    agent: str
    part: str
    steps: int
    worst: float

    @property
    def holds(self) -> bool:
        """Whether the claim held, and was not ten times too large."""
        return 0.1 <= self.worst <= 1


def measure(folder: Path, steps: int, seed: int = 0) -> list[Row]:
    """Run so many steps of each controller and return the worst of each."""
    names = [agent.name for agent in load_manifest(folder).agents]
    texts = {
        name: [(folder / path).read_text() for path in (f"include/{name}.h", f"src/{name}.c")]
        for name in names
    }
    controllers = [read_controller(name, *texts[name], names).controller for name in names]
    stored = read(folder / "design.json")
    plant, _ = plant_in_doubles(sampled_network(stored))
    n, m, _, _, _ = plant.sizes
    runs, rng = -(-steps // LENGTH), np.random.default_rng(seed)
    held = [
        expm(stored.problem.controller.period * np.block([[plant.A, B], [np.zeros((m, n + m))]]))[:n]
        for B in plant.B
    ]
    x = rng.standard_normal((len(names), n, runs)) * 2.0 ** rng.integers(-8, 4, runs)
    x_C = [np.zeros((one.order, runs), dtype=np.float32) for one in controllers]
    worst = {(name, part): 0.0 for name in names for part in ("x_C+", "u")}
    for k in range(LENGTH):
        if k % 50 == 49:
            x += rng.standard_normal(x.shape) * 2.0 ** rng.integers(-8, 4, runs)
        y = [_without_the_least((plant.C @ one).astype(np.float32)) for one in x]
        for i, (name, one) in enumerate(zip(names, controllers, strict=True)):
            after, used = _step(one, x_C[i], y[i], [y[j] for j in one.sources])
            for part, value in used.items():
                worst[name, part] = max(worst[name, part], value)
            x_C[i] = _without_the_least(after[: one.order])
            x[i] = held[i] @ np.vstack([x[i], after[one.order :].astype(float)])
    return [Row(name, part, runs * LENGTH, value) for (name, part), value in worst.items()]


def _step(
    one: HeldController, x: np.ndarray, y: np.ndarray, heard: Sequence[np.ndarray]
) -> tuple[np.ndarray, dict[str, float]]:
    """Return (x_C+, u) in float32, and the largest parts of the claims that its errors used."""
    table, weights = one.table.astype(np.float32), one.weights.astype(np.float32)
    r = np.zeros_like(y)
    for a, other in zip(weights, heard, strict=True):
        difference = y - other
        r = r + (difference if a == 1 else a * difference)
    z = np.vstack([x, r])
    done = np.zeros((len(table), z.shape[1]), dtype=np.float32)
    for row, coefficients in enumerate(table):
        terms = [c * value for c, value in zip(coefficients, z, strict=True) if c != 0]
        done[row] = sum(terms[1:], start=terms[0]) if terms else 0
    assert done.dtype == np.float32
    # Integers from here: coefficients, weights and signals times powers of two.
    exact_d = [
        _integers(a[None, None]) * (_integers(y) - _integers(other))
        for a, other in zip(weights, heard, strict=True)
    ]
    scaled = np.vstack([_integers(x) << EXPONENT, sum(exact_d[1:], start=exact_d[0])])
    error = (_integers(done) << (2 * EXPONENT)) - _integers(table) @ scaled
    length = lambda M, exponent: np.sqrt(((M.astype(float) * 2.0**-exponent) ** 2).sum(axis=0))  # noqa: E731
    n, d, size = one.order, one.deltas, length(_integers(x), EXPONENT)
    across = length(np.vstack(exact_d), 2 * EXPONENT)
    claims = {"x_C+": d["A"] * size + d["B"] * across, "u": d["C"] * size + d["D"] * across}
    errors = {"x_C+": error[:n], "u": error[n:]}
    used = {}
    for part, claim in claims.items():
        seen = length(_rescaled(errors[part]), EXPONENT)
        used[part] = float((seen[claim > 0] / claim[claim > 0]).max(initial=0.0)) if n or part == "u" else 0.0
    return done, used


def _without_the_least(values: np.ndarray) -> np.ndarray:
    return np.where(np.abs(values) < 2.0**-110, np.float32(0), values)


def _integers(values: np.ndarray) -> np.ndarray:
    """Return v 2^140 as Python's integers, which is exact for what float32 has above 2^-117."""
    flat = [int(v) for v in np.ldexp(values.astype(float), EXPONENT).ravel()]
    out = np.empty(len(flat), dtype=object)
    out[:] = flat
    return out.reshape(values.shape)


def _rescaled(error: np.ndarray) -> np.ndarray:
    """Return an error times 2^420 as one times 2^140, to the 53 bits that a double keeps."""
    return np.array([[float(v >> EXPONENT) * 2.0**-EXPONENT for v in row] for row in error]).reshape(
        error.shape
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and return 1 if a claim is false or ten times too large."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=DEFAULT)
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of each controller")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    rows = measure(options.folder, options.steps)
    if options.json:
        print(json.dumps([{**asdict(row), "holds": row.holds} for row in rows], indent=2))
    else:
        print("| agent | part | steps | worst error / claim | claim / worst |\n|---|---|---|---|---|")
        for row in rows:
            print(
                f"| {row.agent} | {row.part} | {row.steps} | {row.worst:.3f} | {1 / max(row.worst, 1e-300):.1f} |"
            )
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
