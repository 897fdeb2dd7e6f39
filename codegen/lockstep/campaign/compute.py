"""A part of a campaign computed: the table of its runs. This is what is sent to other machines."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.engine import Engine, RunFigures
from lockstep.campaign.draw import FAMILIES, draw
from lockstep.campaign.plan import CHUNK, Plan

OWN_COLUMNS = ("run", "family", "covered", "diverged", "ratio", "gain", "stored")
"""Before the engine's: index, row of FAMILIES, whether the certificate covers the run, whether it diverged, the ratio to
the bound of `plan`, |z| / |xi_d| (NaN without disturbance), V of the initial disagreement."""

Keep = Callable[[int, int, Float[np.ndarray, "runs columns"]], None]
"""Called with each chunk: the first run, the one after the last, and the table of those between."""


def columns_of(plan: Plan) -> tuple[str, ...]:
    """Return the columns of the table."""
    return (*OWN_COLUMNS, *plan.source.layout.columns)


def chunks(runs: int) -> list[tuple[int, int]]:
    """Return (begin, end) of each chunk of so many runs.

    >>> chunks(600)
    [(0, 256), (256, 512), (512, 600)]
    """
    return [(begin, min(begin + CHUNK, runs)) for begin in range(0, runs, CHUNK)]


def compute(plan: Plan, begin: int, end: int) -> Float[np.ndarray, "runs columns"]:
    """Return the table of the runs from `begin` to before `end`; the same wherever and whenever it is computed."""
    drawn = draw(plan, begin, end)
    outcome = Engine(plan.source).run(drawn.batch, plan.horizon)
    stored = plan.guarantee.stored(drawn.batch.rows[:, plan.source.layout.places["x"]])
    covered = (drawn.family != FAMILIES.index("drops")) & (outcome["outside"] == 0) & ~np.isnan(stored)
    covered &= (
        (outcome["clipped"] == 0)
        & ~(outcome["effort_peak"] > plan.guarantee.limit)
        & (outcome["faults"] == 0)
    )
    own = np.column_stack(
        [
            drawn.index,
            drawn.family,
            covered,
            outcome.diverged,
            ratios(plan.guarantee.rho, stored, outcome),
            outcome.gain,
            stored,
        ]
    )
    return np.hstack([own.astype(float), outcome.table])


def ratios(rho: float, stored: Float[np.ndarray, " runs"], outcome: RunFigures) -> Float[np.ndarray, " runs"]:
    """Return |z| / (V + rho^2 |xi_d|^2)^1/2; infinite for a diverged run, 0 for one at rest."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.sqrt(outcome["z_squared"] / (stored + rho**2 * outcome["w_squared"]))
    found = np.where(outcome["z_squared"] == 0, 0.0, found)
    return np.where(outcome.diverged, np.inf, found)


@dataclass(frozen=True, eq=False)
class RunTable:
    """All runs of a campaign, in the order of their indices."""

    columns: tuple[str, ...]
    values: Float[np.ndarray, "runs columns"]

    def __getitem__(self, name: str) -> Float[np.ndarray, " runs"]:
        """Return one column."""
        return np.asarray(self.values[:, self.columns.index(name)])

    @property
    def covered(self) -> np.ndarray:
        """Which runs the certificate covers."""
        return np.asarray(self["covered"] == 1)

    def worst(self, count: int = 10) -> list[int]:
        """Return the indices of the covered runs that came nearest to the bound, or beyond it, the worst first."""
        ratio = np.where(self.covered, self["ratio"], -np.inf)
        order = np.argsort(-ratio, kind="stable")[:count]
        return [int(run) for run in self["run"][order[np.isfinite(ratio[order]) | (ratio[order] > 0)]]]


def excused(plan: Plan, figures: RunTable) -> np.ndarray:
    """Which runs left the domain, or clipped where nothing is proved of it: disturbed, with lost messages, out of the domain,
    or from beyond `clipped_radius`."""
    inside = (figures["disagreement_initial"] <= (plan.clipped_radius or 0.0)) & (figures["outside"] == 0)
    inside &= (figures["w_squared"] == 0) & (figures["family"] != FAMILIES.index("drops"))
    return np.asarray(((figures["clipped"] > 0) | (figures["outside"] > 0)) & ~np.asarray(inside))
