"""What a design file claims of its controllers in integers, and the witnesses of that."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from lockstep.check.json_text import above_zero, each, or_none, readers_of, record, whole
from lockstep.check.sampled.inequality import Witness

Positive = Annotated[float, above_zero]
PositiveOrNone = Annotated[float | None, or_none(above_zero)]
_EXPONENTS = partial(each, read=whole(-60, 60))


@dataclass(frozen=True)
class FixedClaims:
    """What is claimed of the controllers in integers while none of them meets the limits of its range.

    decay, residual_per_message_error: as of the sampled loop;  residual_from_rounding: what remains of the disagreement
    because of the rounding of each step, an ultimate distance;  rho, rho_rounding: what is weighed, integrated up to a
    sample at t, is at most V_0 + rho^2 times the disturbance's energy up to t + rho_rounding^2 t (smaller is better for all
    of these);  radius: from disagreements up to it, controllers at rest and undisturbed, no integer meets its limit (larger
    is better);  outputs, inputs, states: exponents e, a count being worth 2^-e, the states' by agent.
    """

    decay: Positive
    residual_per_message_error: Positive
    residual_from_rounding: Positive
    rho: PositiveOrNone
    rho_rounding: PositiveOrNone
    radius: PositiveOrNone
    outputs: Annotated[tuple[int, ...], _EXPONENTS]
    inputs: Annotated[tuple[int, ...], _EXPONENTS]
    states: Annotated[tuple[tuple[int, ...], ...], partial(each, read=_EXPONENTS, name="agent")]


@dataclass(frozen=True, eq=False)
class FixedWitness:
    """What proves the claims: of agreement and both residuals, of rho, of the radius."""

    agreement: Witness
    rho: Witness | None
    radius: Witness | None


def fixed_claims_of(value: Any, where: str) -> FixedClaims:
    """Read `claims.fixed`."""
    return FixedClaims(*record(value, where, readers_of(FixedClaims)))
