"""What a bound is made of besides alpha: a bound of its own for each slope."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """A proved bound of one slope: |d phi_k / d v_l| D_v,l / D_w,k <= bound on the box, with the scales of the bound.

    component: k;  argument: l, both from 0;  bound: a double, 0 or above.
    """

    component: int
    argument: int
    bound: float
