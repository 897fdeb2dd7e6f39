"""Agents with parameters of their own: `[network] parameters` may change B_i and nothing else.

(2) has one A and one C, and its proof needs one h for all agents: only then is agreement, all x_i equal, something
the uncoupled network keeps. Agents that differ in more drift apart from agreement by themselves.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.wording import shorten
from lockstep.model.affine import Affine, NormalForms
from lockstep.model.agent import Agent

_EXPECTED = "agents that differ in B only: (2) has one A, one C and one h for all, or agreement does not last"


def check_same_but_B(common: Agent, variant: Agent, *, where: str) -> None:
    """Refuse a variant of an agent that differs from it in A, in C or in h.

    Raises:
        ProblemError: names the first entry or equation that differs, with both values.
    """
    for letter, a, b in (("A", common.lure.A, variant.lure.A), ("C", common.lure.C, variant.lure.C)):
        _check_equal(letter, a, b, common.states, where)
    mine, forms = common.normal_forms()
    theirs, _ = variant.normal_forms(forms)
    for state, p, r in zip(common.states, mine, theirs, strict=True):
        if (p.constant, p.terms) != (r.constant, r.terms):
            raise ProblemError(
                f"h differs in d/dt {state}: `{_h(forms, p)}` and `{_h(forms, r)}`",
                where=where,
                expected=_EXPECTED,
                remedy=_REMEDY,
            )


_REMEDY = "change a parameter that multiplies inputs only"


def _h(forms: NormalForms, row: Affine) -> str:
    return shorten(forms.text(Affine(constant=row.constant, terms=row.terms)), 50)


def _check_equal(
    letter: str,
    a: Float[np.ndarray, "rows n"],
    b: Float[np.ndarray, "rows n"],
    states: Sequence[str],
    where: str,
) -> None:
    if (a == b).all():
        return
    i, j = np.argwhere(a != b)[0]
    row = f"d/dt {states[i]}" if letter == "A" else f"output {i + 1}"
    raise ProblemError(
        f"{letter} differs: {row} has {float(a[i, j])!r}*{states[j]}, and {float(b[i, j])!r}*{states[j]} here",
        where=where,
        expected=_EXPECTED,
        remedy=_REMEDY,
    )
