"""(3), (5) to (7), Definitions 1 and 2, (30): what is assumed and what is concluded about the nonlinearity."""

import numpy as np
from jaxtyping import Float

from amini.claims.claim import Finding, PaperClaim
from amini.claims.example import ALPHA, A, B, C, arm
from lockstep.model.assembly import bound_of


def _controllable() -> Finding:
    from flint import fmpq_mat

    from lockstep.check.numbers import exactly

    reach = exactly(B)
    seen = exactly(C)
    columns, rows = [reach], [seen]
    for _ in range(3):
        columns.append(exactly(A) @ columns[-1])
        rows.append(rows[-1] @ exactly(A))
    ranks = fmpq_mat(np.hstack(columns).tolist()).rank(), fmpq_mat(np.vstack(rows).tolist()).rank()
    return Finding(f"Kalman ranks {ranks[0]} and {ranks[1]} of 4, exactly", ranks == (4, 4))


def _arm_bound() -> Finding:
    bound = bound_of(arm())
    return Finding(
        f"alpha = {bound.alpha:.6g} with H = e_3', G = e_4, proved in ball arithmetic, as an incremental bound too;"
        f" a slope of {bound.lower:.5g} is reached",
        bound.proved and abs(bound.alpha - ALPHA) < 1e-9 and bound.lower > ALPHA - 1e-6,
    )


def _stacked() -> Finding:
    N, n, v = 3, 4, 4
    return Finding(
        f"H_bar is {N * v} x {n}, and x has {N * n} entries: the product does not exist; a block diagonal does",
        n != N * n,
    )


def _sufficient() -> Finding:
    # N = 1, scalars: alpha_bar = 1 (gamma_bar = 1), H_bar = H = 1, gamma = 4.
    gamma_bar, gamma, x = 1.0, 4.0, 1.0
    condition = 1.0 * gamma_bar <= gamma * 1.0
    return Finding(
        f"one scalar agent, gamma_bar = {gamma_bar:g}, gamma = {gamma:g}, H = 1: (7) holds, and (5) asks"
        f" {x / gamma_bar:g} <= {x / gamma:g}; what suffices is lambda_max(H_bar'H_bar) max gamma <= min gamma_bar min"
        " lambda_min(H_i'H_i)",
        condition and x / gamma_bar > x / gamma,
    )


def _scalar_product() -> Finding:
    total = 3 * ALPHA**2
    return Finding(
        f"a column of three times {ALPHA} gives alpha'alpha = {total:.4g} = {total**0.5:.4g}^2, one number for all"
        " agents",
        abs(total**0.5 - ALPHA) > 1,
    )


def _degrees() -> Finding:
    N = 3
    return Finding(
        f"Definition 2 has {N} entries, Theorem 1 gives {N - 1}, of rows of L and not of agents", N - 1 != N
    )


def _different_h() -> Finding:
    # h_1 = alpha sin, h_2 = 0, both within (3); the same state in both agents.
    state = 1.0
    left = (ALPHA * np.sin(state) - 0.0) ** 2
    return Finding(
        f"h_1 = {ALPHA} sin, h_2 = 0, x_1 = x_2 = 1: x_r = 0 and |z_5|^2 = {left:.3g}; the agents must share h",
        left > 0,
    )


def _equilibrium() -> Finding:
    rows, h = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]), ALPHA * np.sin([1.0, 0.0, 0.0])
    return Finding(
        f"h_1 = {ALPHA} sin, h_2 = h_3 = 0 and all states 1: x_r = 0, and it moves at {np.abs(rows @ h).max():.3g};"
        " h(t, 0) = 0 says nothing about agents that agree elsewhere",
        bool((rows @ h).any()),
    )


def _incremental() -> Finding:
    # h(x) = alpha x sin(20 x^2) is within (3) and has slopes without bound.
    def h(x: float) -> float:
        return float(ALPHA * x * np.sin(20 * x**2))

    a, b = 1.0, 1.01
    ratio = abs(h(a) - h(b)) / abs(a - b) / ALPHA
    return Finding(
        f"h = alpha x sin(20 x^2) shared by all: |h(1) - h(1.01)| = {ratio:.3g} alpha |1 - 1.01|", ratio > 1
    )


def _two_neighbours() -> Finding:
    # Path 1 - 2 - 3: rows (1, -1, 0) and (-1, 2, -1) of L, h = sin with the incremental bound 1.
    rows = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0]])
    steps = np.linspace(0.1, 3.0, 30)
    ratios = [np.linalg.norm(rows @ np.sin(x)) / np.linalg.norm(rows @ x) for x in _states(steps)]
    return Finding(
        f"undirected path of three, h = sin (slopes within 1): |z_5| = {max(ratios):.3g} |x_r| is reached; true where"
        " every row of L_hat has one neighbour, as in (39)",
        max(ratios) > 1.02,
    )


def _states(steps: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    """Return (x_1, x_2, x_3) with equal gaps d around x_2 = -d/2."""
    return np.stack([steps / 2, -steps / 2, -1.5 * steps], axis=1)


def _one_H() -> Finding:
    # H_1 = 1 and H_2 = 2 in two scalar agents with h_i = H_i x: x_1 - x_2 = 0 and h_1 - h_2 = -x.
    x = 1.0
    gap = abs(1.0 * x - 2.0 * x)
    return Finding(
        f"H_1 = 1, H_2 = 2, h_i = H_i x: |h_1 - h_2| = {gap:g} at x_1 = x_2 = 1, where x_r = 0", gap > 0
    )


CLAIMS = (
    PaperClaim(
        "controllable",
        "(2), (38)",
        "(A, B) of the arm is controllable and (A, C) observable.",
        "proved",
        _controllable,
    ),
    PaperClaim(
        "arm-bound", "(3), (38)", "The arm's nonlinearity has the bound 3.33 |theta_l|.", "proved", _arm_bound
    ),
    PaperClaim(
        "stacked-h",
        "(5)",
        "With H_bar the stack of the H_bar_i, x'H_bar'..H_bar x bounds h'h.",
        "refuted",
        _stacked,
    ),
    PaperClaim("sufficient-7", "(7)", "Condition (7) suffices for (5).", "refuted", _sufficient),
    PaperClaim(
        "alpha-product",
        "(17)",
        "The class H_alpha gives each agent a bound of its own.",
        "refuted",
        _scalar_product,
    ),
    PaperClaim(
        "degree-length",
        "Definition 2, Theorem 1",
        "Theorem 1 gives the degree vector that Definition 2 speaks of.",
        "refuted",
        _degrees,
    ),
    PaperClaim(
        "equilibrium",
        "(17), (15)",
        "h in H_alpha makes zero an equilibrium of (15).",
        "refuted",
        _equilibrium,
    ),
    PaperClaim(
        "bound-30",
        "(30)",
        "(3) bounds the disagreement of the h_i by that of the states.",
        "refuted",
        _different_h,
    ),
    PaperClaim(
        "bound-30-shared",
        "(30)",
        "(30) holds at least when all agents share one h that satisfies (3).",
        "refuted",
        _incremental,
    ),
    PaperClaim(
        "bound-30-rows",
        "(30)",
        "(30) holds at least for one shared h with an incremental bound, in the paper's coordinates.",
        "refuted",
        _two_neighbours,
    ),
    PaperClaim(
        "own-h",
        "(3), (20)",
        "Each agent may have an H_i of its own.",
        "refuted",
        _one_H,
    ),
)
