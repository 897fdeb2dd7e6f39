"""Section 4's disturbance, Table 2 and the comparison with [25]: what can be said without the initial states."""

import numpy as np
from jaxtyping import Float

from amini.claims.claim import Finding, PaperClaim
from amini.claims.example import ALPHA, TABLE_1, TABLE_2, A, B, C, G, H, cycle, loop
from lockstep.check.system.loop import Plant

HOLDS = (1e-3, 1e-2)
"""Two sampling periods of the noise, s."""


def _noise() -> Finding:
    spread = [_rms(hold) for hold in HOLDS]
    return Finding(
        f"noise of unit variance held for {HOLDS[0] * 1e3:g} ms leaves a disagreement of {spread[0]:.2f} (rms; gains"
        f" of Corollary 1, linear part), for {HOLDS[1] * 1e3:g} ms of {spread[1]:.2f}; white noise in continuous"
        " time has no variance",
        spread[1] > 3 * spread[0],
    )


def _rms(hold: float) -> float:
    """Return the root mean square of the disagreement of the linear loop under noise held for a period."""
    from scipy.linalg import expm, solve_discrete_lyapunov

    one = loop()
    A_cl, E = one.A_cl(TABLE_1["corollary_1"].blocks), one.E
    n_x, n_d = E.shape
    step = expm(hold * np.vstack([np.hstack([A_cl, E]), np.zeros((n_d, n_x + n_d))]))
    A_d, B_d = step[:n_x, :n_x], step[:n_x, n_x:]
    TT = one.d.T @ one.d.T.T
    covariance = solve_discrete_lyapunov(A_d, B_d @ np.kron(TT, np.eye(4)) @ B_d.T)
    metric = np.kron(np.linalg.inv(TT), np.eye(4))
    return float(np.sqrt(np.trace(metric @ covariance[:n_d, :n_d])))


def _smaller() -> Finding:
    ratio = TABLE_2["reference_25"] / TABLE_2["theorem_1"]
    return Finding(
        f"as printed, all {ratio.size} indices are smaller, by {ratio.min():.2g} times or more",
        ratio.min() > 1,
    )


def _horizon(rows: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, " 3"]:
    """Return the shortest horizon each agent's indices allow: IAE^2 <= T ISE, ITAE^2 <= (T^2 / 2) ITSE."""
    ISE, IAE, ITSE, ITAE = rows.T
    return np.asarray(np.maximum(IAE**2 / ISE, ITAE * np.sqrt(2 / ITSE)))


def _consistent() -> Finding:
    ours, theirs = (_horizon(TABLE_2[key]).max() for key in ("theorem_1", "reference_25"))
    means = [TABLE_2[key][:, 3] / TABLE_2[key][:, 1] for key in ("theorem_1", "reference_25")]
    spans = [f"{mean.min():.2f} to {mean.max():.2f} s" for mean in means]
    return Finding(
        f"possible only for horizons from {ours:.2f} s (Theorem 1) and {theirs:.2f} s ([25]) by Cauchy-Schwarz; mean times"
        f" of the effort {spans[0]} and {spans[1]}, so under lasting noise the horizon was short; it is not given",
        max(ours, theirs) < 2 and all((mean > 0).all() for mean in means),
    )


def _peak() -> Finding:
    ours, theirs = (TABLE_2[key][:, 0] / TABLE_2[key][:, 1] for key in ("theorem_1", "reference_25"))
    return Finding(
        f"sup |u| >= ISE / IAE: at least {theirs.min():.0f} to {theirs.max():.0f} for [25] and {ours.min():.2f} to"
        f" {ours.max():.2f} for Theorem 1, as printed; the trajectories need initial states that are not given",
        theirs.min() > 10 * ours.max(),
    )


def _freedom() -> Finding:
    from lockstep.lmi.analysis.connectivity import connectivity
    from lockstep.lmi.methods.lipschitz import first_step

    plant = Plant(A, (B,), np.eye(4), G, H)
    a = connectivity(cycle())
    found = {decay: first_step(plant, ALPHA, decay) for decay in (0.1, 3.0, 10.0)}
    gains = [np.nan if one is None else one.tau / a * float(np.linalg.norm(one.K)) for one in found.values()]
    shown = ", ".join(f"{gain:.2g}" for gain in gains)
    return Finding(
        f"protocols of [25] for these arms with |c K| = {shown} (decay 0.1, 3, 10 1/s), all"
        " solutions of its step 1; the one simulated is not given",
        gains[0] < 1 < gains[1] < 10 < gains[2],
    )


def _unstructured_25() -> Finding:
    from lockstep.lmi.methods.lipschitz import first_step

    whole, arm = Plant(A, (B,), np.eye(4), np.eye(4), np.eye(4)), Plant(A, (B,), np.eye(4), G, H)
    return Finding(
        f"step 1 of [25] with D = I has no solution at gamma = {ALPHA}; with D = e_4, H = e_3' it has",
        first_step(whole, ALPHA, 1e-3) is None and first_step(arm, ALPHA, 1e-3) is not None,
    )


def _measures_more() -> Finding:
    return Finding(
        f"[25] feeds back all {len(A)} states, Theorem 1 the {len(C)} of the motor: the two are not asked the same",
        len(C) < len(A),
    )


CLAIMS = (
    PaperClaim(
        "noise",
        "Section 4",
        "The disturbance is Gaussian with zero mean and unit variance.",
        "underdetermined",
        _noise,
    ),
    PaperClaim(
        "table-2", "Table 2", "All indices are smaller with Theorem 1 than with [25].", "reproduced", _smaller
    ),
    PaperClaim(
        "table-2-horizon",
        "Table 2",
        "The indices are those of the simulated loops.",
        "underdetermined",
        _consistent,
    ),
    PaperClaim(
        "effort",
        "Section 4, Figure 5",
        "The protocol of [25] starts with a far larger effort.",
        "underdetermined",
        _peak,
    ),
    PaperClaim(
        "gains-25",
        "Section 4, [25]",
        "The comparison is with the protocol of [25].",
        "underdetermined",
        _freedom,
    ),
    PaperClaim(
        "lipschitz-25",
        "Section 4, [25]",
        "The design of [25] applies to the arms as it is printed, with D = I.",
        "refuted",
        _unstructured_25,
    ),
    PaperClaim(
        "same-terms-25",
        "Section 4, Figures 4 and 5",
        "Theorem 1 and [25] are compared on the same terms.",
        "refuted",
        _measures_more,
    ),
)
