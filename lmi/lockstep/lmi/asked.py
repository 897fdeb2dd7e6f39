"""Whether a design file claims at least what its own problem asks for.

A proof of less than was asked is a proof, but not of this design: a smaller alpha or delta than the problem's, a larger
rho, a proof for one phi where it is asked for all that have alpha, gains other than the given ones or beyond the gain
limit. Decided exactly, from the file alone.
"""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import exactly, eye
from lockstep.check.psd import decide_positive_definite
from lockstep.lmi.document import Stored

LIMITED = ("certified", "modal", "lipschitz")
"""Methods whose gains keep to `gain_limit`; those printed in the paper and those given are what they are."""


def shortfalls(stored: Stored) -> Iterator[str]:
    """Yield in words whatever the file claims less of than its problem asks for; nothing where it claims enough."""
    asked = stored.problem.design
    if asked.alpha is not None and stored.claims.alpha < asked.alpha:
        yield f"`alpha` is {stored.claims.alpha:.10g}, but [design] alpha asks for {asked.alpha:.10g}"
    if stored.claims.entries and (asked.alpha is not None or asked.objective == "alpha"):
        yield "`entries` are used, but [design] asks for every nonlinearity that has alpha"
    for letter, delta in stored.problem.fragility.items():
        if stored.claims.fragility[letter] < delta:
            yield f"`fragility` {letter} is {stored.claims.fragility[letter]:g}, but [design.fragility] asks for {delta:g}"
    if (
        asked.rho is not None
        and stored.proofs.certificate is not None
        and stored.proofs.certificate.rho > asked.rho
    ):
        yield f"`rho` is {stored.proofs.certificate.rho:.10g}, but [design] rho asks for {asked.rho:.10g}"
    yield from _other_gains(stored)
    yield from _large_gains(stored)


def _other_gains(stored: Stored) -> Iterator[str]:
    for i, given in enumerate(stored.problem.gains or ()):
        for letter in "ABCD":
            if not np.array_equal(getattr(stored.gains, letter)[i], getattr(given, letter)):
                yield f"`{letter}` of agent {i + 1} is not the one that [[design.gains]] gives"


def _large_gains(stored: Stored) -> Iterator[str]:
    design = stored.problem.design
    if design.method not in LIMITED:
        return
    for i, K in enumerate(stored.gains.blocks):
        if not norm_is_at_most(K, design.gain_limit):
            norm = float(np.linalg.norm(K, 2))
            yield f"the gains of agent {i + 1} have the norm {norm:.10g}, but `gain_limit` is {design.gain_limit:.10g}"


def norm_is_at_most(K: Float[np.ndarray, "k l"], limit: float) -> bool:
    """Decide |K| <= limit for the spectral norm, exactly but for the last bit of the limit.

    It is limit'^2 I - K K' > 0 with limit' the next double above.

    >>> norm_is_at_most(np.array([[3.0, 4.0]]), 5.0), norm_is_at_most(np.array([[3.0, 4.001]]), 5.0)
    (True, False)
    """
    rows = exactly(K if K.shape[0] <= K.shape[1] else K.T)
    square = exactly(np.array([math.nextafter(limit, math.inf)]))[0] ** 2
    return decide_positive_definite(square * eye(len(rows), rows) - rows @ rows.T).positive
