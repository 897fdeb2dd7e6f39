"""A campaign of network faults: many runs of the nodes that ship, held against what is claimed of such a network.

Every other run starts in agreement and is disturbed: by a sine where the linearised loop amplifies most, every eighth by
noise on every state. The others start anywhere and are not disturbed. What is claimed: with ages bounded (no independent
loss) int |z|^2 <= rho^2 int |xi_d|^2 of every run from agreement; with independent losses, as likely or less, of its mean,
whatever xi is.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float

from lockstep.campaign.network_faults.faults import NetworkFaults
from lockstep.campaign.network_faults.loop import COLUMNS, NetworkLoop
from lockstep.campaign.peaks import Peak
from lockstep.model.simulation.divergence import BEYOND

CHUNK = 64
NOISE = 1.0
"""Standard deviation of the noise on each state, held for a period."""
AMPLITUDE = 0.05
"""Of the sines: small, so that the loop stays near the operating point where it is weakest."""
ROUNDED = 1e-9
"""By so much two chances together may come out above what is proved."""


class MessagesProved(Protocol):
    """What is proved of a network: loss, burst, delay and jitter as in [network.messages]."""

    @property
    def loss(self) -> float:
        """Probability of each message."""
        ...

    @property
    def burst(self) -> int:
        """Lost in a row."""
        ...

    @property
    def delay(self) -> tuple[int, int]:
        """Least and most periods."""
        ...

    @property
    def jitter(self) -> float:
        """Part of the period."""
        ...


@dataclass(frozen=True)
class EveryMessageArrives:
    """What certificates without messages assume."""

    loss: float = 0.0
    burst: int = 0
    delay: tuple[int, int] = (0, 0)
    jitter: float = 0.0


@dataclass(frozen=True)
class NetworkGuarantee:
    """rho of the loop with its messages, and the network that it is proved for; None where nothing is claimed."""

    rho: float | None = None
    proved: MessagesProved | None = None

    def covers(self, faults: NetworkFaults) -> bool:
        """Tell whether what was proved is of such faults: chance loses no more, and nothing is more than was proved."""
        proved = self.proved
        if proved is None or self.rho is None or faults.restarts > 0:
            return False
        late = faults.delay[1] <= proved.delay[1] and faults.jitter <= proved.jitter
        if faults.burst is not None:
            return late and faults.burst <= proved.burst
        together = 1.0 - (1.0 - faults.loss) * (1.0 - faults.corrupt)
        return late and not faults.to_bad and together <= proved.loss * (1 + ROUNDED)


@dataclass(frozen=True, eq=False)
class NetworkCampaign:
    """The runs of a campaign, `COLUMNS` each; the even ones were disturbed."""

    faults: NetworkFaults
    guarantee: NetworkGuarantee
    seed: int
    horizon: float
    values: Float[np.ndarray, "runs columns"]
    most: float = BEYOND
    """A larger disagreement counts as divergence."""

    def __getitem__(self, name: str) -> Float[np.ndarray, " runs"]:
        """Return one column."""
        return np.asarray(self.values[:, COLUMNS.index(name)])

    @property
    def held(self) -> Bool[np.ndarray, " disturbed"]:
        """Which of the disturbed runs something is claimed of: no input was clipped, and no agent left its domain."""
        inside = (self["clipped"] == 0) & (self["outside"] == 0)
        known = np.asarray(inside[::2])
        return known if self.faults.oldest is not None else np.full(len(known), known.all())

    @property
    def covered(self) -> bool:
        """Whether something is claimed of such a network and of some of the runs; in the mean square, of all or none."""
        return self.guarantee.covers(self.faults) and bool(self.held.any())

    @property
    def diverged(self) -> int:
        """Number of runs that left all bounds."""
        return int((~(self["disagreement_largest"] < self.most)).sum())

    @property
    def gain(self) -> float:
        """Return |z| / |xi_d| of disturbed runs: the largest of those held; with losses by chance the root mean square."""
        squares = self["z2"][::2] / self["xi2"][::2]
        if self.faults.oldest is not None:
            return float(np.sqrt(squares[self.held if self.held.any() else slice(None)].max()))
        sines = np.arange(len(squares)) % 4 > 0
        return float(np.sqrt(squares[sines if sines.any() else slice(None)].mean()))

    @property
    def ok(self) -> bool:
        """Whether no run diverged, and what is claimed holds."""
        above = self.covered and self.guarantee.rho is not None and self.gain > self.guarantee.rho
        return self.diverged == 0 and not above

    def document(self) -> dict[str, Any]:
        """Return the result as plain JSON types."""
        free = self.values[1::2]
        final, first = (free[:, COLUMNS.index(f"disagreement_{name}")] for name in ("final", "initial"))
        sent = float(self["sent"].sum())
        return {
            "ok": self.ok,
            "runs": len(self.values),
            "seed": self.seed,
            "horizon": self.horizon,
            "faults": asdict(self.faults),
            "oldest": self.faults.oldest,
            "covered": self.covered,
            "rho": self.guarantee.rho,
            "gain": _number(self.gain),
            "gain_of": "the root mean square of the runs" if self.faults.oldest is None else "the worst run",
            "diverged": self.diverged,
            "lost": float(self["lost"].sum()) / sent if sent else 0.0,
            "faulty_steps": int(self["faults"].sum()),
            "clipped_runs": int((self["clipped"] > 0).sum()),
            "runs_outside": int((self["outside"] > 0).sum()),
            "disagreement_kept": _number((final / first).max()) if len(free) else None,
            "refused": {name: int(self[name].sum()) for name in COLUMNS[COLUMNS.index("bad_length") :]},
        }

    def csv(self) -> str:
        """Return the table of the runs."""
        rows = [",".join(("run", *COLUMNS))]
        rows += [",".join([str(k), *(repr(float(v)) for v in row)]) for k, row in enumerate(self.values)]
        return "\n".join(rows) + "\n"

    def summary(self) -> str:
        """Return the document as the text of a file."""
        return json.dumps(self.document(), indent=1, allow_nan=False) + "\n"


def run_network(
    loop: NetworkLoop,
    faults: NetworkFaults,
    guarantee: NetworkGuarantee,
    runs: int,
    *,
    peaks: Sequence[Peak] = (),
    seed: int = 0,
    horizon: float = 10.0,
    starts: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]] | tuple[float, float] = (-1.0, 1.0),
    jobs: int = 1,
    most: float = BEYOND,
) -> NetworkCampaign:
    """Run a campaign: a run is fixed by the seed and its index.

    Args:
        loop: compiled.
        faults: of the network.
        guarantee: what the runs are held against.
        runs: how many.
        peaks: where to disturb; without any all disturbed runs meet noise.
        seed: of all draws.
        horizon: of each run, in s.
        starts: the least and the largest of random initial states.
        jobs: threads.
        most: a larger disagreement counts as divergence.
    """

    def chunk(begin: int) -> np.ndarray:
        index = range(begin, min(begin + CHUNK, runs))
        drawn = [_draw(loop, faults, peaks, seed, k, *starts) for k in index]
        rows, first, waves = (np.array([one[part] for one in drawn]) for part in (0, 2, 3))
        return loop.runs(rows, np.array([one[1] for one in drawn], np.uint64), first, horizon, waves)

    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        values = np.vstack(list(pool.map(chunk, range(0, runs, CHUNK))))
    return NetworkCampaign(faults, guarantee, seed, horizon, values, most)


def _draw(
    loop: NetworkLoop,
    faults: NetworkFaults,
    peaks: Sequence[Peak],
    seed: int,
    k: int,
    low: Float[np.ndarray, " n"] | float,
    high: Float[np.ndarray, " n"] | float,
) -> tuple[list[float], int, np.ndarray, np.ndarray]:
    """Return what run k is: its row of faults, the seed of its network, its start and its disturbance."""
    random, wave = np.random.default_rng([seed, k]), np.zeros(3 * loop.N * loop.n + 1)
    start = random.uniform(low, high, (loop.N, loop.n))
    network_seed = int(random.integers(2**63))
    if k % 2:
        return faults.row(), network_seed, start, wave
    if not peaks or k % 8 == 0:
        return faults.row(NOISE), network_seed, np.tile(start[:1], (loop.N, 1)), wave
    peak = peaks[int(random.integers(len(peaks)))]
    wave[:-1] = np.concatenate(
        [
            np.tile(peak.hold, loop.N),
            AMPLITUDE * peak.direction.real.ravel(),
            -AMPLITUDE * peak.direction.imag.ravel(),
        ]
    )
    wave[-1] = peak.omega
    return faults.row(), network_seed, np.tile(peak.point, (loop.N, 1)), wave


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
