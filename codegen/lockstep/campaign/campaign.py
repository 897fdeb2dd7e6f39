"""Run a campaign: the chunks that are not there yet, on this machine's cores or on a cluster, then the result."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.library import load
from lockstep.campaign.compute import Keep, RunTable, chunks, compute, excused
from lockstep.campaign.draw import FAMILIES, draw
from lockstep.campaign.plan import FORMAT, Plan
from lockstep.campaign.scheduler import over_dask
from lockstep.campaign.store import Store
from lockstep.check.errors import ProblemError

QUANTILES = (0.5, 0.9, 0.99, 1.0)
WORST = 10

Report = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Campaign:
    """What came of a campaign.

    plan;  table: every run;  folder, path: where it is kept, and the table;  computed: runs computed just now, the rest
    being there before;  seconds: that this took.
    """

    plan: Plan
    table: RunTable
    folder: Path
    path: Path
    computed: int
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether runs are covered, none of these is above the bound, none diverged that is not `excused`, and no finite one
        had a fault."""
        diverged, faulty = self.table["diverged"] == 1, self.table["faults"] > 0
        above = self.table["ratio"][self.table.covered] > 1
        wrong = (
            above.any() or (diverged & ~excused(self.plan, self.table)).any() or (faulty & ~diverged).any()
        )
        return bool(self.table.covered.any() and not wrong)

    def document(self) -> dict[str, Any]:
        """Return the result as plain JSON types: the same for the same runs, but for `computed` and the speed."""
        return {
            **summary(self.plan, self.table),
            "ok": self.ok,
            "results": str(self.path),
            "folder": str(self.folder),
            "computed": self.computed,
            "seconds": self.seconds,
            "runs_per_second": self.computed / self.seconds if self.computed else None,
        }


def run_campaign(
    plan: Plan,
    runs: int,
    output: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    report: Report = lambda _what, _part: None,
) -> Campaign:
    """Run a campaign, or what is left of it.

    Args:
        plan: what is run.
        runs: how many; a larger number later adds to those that are there.
        output: a folder, in which the campaign has one of its own.
        jobs: threads on this machine; the C lets the interpreter go while it runs.
        scheduler: the address of a Dask scheduler, on whose workers the chunks are computed instead.
        report: called with what is being done and the part of it that is done.

    Raises:
        ProblemError: no compiler, no such scheduler, an output that cannot be written.
    """
    if runs < 1:
        raise ProblemError(f"{runs} runs", where="campaign", expected="1 or more")
    store = Store(plan, output)
    store.open()
    todo, start = store.missing(runs), time.perf_counter()
    done = len(chunks(runs)) - len(todo)

    def keep(begin: int, end: int, table: Float[np.ndarray, "runs columns"]) -> None:
        nonlocal done
        store.keep(begin, end, table)
        done += 1
        report(f"{min(done * (chunks(runs)[0][1]), runs)} of {runs} runs", done / len(chunks(runs)))

    report("compiling the loop", done / len(chunks(runs)))
    if scheduler is None:
        _on_this_machine(plan, todo, max(jobs, 1), keep)
    else:
        over_dask(plan, todo, scheduler, keep)
    seconds = time.perf_counter() - start
    table = store.table(runs)
    worst = {
        "format": FORMAT,
        "identity": plan.identity,
        "runs": [describe(plan, table, k) for k in table.worst(WORST)],
    }
    path = store.publish(table, {"worst.json": worst, "summary.json": summary(plan, table)})
    computed = sum(end - begin for begin, end in todo)
    return Campaign(plan, table, store.folder, path, computed, seconds)


def _on_this_machine(plan: Plan, todo: list[tuple[int, int]], jobs: int, keep: Keep) -> None:
    if todo:
        load(plan.source)
    pool = ThreadPoolExecutor(jobs)
    futures = {pool.submit(compute, plan, *chunk): chunk for chunk in todo}
    try:
        for future in as_completed(futures):
            keep(*futures[future], future.result())
    finally:
        # Interrupted: what is kept is kept, what has not begun is not begun.
        pool.shutdown(wait=True, cancel_futures=True)


def summary(plan: Plan, table: RunTable) -> dict[str, Any]:
    """Return the figures of a campaign as plain JSON types."""
    covered = table.covered
    ratio, finite = table["ratio"][covered], table["diverged"] == 0
    worst = table.worst(1)
    return {
        "format": FORMAT,
        "title": plan.title,
        "identity": plan.identity,
        "controllers": plan.controllers,
        "seed": plan.seed,
        "horizon": plan.horizon,
        "step": plan.source.layout.step,
        "runs": len(table.values),
        "covered": int(covered.sum()),
        "rho": plan.guarantee.rho,
        "linear_gain": max(one.gain for one in plan.peaks),
        "worst_run": worst[0] if worst else None,
        "worst_ratio": _number(ratio.max(initial=0.0)),
        "margin": _number(1 - ratio.max(initial=0.0)),
        "above": int((ratio > 1).sum()),
        "worst_ratio_not_covered": _largest(table["ratio"][~covered]),
        "diverged": int((~finite).sum()),
        "faults": int(np.nansum(table["faults"])),
        "clipped": int(np.nansum(table["clipped"])),
        "clipped_runs": int((table["clipped"] > 0).sum()),
        "runs_outside": int((table["outside"] > 0).sum()),
        "clipped_inside": int(((table["clipped"] > 0) & ~excused(plan, table)).sum()),
        "quantiles": _quantiles(table, covered),
        "families": {
            name: _family(table, table["family"] == k, covered)
            for k, name in enumerate(FAMILIES)
            if (table["family"] == k).any()
        },
    }


def _quantiles(table: RunTable, covered: np.ndarray) -> dict[str, dict[str, float | None]]:
    shown = {
        "ratio": table["ratio"][covered],
        "disagreement_final": table["disagreement_final"],
        "effort_peak": table["effort_peak"],
    }
    return {
        name: {str(q): _number(np.quantile(values, q)) for q in QUANTILES} if len(values) else {}
        for name, values in shown.items()
    }


def _family(table: RunTable, here: np.ndarray, covered: np.ndarray) -> dict[str, Any]:
    ratio = table["ratio"][here & covered]
    return {
        "runs": int(here.sum()),
        "covered": int((here & covered).sum()),
        "worst_ratio": _number(ratio.max()) if len(ratio) else None,
        "diverged": int((table["diverged"][here] == 1).sum()),
    }


def describe(plan: Plan, table: RunTable, run: int) -> dict[str, Any]:
    """Return a run's figures and what it started from and met, as plain JSON types."""
    batch = draw(plan, run, run + 1).batch
    figures = dict(zip(table.columns, table.values[run], strict=True))
    return {
        "run": run,
        "family": FAMILIES[int(figures["family"])],
        "ratio": _number(figures["ratio"]),
        "gain": _number(figures["gain"]),
        "disagreement_initial": _number(figures["disagreement_initial"]),
        "disagreement_final": _number(figures["disagreement_final"]),
        "seed": int(batch.seeds[0]),
        "parameters": {
            name: [_number(value) for value in batch.rows[0, place]]
            for name, place in plan.source.layout.places.items()
        },
    }


def _largest(values: Float[np.ndarray, " runs"]) -> float | None:
    known = values[~np.isnan(values)]
    return _number(known.max()) if len(known) else None


def _number(value: Any) -> float | None:
    """JSON has no infinity: null."""
    return float(value) if np.isfinite(value) else None
