"""One period instead of everything: variables that enter only through sin, cos and tan.

If v enters phi only inside sin, cos or tan of c v + (terms without v) with rational c, all of which are whole
multiples of g, then every slope has the period 2 pi/g in v and one period holds every value.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Annotated

import numpy as np

from lockstep.check.expression.node import Node, linear_terms
from lockstep.check.expression.traversal import order

WAVES = frozenset({"sin", "cos", "tan"})
MOST_WAVES = 64  # a period of so many waves of its fastest term is no shortcut


def period(outputs: Sequence[Node], index: int) -> float | None:
    """Return a double just above the period of the outputs in one variable, None if none is seen."""
    rates = _rates(outputs, index)
    if not rates:
        return None
    # The greatest common divisor of rationals in lowest terms.
    common = Fraction(math.gcd(*(r.numerator for r in rates)), math.lcm(*(r.denominator for r in rates)))
    if max(rates) / common > MOST_WAVES:
        return None
    # 2 pi/g with relative error below 2^-51 from two roundings and the error of pi, widened by more.
    return 2.0 * math.pi / float(common) * (1.0 + 2.0**-48)


def _rates(outputs: Sequence[Node], index: int) -> set[Fraction]:
    """Return |c| of every use c v + ...; the empty set if v is used in any other way."""
    periodic: dict[Node, bool] = {}
    rates: set[Fraction] = set()
    for node in order(outputs):
        if index not in node.variables:
            periodic[node] = True
        elif node.op in WAVES and not periodic[node.args[0]]:
            terms = linear_terms(node.args[0])[1]
            own = [c for c, x in terms if x.op == "variable" and x.data == index]
            rest = [x for _, x in terms if not (x.op == "variable" and x.data == index)]
            periodic[node] = bool(own) and all(periodic[x] for x in rest)
            rates.update(abs(c) for c in own)
        else:
            periodic[node] = bool(node.args) and all(periodic[a] for a in node.args)
    return rates if all(periodic[n] for n in outputs) else set()


def reduce_to_period(
    outputs: Sequence[Node],
    lower: Annotated[np.ndarray, " variables"],
    upper: Annotated[np.ndarray, " variables"],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the domain with one period in place of every longer range of a periodic variable.

    The period that begins at 0: any range of a whole period has the same values, and far from 0 the doubles are
    too far apart to hold one, so that lower + period may be less than a period above lower.
    """
    lower, upper = lower.copy(), upper.copy()
    for k in range(len(lower)):
        one = period(outputs, k)
        if one is not None and upper[k] - lower[k] > 2.0 * one:
            lower[k], upper[k] = 0.0, one
    return lower, upper
