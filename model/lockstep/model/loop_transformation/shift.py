"""Moving a linear part S v out of phi and into A without changing the agent.

    A x + G phi(H x, t) = (A + G S H) x + G (phi(H x, t) - S H x)

is kept exactly where an amount S_kj can be had with which every entry of A + G S H is a double, the exact sum; phi then
loses S_kj v_j in one term, or in two if the amount is a sum of two doubles and none itself. Where there is none near enough
the entries are rounded once each.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np

from lockstep.check.numbers import is_double
from lockstep.model.loop_transformation.lure import Lure


def shifted(lure: Lure, k: int, j: int, amount: Fraction) -> Lure | None:
    """Return the agent with S_kj = amount moved from component k and argument j of phi into A.

    None if a sum in A, or the amount itself, is no double (no sum of two).
    """
    exact = all(is_double(total) for *_, total in _sums(lure, k, j, amount))
    return rounded(lure, k, j, amount) if exact and _two_doubles(amount) is not None else None


def rounded(lure: Lure, k: int, j: int, amount: Fraction) -> Lure:
    """Return the agent with S_kj = amount moved, each entry of A rounded once to a double; `Lure.rounded` names them.

    For the search: the checker sums in rationals.
    """
    A, names = np.array(lure.A), list[str]()
    for i, c, exact in _sums(lure, k, j, amount):
        A[i, c] = float(exact)
        names += [] if is_double(exact) else [f"A[{i + 1},{c + 1}]"]
    names = list(dict.fromkeys((*lure.rounded, *names)))
    return replace(lure, A=A, phi=phi_without(lure.phi, k, j, amount), rounded=tuple(names))


def moved_exactly(
    lure: Lure,
    k: int,
    j: int,
    amounts: Iterable[Fraction],
    allowed: Callable[[Fraction], bool] = lambda _amount: True,
) -> tuple[Lure, Fraction]:
    """Return the agent with the first allowed amount moved that is exact, of those given and next to them, and it.

    Where none is exact the first is moved, and A rounded.
    """
    amounts = list(amounts)
    for wanted in amounts:
        for amount in (wanted, *exact_amounts(lure, k, j, wanted)):
            if allowed(amount) and (found := shifted(lure, k, j, amount)) is not None:
                return found, amount
    return rounded(lure, k, j, amounts[0]), amounts[0]


def exact_amounts(lure: Lure, k: int, j: int, wanted: Fraction) -> Iterator[Fraction]:
    """Yield amounts next to the one wanted that make one entry of A a double: 0.1 + 0.5 is none, 0.6 is."""
    for i, c, weight in _entries(lure, k, j):
        old = Fraction(float(lure.A[i, c]))
        amount = (Fraction(float(old + wanted * weight)) - old) / weight
        if _two_doubles(amount) is not None:
            yield amount


def phi_without(phi: ca.Function, k: int, j: int, amount: Fraction) -> ca.Function:
    """Return phi with amount v_j taken from component k, in two terms if the amount is no double."""
    v, t = ca.SX.sym("v", phi.size1_in(0)), ca.SX.sym("t")
    w = ca.densify(phi(v, t))
    parts = _two_doubles(amount)
    assert parts is not None
    for part in parts:
        if part:
            w[k] -= part * v[j]
    return ca.Function("phi", [v, t], [w], ["v", "t"], ["w"])


def _entries(lure: Lure, k: int, j: int) -> list[tuple[int, int, Fraction]]:
    """Return (i, l, G_ik H_jl) for the entries of A that a slope of component k by argument j belongs to."""
    rows, columns = np.flatnonzero(lure.G[:, k]), np.flatnonzero(lure.H[j])
    return [
        (int(i), int(c), Fraction(float(lure.G[i, k])) * Fraction(float(lure.H[j, c])))
        for i in rows
        for c in columns
    ]


def _two_doubles(amount: Fraction) -> tuple[float, float] | None:
    high = float(amount)
    low = float(amount - Fraction(high))
    return (high, low) if Fraction(high) + Fraction(low) == amount else None


def _sums(lure: Lure, k: int, j: int, amount: Fraction) -> list[tuple[int, int, Fraction]]:
    """Return (i, l, the entry of A + amount G e_k e_j' H) for each entry that changes."""
    return [(i, c, Fraction(float(lure.A[i, c])) + amount * w) for i, c, w in _entries(lure, k, j)]
