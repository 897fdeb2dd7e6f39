"""`split = "jacobian"`: the slope of phi at the origin goes into A, as in a linearisation at x = 0.

The slope is computed in doubles; what is moved is that double, or the number next to it for which the agent stays
exactly what it was (`shift`). Whatever is moved, the bound is proved of what is left.
"""

from collections.abc import Iterator
from fractions import Fraction
from itertools import product
from math import frexp, ldexp

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.system.agent import Move
from lockstep.model.loop_transformation.lure import Lure
from lockstep.model.loop_transformation.shift import moved_exactly

STEP, JUMP = 1e-9, 1e-6
"""A kink shows as a slope that jumps by this part within this distance of the origin."""

FEWEST_BITS = 20
"""An amount that agrees with the slope to fewer bits than this is no linearisation any more."""


def linearised(lure: Lure) -> tuple[Lure, tuple[Move, ...]]:
    """Return the same agent with the slope of phi at v = 0 moved into A, and what was moved.

    Where doubles cannot hold the sums the entries of A are rounded once each, and `Lure.rounded` names them.

    Raises:
        ProblemError: no slope at the origin, or one that depends on t.

    >>> from lockstep.model.agents.agent import Agent
    >>> cart = Agent.from_expressions("cart", states=["v"], inputs=["f"], outputs={"y": "v"}, split="jacobian",
    ...                               dynamics={"v": "f - 0.1*v - tanh(v)"})
    >>> cart.lure.A, cart.lure.rounded
    (array([[-1.1]]), ())
    """
    slope, moves = _slope_at_origin(lure), list[Move]()
    for k, j in product(*map(range, slope.shape)):
        if slope[k, j]:
            lure, amount = moved_exactly(lure, k, j, _near(float(slope[k, j])))
            moves.append(Move(k, j, amount))
    return lure, tuple(moves)


def _near(slope: float) -> Iterator[Fraction]:
    """Yield the slope, then numbers of fewer and fewer bits next to it."""
    mantissa, exponent = frexp(slope)
    for bits in range(53, FEWEST_BITS - 1, -1):
        yield Fraction(ldexp(round(ldexp(mantissa, bits)), exponent - bits))


def _slope_at_origin(lure: Lure) -> Float[np.ndarray, "r v"]:
    """Return d phi / d v at v = 0."""
    v, t = ca.SX.sym("v", lure.H.shape[0]), ca.SX.sym("t")
    jacobian = ca.densify(ca.jacobian(lure.phi(v, t), v))
    if ca.depends_on(ca.substitute(jacobian, v, ca.SX.zeros(v.shape[0])), t):
        raise _refused("the slope of the nonlinearity at the origin depends on t", "a linear part without t")
    at = ca.Function("slope", [v, t], [jacobian])
    value = np.asarray(at(np.zeros(v.shape[0]), 0.0)).reshape(jacobian.shape)
    near = [np.asarray(at(sign * STEP * e, 0.0)) for e in np.eye(v.shape[0]) for sign in (-1, 1)]
    if not np.isfinite(value).all() or any(not np.allclose(value, x, rtol=JUMP, atol=JUMP) for x in near):
        raise _refused(
            "the nonlinearity has no slope at the origin", "a right-hand side that is differentiable at x = 0"
        )
    return value


def _refused(found: str, expected: str) -> ProblemError:
    return ProblemError(found, where="[agent] split", expected=expected, remedy='use split = "terms"')
