"""The fastest decay that is proved for given gains: e^(-sigma t) bounds every disagreement, for every phi and gain error.

The loop of e^(sigma t) x_cl has A_0 + sigma I in place of A_0, and a phi with the same bound: a certificate of it, with
any rho, proves V' < -2 sigma V. Of sigma = 0 the certificate of rho is one; -abscissa of A_cl is beyond.
"""

import contextlib

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.margins import bisect
from lockstep.model.network import Network

HALVINGS = 7
"""Of the range from 0 to what the linear loop has: about 1 % of it."""

KEPT = (0.98, 0.9, 0.7)
"""Parts of the decay found in doubles that are claimed: rounding needs some room."""

Decay = tuple[float, Certificate | ModalCertificate]


def fastest_decay(network: Network, gains: Gains, claim: Claim, *, modal: bool) -> Decay | None:
    """Return the fastest decay proved, in 1/s and short decimals, with its certificate; None where none is.

    Args:
        network: the agents and their graph.
        gains: the controllers.
        claim: alpha and delta; what rho weighs does not matter, but for the solver's scaling.
        modal: whether a certificate of the modes is looked for.
    """

    def holds(decay: float) -> bool:
        return _holds(network.decaying(decay), gains, claim, modal)

    linear = -abscissa(network, gains, modal=modal)
    low = bisect(holds, 0.0, linear, HALVINGS)
    # Where the solver's units let nothing hold, the proof, whose units are others, is asked itself.
    tried = [part * low for part in KEPT] if low > 0 else [linear / 2**k for k in (1, 2, 3, 4)]
    for decay in (float(f"{one:.3g}") for one in tried if one > 0):
        with contextlib.suppress(NotCertified):
            return decay, proved_decay(network, gains, claim, decay, modal=modal)
    return None


def abscissa(network: Network, gains: Gains, *, modal: bool) -> float:
    """Return the largest real part of the linear loop's poles, in doubles; of many graphs, on a grid of their lambdas."""
    if not modal:
        return float(np.linalg.eigvals(network.loop(gains.order).A_cl(gains.blocks)).real.max())
    from lockstep.check.continuous.modes import Modes
    from lockstep.lmi.methods.modal import eigenvalues_of

    modes, K = Modes(network.plant, gains.order, network.decay), gains.blocks[0]
    found = [np.linalg.eigvals(modes.at(value).A_cl(K[None])) for value in eigenvalues_of(network)]
    n_C = gains.order
    found.append(np.linalg.eigvals(K[:n_C, :n_C]) + network.decay)
    return float(np.concatenate(found).real.max())


def proved_decay(
    network: Network, gains: Gains, claim: Claim, decay: float, *, modal: bool
) -> Certificate | ModalCertificate:
    """Return a certificate of a decay.

    Raises:
        NotCertified: none was found, or it did not survive the exact check.
    """
    from lockstep.lmi.analysis.rounding import prove
    from lockstep.lmi.methods.modal import prove_modes

    return (prove_modes if modal else prove)(network.decaying(decay), gains, claim)


def _holds(network: Network, gains: Gains, claim: Claim, modal: bool) -> bool:
    from lockstep.lmi.analysis.certificate_sdp import least_rho
    from lockstep.lmi.methods.modal import least_witness

    if modal:
        return least_witness(network, gains, claim)[1] is not None
    return least_rho(network.loop(gains.order), gains.blocks, claim, any_rho=True) is not None
