"""Whether a design file claims at least what its own problem asks for.

A proof of less than was asked is a proof, but not of this design: a smaller alpha or delta than the problem's, a larger
rho, a proof for one phi where it is asked for all that have alpha, gains other than the given ones or beyond the gain
limit. Decided exactly, from the file alone.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Annotated, Any

import numpy as np

from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.design_file.claims import Claims
from lockstep.check.json_text import above_zero, flag, matrix, number, one_of, only, or_none
from lockstep.check.numbers import as_floats, exact, exactly, eye
from lockstep.check.psd import decide_positive_definite
from lockstep.check.system.loop import Gains

DESIGN, GAINS = "[design]", "[[design.gains]]"
GainUnits = tuple[Annotated[np.ndarray, " k"], Annotated[np.ndarray, " l"]]
LIMITED = ("certified", "modal", "lipschitz")
"""Methods whose gains keep to `gain_limit`; those printed in the paper and those given are what they are."""

UNLIMITED = ("given", "theorem1", "corollary1")


def shortfalls(
    asked: Mapping[str, Any], claims: Claims, gains: Gains, units: GainUnits, moved: Sequence[Fraction] = ()
) -> Iterator[str]:
    """Yield in words whatever a file claims less of than its problem asks for; nothing where it claims enough.

    Args:
        asked: the table [design] of the problem.
        claims, gains: of the file.
        units: `ProblemTables.gain_units`, in which the limit of the gains is.
        moved: slopes J in A that the text has in phi: of S in phi S - J is left, |S - J| <= |S| + |J|.

    Raises:
        ProblemError: a value of the table that cannot be one of its kind.
    """
    wishes = {"alpha": number, "rho": number, "decay": number, "stable_controllers": flag}
    alpha, rho, decay, stable = (
        or_none(read)(asked.get(key), f"{DESIGN}, `{key}`") for key, read in wishes.items()
    )
    fragility = asked.get("fragility") or {}
    only(fragility, LETTERS, "[design.fragility]")
    J = sum(map(abs, moved), Fraction(0))
    if alpha is not None and (Fraction(claims.alpha) < Fraction(alpha) + J or (J and claims.scales)):
        besides = f", and slopes of {float(J):.10g} are moved into A" if J else ""
        yield f"`alpha` is {claims.alpha:.10g}, but [design] alpha asks for {alpha:.10g}{besides}"
    D_w, D_v = claims.scales or ((), ())
    if alpha is not None and len(D_w) == 1 and {*D_w, *D_v} != {1.0}:
        # Of several components alpha is relative to scales that are part of the claim.
        yield "`alpha` is in other `scales` than ones, but [design] alpha asks for it of one component as it is"
    if claims.entries and (alpha is not None or asked.get("objective") == "alpha"):
        yield "`entries` are used, but [design] asks for every nonlinearity that has alpha"
    for letter in fragility:
        delta = number(fragility[letter], f"[design.fragility] {letter}")
        if claims.fragility[letter] < delta:
            yield f"`fragility` {letter} is {claims.fragility[letter]:g}, but [design.fragility] asks for {delta:g}"
    if rho is not None and claims.rho is not None and claims.rho > rho:
        yield f"`rho` is {claims.rho:.10g}, but [design] rho asks for {rho:.10g}"
    if decay is not None and (claims.decay or 0.0) < decay:
        yield f"`decay` is {claims.decay or 0.0:.10g}, but [design] decay asks for {decay:.10g}"
    if stable and not claims.controllers_stable:
        yield "`controllers_stable` is not claimed, but [design] stable_controllers asks for it"
    yield from _other_gains(asked.get("gains") or (), gains)
    yield from _large_gains(asked, gains, units)


def _other_gains(given: Any, gains: Gains) -> Iterator[str]:
    if given and len(given) != gains.N:
        yield f"[[design.gains]] has {len(given)} tables, and there are {gains.N} agents"
        return
    for i, one in enumerate(given):
        only(one, LETTERS, GAINS)
        for letter in LETTERS:
            mine = getattr(gains, letter)[i]
            rows = one.get(letter) or mine[:, :0].tolist()  # at order 0 there is D alone
            if not np.array_equal(mine, matrix(*mine.shape)(rows, f"{GAINS} {letter}")):
                yield f"`{letter}` of agent {i + 1} is not the one that [[design.gains]] gives"


def _large_gains(asked: Mapping[str, Any], gains: Gains, units: GainUnits) -> Iterator[str]:
    if one_of(asked.get("method", "certified"), (*LIMITED, *UNLIMITED), f"{DESIGN} method") not in LIMITED:
        return
    limit = above_zero(asked.get("gain_limit", 50.0), f"{DESIGN} gain_limit")
    for i, K in enumerate(units[0][:, None] * exactly(gains.blocks) * units[1]):
        if not norm_is_at_most(K, limit):
            norm, named = float(np.linalg.norm(as_floats(K), 2)), " in `gain_units`" * ("gain_units" in asked)
            yield f"the gains of agent {i + 1} have the norm {norm:.10g}{named}, but `gain_limit` is {limit:.10g}"


def norm_is_at_most(K: Annotated[np.ndarray, "k l"], limit: float) -> bool:
    """Decide |K| <= limit for the spectral norm, exactly but for the last bit of the limit.

    It is limit'^2 I - K K' > 0 with limit' the next double above.

    >>> norm_is_at_most(np.array([[3.0, 4.0]]), 5.0), norm_is_at_most(np.array([[3.0, 4.001]]), 5.0)
    (True, False)
    """
    rows = exactly(K if K.shape[0] <= K.shape[1] else K.T)
    square = exact(math.nextafter(limit, math.inf)) ** 2
    return decide_positive_definite(square * eye(len(rows), rows) - rows @ rows.T).positive
