"""The proof: whether P > 0, m >= 0, t >= 0 and F < 0, decided exactly for the numbers as they stand."""

import numpy as np
from jaxtyping import Float

from lockstep.lmi.definite import Definiteness, decide_positive_definite
from lockstep.lmi.inequality import Certificate, Claim, F_matrix
from lockstep.model.loop import Loop
from lockstep.model.numbers import exactly


def decide(
    exact_loop: Loop, gains: Float[np.ndarray, "N k l"], claim: Claim, certificate: Certificate
) -> Definiteness:
    """Decide exactly whether P > 0, m >= 0, t >= 0 and F < 0: the whole proof, for these very numbers."""
    for weights in (certificate.m, certificate.t):
        if np.any(weights < 0):
            unit = -np.eye(len(weights))[int(np.argmin(weights))]
            return Definiteness(
                False, "sign of a multiplier", float(weights.min()), unit, float(weights.min())
            )
    skew = certificate.P - certificate.P.T
    if skew.any():
        i, j = np.unravel_index(int(np.abs(skew).argmax()), skew.shape)
        unit = np.eye(len(skew))[int(i)]
        return Definiteness(
            False, f"P is not symmetric at ({i + 1}, {j + 1})", float("nan"), unit, float(skew[i, j])
        )
    P = decide_positive_definite(exactly(certificate.P))
    return P if not P.positive else decide_positive_definite(-F_matrix(exact_loop, gains, claim, certificate))
