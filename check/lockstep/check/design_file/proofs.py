"""`proofs` of a design file: the witnesses of its claims. Each is put to the proof; none is believed."""

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from lockstep.check import json_text as read
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.design_file.claims import Claims
from lockstep.check.design_file.fixed_point import FixedWitness
from lockstep.check.design_file.messages import message_witness_of
from lockstep.check.design_file.modal_proof import modal_witness_of, segments
from lockstep.check.design_file.problem_part import Sizes
from lockstep.check.errors import demand
from lockstep.check.floor.witness import FloorWitness, Piece
from lockstep.check.sampled.inequality import NUMBERS, Witness
from lockstep.check.sampled.inputs.saturation import ClippedWitness
from lockstep.check.sampled.links import MessageWitness
from lockstep.check.sampled.modes import SampledModalWitness
from lockstep.check.system.agent import Move

_AMOUNT = re.compile("-?[0-9]{1,400}(/0*[1-9][0-9]{0,399})?")


@dataclass(frozen=True)
class BoundProof:
    """What the bound of phi was proved with: slopes moved from phi into A, and how many boxes the decision takes."""

    boxes: int = 0
    moves: tuple[Move, ...] = ()


@dataclass(frozen=True, eq=False)
class Proofs:
    """What proves the claims of a design file.

    certificate: of rho, with P, m, t;  decay: a certificate of the loop of e^(decay t) x_cl, with a rho of its own;
    initial_set: one of the loop itself, with a rho of its own, where the certificate does not prove the set;  floor: dual
    points;  sampled, sampled_rho, max_period, radius, limits_gain, clipped: of the sampled loop, at its period, of its rho,
    at the largest period claimed, of the radius, of the energy that meets no limit, and of the clipped loop;
    sampled_decay: of its fastest decay;  bound: of alpha and the entries;  messages, messages_rho: of the sampled loop
    whose messages are lost or late;  fixed: of the controllers in integers. A claim whose witness is None is proved anew, or
    is not.
    """

    certificate: Certificate | ModalCertificate | None = None
    decay: Certificate | ModalCertificate | None = None
    floor: FloorWitness | None = None
    sampled: Witness | SampledModalWitness | None = None
    sampled_rho: Witness | SampledModalWitness | None = None
    max_period: Witness | SampledModalWitness | None = None
    sampled_decay: Witness | SampledModalWitness | None = None
    radius: Witness | None = None
    bound: BoundProof | None = None
    messages: MessageWitness | None = None
    messages_rho: MessageWitness | None = None
    limits_gain: Witness | None = None
    clipped: ClippedWitness | None = None
    fixed: FixedWitness | None = None
    initial_set: Certificate | ModalCertificate | None = None


def proofs_of(content: Any, claims: Claims, sizes: Sizes) -> Proofs:
    """Read `proofs`, of claims about loops of these sizes.

    Raises:
        ProblemError: a key missing or unknown, a witness of another shape, or a floor that is claimed without one.
    """
    rho, maybe, held = claims.floor, read.or_none(sampled_witness_of), read.or_none(_sampled_witness)
    move = read.made(Move, {"component": read.position, "argument": read.position, "amount": _rational})
    readers: dict[str, read.Reader] = {
        "certificate": read.or_none(partial(_certificate, claims, sizes, claims.rho)),
        "decay": read.or_none(partial(_with_rho, claims, sizes)),
        "floor": lambda value, where: None if rho is None else floor_witness_of(rho, value, where),
        **dict.fromkeys(("sampled", "sampled_rho", "max_period", "sampled_decay"), held),
        "radius": maybe,
        "bound": read.or_none(
            read.made(
                BoundProof, {"boxes": read.whole(0), "moves": partial(read.each, read=move, name="move")}
            )
        ),
        **dict.fromkeys(("messages", "messages_rho"), read.or_none(message_witness_of)),
        "limits_gain": maybe,
        "clipped": read.or_none(_clipped),
        "fixed": read.or_none(
            read.made(FixedWitness, {"agreement": sampled_witness_of, "rho": maybe, "radius": maybe})
        ),
        "initial_set": read.or_none(partial(_with_rho, claims, sizes)),
    }
    return Proofs(*read.record(content, "proofs", readers))


def _rational(value: Any, where: str) -> Fraction:
    rational = isinstance(value, str) and len(value) < 810 and _AMOUNT.fullmatch(value)
    demand(rational, f"{value!r}", where, 'a rational such as "-1/2"')
    return Fraction(value)


