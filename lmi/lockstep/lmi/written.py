"""A design file as plain JSON types: what `lockstep.check.design_file` reads."""

import math
from typing import Any

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.design_file.content import FORMAT, DesignFile
from lockstep.check.design_file.proofs import BoundProof, Proofs
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.system.loop import Gains
from lockstep.model.plain_json import plain


def file_document(stored: DesignFile[Any]) -> dict[str, Any]:
    """Return a design file; gains that the problem gives are written once, under `gains`."""
    problem = stored.problem.document()
    design = {key: value for key, value in problem["design"].items() if key != "gains"}
    table: dict[str, Any] = plain(
        {
            "format": FORMAT,
            "problem": {**problem, "design": design},
            "gains": gains_document(stored.gains),
            "claims": stored.claims.document(),
            "proofs": proofs_document(stored.proofs),
            "info": stored.info,
        }
    )
    return table


def gains_document(gains: Gains) -> list[dict[str, Any]]:
    """Return A, B, C and D of each agent as plain JSON types."""
    return [{letter: getattr(gains, letter)[i].tolist() for letter in "ABCD"} for i in range(gains.N)]


def proofs_document(proofs: Proofs) -> dict[str, Any]:
    """Return the witnesses."""
    sampled = {
        key: None if (one := getattr(proofs, key)) is None else one.document()
        for key in ("sampled", "sampled_rho", "max_period", "radius")
    }
    names = ("limits_gain", "clipped", "messages", "messages_rho", "fixed")
    later = {key: one.document() for key in names if (one := getattr(proofs, key)) is not None}
    return {
        "certificate": None if proofs.certificate is None else certificate_document(proofs.certificate),
        "decay": None if proofs.decay is None else _with_rho(proofs.decay),
        **({} if proofs.initial_set is None else {"initial_set": _with_rho(proofs.initial_set)}),
        "floor": None if proofs.floor is None else pieces_document(proofs.floor),
        **sampled,
        "bound": None if proofs.bound is None else _bound_document(proofs.bound),
        **later,
    }


def _with_rho(certificate: Certificate | ModalCertificate) -> dict[str, Any]:
    return {"rho": certificate.rho, **certificate_document(certificate)}


def _bound_document(proof: BoundProof) -> dict[str, Any]:
    """Components and arguments are counted from 1, amounts are rationals as text."""
    moves = [
        {"component": one.component + 1, "argument": one.argument + 1, "amount": str(one.amount)}
        for one in proof.moves
    ]
    return {"boxes": proof.boxes, "moves": moves}


def certificate_document(c: Certificate | ModalCertificate) -> dict[str, Any]:
    """Return a certificate as plain JSON types, but for its rho, which is claimed."""
    if isinstance(c, ModalCertificate):
        return {
            "kind": "modal",
            "lower": c.lower,
            "segments": [{"upper": segment.upper, "P": segment.P.tolist()} for segment in c.segments],
            "mu": c.mu,
            **({"mu_entries": list(c.mu_entries)} if c.mu_entries else {}),
            "P_mean": c.P_mean.tolist(),
        }
    own = {"m_entries": c.m_entries.tolist()} if len(c.m_entries) else {}
    return {"P": c.P.tolist(), "m": c.m.tolist(), "t": c.t.tolist(), **own}


def pieces_document(witness: FloorWitness) -> list[dict[str, Any]]:
    """Return the pieces of a witness as plain JSON types."""
    return [
        {
            "upper": piece.upper if math.isfinite(piece.upper) else None,
            "Z": [piece.Z[i, : i + 1].tolist() for i in range(len(piece.Z))],
            "Z_dual": [piece.Z_dual[i, : i + 1].tolist() for i in range(len(piece.Z_dual))],
            "k": piece.k.tolist(),
        }
        for piece in witness.pieces
    ]
