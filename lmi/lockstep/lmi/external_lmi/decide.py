"""Whether F(x) > 0, F(x) >= 0 or F(x) = 0 at a point, decided over the rationals, with what shows it.

Definiteness is `lockstep.check.psd`. Semidefinite matrices on the edge, which it does not accept, are decided by an exact
L D L' that may meet zero pivots: with a zero pivot the rest of its column has to be zero. What refutes is a vector v with
v' F v <= 0 (for >: v not 0), or < 0 (for >=), of whole numbers or rationals: anyone can multiply it out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.numbers import as_floats, exactly
from lockstep.check.psd import MOST_BITS, MOST_WORK, decide_positive_definite
from lockstep.lmi.external_lmi.lmi_file import Constraint, Lmi
from lockstep.model.html_table import html_table

Found = Literal["proved", "refuted", "undecided"]


@dataclass(frozen=True, eq=False)
class ConstraintVerdict:
    """What is decided of one constraint.

    found: "proved", "refuted" or "undecided";  method: the exact argument;  vector, value: v and v' F v that refute, over the
    rationals;  margin: the smallest eigenvalue in doubles, for information.
    """

    constraint: Constraint
    found: Found
    method: str
    margin: float = float("nan")
    vector: tuple[Any, ...] | None = None
    value: Any = None

    def document(self) -> dict[str, Any]:
        """Return it as JSON types; rationals as text."""
        shown = (
            {} if self.vector is None else {"vector": [str(v) for v in self.vector], "value": str(self.value)}
        )
        return {
            "name": self.constraint.name,
            "sign": self.constraint.sign,
            "rows": len(self.constraint.constant),
            "verdict": self.found,
            "method": self.method,
            "margin": self.margin,
            **shown,
        }


@dataclass(frozen=True, eq=False)
class LmiVerdict:
    """What is decided of all constraints."""

    constraints: tuple[ConstraintVerdict, ...]

    @property
    def ok(self) -> bool:
        """Whether every constraint is proved."""
        return all(one.found == "proved" for one in self.constraints)

    @property
    def reason(self) -> str:
        """How it was decided, or what fails first."""
        for one in self.constraints:
            if one.found != "proved":
                return f"{one.constraint.name} {one.constraint.sign} 0 is {one.found}: {one.method}"
        return "every constraint, in exact arithmetic"

    def document(self) -> dict[str, Any]:
        """Return the answer of the command."""
        error = {} if self.ok else {"error": {"kind": "NotCertified", "message": self.reason, "figures": {}}}
        return {
            "ok": self.ok,
            "certified": self.ok,
            "proof": "exact" if self.ok else "none",
            "reason": self.reason,
            "constraints": [one.document() for one in self.constraints],
            **error,
        }

    def _repr_html_(self) -> str:
        """Return a table, for a notebook."""
        return html_table(
            (f"{one.constraint.name} {one.constraint.sign} 0", one.found, one.method)
            for one in self.constraints
        )

    def __repr__(self) -> str:
        """Say what was decided."""
        return f"<LmiVerdict {'proved' if self.ok else 'not proved'}: {self.reason}>"


def decide_lmi(lmi: Lmi | Path | str | Mapping[str, Any]) -> LmiVerdict:
    """Decide a linear matrix inequality at its point, exactly: no solver, no rounding.

    Args:
        lmi: itself, its file, or what the file would hold.

    Raises:
        ProblemError: no LMI, with the place.

    >>> decide_lmi({"constraints": [{"constant": [["1", "1"], ["1", "1"]]}]}).constraints[0].vector
    (-1, 1)
    >>> decide_lmi({"constraints": [{"sign": ">=", "constant": [["1", "1"], ["1", "1"]]}]}).ok
    True
    """
    if not isinstance(lmi, Lmi):
        content = dict(lmi) if isinstance(lmi, Mapping) else lmi
        lmi = Lmi.read(content) if isinstance(content, str | Path) else Lmi.of(content)
    return LmiVerdict(tuple(_decided(one, one.at(lmi.point)) for one in lmi.constraints))


def _decided(one: Constraint, F: np.ndarray) -> ConstraintVerdict:
    if one.sign == "=":
        return _zero(one, F)
    for i, j in zip(*np.triu_indices(len(F), 1), strict=True):
        if F[i, j] != F[j, i]:
            above = f"({i + 1}, {j + 1}) is {_short(F[i, j])}"
            below = f"({j + 1}, {i + 1}) is {_short(F[j, i])}"
            said = f"not symmetric: entry {above}, entry {below}"
            return ConstraintVerdict(one, "refuted", said)
    first = decide_positive_definite(F)
    if first.positive:
        return ConstraintVerdict(one, "proved", first.method, first.margin)
    if not first.decided:
        return ConstraintVerdict(one, "undecided", first.method, first.margin)
    vector = _plain_vector(F, strict=one.sign == ">")
    if vector is None:
        bits = max(max(int(v.p).bit_length(), int(v.q).bit_length()) for v in F.flat)
        if bits > MOST_BITS or len(F) ** 4 * bits > MOST_WORK:
            return ConstraintVerdict(
                one, "undecided", f"{len(F)} rows of {bits} bits: too long for exact arithmetic"
            )
        vector = semidefinite_violation(F) if one.sign == ">=" else _null_or_violation(F)
    if vector is None:
        return ConstraintVerdict(one, "proved", "exact LDL' with zero pivots", first.margin)
    value = vector @ (F @ vector)
    assert value < 0 or (value == 0 and one.sign == ">" and any(vector))
    below = "v' F v < 0" if value < 0 else "v' F v = 0"
    return ConstraintVerdict(one, "refuted", f"a vector with {below}", first.margin, tuple(vector), value)


def _zero(one: Constraint, F: np.ndarray) -> ConstraintVerdict:
    for (i, j), value in np.ndenumerate(F):
        if value != 0:
            return ConstraintVerdict(one, "refuted", f"entry ({i + 1}, {j + 1}) is {_short(value)}, not 0")
    return ConstraintVerdict(one, "proved", "every entry is 0")


def semidefinite_violation(F: np.ndarray) -> np.ndarray | None:
    """Return v with v' F v < 0, exactly, or None: F is positive semidefinite.

    With J the rows of nonzero pivots so far and S = F_RR - F_RJ F_JJ^-1 F_JR, (-F_JJ^-1 F_JR w, w)' F (...) = w' S w.
    """
    n = len(F)
    S, used = F.copy(), list[int]()
    for k in range(n):
        rest = range(k + 1, n)
        if S[k, k] < 0:
            return _lifted(F, used, {k: fmpq(1)})
        if S[k, k] == 0:
            for i in rest:
                if S[i, k] != 0:
                    # (a, 1) on rows k, i: 2 a s_ik + s_ii = -1.
                    return _lifted(F, used, {k: -(S[i, i] + 1) / (2 * S[i, k]), i: fmpq(1)})
            continue
        used.append(k)
        column = S[:, k].copy()
        for i in rest:
            if column[i] != 0:
                S[i, k + 1 :] = S[i, k + 1 :] - (column[i] / column[k]) * column[k + 1 :]
    return None


def _null_or_violation(F: np.ndarray) -> np.ndarray | None:
    """Return v, not 0, with v' F v <= 0, for an F that is not positive definite."""
    found = semidefinite_violation(F)
    if found is not None:
        return found
    S, used = F.copy(), list[int]()
    for k in range(len(F)):
        if S[k, k] == 0:
            return _lifted(F, used, {k: fmpq(1)})
        used.append(k)
        column = S[:, k].copy()
        for i in range(k + 1, len(F)):
            S[i, k + 1 :] = S[i, k + 1 :] - (column[i] / column[k]) * column[k + 1 :]
    return None