def _sampled_witness(value: Any, where: str) -> Witness | SampledModalWitness:
    modal = isinstance(value, dict) and "kind" in value
    return modal_witness_of(value, where) if modal else sampled_witness_of(value, where)


def sampled_witness_of(value: Any, where: str) -> Witness:
    """Read a witness of the sampled loop; whether its sizes fit is decided with the loop."""
    if isinstance(value, dict):  # files written before mu had a number of its own counted it like nu
        value = {"kappa_mu": value.get("kappa"), **value}
    readers = {"P": read.matrix()} | dict.fromkeys("mt", read.vector()) | dict.fromkeys(NUMBERS, read.number)
    return Witness(*read.record(value, where, readers))


def _clipped(value: Any, where: str) -> ClippedWitness:
    demand(isinstance(value, dict), f"a {type(value).__name__}", where, "an object")
    own = {key: value.get(key) for key in ("tau", "H")}
    storage = sampled_witness_of({key: one for key, one in value.items() if key not in own}, where)
    return ClippedWitness(storage, *read.record(own, where, {"tau": read.vector(), "H": read.matrix()}))


def floor_witness_of(rho: float, value: Any, where: str) -> FloorWitness:
    """Read the witness of a floor rho: of the symmetric Z and Z_dual the lower triangles, row by row.

    A list of pieces alone, as it was written before noise and the weights of inputs counted, is of xi and R.

    Raises:
        ProblemError: it is not one by its form.
    """
    end = lambda value, where: math.inf if value is None else read.number(value, where)  # noqa: E731
    piece = read.made(Piece, {"upper": end, "Z": _triangle, "Z_dual": _triangle, "k": read.matrix()})
    pieces: read.Reader = partial(read.each, read=piece, name="piece")
    if isinstance(value, list):
        return FloorWitness(rho, pieces(value, where))
    slopes, found = read.record(value, where, {"slopes": read.vector(), "pieces": pieces})
    return FloorWitness(rho, found, tuple(slopes.tolist()))


def _triangle(value: Any, where: str) -> Any:
    rows = read.each(value, where, read.vector(), "row")
    whole = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        demand(len(row) == i + 1, f"{len(row)} numbers", f"{where}, row {i + 1}", f"{i + 1}")
        whole[i, : i + 1] = whole[: i + 1, i] = row
    return whole


def _with_rho(claims: Claims, sizes: Sizes, stored: Any, where: str) -> Certificate | ModalCertificate:
    """Read a certificate with a rho of its own."""
    demand(isinstance(stored, dict), f"a {type(stored).__name__}", where, "an object")
    rho = read.above_zero(stored.get("rho"), f"{where}, `rho`")
    return _certificate(claims, sizes, rho, {key: one for key, one in stored.items() if key != "rho"}, where)


def _certificate(
    claims: Claims, sizes: Sizes, rho: float | None, stored: Any, where: str
) -> Certificate | ModalCertificate:
    rho, entries = read.number(rho, "claims, `rho`"), len(claims.entries)
    if isinstance(stored, dict) and "kind" in stored:
        return _modal_certificate(rho, sizes, entries, {"mu_entries": [], **stored}, where)
    if isinstance(stored, dict):
        stored = {"m_entries": [], **stored}
    N, n, m, q, n_C = sizes
    n_x, pairs = n * (N - 1) + n_C * N, N * (N - 1) // 2
    blocks = {"A": n_C * n_C, "B": n_C * q, "C": m * n_C, "D": m * q}
    ways = N * sum(1 for letter in "ABCD" if claims.fragility[letter] > 0 and blocks[letter])
    readers = {"P": read.matrix(n_x, n_x, symmetric=True), "m": read.vector(pairs), "t": read.vector(ways)}
    return Certificate(
        rho, *read.record(stored, where, {**readers, "m_entries": read.matrix(entries, pairs)})
    )


def _modal_certificate(rho: float, sizes: Sizes, entries: int, stored: Any, where: str) -> ModalCertificate:
    size, n_C = sizes.n + sizes.n_C, sizes.n_C
    readers: dict[str, read.Reader] = {
        "kind": read.among("modal"),
        "lower": read.number,
        "segments": segments(size),
        "mu": read.number,
        "P_mean": read.matrix(n_C, n_C, symmetric=True),
        "mu_entries": lambda value, place: tuple(read.vector(entries)(value, place).tolist()),
    }
    return ModalCertificate(rho, *read.record(stored, where, readers)[1:])
