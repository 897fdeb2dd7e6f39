"""Gains for what a network does to messages: from gains that do not carry it to such as may. Proposals, nothing is proved.

`descent.AgedObjective` knows ages alone. What it takes for all that a problem asks is what the two bounds of
`lockstep.check.sampled.messages` make of it where differences change steadily, by one in each period. A message that chance
holds back is n periods old with probability p^n (1 - p): it is off by held = (E n^2)^(1/2) = (p (1 + p))^(1/2) / (1 - p), and
the square of a jump is (1 + p) / (1 - p) on average, so

    age = min(D ((1 + p) / (1 - p))^(1/2) + held,   D + (D + 1)^(1/2) held) + J.

That is reached in steps, each of which starts from the gains of the one before.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.sampled.messages.descent import AgedObjective
from lockstep.lmi.sampled.messages.witnesses import certify_messages
from lockstep.lmi.sampled.synthesis.descent import Descent, DescentPoint, Stage
from lockstep.lmi.sampled.synthesis.gains_for_period import ROOM, AtPeriod, StartingGains, positive_weights
from lockstep.lmi.sampled.witnesses import in_doubles
from lockstep.lmi.shapes import GainBlocks, PairWeights

PARTS = (0.8, 1.0, 1.1)
"""Of the age that are reached one after the other; gains of the whole of it are worth a proof."""

STAGES, ITERATIONS = (Stage(4, 1e-2), Stage(12, 1e-3), Stage(48, 3e-5)), 60
"""Of the first part; the others leave the first stage out."""

STEPS = len(PARTS) * (len(STAGES) - 1) + 1.5
"""Descents of all parts, and what is done before the first of them, which takes half as long."""

RHO_KEPT = 10.0
"""The continuous rho may grow by about so much: what ships is the loop with its messages."""

SCALES = np.geomspace(1e-3, 1e3, 13)
"""Of the first X, whose witness knows nothing of the weights of rho."""


def steady_age(messages: Messages) -> float:
    """Return the age, in periods, that stands for all of it.

    >>> steady_age(Messages(burst=2, delay=(0, 3), jitter=0.5)), round(steady_age(Messages(0.5, 10)), 3)
    (5.5, 15.745)
    """
    p, D = messages.loss, messages.age
    held = np.sqrt(p * (1 + p)) / (1 - p)
    return float(min(D * np.sqrt((1 + p) / (1 - p)) + held, D + np.sqrt(D + 1) * held) + messages.jitter)


def gains_for_messages(
    at: AtPeriod,
    start: StartingGains,
    messages: Messages,
    controllers: tuple[HeldController, ...],
    rho_most: float | None = None,
    tell: Callable[[float], None] = lambda _part: None,
) -> Iterator[StartingGains]:
    """Yield gains that may carry what is asked of the messages, and their pair weights.

    Args:
        at: the loop and its period, and the limit of the gains.
        start: gains that do not, and the pair weights and rho of their continuous certificate.
        messages: what is asked.
        controllers: what these gains are sampled to.
        rho_most: the largest rho of the continuous loop; by default a multiple of the start's.
        tell: called with the part that is done.
    """
    tell(0.0)
    known = positive_weights(start.m, len(at.network.d.pairs()))
    witness = _of_less(at, messages, controllers)
    X = _alike(at) if witness is None else known.mean() / max(float(witness.m.mean()), 1e-300) * witness.X
    point: DescentPoint | None = None
    stages: tuple[Stage, ...] = STAGES
    done = 0.5
    for part in PARTS:
        objective = _objective(at, part * steady_age(messages))
        descent = Descent(objective, at.gain_limit, rho_most or RHO_KEPT * start.rho)
        if point is None:
            logs = _first(objective, descent.most, start.K, known, X)
            point = DescentPoint(start.K, logs, np.log(known) if objective.has_phi else np.zeros(0))
        for stage in stages:
            tell(done / STEPS)
            point = descent.lowered(point, stage, ITERATIONS)
            if point is None:
                return
            done += 1
        stages = STAGES[1:]
        if part >= 1:
            m = np.exp(point.logs[: len(objective.pairs)]) if objective.has_phi else known
            yield StartingGains(limited(point.K, (1 - ROOM) * at.gain_limit), m, start.rho)


def _of_less(
    at: AtPeriod, messages: Messages, controllers: tuple[HeldController, ...]
) -> MessageWitness | None:
    """Return a witness for ages, as many as are carried up to those asked for; its X are where the search starts."""
    age = max(messages.age, 1)
    while age:
        found = certify_messages(at.network, controllers, Messages(burst=age))
        if found is not None:
            return found.witness
        age //= 2
    return None


def _alike(at: AtPeriod) -> Float[np.ndarray, "links q"]:
    """Return an X to start from where gains carry no age at all: every output of every link counts alike."""
    return np.tile(np.eye(len(at.network.plant.C)), (len(at.edges), 1))


def _objective(at: AtPeriod, age: float) -> AgedObjective:
    _, m, q, _, _ = at.network.plant.sizes
    zero = np.zeros((at.network.d.N, at.order + m, at.order + q))
    return AgedObjective(in_doubles(at.network, at.controllers(zero)), at.weights, at.order, age)


def _first(
    objective: AgedObjective, log_rho: float, K: GainBlocks, m: PairWeights, X: Float[np.ndarray, "links q"]
) -> Float[np.ndarray, " logs"]:
    """Return log m and the roots of X in the scale in which the loop's power mean is least."""
    points, tried = objective.angles(K), [objective.packed(m, scale * X) for scale in SCALES]
    means = [objective.sampled(K, logs, log_rho, points, STAGES[0].p) for logs in tried]
    values = [np.inf if mean is None else mean.value for mean in means]
    return tried[int(np.argmin(values))]
