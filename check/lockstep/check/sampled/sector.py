"""One sector of phi for all pairs of agents, from the pair weights of a continuous certificate.

With weights mu_l > 0 the bounds |w_l| <= r_kl |v_l| of the entries of a component, phi_k = sum_l w_l, give by Cauchy and
Schwarz

    |phi_k|^2 / sum_l (1 / mu_l) <= sum_l mu_l w_l^2 <= sum_l mu_l r_kl^2 v_l^2

for the differences of any pair of agents; and mu |phi|^2 <= mu alpha^2 |v|^2 may be added. Sums over the pairs give

    sum_k Pi_w,k |phi_k,i - phi_k,j|^2 <= sum_l Pi_z,l |v_l,i - v_l,j|^2        for all pairs and all t,

so that G Pi_w^-1/2 and Pi_z^1/2 H take the places of G and alpha H in the lifted loop, and one multiplier M does for all of
it. It holds for any weights: nothing about it has to be decided. Pi_w is rounded down and Pi_z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.numbers import as_fraction, rounded_down


@dataclass(frozen=True, eq=False)
class Sector:
    """sum_k Pi_w,k |phi_k(a, t) - phi_k(b, t)|^2 <= sum_l Pi_z,l |a_l - b_l|^2, Pi_w (r,) > 0, Pi_z (v,) >= 0 in doubles."""

    Pi_w: Annotated[np.ndarray, " r"]
    Pi_z: Annotated[np.ndarray, " v"]


def common_sector(
    alpha: float,
    entries: Sequence[Entry],
    m: Annotated[np.ndarray, " pairs"],
    m_entries: Annotated[np.ndarray, "entries pairs"],
    r: int,
    v: int,
) -> Sector | None:
    """Return the sector of the summed pair weights, the largest Pi_w,k being about 1; None where a component has no weight.

    Args:
        alpha: |phi(a, t) - phi(b, t)| <= alpha |a - b|.
        entries: the proved bounds of single slopes, in the scales of alpha; all that are not 0.
        m, m_entries: weights 0 or above, of alpha and of each entry; they need not prove anything.
        r, v: the numbers of components and arguments of phi.
    """
    weights = [sum(map(as_fraction, row), Fraction(0)) for row in m_entries]
    whole = sum(map(as_fraction, m), Fraction(0))
    Pi_w, Pi_z = [whole] * r, [whole * as_fraction(alpha) ** 2] * v
    for k in {one.component for one in entries}:
        own = [(one, mu) for one, mu in zip(entries, weights, strict=True) if one.component == k]
        if all(mu > 0 for _, mu in own):
            Pi_w[k] += 1 / sum((1 / mu for _, mu in own), Fraction(0))
            for one, mu in own:
                Pi_z[one.argument] += mu * as_fraction(one.bound) ** 2
    if not all(value > 0 for value in Pi_w):
        return None
    unit = Fraction(float(max(Pi_w)))
    # Rounded down and up.
    return Sector(
        np.array([rounded_down(value / unit) for value in Pi_w]),
        np.array([-rounded_down(-value / unit) for value in Pi_z]),
    )
