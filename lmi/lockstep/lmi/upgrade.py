"""A design file of format 1, in which claims, witnesses and remarks stood side by side, as one of format 2."""

from collections.abc import Mapping
from typing import Any

FORMAT_1 = "lockstep-design/1"

_CLAIMS = ("certified", "proof", "rho", "alpha", "fragility", "scope", "scales", "entries", "floor")
_SAMPLED = ("certified", "proof", "period", "delay", "rho", "max_period")
"""Of the sampled loop, what the checker of that time checked or found again; the other figures become remarks."""

_INITIAL = ("leader", "inner", "box", "level", "radius", "energy")
_DERIVED = ("format", "title", "method", "coordinates", "floor_proof")
"""The format, and what the problem says already, or what `floor` says by being there."""


def upgraded(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a file of format 1 in format 2. Nothing is judged here; whatever is not known is a remark."""
    rest = {key: value for key, value in content.items() if key not in (*_CLAIMS, *_DERIVED)}
    sampled, initial = (_taken(rest, key) for key in ("sampled", "initial_set"))
    certified = content.get("certificate") is not None
    claims: dict[str, Any] = {"certified": certified, "proof": "exact" if certified else "none"}
    claims |= {key: content[key] for key in _CLAIMS if key in content}
    named: tuple[str, ...] = (
        _SAMPLED if sampled.get("certified") is True else ("certified", "proof", "max_period")
    )
    claims["sampled"] = {"proof": "ball" if sampled.get("certified") is True else "none"}
    if sampled.get("max_period_witness") is None:
        named = tuple(
            key for key in named if key != "max_period"
        )  # it was looked for again, and is now a remark
    claims["sampled"] |= {"certified": False} | {key: sampled[key] for key in named if key in sampled}
    if initial.get("available"):
        claims["initial_set"] = {key: initial.get(key) for key in _INITIAL}
    certificate = rest.pop("certificate", None)
    if isinstance(certificate, dict):
        certificate = {key: value for key, value in certificate.items() if key != "pairs"}
    proofs = {"certificate": certificate, "floor": rest.pop("floor_witness", None)}
    proofs |= {"sampled": sampled.get("witness"), "sampled_rho": sampled.get("rho_witness")}
    proofs["max_period"] = sampled.get("max_period_witness")
    kept = {
        "format": "lockstep-design/2",
        "problem": rest.pop("problem", None),
        "gains": rest.pop("gains", None),
    }
    rest["sampled"] = {
        key: value
        for key, value in sampled.items()
        if key not in (*named, "witness", "rho_witness", "max_period_witness")
    }
    rest["initial_set"] = {
        key: value for key, value in initial.items() if key not in (*_INITIAL, "available")
    }
    return {**kept, "claims": claims, "proofs": proofs, "info": rest}


def _taken(content: dict[str, Any], key: str) -> dict[str, Any]:
    found = content.pop(key, None)
    return found if isinstance(found, dict) else {}
