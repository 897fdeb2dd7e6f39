"""`claims` of a design file: everything that the file says is proved, each number of it to be checked.

A field is a key of the file: its annotation names the reader of its value, and what a number claims is given with it.
"Better" is what a larger claim would be: a checker accepts a claim that is no better than what it proves itself.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, TypeVar

from lockstep.check import json_text as read
from lockstep.check.bound.box import Box
from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.continuous.initial_set import InitialSet
from lockstep.check.design_file.fixed_point import FixedClaims, fixed_claims_of
from lockstep.check.design_file.messages import MessageClaims, message_claims_of
from lockstep.check.errors import demand
from lockstep.check.sampled.certificate import SampledVerdict
from lockstep.check.system.domain import Scope

SURE = 1 - 5e-10
"""What is proved of residuals is rounded up by 1e-9 of itself, of which its few operations need 1e-14: a file from another
machine may be below it by half of that."""

RESIDUALS = ("residual_per_message_error", "residual_rms_per_message_error", "residual_from_underflow")

PositiveOrNone = Annotated[float | None, read.or_none(read.above_zero)]
NotNegativeOrNone = Annotated[float | None, read.or_none(read.not_negative)]
Scales = tuple[tuple[float, ...], tuple[float, ...]]
T = TypeVar("T")


def _scales(value: Any, where: str) -> Scales:
    G, H = read.record(value, where, dict.fromkeys("GH", partial(read.each, read=read.above_zero)))
    return G, H


def _box(value: Any, where: str) -> Box:
    sides = read.each(value, where, read.interval, "side")
    return Box(tuple(low for low, _ in sides), tuple(high for _, high in sides))


def _by_letter(value: Any, where: str) -> dict[str, float]:
    found = read.record(value, where, dict.fromkeys(LETTERS, read.not_negative))
    return dict(zip(LETTERS, found, strict=True))


def _with_proof(kind: type[T], proof: str, value: Any, where: str) -> T:
    """Read claims that say, besides their fields, how they are proved: with `proof`, or not where nothing is certified."""
    *found, said = read.record(value, where, {**read.readers_of(kind), "proof": read.among(proof, "none")})
    read.one_of(said, (proof if found[0] else "none",), f"{where}, `proof`")
    return kind(*found)


_ENTRY = read.made(Entry, {"component": read.position, "argument": read.position, "bound": read.not_negative})
_AXES = read.or_none(partial(read.each, read=read.above_zero))
_FIGURES = {**dict.fromkeys(("level", "radius", "energy"), read.above_zero), "half_axes": _AXES}
_INITIAL_SET = read.made(InitialSet, {"leader": read.whole(1), "box": _box, "inner": _box, **_FIGURES})
_ROUNDING = partial(read.each, read=_by_letter, name="agent")


@dataclass(frozen=True)
class SampledClaims:
    """What is claimed of the controllers sampled and rounded; None where nothing is.

    period: they agree when stepped so often, in s;  delay: periods until u acts;  decay: V shrinks by it from sample to
    sample (smaller is better);  rho: the disturbance gain (smaller is better);  residual_...: what remains of the
    disagreement (smaller is better);  rounding: per agent and letter, the gain error that stands for every rounding of a
    step (smaller is better);  max_period: the same gains, sampled anew, agree at it too (larger is better);  radius: from
    disagreements up to it, controllers at rest, no input meets its limit (larger is better);  limits_gain: none does under
    a disturbance from agreement, of energy limits_gain^2 (larger is better);  clipped_radius: from disagreements up to it
    the loop converges with its inputs clipped (larger is better);  half_axes, clipped_half_axes: the same from disagreements
    with sum_i sum_k ((x_ik - mean_k) / a_k)^2 <= 1, a in the unit of each state (larger is better);  fastest_decay: as decay,
    of a V of its own: the one that says most of residuals decays slowly (smaller is better).
    """

    certified: Annotated[bool, read.flag] = False
    period: PositiveOrNone = None
    delay: Annotated[int | None, read.or_none(read.among(0, 1))] = None
    decay: NotNegativeOrNone = None
    rho: PositiveOrNone = None
    residual_per_message_error: NotNegativeOrNone = None
    residual_rms_per_message_error: NotNegativeOrNone = None
    residual_from_underflow: NotNegativeOrNone = None
    rounding: Annotated[tuple[Mapping[str, float], ...], read.or_none(_ROUNDING, ())] = ()
    max_period: PositiveOrNone = None
    radius: PositiveOrNone = None
    limits_gain: PositiveOrNone = None
    clipped_radius: PositiveOrNone = None
    half_axes: Annotated[tuple[float, ...] | None, _AXES] = None
    clipped_half_axes: Annotated[tuple[float, ...] | None, _AXES] = None
    fastest_decay: PositiveOrNone = None

    def __post_init__(self) -> None:
        claimed = [one for key, one in vars(self).items() if key not in ("certified", "max_period")]
        demand(
            self.certified or all(one in (None, ()) for one in claimed),
            "numbers are claimed of controllers that are not claimed to be certified",
            "claims, sampled",
            "`max_period` alone beside `certified` = false",
        )

    def better_than(self, proved: SampledVerdict) -> Iterator[str]:
        """Yield in words each claim that is better than what is proved of one period; all other claims are decided apart."""
        for key in ("period", "delay"):
            if (claimed := getattr(self, key)) not in (None, getattr(proved, key)):
                yield _unproved(key, claimed, getattr(proved, key))
        for key in ("decay", *RESIDUALS):
            claimed, least = getattr(self, key), getattr(proved, key)
            if claimed is not None and not claimed >= (SURE if key in RESIDUALS else 1.0) * least:
                yield _unproved(key, claimed, least)
        if self.rounding and len(self.rounding) != len(proved.deltas):
            yield f"the file claims `rounding` of {len(self.rounding)} agents, not of {len(proved.deltas)}"
            return
        for i, (one, own) in enumerate(zip(self.rounding, proved.deltas, strict=False), start=1):
            for letter in LETTERS:
                if not one[letter] >= own[letter]:
                    yield _unproved(f"rounding of {letter} of agent {i}", one[letter], own[letter])


def _unproved(name: str, claimed: float, proved: float) -> str:
    return f"the file claims {name} = {claimed:.10g} of the sampled loop, but {proved:.10g} is proved"


_SAMPLED = partial(_with_proof, SampledClaims, "ball")


@dataclass(frozen=True)
class Claims:
    """What a design file claims.

    certified: whether its gains have a certificate;  rho: the disturbance gain that it proves (smaller is better);  alpha:
    for every phi with this incremental bound (larger is better);  fragility: delta by letter, for every gain error up to it
    (larger is better);  scope: for every state ("global", better) or while the agents stay in their domain;  scales: D_w and
    D_v that alpha is a bound in, where they are not all one;  entries: bounds of single slopes that are used besides;
    initial_set: states from which the agents stay in their domain;  floor: no controllers can certify less (larger is
    better);  decay: sigma in 1/s, by which e^(-sigma t) bounds every disagreement up to a constant (larger is better);
    controllers_stable: whether each controller is stable by itself, as designed and as it ships (of the coefficients,
    rounding aside);  sampled: of the controllers that ship;  messages: of these where the network loses or delays
    messages;  fixed: of those in integers.
    """

    certified: Annotated[bool, read.flag]
    rho: PositiveOrNone
    alpha: Annotated[float, read.not_negative]
    fragility: Annotated[Mapping[str, float], _by_letter]
    scope: Annotated[Scope | None, read.or_none(read.among("global", "local"))] = None
    scales: Annotated[Scales | None, read.or_none(_scales)] = None
    entries: Annotated[tuple[Entry, ...], read.or_none(partial(read.each, read=_ENTRY), ())] = ()
    initial_set: Annotated[InitialSet | None, read.or_none(_INITIAL_SET)] = None
    floor: PositiveOrNone = None
    decay: PositiveOrNone = None
    controllers_stable: Annotated[bool, read.or_none(read.flag, otherwise=False)] = False
    sampled: Annotated[SampledClaims, read.or_none(_SAMPLED, SampledClaims())] = SampledClaims()
    messages: Annotated[MessageClaims | None, read.or_none(message_claims_of)] = None
    fixed: Annotated[FixedClaims | None, read.or_none(fixed_claims_of)] = None

    def __post_init__(self) -> None:
        bare = not any((self.rho, self.scope, self.initial_set, self.decay))
        found = "`rho`, `scope`, `initial_set` or `decay` is claimed without a certificate"
        demand(self.certified or bare, found, "claims", "null beside `certified` = false")
        demand(not self.certified or self.rho is not None, "None", "claims, `rho`", "a finite number")


def claims_of(content: Any) -> Claims:
    """Read `claims`.

    Raises:
        ProblemError: a key missing or unknown, or a value that cannot be one of its kind.
    """
    return _with_proof(Claims, "exact", content, "claims")
