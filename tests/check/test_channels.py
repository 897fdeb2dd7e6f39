"""The inequality from channels: the quadratic form it stands for, term by term, in every kind of number."""

from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq
from hypothesis import given
from hypothesis import strategies as st

from lockstep.check.continuous.channels import Channel, Inequality, Term
from lockstep.check.numbers import as_floats, exactly

N, N_X, K_IN, K_OUT = 2, 3, 2, 1
"""Two agents; x_cl; what a controller is given and puts out."""


def whole(generator, *shape):
    """Whole numbers as doubles: products of a few are exact in doubles too."""
    return generator.integers(-3, 4, shape).astype(float)


def symmetric(generator, size):
    half = whole(generator, size, size)
    return half + half.T


def term(generator, width, *, z=2, controllers=False):
    D_z = tuple(whole(generator, z, K_OUT) for _ in range(N)) if controllers else ()
    Pi_w = symmetric(generator, 2)
    return Term(whole(generator, z, N_X), symmetric(generator, z), whole(generator, 2, width), Pi_w, D_z)


def stated(generator):
    """A disturbance, measurement noise (Y), an input in the cost (D_z), a channel without columns, one without terms."""
    noise = tuple(whole(generator, K_IN, 2) for _ in range(N))
    return Inequality(
        whole(generator, N_X, N_X),
        tuple(whole(generator, N_X, K_OUT) for _ in range(N)),
        tuple(whole(generator, K_IN, N_X) for _ in range(N)),
        (
            Channel(
                "disturbance", whole(generator, N_X, 2), (term(generator, 2),), (term(generator, 2, z=3),)
            ),
            Channel("noise", whole(generator, N_X, 2), (term(generator, 2), term(generator, 2)), (), noise),
            Channel("input", whole(generator, N_X, 1), (), (term(generator, 1, controllers=True),)),
            Channel("nothing", whole(generator, N_X, 0), (term(generator, 0, controllers=True),)),
            Channel("idle", whole(generator, N_X, 1), ()),
        ),
    )


def form(one, P, K, multipliers, x, w):
    """2 x'P x' + the channels' forms at one point, from their definitions, in Python's fractions."""

    def times(M, v):
        return [
            sum((Fraction(a) * b for a, b in zip(row, v, strict=True)), Fraction(0)) for row in M.tolist()
        ]

    def plus(*vectors):
        return [sum(column) for column in zip(*vectors, strict=True)]

    def square(Pi, v):
        return sum(a * b for a, b in zip(v, times(Pi, v), strict=True))

    y = [
        plus(times(Y, x), *[times(c.Y[i], v) for c, v in zip(one.channels, w, strict=True) if c.Y])
        for i, Y in enumerate(one.Y)
    ]
    u = [times(K[i], y[i]) for i in range(N)]
    rate = plus(
        times(one.A_0, x),
        *[times(U, u[i]) for i, U in enumerate(one.U)],
        *[times(c.E, v) for c, v in zip(one.channels, w, strict=True)],
    )
    total, left = 2 * sum(a * b for a, b in zip(times(P, x), rate, strict=True)), list(multipliers)
    for channel, v in zip(one.channels, w, strict=True):
        weighted = [(Fraction(1), t) for t in channel.fixed] + [(left.pop(0), t) for t in channel.cone]
        for weight, t in weighted:
            z = plus(times(t.C_z, x), *[times(D, u[i]) for i, D in enumerate(t.D_z)])
            total += weight * (square(t.Pi_z, z) - square(t.Pi_w, times(t.C_w, v)))
    return total


def in_numbers(one, number):
    """The same inequality in another kind of number."""

    def convert(value):
        if isinstance(value, np.ndarray):
            return number(value)
        if isinstance(value, tuple):
            parts = [convert(part) for part in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        return value

    return Inequality(*(convert(part) for part in (one.A_0, one.U, one.Y, one.channels)))


@given(st.integers(0, 2**32))
def test_F_is_the_form_it_stands_for(seed):
    generator = np.random.default_rng(seed)
    one, P, K = stated(generator), symmetric(generator, N_X), whole(generator, N, K_OUT, K_IN)
    multipliers = [Fraction(int(generator.integers(0, 9)), 7) for _ in range(one.multipliers)]
    F = in_numbers(one, exactly).F(
        exactly(P),
        exactly(K),
        np.array([fmpq(m.numerator, m.denominator) for m in multipliers], dtype=object),
    )
    assert (F == F.T).all()
    assert len(F) == one.size
    widths = [c.E.shape[1] for c in one.channels]
    for _ in range(3):
        x, *w = (whole(generator, size) for size in (N_X, *widths))
        point = exactly(np.concatenate([x, *w]))
        value = point @ F @ point
        parts = [[Fraction(v) for v in part] for part in (x, *w)]
        assert Fraction(int(value.p), int(value.q)) == form(one, P, K, multipliers, parts[0], parts[1:])


def test_doubles_and_rationals_are_one_assembly():
    generator = np.random.default_rng(1)
    one, P, K = stated(generator), symmetric(generator, N_X), whole(generator, N, K_OUT, K_IN)
    multipliers = whole(generator, one.multipliers)
    doubles = one.F(P, K, multipliers)
    exact = in_numbers(one, exactly).F(exactly(P), exactly(K), exactly(multipliers))
    assert as_floats(exact).tolist() == doubles.tolist(), "whole numbers: nothing is rounded"


def test_the_coefficients_add_up_to_F():
    """F = He([I; 0] P flow) + F_0 + sum tau F_k: all that a program in P and tau needs."""
    generator = np.random.default_rng(2)
    one, P, K = stated(generator), symmetric(generator, N_X), whole(generator, N, K_OUT, K_IN)
    multipliers, half = whole(generator, one.multipliers), np.zeros((one.size, one.size))
    half[:N_X] = P @ one.flow(K)
    whole_F = half + half.T + one.constant(K) + np.tensordot(multipliers, one.slopes(K), 1)
    assert whole_F.tolist() == one.F(P, K, multipliers).tolist()


def test_without_channels_it_is_lyapunov_s():
    A, P = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.eye(2)
    alone = Inequality(A, (), (), ())
    assert alone.F(P, np.zeros((0, 1, 1)), np.zeros(0)).tolist() == (A + A.T).tolist()
    assert alone.slopes(np.zeros((0, 1, 1))).shape == (0, 2, 2)


@pytest.mark.parametrize("count", [0, 3, 5])
def test_a_wrong_number_of_multipliers_is_refused(count):
    one = stated(np.random.default_rng(3))
    assert one.multipliers == 4
    with pytest.raises(ValueError, match=f"{count} multipliers for 4 terms"):
        one.F(np.eye(N_X), np.zeros((N, K_OUT, K_IN)), np.zeros(count))
