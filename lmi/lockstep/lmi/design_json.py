"""A design file as plain JSON types: what `lockstep.check.design_file` reads."""

import math
from typing import Any

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.initial_set import InitialSet
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.design_file.claims import RESIDUALS, Claims, SampledClaims
from lockstep.check.design_file.content import FORMAT, DesignFile
from lockstep.check.design_file.messages import MessageClaims
from lockstep.check.design_file.proofs import BoundProof, Proofs
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.sampled.inputs.saturation import ClippedWitness
from lockstep.check.sampled.modes import SampledModalWitness
from lockstep.check.system.loop import Gains
from lockstep.model.plain_json import plain

LATER = ("limits_gain", "clipped_radius", "half_axes", "clipped_half_axes", "fastest_decay")
"""Claims of the sampled controllers that files from before do not have."""


def file_document(stored: DesignFile[Any]) -> dict[str, Any]:
    """Return a design file; gains that the problem gives are written once, under `gains`."""
    problem = stored.problem.document()
    design = {key: value for key, value in problem["design"].items() if key != "gains"}
    table: dict[str, Any] = plain(
        {
            "format": FORMAT,
            "problem": {**problem, "design": design},
            "gains": gains_document(stored.gains),
            "claims": claims_document(stored.claims),
            "proofs": proofs_document(stored.proofs),
            "info": stored.info,
        }
    )
    return table


def gains_document(gains: Gains) -> list[dict[str, Any]]:
    """Return A, B, C and D of each agent as plain JSON types."""
    return [{letter: getattr(gains, letter)[i].tolist() for letter in "ABCD"} for i in range(gains.N)]


def claims_document(claims: Claims) -> dict[str, Any]:
    """Return the claims; components, arguments and agents are counted from 1."""
    entries = [
        {"component": one.component + 1, "argument": one.argument + 1, "bound": one.bound}
        for one in claims.entries
    ]
    later = {
        "messages": claims.messages and message_claims_document(claims.messages),
        "fixed": claims.fixed and plain(claims.fixed),
    }
    plainly = {key: value for key, value in vars(claims).items() if key not in later}
    return {
        "certified": claims.certified,
        "proof": "exact" if claims.certified else "none",
        **plainly,
        "fragility": dict(claims.fragility),
        "scales": claims.scales and {key: list(d) for key, d in zip("GH", claims.scales, strict=True)},
        "entries": entries,
        "initial_set": claims.initial_set and initial_set_document(claims.initial_set),
        "sampled": sampled_document(claims.sampled),
        **{key: one for key, one in later.items() if one is not None},
    }


def sampled_document(claims: SampledClaims) -> dict[str, Any]:
    """Return the claims of the sampled controllers; those that came later only where they are made."""
    own = vars(claims)
    return {
        "certified": claims.certified,
        "proof": "ball" if claims.certified else "none",
        **{key: own[key] for key in ("period", "delay", "decay", "rho", "max_period", "radius", *RESIDUALS)},
        "rounding": [dict(one) for one in claims.rounding],
        **{key: own[key] for key in LATER if own[key] is not None},
    }


def message_claims_document(claims: MessageClaims) -> dict[str, Any]:
    """Return what is claimed of messages."""
    return {**plain(claims.messages), "decay": claims.decay, "rho": claims.rho}


def initial_set_document(claimed: InitialSet) -> dict[str, Any]:
    """Return what is claimed of initial states; a side without a limit is None."""
    figures: dict[str, Any] = {"level": claimed.level, "radius": claimed.radius, "energy": claimed.energy}
    if claimed.half_axes is not None:
        figures["half_axes"] = list(claimed.half_axes)
    return {"leader": claimed.leader, "inner": _sides(claimed.inner), "box": _sides(claimed.box), **figures}


def _sides(box: Box) -> list[list[float | None]]:
    return [
        [x if math.isfinite(x) else None for x in side] for side in zip(box.lower, box.upper, strict=True)
    ]


def witness_document(witness: Any) -> dict[str, Any]:
    """Return a witness of the sampled loop: its fields by their names."""
    if isinstance(witness, ClippedWitness):
        return {**plain(witness.storage), "tau": plain(witness.tau), "H": plain(witness.h)}
    kind = {"kind": "modal"} if isinstance(witness, SampledModalWitness) else {}
    return {**kind, **plain(witness)}


def proofs_document(proofs: Proofs) -> dict[str, Any]:
    """Return the witnesses."""
    sampled = {
        key: None if (one := getattr(proofs, key)) is None else witness_document(one)
        for key in ("sampled", "sampled_rho", "max_period", "radius")
    }
    names = ("limits_gain", "clipped", "messages", "messages_rho", "fixed", "sampled_decay")
    later = {key: witness_document(one) for key in names if (one := getattr(proofs, key)) is not None}
    return {
        "certificate": None if proofs.certificate is None else certificate_document(proofs.certificate),
        "decay": None if proofs.decay is None else _with_rho(proofs.decay),
        **({} if proofs.initial_set is None else {"initial_set": _with_rho(proofs.initial_set)}),
        "floor": None if proofs.floor is None else floor_document(proofs.floor),
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


def floor_document(witness: FloorWitness) -> dict[str, Any] | list[Any]:
    """Return the witness of a floor as plain JSON types, as `floor_witness_of` reads it."""
    pieces = [
        {
            "upper": piece.upper if math.isfinite(piece.upper) else None,
            "Z": [piece.Z[i, : i + 1].tolist() for i in range(len(piece.Z))],
            "Z_dual": [piece.Z_dual[i, : i + 1].tolist() for i in range(len(piece.Z_dual))],
            "k": piece.k.tolist(),
        }
        for piece in witness.pieces
    ]
    return pieces if witness.slopes is None else {"slopes": list(witness.slopes), "pieces": pieces}
