"""One step of the inner convex approximation: gains and certificate improved inside the certified set.

From (P_0, K_0) that satisfies F <= 0, with dP = P - P_0 and dK = K - K_0,

    He(P U K Y) = He(P U K_0 Y + P_0 U dK Y) + He(dP U dK Y)
               <= He(P U K_0 Y + P_0 U dK Y) + w^2 dP U U' dP + w^-2 Y' dK' dK Y,

each square by a Schur complement. Minimising rho^2 under this stronger inequality never raises rho, and what
comes back carries a certificate. It creeps where `bmi` strides, but it cannot be misled: it finishes what
`bmi` began.
"""

import numpy as np
from jaxtyping import Float

from lockstep.check.inequality import Certificate, Claim
from lockstep.check.loop import Loop
from lockstep.lmi.analysis.solve import AffineF, run


def inner_step(
    loop: Loop, K: Float[np.ndarray, "N k l"], claim: Claim, certificate: Certificate, gain_limit: float
) -> tuple[Float[np.ndarray, "N k l"], Certificate] | None:
    """Return better gains and their certificate, or None where the solver finds no better ones."""
    import cvxpy as cp

    form = AffineF(loop, K, claim)
    n_x, n_F = form.Z.shape
    P, w = cp.Variable((n_x, n_x), symmetric=True), cp.Variable(len(form.slopes))
    dK = [cp.Variable(block.shape) for block in K]
    dP, J = P - certificate.P, np.eye(n_F, n_x)
    Z = form.Z
    move = sum(
        (J @ certificate.P @ U @ d @ Y @ J.T for U, d, Y in zip(loop.U, dK, loop.Y, strict=True)),
        start=np.zeros((n_F, n_F)),
    )
    half = J @ P @ Z + move
    F = (
        half
        + half.T
        + form.constant
        + cp.reshape(form.slopes.reshape(len(form.slopes), -1).T @ w, (n_F, n_F), order="C")
    )
    balance = (
        np.sqrt(float(np.linalg.norm(K.reshape(-1))) / max(float(np.linalg.norm(certificate.P)), 1e-12))
        or 1.0
    )
    side = cp.hstack(
        [
            *[balance * (J @ dP @ U) for U in loop.U],
            *[J @ Y.T @ d.T / balance for d, Y in zip(dK, loop.Y, strict=True)],
        ]
    )
    whole = cp.bmat([[F, side], [side.T, -np.eye(side.shape[1])]])
    limits = [cp.sigma_max(block + d) <= gain_limit for block, d in zip(K, dK, strict=True)]
    conditions = [
        P >> 0,
        (whole + whole.T) / 2 << 0,
        *([w[:-1] >= 0] if len(form.slopes) > 1 else []),
        *limits,
    ]
    problem = cp.Problem(cp.Minimize(w[-1]), conditions)
    if not run(problem) or w.value is None or P.value is None or not w.value[-1] < certificate.rho**2:
        return None
    return K + np.stack([d.value for d in dK]), form.certificate(P.value, w.value)