def _lifted(F: np.ndarray, used: list[int], w: Mapping[int, Any]) -> np.ndarray:
    v = np.full(len(F), fmpq(0), dtype=object)
    for k, value in w.items():
        v[k] = value
    if used:
        head = fmpq_mat(F[np.ix_(used, used)].tolist())
        side = fmpq_mat([[-sum((F[j, k] * value for k, value in w.items()), start=fmpq(0))] for j in used])
        for j, row in zip(used, head.solve(side).tolist(), strict=True):
            v[j] = row[0]
    return v


def _plain_vector(F: np.ndarray, *, strict: bool) -> np.ndarray | None:
    """Return a vector of short whole numbers that refutes, if rounding the last eigenvector to one does."""
    doubles = as_floats(F)
    if not np.isfinite(doubles).all():
        return None
    scale = 2.0 ** -np.round(np.log2(np.maximum(np.abs(np.diag(doubles)), 1e-300)) / 2)
    scale = np.where(np.diag(doubles) == 0, 1.0, scale)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = doubles * np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return None
    _, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    direction = vectors[:, 0] * scale
    direction = direction / np.abs(direction).max()
    for bits in (0, 2, 4, 8, 16, 32, 50):
        v = exactly(np.round(direction * 2.0**bits))
        value = v @ (F @ v)
        if value < 0 or (strict and value == 0 and any(v)):
            return v
    return None


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) < 40 else f"{float(as_floats(np.array([value], dtype=object))[0]):.17g}..."
