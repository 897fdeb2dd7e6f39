"""The proof: whether P > 0, m >= 0 (of every sector), t >= 0 and F < 0, decided exactly for the numbers as they stand.

R, Q and W belong to the claim, and with an R that is not positive definite, or a W that is negative somewhere, V' + x_d'R x_d
+ u'W u < 0 says nothing of x_d: they are decided as well, not only looked at in doubles when the problem is read.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim, F_matrix
from lockstep.check.numbers import exactly
from lockstep.check.psd import Definiteness, decide_positive_definite
from lockstep.check.system.loop import Loop


def decide(
    exact_loop: Loop, gains: Annotated[np.ndarray, "N k l"], claim: Claim, certificate: Certificate
) -> Definiteness:
    """Decide exactly whether R, Q, P > 0, W, m, t >= 0 and F < 0: the whole proof, for these very numbers."""
    for weights in (certificate.m, certificate.t, certificate.m_entries.ravel()):
        if np.any(weights < 0):
            return Definiteness(False, "sign of a multiplier", least := float(weights.min()), value=least)
    if (certificate.P != certificate.P.T).any():
        return Definiteness(False, "P is not symmetric", float("nan"))
    answer = decide_weights(claim)
    if not answer.positive:
        return answer
    answer = decide_positive_definite(exactly(certificate.P))
    if not answer.positive:
        return replace(answer, method=f"{answer.method}, M = P")
    return decide_positive_definite(-F_matrix(exact_loop, gains, claim, certificate))


def decide_weights(claim: Claim) -> Definiteness:
    """Decide R > 0, Q > 0, and that W is diagonal with no entry below 0, or positive definite."""
    plain = np.array_equal(claim.W, np.diag(np.diag(claim.W))) and bool((claim.W >= 0).all())
    for name, weight in (("W", claim.W[:0, :0] if plain else claim.W), ("R", claim.R), ("Q", claim.Q)):
        answer = decide_positive_definite(exactly(weight))
        if not answer.positive:
            return replace(answer, method=f"{answer.method}, M = {name}")
    return answer
