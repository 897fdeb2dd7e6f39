"""`proofs` of a design file: the witnesses of its claims. Each is put to the proof; none is believed."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from lockstep.check.agent import Move
from lockstep.check.design_file.claims import Claims
from lockstep.check.design_file.json_text import (
    item,
    matrix,
    number,
    one_of,
    only,
    optional,
    part,
    position,
    rows_or_none,
    symmetric,
    vector,
)
from lockstep.check.design_file.problem_part import Sizes
from lockstep.check.errors import ProblemError
from lockstep.check.floor.text import pieces_document, witness_of
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.inequality import Certificate
from lockstep.check.modes import ModalCertificate, Segment
from lockstep.check.sampled.inequality import NUMBERS, Witness

MODAL = "modal"
CERTIFICATE = "proofs, certificate"


@dataclass(frozen=True)
class BoundProof:
    """What the bound of phi was proved with: slopes moved from phi into A, and how many boxes the decision takes."""

    boxes: int = 0
    moves: tuple[Move, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON types; components and arguments are counted from 1, amounts are rationals as text."""
        moves = [
            {"component": one.component + 1, "argument": one.argument + 1, "amount": str(one.amount)}
            for one in self.moves
        ]
        return {"boxes": self.boxes, "moves": moves}


@dataclass(frozen=True, eq=False)
class Proofs:
    """What proves the claims of a design file.

    certificate: of rho, with P, m, t;  floor: dual points;  sampled, sampled_rho, max_period: of the sampled loop, at its
    period, of its rho, and at the largest period claimed;  bound: of alpha and the entries. A claim whose witness is None is
    not proved.
    """

    certificate: Certificate | ModalCertificate | None = None
    floor: FloorWitness | None = None
    sampled: Witness | None = None
    sampled_rho: Witness | None = None
    max_period: Witness | None = None
    bound: BoundProof | None = None

    def document(self) -> dict[str, Any]:
        """Return the witnesses as plain JSON types."""
        sampled = {
            key: None if (one := getattr(self, key)) is None else one.document()
            for key in ("sampled", "sampled_rho", "max_period")
        }
        return {
            "certificate": None if self.certificate is None else certificate_document(self.certificate),
            "floor": None if self.floor is None else pieces_document(self.floor),
            **sampled,
            "bound": None if self.bound is None else self.bound.document(),
        }


def certificate_document(c: Certificate | ModalCertificate) -> dict[str, Any]:
    """Return a certificate as plain JSON types, but for its rho, which is claimed."""
    if isinstance(c, ModalCertificate):
        return {
            "kind": MODAL,
            "lower": c.lower,
            "segments": [{"upper": segment.upper, "P": segment.P.tolist()} for segment in c.segments],
            "mu": c.mu,
            **({"mu_entries": list(c.mu_entries)} if c.mu_entries else {}),
            "P_mean": c.P_mean.tolist(),
        }
    own = {"m_entries": c.m_entries.tolist()} if len(c.m_entries) else {}
    return {"P": c.P.tolist(), "m": c.m.tolist(), "t": c.t.tolist(), **own}


def proofs_of(content: Any, claims: Claims, sizes: Sizes) -> Proofs:
    """Read `proofs`, of claims about loops of these sizes.

    Raises:
        ProblemError: a key missing or unknown, a witness of another shape, or a floor that is claimed without one.
    """
    only(content, Proofs().document(), "proofs")
    floor = None
    if claims.floor is not None:
        floor = witness_of(claims.floor, content.get("floor"), "proofs, `floor`")
    sampled, rho, longest = (
        optional(content, key, sampled_witness_of, "proofs")
        for key in ("sampled", "sampled_rho", "max_period")
    )
    bound = optional(content, "bound", _bound, "proofs")
    certificate = _certificate(content.get("certificate"), claims, sizes)
    return Proofs(certificate, floor, sampled, rho, longest, bound)


_AMOUNT = re.compile("-?[0-9]{1,400}(/[0-9]{1,400})?")


