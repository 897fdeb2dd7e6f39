"""The continuous claims of a design: from exact matrices, gains, claims and proofs to one verdict for each claim.

    the certificate     V' + x_d'(S (x) R) x_d + x_C'Q x_C + u'W u < rho^2 (|xi_d|^2 + |nu_d|^2), norms in the metric S, for
                        every admitted phi and gain error (`decide`, `modes`)
    the decay           the same for e^(sigma t) x_cl, the loop of `network.decaying(sigma)`
    the controllers     each is stable by itself (`stability`)
    the floor           no controllers certify a rho below the one claimed (`floor.witness`)
    the initial states  from which the agents stay where the bound was proved (`initial_set`)

Each takes for granted what the ones before it decide, and that phi has the bounds of the claim on its domain.
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from lockstep.check.continuous.decide import decide
from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.initial_set import Domain, InitialSet, axes_text, better_than_proved, box_text
from lockstep.check.continuous.modes import ModalCertificate, decide_modes
from lockstep.check.continuous.stability import is_stable, is_stable_step
from lockstep.check.floor.witness import FloorWitness, proves_floor
from lockstep.check.psd import Definiteness
from lockstep.check.system.loop import Gains
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict


def decide_certificate(
    network: ExactNetwork, gains: Gains, claim: Claim, certificate: Certificate | ModalCertificate
) -> Verdict:
    """Decide whether a certificate proves its rho for these gains and this claim; undecided where its numbers are too long.

    Raises:
        ProblemError: a modal certificate for agents, a graph or gains that do not split into modes.
    """
    if not certificate.rho > 0 or not claim.alpha >= 0:
        said = f"rho = {certificate.rho:g} and alpha = {claim.alpha:g}"
        return Verdict("refuted", f"{said} are claimed: rho must be positive and alpha not negative")
    if isinstance(certificate, ModalCertificate):
        answer = decide_modes(network, gains, claim, certificate)
    else:
        answer = decide(network.loop(gains.order, exact_arithmetic=True), gains.blocks, claim, certificate)
    if answer.positive:
        reason = f"P > 0 and F < 0, decided exactly ({answer.method})"
        return Verdict("proved", reason, {"margin": answer.margin})
    undecided = Verdict("undecided", answer.method, {"margin": answer.margin})
    return _refuted(answer) if answer.decided else undecided


def decide_stable_controllers(
    matrices: Sequence[Annotated[np.ndarray, "n_C n_C"]], *, sampled: bool = False
) -> Verdict:
    """Decide whether each controller is stable by itself: A_C of x_C' = A_C x_C, or of x_C+ = A_C x_C where sampled.

    It is of the coefficients: what rounding does at each step is counted in the loop, not here.
    """
    for i, A_C in enumerate(matrices, start=1):
        if not (is_stable_step(A_C) if sampled else is_stable(A_C)):
            return Verdict("refuted", f"the controller of agent {i} is not stable by itself")
    aside = "; rounding of a step aside" if sampled else ""
    return Verdict("proved", f"each controller is stable by itself, decided exactly{aside}")


def decide_floor(network: ExactNetwork, claim: Claim, witness: FloorWitness) -> Verdict:
    """Decide whether a witness proves that no controllers certify a rho below its own; one that does not refutes nothing."""
    said = f"no controllers certify a rho below {witness.rho:.10g}"
    if network.spectrum is not None:
        return Verdict("undecided", f"it is claimed that {said}, of graphs that are not named")
    return Verdict.of(said, proves_floor(network, claim, witness))


def decide_initial_set(
    network: ExactNetwork, certificate: Certificate | ModalCertificate, domain: Domain, claimed: InitialSet
) -> Verdict:
    """Decide whether a claimed set is one from which all agents stay in the domain and agree.

    Raises:
        ProblemError: an inner box of the claim that is not inside the domain.
    """
    found = better_than_proved(network, certificate, domain, claimed)
    if found is None:
        inside, radius = box_text(claimed.inner), f"|x_d(0)| <= {claimed.radius:.10g}"
        radius += f", or {axes_text(claimed.half_axes, domain.states)}" if claimed.half_axes else ""
        alone = f"while agent {claimed.leader} moves by itself, without a command of its own, and stays in {inside}"
        return Verdict("proved", f"{alone}, all stay in their domain and agree from {radius}")
    return Verdict("undecided", f"other initial states are claimed than are proved: {found}")


def _refuted(answer: Definiteness) -> Verdict:
    found, vector = f"{answer.method}: {answer.value:.6g}", None
    if answer.vector is not None:
        found = f"z' M z = {answer.value:.6g} <= 0 for a vector z of length 1 ({answer.method})"
        vector = [float(entry) for entry in answer.vector]
    figures = {"margin": answer.margin, "value": answer.value, "vector": vector}
    return Verdict("refuted", f"the inequality does not hold: {found}", figures)
