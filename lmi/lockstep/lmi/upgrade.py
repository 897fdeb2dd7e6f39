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
    rest = _without(content, *_CLAIMS, *_DERIVED)
    sampled, initial = (_taken(rest, key) for key in ("sampled", "initial_set"))
    certified = content.get("certificate") is not None
    claims: dict[str, Any] = {"certified": certified, "proof": "exact" if certified else "none"}
    claims |= {key: content[key] for key in _CLAIMS if key in content}
    held = sampled.get("certified") is True
    named: tuple[str, ...] = _SAMPLED if held else ("certified", "proof", "max_period")
    claims["sampled"] = {"proof": "ball" if held else "none"}
    if sampled.get("max_period_witness") is None:  # it was looked for again, and is now a remark
        named = tuple(key for key in named if key != "max_period")
    claims["sampled"] |= {"certified": False} | {key: sampled[key] for key in named if key in sampled}
    if initial.get("available"):
        claims["initial_set"] = {key: initial.get(key) for key in _INITIAL}
    certificate = rest.pop("certificate", None)
    if isinstance(certificate, dict):
        certificate = _without(certificate, "pairs")
    proofs = {"certificate": certificate, "floor": rest.pop("floor_witness", None)}
    proofs |= {"sampled": sampled.get("witness"), "sampled_rho": sampled.get("rho_witness")}
    proofs["max_period"] = sampled.get("max_period_witness")
    kept = {"format": "lockstep-design/2"} | {key: rest.pop(key, None) for key in ("problem", "gains")}
    rest["sampled"] = _without(sampled, *named, "witness", "rho_witness", "max_period_witness")
    rest["initial_set"] = _without(initial, *_INITIAL, "available")
    return {**kept, "claims": claims, "proofs": proofs, "info": rest}


def _without(content: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    return {key: value for key, value in content.items() if key not in keys}


def _taken(content: dict[str, Any], key: str) -> dict[str, Any]:
    found = content.pop(key, None)
    return found if isinstance(found, dict) else {}
