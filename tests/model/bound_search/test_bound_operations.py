"""Every operation an SX graph can hold: bounded, and not below its own differences, or refused by name."""

import casadi as ca
import numpy as np
import pytest
from bound_cases import smallest_bound

from lockstep.check.errors import ProblemError
from lockstep.model.bound_search import Box

NAMES = {getattr(ca, key): key[3:].lower() for key in dir(ca) if key.startswith("OP_")}
LOWER, UPPER = (0.3, 0.2), (0.8, 0.7)
JUMPS = {"lt", "le", "eq", "ne"}
"""Their values jump inside of the box."""
NONE_OF_OURS = {"asinh", "acosh", "atanh", "erf", "erfinv", "floor", "ceil", "fmod", "remainder"}
"""No formula of a problem file has them, so that no design file could hold them."""


def operations():
    """Every (name, phi) that CasADi makes an SX node of, of one argument or two."""
    v, t = ca.SX.sym("v", 2), ca.SX.sym("t")
    found = {}
    for op, name in sorted(NAMES.items()):
        for make in (lambda op: ca.SX.unary(op, v[0]), lambda op: ca.SX.binary(op, v[0], v[1])):
            try:
                w = make(op)
            except (RuntimeError, NotImplementedError, TypeError):
                continue
            phi = ca.Function("phi", [v, t], [ca.densify(w)])
            held = {NAMES[phi.instruction_id(k)] for k in range(phi.n_instructions())}
            if name in held - {"input", "output", "const"}:
                found[name] = phi  # of two arguments where there are two
    return found


OPERATIONS = operations()


def test_these_are_the_operations_of_casadi():
    assert len(OPERATIONS) >= 40
    assert {"pow", "atan2", "hypot", "if_else_zero", "erfinv", "log1p", "fmin"} <= OPERATIONS.keys()


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_bounded_or_refused_by_name(name):
    phi = OPERATIONS[name]
    if name in NONE_OF_OURS:
        with pytest.raises(ProblemError, match=f"`{name}` has no bound here"):
            smallest_bound(phi, Box(LOWER, UPPER))
        return
    bound = smallest_bound(phi, Box(LOWER, UPPER))
    if name in JUMPS:
        assert not bound.proved
        assert "comparison" in bound.reason
        return
    assert bound.proved
    a, b = np.random.default_rng(0).uniform(LOWER, UPPER, (2, 2000, 2))
    values = [np.asarray(phi.map(2000)(points.T, 0.0)).ravel() for points in (a, b)]
    secants = np.abs(values[0] - values[1]) / np.linalg.norm(a - b, axis=1)
    assert bound.alpha >= secants.max() * (1 - 1e-12)
    assert bound.lower == pytest.approx(bound.alpha, rel=1e-5)


def test_a_call_of_another_function_is_refused_by_name():
    x, v, t = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("t")
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    with pytest.raises(ProblemError, match="`call` has no bound here"):
        smallest_bound(ca.Function("phi", [v, t], [inner(v)]), Box.everywhere(1))