def _bound(value: Any, where: str) -> BoundProof:
    only(value, ("boxes", "moves"), where)
    boxes, moves = part(value, "boxes", int), []
    if isinstance(boxes, bool) or boxes < 0:
        raise ProblemError(f"{boxes!r}", where=f"{where}, `boxes`", expected="a whole number from 0 up")
    for i, one in enumerate(part(value, "moves", list), start=1):
        place = f"{where}, move {i}"
        component, argument, amount = (item(one, key, place) for key in ("component", "argument", "amount"))
        only(one, ("component", "argument", "amount"), place)
        if not isinstance(amount, str) or not _AMOUNT.fullmatch(amount) or amount.endswith("/0"):
            raise ProblemError(
                f"{amount!r}", where=f"{place}, `amount`", expected='a rational such as "-1/2"'
            )
        numbers = position(component, f"{place}, `component`"), position(argument, f"{place}, `argument`")
        moves.append(Move(*numbers, Fraction(amount)))
    return BoundProof(boxes, tuple(moves))


def sampled_witness_of(value: Any, where: str) -> Witness:
    """Read a witness of the sampled loop; whether its sizes fit is decided with the loop."""
    sizes = [len(rows) if isinstance(rows := item(value, key, where), list) else 0 for key in ("P", "m", "t")]
    only(value, ("P", "m", "t", *NUMBERS), where)
    # Files written before mu had a number of its own counted it like nu.
    numbers = {"kappa_mu": value.get("kappa"), **value}
    return Witness(
        matrix(value, "P", where, (sizes[0], sizes[0])),
        vector(value, "m", sizes[1], where),
        vector(value, "t", sizes[2], where),
        *(number(numbers.get(key), f"{where}, `{key}`") for key in NUMBERS),
    )


def _certificate(stored: Any, claims: Claims, sizes: Sizes) -> Certificate | ModalCertificate | None:
    if stored is None:
        return None
    if not isinstance(stored, dict):
        raise ProblemError(
            f"a {type(stored).__name__}", where=CERTIFICATE, expected="an object with P, m and t"
        )
    rho, entries = number(claims.rho, "claims, `rho`"), len(claims.entries)
    if "kind" in stored:
        return _modal_certificate(stored, rho, sizes, entries)
    only(stored, ("P", "m", "t", "m_entries"), CERTIFICATE)
    N, n, m, q, n_C = sizes
    n_x, pairs = n * (N - 1) + n_C * N, N * (N - 1) // 2
    blocks = {"A": n_C * n_C, "B": n_C * q, "C": m * n_C, "D": m * q}
    ways = N * sum(1 for letter in "ABCD" if claims.fragility[letter] > 0 and blocks[letter])
    weights, t = vector(stored, "m", pairs, CERTIFICATE), vector(stored, "t", ways, CERTIFICATE)
    P = symmetric(matrix(stored, "P", CERTIFICATE, (n_x, n_x)), f"{CERTIFICATE}, `P`")
    return Certificate(rho, P, weights, t, rows_or_none(stored, "m_entries", (entries, pairs), CERTIFICATE))


def _modal_certificate(stored: Mapping[str, Any], rho: float, sizes: Sizes, entries: int) -> ModalCertificate:
    one_of(stored["kind"], (MODAL,), f"{CERTIFICATE}, `kind`")
    only(stored, ("kind", "lower", "segments", "mu", "mu_entries", "P_mean"), CERTIFICATE)
    n_C, size = sizes.n_C, sizes.n + sizes.n_C
    segments = tuple(
        Segment(
            number(item(one, "upper", place), f"{place}, `upper`"),
            symmetric(matrix(one, "P", place, (size, size)), f"{place}, `P`"),
        )
        for one, place in (
            (one, f"{CERTIFICATE}, segment {i}")
            for i, one in enumerate(part(stored, "segments", list), start=1)
        )
    )
    P_mean = symmetric(matrix(stored, "P_mean", CERTIFICATE, (n_C, n_C)), f"{CERTIFICATE}, `P_mean`")
    lower, mu = (number(stored.get(key), f"{CERTIFICATE}, `{key}`") for key in ("lower", "mu"))
    own = tuple(vector({"mu_entries": [], **stored}, "mu_entries", entries, CERTIFICATE).tolist())
    return ModalCertificate(rho, lower, segments, mu, P_mean, own)
