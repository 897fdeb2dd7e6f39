"""Documents for `lockstep certify --lmi` from what others have: matrices, Gram matrices, a solved cvxpy problem.

Numbers are written as Python writes a double, in the shortest decimals that read back: the claim is about these decimals.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.lmi.external_lmi.lmi_file import FORMAT

Monomial = tuple[int, ...]


def document_of_matrices(matrices: Mapping[str, Any], *, sign: str = ">") -> dict[str, Any]:
    """Return the claim that matrices are positive, each by its name: what a solver of any language leaves.

    >>> document_of_matrices({"P": np.eye(2)})["constraints"][0]["constant"]
    [['1.0', '0.0'], ['0.0', '1.0']]
    """
    constraints = [{"name": name, "sign": sign, "constant": _rows(M)} for name, M in matrices.items()]
    return {"format": FORMAT, "variables": [], "constraints": constraints, "point": {}}


def document_of_gram(
    Q: Any, monomials: Sequence[Monomial], polynomial: Mapping[Monomial, Any], *, name: str = "Q"
) -> dict[str, Any]:
    """Return the claim that p = m' Q m with Q >= 0: p is a sum of squares (Drake's and SumOfSquares' certificate).

    Args:
        Q: (k, k), doubles or rationals (`fractions.Fraction`, text).
        monomials: the exponents of m_1, ..., m_k.
        polynomial: coefficient by exponents.
        name: of the matrix.
    """
    rows = _rows(Q)
    entries = _products(monomials)
    names = [[f"{name}_{min(i, j) + 1}_{max(i, j) + 1}" for j in range(len(rows))] for i in range(len(rows))]
    claimed = sorted({*entries, *(tuple(k) for k in polynomial)})
    terms: dict[str, list[list[str]]] = {}
    for row, exponents in enumerate(claimed):
        for i, j in entries.get(exponents, []):
            column = terms.setdefault(names[i][j], [["0"] for _ in claimed])
            column[row][0] = str(int(column[row][0]) + 1)
    basis = {names[i][j]: _unit(i, j, len(rows)) for i in range(len(rows)) for j in range(i, len(rows))}
    lower = next(((i, j) for i in range(len(rows)) for j in range(i) if rows[i][j] != rows[j][i]), None)
    if lower is not None:
        raise ProblemError(
            f"entries {lower[::-1]} and {lower} differ", where=name, expected="a symmetric Gram matrix"
        )
    constant = [[_text(-Fraction(_text(polynomial.get(k, 0))))] for k in claimed]
    return {
        "format": FORMAT,
        "variables": list(basis),
        "constraints": [
            {"name": name, "sign": ">=", "terms": basis},
            {"name": "p - m' Q m", "sign": "=", "constant": constant, "terms": terms},
        ],
        "point": {names[i][j]: rows[i][j] for i in range(len(rows)) for j in range(i, len(rows))},
    }


def rounded_gram(
    Q: Any, monomials: Sequence[Monomial], polynomial: Mapping[Monomial, Any], *, digits: int = 9
) -> list[list[Fraction]]:
    """Return Q rounded to decimals and moved onto p = m' Q m, exactly (Peyrl and Parrilo 2008): positive if Q had room.

    Args:
        Q: (k, k), a solver's.
        monomials, polynomial: as in `document_of_gram`.
        digits: of the rounding.

    Raises:
        ProblemError: a coefficient of p that no product of monomials has.
    """
    doubles = np.asarray(Q, dtype=float)
    exact = [[Fraction(f"{x:.{digits}f}") for x in row] for row in ((doubles + doubles.T) / 2).tolist()]
    entries = _products(monomials)
    for exponents, wanted in polynomial.items():
        if tuple(exponents) not in entries and Fraction(_text(wanted)) != 0:
            raise ProblemError(
                f"the monomial {exponents}", where="rounded_gram", expected="a product of two of `monomials`"
            )
    for exponents, places in entries.items():
        off = Fraction(_text(polynomial.get(exponents, 0))) - sum(exact[i][j] for i, j in places)
        for i, j in places:
            exact[i][j] += off / len(places)
    return exact


def document_of_cvxpy(problem: Any, *, strict: bool = False) -> dict[str, Any]:
    """Return the constraints of a solved cvxpy problem, affine in its variables, with its solution as the point.

    Args:
        problem: a `cvxpy.Problem` with values; PSD, equality and inequality constraints, and variables that are PSD.
        strict: claim > instead of >= of the matrix constraints.

    Raises:
        ProblemError: a problem without a solution, or a constraint that is not affine or of another kind.
    """
    variables = problem.variables()
    if any(v.value is None for v in variables) or any(v.is_complex() for v in variables):
        raise ProblemError(
            "a problem without values, or complex ones", where="cvxpy", remedy="solve it first, in reals"
        )
    solution = {v.id: np.array(v.value, dtype=float) for v in variables}
    names = {v.id: _entries(v, f"x{k + 1}") for k, v in enumerate(variables)}
    sign = ">" if strict else ">="
    claims = [(v.name(), v, sign, False) for v in variables if v.attributes["PSD"]]
    for k, one in enumerate(problem.constraints):
        kind = type(one).__name__
        if kind not in ("PSD", "Equality", "Zero", "Inequality", "NonNeg") or not one.args[0].is_affine():
            raise ProblemError(
                f"constraint {k + 1} is a {kind}", where="cvxpy", expected="affine PSD, = and <= constraints"
            )
        relation = {"PSD": sign, "Equality": "=", "Zero": "="}.get(kind, ">=")
        expression = one.args[0] if kind in ("PSD", "Zero", "NonNeg") else one.args[1] - one.args[0]
        claims.append((f"constraint {k + 1}", expression, relation, kind in ("Inequality", "NonNeg")))
    try:
        constraints = [part for claim in claims for part in _affine(*claim, variables, names)]
    finally:
        for v in variables:
            v.save_value(solution[v.id])
    point = {name: repr(float(solution[v.id][at])) for v in variables for name, at in names[v.id]}
    return {"format": FORMAT, "variables": list(point), "constraints": constraints, "point": point}


def _affine(
    name: str, expression: Any, sign: str, entrywise: bool, variables: Sequence[Any], names: Mapping[int, Any]
) -> list[dict[str, Any]]:
    """Return a claim with its coefficients, read off at 0 and at unit points; entrywise inequalities one by one."""

    def value() -> np.ndarray:
        found = expression.value
        return np.atleast_2d(np.asarray(found.toarray() if hasattr(found, "toarray") else found))

    for v in variables:
        v.save_value(np.zeros(v.shape))
    constant, terms = value(), dict[str, np.ndarray]()
    mine = {v.id for v in expression.variables()}
    for v in (v for v in variables if v.id in mine):
        for entry, at in names[v.id]:
            unit = np.zeros(v.shape)
            unit[at] = 1.0
            if v.is_symmetric() and len(at) == 2:
                unit[at[::-1]] = 1.0
            v.save_value(unit)
            part = value() - constant
            if part.any():
                terms[entry] = part
        v.save_value(np.zeros(v.shape))
    if not entrywise:
        return [
            {
                "name": name,
                "sign": sign,
                "constant": _rows(constant),
                "terms": {k: _rows(M) for k, M in terms.items()},
            }
        ]
    return [
        {
            "name": f"{name}, entry {at}",
            "sign": sign,
            "constant": _rows([[constant[at]]]),
            "terms": {k: _rows([[M[at]]]) for k, M in terms.items() if M[at]},
        }
        for at in product(*map(range, constant.shape))
    ]


def _entries(variable: Any, fallback: str) -> list[tuple[str, tuple[int, ...]]]:
    name = variable.name() or fallback
    places = product(*map(range, variable.shape))
    symmetric = len(variable.shape) == 2 and variable.is_symmetric() and variable.shape[0] > 1
    kept = [at for at in places if not symmetric or at[0] <= at[1]]
    return [("_".join([name, *(str(k + 1) for k in at)]), at) for at in kept]


def _products(monomials: Sequence[Monomial]) -> dict[Monomial, list[tuple[int, int]]]:
    found: dict[Monomial, list[tuple[int, int]]] = {}
    for (i, a), (j, b) in product(enumerate(monomials), repeat=2):
        found.setdefault(tuple(x + y for x, y in zip(a, b, strict=True)), []).append((i, j))
    return found


def _unit(i: int, j: int, size: int) -> list[list[str]]:
    return [["1" if (r, c) in ((i, j), (j, i)) else "0" for c in range(size)] for r in range(size)]


def _rows(matrix: Any) -> list[list[str]]:
    return [[_text(value) for value in row] for row in matrix]


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    return repr(value) if isinstance(value, int) else repr(float(value))
