"""What is proved of given gains besides rho: how fast every disagreement decays, and that controllers are stable alone.

The fastest decay that is proved: a constant times e^(-sigma t) bounds every disagreement, for every phi. The loop of
e^(sigma t) x_cl has A_0 + sigma I in place of A_0, and a phi with the same bound: a certificate of it, with any rho, proves
V' < -2 sigma V. Of sigma = 0 the certificate of rho is one; -abscissa of A_cl is beyond.
"""

import contextlib
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate, Modes
from lockstep.check.continuous.stability import is_stable
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import MOST_OF_GIVEN, eliminates_P
from lockstep.lmi.analysis.margins import bisect
from lockstep.lmi.analysis.rounding import may_be_proved, prove
from lockstep.lmi.methods.modal import eigenvalues_of, least_witness, prove_modes
from lockstep.model.network import Network
from lockstep.model.problem import Problem

HALVINGS = 7
"""Of the range from 0 to what the linear loop has: about 1 % of it."""

KEPT = (0.98, 0.95, 0.9, 0.8, 0.7, 0.5, 0.25, 0.1, 0.03)
"""Parts of the decay found in doubles that are claimed, the first that is proved: rounding needs some room, and the solver
may have found one that does not bear the exact check."""

Decay = tuple[float, Certificate | ModalCertificate]


@dataclass(frozen=True)
class Guarantees:
    """decay: sigma in 1/s, with its certificate, or None;  stable: whether each controller is stable by itself."""

    decay: Decay | None = None
    stable: bool = False


def guarantees(problem: Problem, network: Network, gains: Gains, claim: Claim, *, modal: bool) -> Guarantees:
    """Prove the decay and decide the controllers' stability, both at least as the problem asks.

    Args:
        problem: what is asked.
        network, gains, claim: of the certificate of rho.
        modal: whether that is one of the modes.

    Raises:
        NotCertified: the decay asked for was not proved, or a controller that is to be stable is not.
    """
    table = problem.design
    unstable = [i for i, A_C in enumerate(gains.A, start=1) if not is_stable(A_C)]
    if unstable and table.stable_controllers:
        said = ", ".join(map(str, unstable))
        raise NotCertified(
            f"[design] stable_controllers asks for controllers that are stable by themselves, that of agent {said} is not",
            unstable_controllers=unstable,
        )
    found = fastest_decay(network, gains, claim, modal=modal)
    if table.decay is not None and (found is None or found[0] < table.decay):
        try:
            found = table.decay, proved_decay(network, gains, claim, table.decay, modal=modal)
        except NotCertified:
            reached = 0.0 if found is None else found[0]
            raise NotCertified(
                f"[design] decay asks for {table.decay:g} 1/s, but {reached:g} is proved of these gains",
                decay=reached,
            ) from None
    return Guarantees(found, not unstable)


def fastest_decay(network: Network, gains: Gains, claim: Claim, *, modal: bool) -> Decay | None:
    """Return the fastest decay proved, in 1/s and short decimals, with its certificate; None where none is.

    Args:
        network: the agents and their graph.
        gains: the controllers.
        claim: alpha and delta; what rho weighs does not matter, but for the solver's scaling.
        modal: whether a certificate of the modes is looked for.
    """

    def holds(decay: float, *, quick: bool = False) -> bool:
        decaying = network.decaying(decay)
        if modal:
            return least_witness(decaying, gains, claim)[1] is not None
        return may_be_proved(decaying, gains, claim, quick=quick)

    linear = -abscissa(network, gains, modal=modal)
    low = bisect(partial(holds, quick=True), 0.0, linear, HALVINGS)
    above = low + linear / 2**HALVINGS
    one_way = modal or eliminates_P(network.loop(gains.order), MOST_OF_GIVEN)
    if not one_way and above < linear and holds(above):  # where frequencies do not find what there is
        low = bisect(holds, above, linear, HALVINGS)
    # Where nothing holds for the solver, the proof, which tries more than one rho, is asked itself.
    for decay in (float(f"{part * (low or linear):.3g}") for part in KEPT):
        if not decay > 0:
            break
        with contextlib.suppress(NotCertified):
            return decay, proved_decay(network, gains, claim, decay, modal=modal)
    return None


def decay_alone(network: Network, claim: Claim) -> float | None:
    """Return the fastest decay of every disagreement that is proved for u = 0, in 1/s; None where none is.

    Args:
        network: the agents and their graph.
        claim: alpha; the gains' errors and what rho weighs mean nothing here.
    """
    m, q = network.plant.B[0].shape[1], len(network.plant.C)
    gains, plain = Gains.from_blocks(np.zeros((network.N, m, q)), 0), np.zeros((0, 0))
    found = fastest_decay(network, gains, replace(claim, Q=plain, delta=0 * claim.delta), modal=False)
    return None if found is None else found[0]


def abscissa(network: Network, gains: Gains, *, modal: bool) -> float:
    """Return the largest real part of the linear loop's poles, in doubles; of many graphs, on a grid of their lambdas."""
    if not modal:
        return float(np.linalg.eigvals(network.loop(gains.order).A_cl(gains.blocks)).real.max())
    modes, K = Modes(network.plant, gains.order, network.decay), gains.blocks[0]
    found = [np.linalg.eigvals(modes.at(value).A_cl(K[None])) for value in eigenvalues_of(network)]
    found.append(np.linalg.eigvals(K[: gains.order, : gains.order]) + network.decay)
    return float(np.concatenate(found).real.max())


def proved_decay(
    network: Network, gains: Gains, claim: Claim, decay: float, *, modal: bool
) -> Certificate | ModalCertificate:
    """Return a certificate of a decay.

    Raises:
        NotCertified: none was found, or it did not survive the exact check.
    """
    return (prove_modes if modal else prove)(network.decaying(decay), gains, claim)
