"""What a design file claims of its controllers in integers, and the witnesses of that."""

from dataclasses import dataclass
from functools import partial
from typing import Any

from lockstep.check.json_text import above_zero, each, or_none, record, whole
from lockstep.check.sampled.inequality import Witness

NUMBERS = ("decay", "residual_per_message_error", "residual_from_rounding")
LATER = ("rho", "rho_rounding", "radius")


@dataclass(frozen=True)
class FixedClaims:
    """What is claimed of the controllers in integers while none of them meets the limits of its range.

    decay, residual_per_message_error: as of the sampled loop;  residual_from_rounding: what remains of the disagreement
    because of the rounding of each step, an ultimate distance;  rho, rho_rounding: what is weighed, integrated up to a
    sample at t, is at most V_0 + rho^2 times the disturbance's energy up to t + rho_rounding^2 t (smaller is better for all
    of these);  radius: from disagreements up to it, controllers at rest and undisturbed, no integer meets its limit (larger
    is better);  outputs, inputs, states: exponents e, a count being worth 2^-e, the states' by agent.
    """

    decay: float
    residual_per_message_error: float
    residual_from_rounding: float
    rho: float | None
    rho_rounding: float | None
    radius: float | None
    outputs: tuple[int, ...]
    inputs: tuple[int, ...]
    states: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class FixedWitness:
    """What proves the claims: of agreement and both residuals, of rho, of the radius."""

    agreement: Witness
    rho: Witness | None
    radius: Witness | None


def fixed_claims_of(value: Any, where: str) -> FixedClaims:
    """Read `claims.fixed`."""
    row = partial(each, read=whole(-60, 60))
    formats = {"outputs": row, "inputs": row, "states": partial(each, read=row, name="agent")}
    numbers = dict.fromkeys(NUMBERS, above_zero) | dict.fromkeys(LATER, or_none(above_zero))
    return FixedClaims(*record(value, where, {**numbers, **formats}))
