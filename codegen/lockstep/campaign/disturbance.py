"""The disturbance of a run again, in NumPy: what the C made of its parameters, for a replay to show.

Random numbers are counted, not drawn one after another: a number is the hash of the run's seed, of what it is for, and
of its place (SplitMix64's finalizer: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
"""

import numpy as np
from jaxtyping import Float, UInt64

from lockstep.campaign.compiled.engine import Batch

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
NOISE, DROPS = 1, 2
"""Streams: what a random number is for."""


def random_unit(seed: int, stream: int, counter: UInt64[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return uniform numbers in (0, 1), as `random_unit` of campaign-lanes.h does, bit for bit."""
    with np.errstate(over="ignore"):
        key = _scattered(
            _scattered(np.asarray([seed], np.uint64) + GOLDEN) + np.asarray([stream], np.uint64) * GOLDEN
        )
        bits = _scattered(key + (np.asarray(counter, np.uint64) + np.uint64(1)) * GOLDEN)
    return np.asarray(((bits >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53)


def _scattered(z: UInt64[np.ndarray, "..."]) -> UInt64[np.ndarray, "..."]:
    """The finalizer; of the golden ratio, SplitMix64's first number from the seed 0.

    >>> hex(_scattered(np.array([GOLDEN]))[0])
    '0xe220a8397b1dcdaf'
    """
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


def gaussians(seed: int, periods: int, states: int) -> Float[np.ndarray, "periods states"]:
    """Return the standard Gaussians of a run: two by two from two uniform numbers (Box and Muller 1958)."""
    even = np.arange(0, states, 2)
    place = (np.arange(periods)[:, None] * (states + 1) + even).astype(np.uint64)
    radius = np.sqrt(-2 * np.log(random_unit(seed, NOISE, place)))
    angle = 2 * np.pi * random_unit(seed, NOISE, place + np.uint64(1))
    pairs = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=2)
    return np.asarray(pairs.reshape(periods, -1)[:, :states])


def disturbance(batch: Batch, run: int, periods: int) -> Float[np.ndarray, "K N n"]:
    """Return xi of a run at the beginning of each step, and at the end as during the last."""
    layout = batch.layout
    states, substeps = layout.N * layout.n, layout.substeps
    places, row = layout.places, batch.rows[run]
    t = np.arange(periods * substeps + 1) * layout.step
    held = np.tile(row[places["bias"]], (periods, 1))
    if "sigma" in places:
        held = held + row[places["sigma"]] * gaussians(int(batch.seeds[run]), periods, states)
    if "scale" in places and batch.which[run] >= 0:
        held = held + row[places["scale"]] * batch.sequences[batch.which[run]]
    xi = held[np.minimum(np.arange(len(t)) // substeps, periods - 1)]
    if "omega" in places:
        xi = xi + _wave(batch, run, t)
    return np.asarray(xi.reshape(len(t), layout.N, layout.n))


def _wave(batch: Batch, run: int, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K states"]:
    places, row = batch.layout.places, batch.rows[run]
    omega, start, stop, hann, turn = (
        float(row[places[name]][0]) for name in ("omega", "start", "stop", "hann", "turn")
    )
    amount = ((t >= start) & (t < stop)) * (1 - hann * (0.5 + 0.5 * np.cos(turn * (t - start))))
    angle = omega * t[:, None]
    return np.asarray(
        amount[:, None] * (row[places["cosine"]] * np.cos(angle) + row[places["sine"]] * np.sin(angle))
    )
