"""The proof: whether P > 0, m >= 0 (of every sector), t >= 0 and F < 0, decided exactly for the numbers as they stand.

R and Q belong to the claim, and with an R that is not positive definite V' + x_d'R x_d < 0 says nothing of x_d: they
are decided as well, not only looked at in doubles when the problem is read.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from lockstep.check.inequality import Certificate, Claim, F_matrix
from lockstep.check.loop import Loop
from lockstep.check.numbers import exactly
from lockstep.check.psd import Definiteness, decide_positive_definite


def decide(
    exact_loop: Loop, gains: Annotated[np.ndarray, "N k l"], claim: Claim, certificate: Certificate
) -> Definiteness:
    """Decide exactly whether R > 0, Q > 0, P > 0, m >= 0, t >= 0 and F < 0: the whole proof, for these very numbers."""
    for weights in (certificate.m, certificate.t, certificate.m_entries.ravel()):
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
    if not _is_a_weight(claim.W):
        return Definiteness(False, "W of u has a negative eigenvalue", float(np.linalg.eigvalsh(claim.W)[0]))
    for name, matrix in (("R", claim.R), ("Q", claim.Q), ("P", certificate.P)):
        answer = decide_positive_definite(exactly(matrix))
        if not answer.positive:
            return replace(answer, method=f"{answer.method}, M = {name}")
    return decide_positive_definite(-F_matrix(exact_loop, gains, claim, certificate))


def _is_a_weight(W: Annotated[np.ndarray, "m m"]) -> bool:
    """Decide whether W is diagonal with entries 0 or above, or positive definite."""
    diagonal = np.diag(W)
    return bool(
        (np.array_equal(W, np.diag(diagonal)) and (diagonal >= 0).all())
        or decide_positive_definite(exactly(W)).positive
    )
