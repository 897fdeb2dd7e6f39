"""Each run's own random numbers: what it starts from and meets, from the campaign's seed and the run's index alone."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.engine import Batch
from lockstep.campaign.plan import Plan

FAMILIES = ("peak", "sine", "noise", "step", "start", "drops")
"""peak: from agreement at an operating point, a windowed sine near the frequency and direction of the largest singular
value there;  sine: random frequency and direction;  noise: Gaussian, held;  step: a constant for a while;  start: random
initial states, some with noise, those without from where the clipped loop is proved to converge, if it is;  drops: the same
while messages are lost, which no certificate covers."""

SHARES = (0.35, 0.2, 0.1, 0.1, 0.15, 0.1)

AMPLITUDES = (1e-2, 3.0)
MOST_DROPS = 0.3
JITTER = 0.03
"""Relative spread of the frequencies around a peak."""

INSIDE = 1 - 1e-12
"""Keeps |Delta| at its bound and not an ulp above it."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """The runs of a part of the campaign: their indices, their families (rows of FAMILIES), and the batch."""

    index: np.ndarray
    family: np.ndarray
    batch: Batch


def draw(plan: Plan, begin: int, end: int) -> Drawn:
    """Draw the runs from index `begin` to before `end`."""
    layout = plan.source.layout
    rows, index = layout.rows(end - begin), np.arange(begin, end)
    family, seeds = np.zeros(len(index), int), np.zeros(len(index), np.uint64)
    for k, run in enumerate(index):
        # Counter-based: run `run` is what it is whether or not the others are drawn.
        random = np.random.Generator(np.random.Philox(key=np.array([plan.seed, run], np.uint64)))
        seeds[k] = random.integers(0, 2**63)
        family[k] = _family(plan, random)
        for name, value in _parameters(plan, FAMILIES[family[k]], random).items():
            rows[k, layout.places[name]] = np.ravel(value)
    nothing = np.zeros((0, 1, layout.N * layout.n))
    return Drawn(index, family, Batch(layout, rows, seeds, np.full(len(index), -1), nothing))


def _family(plan: Plan, random: np.random.Generator) -> int:
    found = int(np.searchsorted(np.cumsum(SHARES), random.random(), side="right"))
    found = min(found, len(FAMILIES) - 1)
    lossless = FAMILIES[found] == "drops" and not plan.source.layout.features.drops
    return FAMILIES.index("start") if lossless else found


def _parameters(
    plan: Plan, family: str, random: np.random.Generator
) -> dict[str, Float[np.ndarray, "..."] | float]:
    values = _perturbation(plan, random)
    if family in ("start", "drops"):
        values |= _from_disagreement(plan, random)
        if family == "drops":
            values["drop"] = random.uniform(0, MOST_DROPS)
        return values
    peak = plan.peaks[int(random.integers(len(plan.peaks)))]
    N = plan.source.layout.N
    # All agents at one state, held there by a disturbance that all of them share: x_d = 0 and xi_d = 0.
    values |= {"x": np.tile(peak.point, N), "bias": np.tile(peak.hold, N)}
    size = _log_uniform(random, *AMPLITUDES)
    if family == "noise":
        return values | {"sigma": size * plan.driven * np.abs(random.normal(size=(N, len(peak.point))))}
    if family == "step":
        begin, end = np.sort(random.uniform(0, plan.horizon, 2))
        return values | {"cosine": size * _direction(plan, random), "start": begin, "stop": end}
    if family == "peak":
        omega = peak.omega * np.exp(JITTER * random.normal())
        direction = peak.direction
    else:
        slowest = 2 * np.pi / plan.horizon
        fastest = 10 * max(slowest, *(one.omega for one in plan.peaks))
        omega = _log_uniform(random, slowest, fastest)
        direction = _direction(plan, random) + 1j * _direction(plan, random)
    # Re((a - j b) e^(j omega t)) = a cos omega t + b sin omega t
    wave = {"cosine": size * direction.real, "sine": -size * direction.imag, "omega": omega}
    begin = plan.horizon * random.choice([0.0, 0.0, 0.3]) * random.random()
    window = {"start": begin, "stop": plan.horizon, "hann": float(random.random() < 0.8)}
    return values | wave | window | {"turn": 2 * np.pi / (plan.horizon - begin)}


def _from_disagreement(
    plan: Plan, random: np.random.Generator
) -> dict[str, Float[np.ndarray, "..."] | float]:
    layout = plan.source.layout
    low, high = plan.starts
    x = random.uniform(low, high, (layout.N, layout.n)).ravel()
    if random.random() < 0.5:
        return {"x": x if plan.clipped_radius is None else _within(plan.clipped_radius, layout.N, random, x)}
    return {"x": x, "sigma": _log_uniform(random, *AMPLITUDES) * np.tile(plan.driven, layout.N)}


def _within(
    radius: float, N: int, random: np.random.Generator, x: Float[np.ndarray, " states"]
) -> Float[np.ndarray, " states"]:
    """States with the same mean whose disagreement is uniform in direction, and up to a radius: at it half of the time."""
    states = x.reshape(N, -1)
    away = random.normal(size=states.shape)
    away -= away.mean(axis=0)
    size = INSIDE * radius * random.choice([1.0, random.random()])
    return np.asarray(states.mean(axis=0) + size * away / np.linalg.norm(away)).ravel()


def _perturbation(plan: Plan, random: np.random.Generator) -> dict[str, Float[np.ndarray, "..."] | float]:
    """Delta(t) = cos(nu t + phase) E per agent and letter, every singular value of E at the bound of (11); half of
    them constant."""
    if not plan.source.layout.features.uncertain:
        return {}
    constant = random.random() < 0.5
    even, odd = [], []
    for _ in range(plan.source.layout.N):
        for _, bound, shape in plan.deltas:
            u, _, v = np.linalg.svd(random.normal(size=shape), full_matrices=False)
            E = bound * INSIDE * u @ v
            phase = 0.0 if constant else random.uniform(0, 2 * np.pi)
            even.append(np.cos(phase) * E.ravel())
            odd.append(-np.sin(phase) * E.ravel())
    nu = 0.0 if constant else _log_uniform(random, 0.1, 30.0)
    return {"delta": np.concatenate([*even, *odd]), "nu": nu}


def _direction(plan: Plan, random: np.random.Generator) -> Float[np.ndarray, "N n"]:
    """A random direction of unit length among the driven states, in some of them only as often as in all."""
    layout = plan.source.layout
    found = plan.driven * random.normal(size=(layout.N, layout.n))
    if random.random() < 0.5:
        found = found * (random.random(layout.n) < 0.5)
    length = float(np.linalg.norm(found))
    return found / length if length else _direction(plan, random)


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))
