"""The five loops of three arms that are compared, and what is proved of each.

Theorem 1 and Corollary 1 as the paper publishes them (Table 1); their counterparts from Lockstep, in the same case
(gains uncertain, gains certain); and the protocol of [25] (Li, Liu and Fu 2011). The uncertain ones run with the paper's
Delta(t), as printed, its column repeated for q = 2: that is more than (11) admits, so no proof covers those runs.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from amini.claims.example import TABLE_1, arm, claim, cycle
from lockstep.check.errors import ClaimError
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.network import Network
from lockstep.model.simulation.perturbation import PaperPerturbation, Perturbation

GAIN_LIMIT = 50.0
"""Bound on the spectral norm of each controller of [25]: that of the certified designs (examples/)."""

CERTIFIED = Gains(
    A=(
        np.array([[6.4267, 21.4161], [-15.2661, -7.6968]]),
        np.array([[26.4863, -25.1052], [1.4111, 14.8612]]),
        np.array([[-1.6192, -6.5347], [3.3614, 0.1457]]),
    ),
    B=(
        np.array([[0.8464, -0.3605], [-4.5795, -0.3831]]),
        np.array([[-15.8004, -2.9788], [5.6203, 0.473]]),
        np.array([[-0.4951, 0.0029], [-0.0838, -0.0377]]),
    ),
    C=(np.array([[-42.8129, 15.9595]]), np.array([[34.5321, 0.9665]]), np.array([[3.5663, -9.38]])),
    D=(np.array([[-15.5151, -2.2825]]), np.array([[-7.6059, -2.5716]]), np.array([[-1.0746, -0.0882]])),
)
"""What `lockstep design` found for examples/flexible_joint_arms.toml at gain_limit = 50, for rho alone."""

CERTIFIED_UNCERTAIN = Gains(
    A=(
        np.array([[-49.9999, 0.0139], [-0.0139, -49.9999]]),
        np.array([[-49.9956, -0.6627], [0.6627, -49.9956]]),
        np.array([[23.4462, -40.6777], [5.8877, 4.4732]]),
    ),
    B=(np.zeros((2, 2)), np.zeros((2, 2)), np.array([[5.4991, 11.5386], [-5.3895, -2.4586]])),
    C=(np.zeros((1, 2)), np.zeros((1, 2)), np.array([[-7.4572, 8.1988]])),
    D=(np.array([[-0.2961, 0.0065]]), np.array([[-0.7503, -1.3464]]), np.array([[-0.994, -3.129]])),
)
"""What it finds for examples/fragile_arms.toml, delta = (0.5, 0.2, 0.2, 0.2), to four decimals."""


@dataclass(frozen=True, eq=False)
class Contestant:
    """One loop: a key, a name for people, the network, the gains, Delta(t) if any, and the proved rho if any.

    delta: the part of the paper's delta with which rho is proved, 0 or 1.
    """

    key: str
    name: str
    network: Network
    gains: Gains
    perturbation: Perturbation | None
    rho: float | None
    delta: float


def contestants() -> Iterator[Contestant]:
    """Yield the loops, each with its proof made anew."""
    ours, moving = Network(arm(), cycle()), PaperPerturbation(3, 2)
    yield _one("theorem_1", "Theorem 1, published", ours, TABLE_1["theorem_1"], moving, 0.0)
    yield _one("corollary_1", "Corollary 1, published", ours, TABLE_1["corollary_1"], None, 0.0)
    yield _one("certified_uncertain", "Lockstep, gains uncertain", ours, CERTIFIED_UNCERTAIN, moving, 1.0)
    yield _one("certified", "Lockstep, gains certain", ours, CERTIFIED, None, 0.0)
    measured, gains = protocol_of_25()
    yield _one("reference_25", "[25], all states measured", measured, gains, None, 0.0)


def protocol_of_25() -> tuple[Network, Gains]:
    """Return the protocol of [25] for arms that measure their whole state, the one of least proved rho in the limit."""
    from lockstep.lmi.analysis.rounding import short_gains
    from lockstep.lmi.methods.lipschitz import design_protocol, protocol_gains

    network = Network(_whole_arm(), cycle())
    gains = protocol_gains(network, design_protocol(network, claim(order=0), GAIN_LIMIT))
    return network, Gains.from_blocks(short_gains(gains.blocks, GAIN_LIMIT), 0)


def _whole_arm() -> Agent:
    measured = arm()
    return Agent(
        name=measured.name, x=measured.x, u=measured.u, rhs=measured.rhs, y=measured.x, states=measured.states
    )


def _one(
    key: str, name: str, network: Network, gains: Gains, moving: Perturbation | None, delta: float
) -> Contestant:
    from lockstep.lmi.analysis.rounding import prove

    try:
        rho: float | None = prove(network, gains, claim(delta=delta, order=gains.order)).rho
    except ClaimError:
        rho = None
    return Contestant(key, name, network, gains, moving, rho, delta)
