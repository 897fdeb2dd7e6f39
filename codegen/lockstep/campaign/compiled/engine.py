"""Runs of the closed loop, many at a time, in the compiled C."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int64, UInt64

from lockstep.campaign.compiled.lanes import LANES
from lockstep.campaign.compiled.layout import INDICES, Layout
from lockstep.campaign.compiled.library import load
from lockstep.campaign.compiled.source import CampaignSource
from lockstep.check.errors import ProblemError, demand


@dataclass(frozen=True, eq=False)
class Batch:
    """What each run starts from and meets.

    rows: (runs, parameters), see `Layout.places`;  seeds: of the noise and the drops;  which: a row of `sequences`, or
    -1;  sequences: (any, periods, N n), xi held for a period each, the same for all runs that name it.
    """

    layout: Layout
    rows: Float[np.ndarray, "runs parameters"]
    seeds: UInt64[np.ndarray, " runs"]
    which: Int64[np.ndarray, " runs"]
    sequences: Float[np.ndarray, "any periods states"]

    def __post_init__(self) -> None:
        """Refuse arrays of other shapes or types: C reads them as they are."""
        count, states = len(self.seeds), self.layout.N * self.layout.n
        if self.rows.shape != (count, self.layout.parameters) or self.which.shape != (count,):
            raise ProblemError(
                f"rows {self.rows.shape}, which {self.which.shape} for {count} seeds",
                where="campaign batch",
                expected=f"({count}, {self.layout.parameters}) and ({count},)",
            )
        if self.sequences.ndim != 3 or self.sequences.shape[2] != states:
            raise ProblemError(
                f"sequences {self.sequences.shape}",
                where="campaign batch",
                expected=f"(any, periods, {states})",
            )
        if count and not -1 <= self.which.min() <= self.which.max() < len(self.sequences):
            raise ProblemError(
                f"a run names sequence {self.which.max()} of {len(self.sequences)}", where="campaign batch"
            )
        for name, kind in (("rows", "f8"), ("seeds", "u8"), ("which", "i8"), ("sequences", "f8")):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=kind))

    @classmethod
    def at_rest(
        cls,
        layout: Layout,
        count: int,
        *,
        seeds: UInt64[np.ndarray, " runs"] | None = None,
        sequences: Float[np.ndarray, "any periods states"] | None = None,
        **values: Float[np.ndarray, "..."] | float,
    ) -> "Batch":
        """Return runs with parameters by name, all else zero: no disturbance, no Delta, every message arrives.

        With one sequence or more, run k takes sequence k modulo their number, times 1 unless `scale` is given.
        """
        rows = layout.rows(count)
        if sequences is not None and "scale" not in values:
            values = {**values, "scale": 1.0}
        for name, value in values.items():
            found = f"`{name}` is no parameter"
            demand(name in layout.places, found, "campaign batch", ", ".join(layout.places))
            place = layout.places[name]
            numbers = np.asarray(value, dtype=float)
            width = place.stop - place.start
            rows[:, place] = numbers.reshape(-1, width) if numbers.ndim else numbers
        given = (
            np.zeros((0, 1, layout.N * layout.n)) if sequences is None else np.asarray(sequences, dtype=float)
        )
        which = np.full(count, -1) if sequences is None else np.arange(count) % len(given)
        return cls(
            layout,
            rows,
            np.zeros(count, np.uint64) if seeds is None else seeds,
            which.astype(np.int64),
            given,
        )

    def part(self, begin: int, end: int) -> "Batch":
        """Return some of the runs."""
        rows = slice(begin, end)
        return Batch(self.layout, self.rows[rows], self.seeds[rows], self.which[rows], self.sequences)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.seeds)


@dataclass(frozen=True, eq=False)
class RunFigures:
    """The figures of each run: a table with the columns of `Layout.columns`."""

    layout: Layout
    table: Float[np.ndarray, "runs figures"]

    def __getitem__(self, name: str) -> Float[np.ndarray, " runs"]:
        """Return one figure of every run."""
        return np.asarray(self.table[:, self.layout.columns.index(name)])

    @property
    def gain(self) -> Float[np.ndarray, " runs"]:
        """|z|_L2 / |xi_d|_L2; NaN without a disturbance. It is a gain if the run starts in agreement."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(self["z_squared"] / self["w_squared"])
        return np.where(self["w_squared"] > 0, ratio, np.nan)

    @property
    def diverged(self) -> np.ndarray:
        """Whether a run left all proportion or is not finite."""
        return np.asarray((self["ended"] >= 0) | ~np.isfinite(self.table).all(axis=1))

    @property
    def indices(self) -> Float[np.ndarray, "runs N 4"]:
        """ISE, IAE, ITSE, ITAE of each agent's disagreement, as in `lockstep.model.simulation.results.indices`."""
        first = self.layout.columns.index(f"{INDICES[0]}_1")
        return self.table[:, first : first + 4 * self.layout.N].reshape(-1, self.layout.N, 4)

    @property
    def states(self) -> Float[np.ndarray, "runs N n"]:
        """The states at the end."""
        width = self.layout.N * self.layout.n
        return self.table[:, -width:].reshape(-1, self.layout.N, self.layout.n)


