"""The ledger as a Markdown page: docs/claims.md."""

from collections import Counter
from collections.abc import Sequence
from typing import get_args

from amini.claims.claim import ClaimRow, ClaimVerdict

HEAD = """# The paper's claims, one by one

Amini, Azarbahram and Sojoodi, *H-infinity consensus of nonlinear complex multi-agent systems using dynamic output
feedback controller: an LMI approach*. Equation numbers are the paper's. Every figure on this page is computed by
`lockstep reproduce -o docs/claims.md`; `lockstep reproduce NAME`, with the name that ends its claim, computes a row alone.

- **proved**: by exact arithmetic or by algebra that the row states.
- **reproduced**: the figure is met numerically.
- **refuted**: a counterexample is computed, or the opposite is shown. Where the opposite is that something has no
  solution, or a least value, and the row names no proof, it is a solver's answer in doubles.
- **underdetermined**: the paper does not give what a verdict would need.

A refuted claim is a fact about the paper. The command fails only where a verdict does not come out as it stands here.
"""

EQUATIONS = (
    (
        "Section 2",
        "edge-direction; a_ij = 1 if (i, j) is in E is meant (printed: V), and an adjacency matrix N x N (printed: n x n)",
    ),
    ("(1)", "a definition; simple-zero, positive-eigenvalues"),
    (
        "(2)",
        "a definition; controllable. Here all agents share A, C and one nonlinearity; the B_i may differ",
    ),
    (
        "(3)",
        "an assumption on h; arm-bound. It bounds |h_i|, not the difference of two: bound-30, bound-30-shared, own-h",
    ),
    (
        "(4), (6), (8), (9), (10)",
        "definitions; nothing is claimed. (8) is what every continuous certificate here proves; that of the C proves it up to"
        " what rounding leaves",
    ),
    ("(5), (7)", "stacked-h, sufficient-7; Gamma_bar_N in (5) is that of the gamma_bar_1i"),
    ("(11)", "an assumption on the errors; peak-a, peak-c, error-shapes"),
    ("(12), (15)", "true: reduction"),
    (
        "(13), (14)",
        "relative-states, any-row, rho-of-rows, c-r; x_r is one column of n (N - 1) entries (printed: (N - 1) x n)",
    ),
    ("(16)", "true: A_cl is affine in the gains"),
    ("(17), Definitions 1 and 2", "alpha-product, degree-length, equilibrium"),
    ("(18)", "dynamic-part: this P leaves the dynamics without effect"),
    ("(19), (20)", "last-column, unsquared, rho-charged, theorem-1"),
    ("(21)", "hadamard-shape, hadamard; Pi_C is written with J of n x nc, as Pi_D should be"),
    ("(22)", "recovery, recovery-mended, theorem-1, corollary-1"),
    (
        "(23)",
        "integrated, it bounds the weighed square by V(0) and rho^2 times that of xi_r: a gain for V(0) = 0",
    ),
    ("(24) to (28)", "true: algebra"),
    ("(29), (30)", "unsquared, bound-30, bound-30-shared, bound-30-rows"),
    (
        "(31), (32)",
        "(31) adds the five bounds up, and one multiplier for their sum does not give (33); the bounds themselves do, with a"
        " tau for each",
    ),
    ("(33)", "expansion-33, schur-19; it suffices for (32) where (29) and (30) hold"),
    ("(34)", "corollary-1, covers-arms, largest-alpha, h-hat-identity; its tau_1 is the tau_5 of (19)"),
    ("Remark 1", "remark-1, remark-1-printed; C = I is a case of C"),
    (
        "(35) to (38)",
        "(35) in the states of (37) is (38) with k / J_m = 48.6, b / J_m = 1.25, k_tau / J_m = 21.6, k / J_l = 19.5,"
        " m g l / J_l = 3.33",
    ),
    ("(39)", "simple-zero, positive-eigenvalues: a directed cycle of three"),
)
"""What the rows say of each equation, and what is true of those that claim nothing."""

MENDED = (
    "Theorem 1 holds where all agents share one h with an incremental bound, every row of L_hat has one neighbour, k_i and"
    " f_i are in the range of p_s B_i, (20) has |C_r|^2, (21) J of n x q, and (19) H_hat transposed. Asked for by the linear"
    " p_s B_i = B_i X_i, that range has no solution on the example (recovery-mended)."
)

COLUMNS = '<div class="stacked">\n\n| where | claim | verdict | figure |\n|---|---|---|---|\n'
"""How the table of the rows begins, whose cells stand below each other where the page is narrow."""


def to_markdown(rows: Sequence[ClaimRow]) -> str:
    """Return the page.

    >>> page = to_markdown([ClaimRow("x", "(1)", "It holds.", "proved", "proved", "1 = 1")])
    >>> print(next(line for line in page.splitlines() if "It holds." in line))
    | (1) | It holds. `x` | proved | 1 = 1 |
    """
    counts = Counter(row.verdict for row in rows)
    total = ", ".join(f"{counts[verdict]} {verdict}" for verdict in get_args(ClaimVerdict))
    lines = "".join(
        f"| {_cell(row.where)} | {_cell(row.claim)} `{row.name}` | {row.verdict or 'NOT AS EXPECTED'} |"
        f" {_cell(row.figure)} |\n"
        for row in rows
    )
    return f"{HEAD}\n{len(rows)} claims: {total}.\n\n{COLUMNS}{lines}\n</div>\n\n{_equations()}"


def _equations() -> str:
    rows = "".join(f"| {_cell(where)} | {_cell(what)} |\n" for where, what in EQUATIONS)
    return f"## Every equation\n\n| equation | what is true of it |\n|---|---|\n{rows}\n{_cell(MENDED)}\n"


def _cell(text: str) -> str:
    """Escape what Markdown would read as layout."""
    return text.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")
