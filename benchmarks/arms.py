"""Published gains, gains for rho alone, and the default design of the arms, side by side, every figure proved.

Run by hand:  python benchmarks/arms.py [--rho-only FILE] [--default FILE] [--write]

The problem is examples/flexible_joint_arms.toml, the published gains are those of examples/table_1.toml, and those for rho
alone are designed with `gain_limit = 50.0`, unless a design file is named; so is the default. All three are given to the
same problem, R = Q = I: what rho weighs besides is left out of the table. --write puts it into docs/designs.md.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from page import markdown, write

import lockstep
from lockstep.check.system.loop import Gains
from lockstep.lmi.proposal import given_gains
from lockstep.model.problem import load_problem

ROOT = Path(__file__).resolve().parents[1]
ARMS, PUBLISHED = ROOT / "examples" / "flexible_joint_arms.toml", ROOT / "examples" / "table_1.toml"
PAGE = ROOT / "docs" / "designs.md"
BEGIN, END = "<!-- table: python benchmarks/arms.py --write -->", "<!-- end of the table of the arms -->"
HEAD = (
    "gains", "rho, continuous", "rho, sampled", "decay, 1/s", "radius within 10 V", "largest gain norm", "longest period, ms",
    "residual per message error", "controllers by themselves",
)  # fmt: skip


def measured(gains: Gains) -> dict[str, Any]:
    """Return the answer of `lockstep design` for gains that are given."""
    content = load_problem(ARMS).document()
    tables = [{letter: getattr(gains, letter)[i].tolist() for letter in "ABCD"} for i in range(gains.N)]
    content["design"] = {"method": "given", "gains": tables}
    return lockstep.design(lockstep.Problem.from_document(content)).document()


def row(name: str, gains: Gains) -> tuple[str, ...]:
    """Return what is proved of gains, as text."""
    answer = measured(gains)
    sampled, radius = answer["sampled"], answer.get("limits", {}).get("radius")
    return (
        name,
        f"{answer['rho']:.4g}",
        f"{sampled['rho']:.4g}",
        f"{answer['decay']:.2g}",
        "none" if radius is None else f"{radius:.3g}",
        f"{np.linalg.norm(gains.blocks, 2, axis=(1, 2)).max():.3g}",
        f"{1e3 * sampled['max_period']:.3g}",
        f"{sampled['residual_per_message_error']:.0f}",
        "stable" if answer.get("controllers_stable") else "not all stable",
    )


def table(rho_only: Path | None, default: Path | None) -> str:
    """Return the table in Markdown."""
    alone = load_problem(ARMS).document()
    alone["design"]["gain_limit"] = 50.0
    gains = {
        "published": given_gains(load_problem(PUBLISHED)),
        "for rho alone": (
            lockstep.load(rho_only) if rho_only else lockstep.design(lockstep.Problem.from_document(alone))
        ).gains,
        "by default": (lockstep.load(default) if default else lockstep.design(ARMS)).gains,
    }
    return markdown(HEAD, (row(name, one) for name, one in gains.items()))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write the table if asked to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rho-only", type=Path, help="a design file of the arms for rho alone")
    parser.add_argument("--default", type=Path, help="a design file of the arms by default")
    parser.add_argument("--write", action="store_true", help="put the table into docs/designs.md")
    asked = parser.parse_args(arguments)
    made = table(asked.rho_only, asked.default)
    print(made)
    if asked.write:
        write(PAGE, BEGIN, END, made)


if __name__ == "__main__":
    main()