@dataclass(frozen=True)
class Engine:
    """The closed loop, compiled.

    Raises on its first run: `ProblemError` without a compiler, `ClaimError` if the compiler refuses the C.
    """

    source: CampaignSource

    @property
    def layout(self) -> Layout:
        """The layout of its rows."""
        return self.source.layout

    def run(self, batch: Batch, horizon: float, *, threads: int = 1) -> RunFigures:
        """Integrate every run of a batch over a horizon in s, rounded up to whole periods.

        Args:
            batch: the runs.
            horizon: in s.
            threads: on which the runs are spread; the answer is the same.
        """
        periods = self._periods(batch, horizon)
        figures = np.empty((len(batch), len(self.layout.columns)))
        share = -(-len(batch) // max(threads, 1))
        share += -share % LANES
        parts = [(begin, min(begin + share, len(batch))) for begin in range(0, len(batch), max(share, 1))]
        load(self.source)
        if len(parts) <= 1:
            self._call(batch, periods, figures)
            return RunFigures(self.layout, figures)
        with ThreadPoolExecutor(threads) as pool:
            for done in [
                pool.submit(self._call, batch.part(begin, end), periods, figures[begin:end])
                for begin, end in parts
            ]:
                done.result()
        return RunFigures(self.layout, figures)

    def trace(self, batch: Batch, horizon: float) -> Mapping[str, Float[np.ndarray, "..."]]:
        """Return the first run of a batch step by step: t, x (K, N, n), x_C (K, N, n_C), u (K, N, m).

        One period more is run, and cut off: its first instant is the last of the trace, with the u that belongs to it.
        """
        layout, periods, one = self.layout, self._periods(batch, horizon), batch.part(0, 1)
        steps = periods * layout.substeps
        longer = replace(one, sequences=np.concatenate([one.sequences, one.sequences[:, -1:]], axis=1))
        rows = np.zeros((steps + layout.substeps, layout.trace_width))
        self._call(longer, periods + 1, np.empty((1, len(layout.columns))), rows)
        rows = rows[: steps + 1]
        ends = np.cumsum([layout.N * layout.n, layout.N * layout.order])
        x, x_C, u = np.split(rows, ends, axis=1)
        shape = (steps + 1, layout.N, -1)
        widths = (layout.n, layout.order, layout.m)
        named = zip(("x", "x_C", "u"), (x, x_C, u), widths, strict=True)
        t = np.arange(steps + 1) * layout.step
        return {"t": t, **{name: value.reshape(*shape[:2], width) for name, value, width in named}}

    def _periods(self, batch: Batch, horizon: float) -> int:
        periods = self.layout.periods(horizon)
        if len(batch.sequences) and batch.sequences.shape[1] != periods:
            raise ProblemError(
                f"sequences of {batch.sequences.shape[1]} periods",
                where="campaign batch",
                expected=f"{periods}: a horizon of {horizon:g} s",
            )
        return periods

    def _call(
        self,
        batch: Batch,
        periods: int,
        figures: Float[np.ndarray, "runs figures"],
        trace: Float[np.ndarray, "steps width"] | None = None,
    ) -> None:
        load(self.source)(
            len(batch),
            batch.rows.ctypes.data,
            batch.seeds.ctypes.data,
            batch.which.ctypes.data,
            batch.sequences.ctypes.data,
            periods,
            figures.ctypes.data,
            None if trace is None else trace.ctypes.data,
        )
