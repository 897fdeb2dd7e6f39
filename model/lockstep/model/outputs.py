"""The outputs y = C x of (2): linear in the states, and nothing else."""

from collections.abc import Mapping, Sequence

import casadi as ca

from lockstep.check.errors import ProblemError
from lockstep.check.wording import shorten
from lockstep.model.affine import Affine, NormalForms, Row

_EXPECTED = "a sum of states with constant coefficients, y = C x as in (2)"


def output_rows(
    forms: NormalForms, outputs: Mapping[str, ca.SX], states: Sequence[str], inputs: Sequence[str]
) -> list[Row]:
    """Return the rows of C for outputs given as expressions.

    Args:
        forms: a table over the states, then the inputs.
        outputs: the expression of each output, by name.
        states: their names.
        inputs: their names.

    Raises:
        ProblemError: an output that is not linear, has a constant, contains an input, or shows no state.
    """
    rows = []
    for name, expression in outputs.items():
        where = f"[agent.outputs] {name}"
        try:
            form = forms.split(expression)
        except ProblemError as error:
            raise error.within(where) from None
        _check_linear(forms, form, where)
        for j, _ in form.row:
            if j >= len(states):
                raise ProblemError(
                    f"the input `{inputs[j - len(states)]}` is in an output",
                    where=where,
                    expected=_EXPECTED,
                    remedy="leave the feedthrough out: the controller knows its own input",
                )
        rows.append(form.row)
    return rows


def _check_linear(forms: NormalForms, form: Affine, where: str) -> None:
    if form.terms:
        term = shorten(forms.text(Affine(terms=form.terms[:1])))
        raise ProblemError(
            f"`{term}` is not linear in the states",
            where=where,
            expected=_EXPECTED,
            remedy="make what is measured a state, or measure the states it is made of",
        )
    if form.constant:
        raise ProblemError(
            f"the output has the constant {float(form.constant):.6g}",
            where=where,
            expected=_EXPECTED,
            remedy="leave it out: relative outputs do not see it",
        )
    if not form.row:
        raise ProblemError("the output depends on no state", where=where, expected=_EXPECTED)
