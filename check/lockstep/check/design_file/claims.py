"""`claims` of a design file: everything that the file says is proved, each number of it to be checked.

What a number claims is given beside it. "Better" is what a larger claim would be: a checker accepts a claim that is no
better than what it proves itself.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

from lockstep.check.bound.box import Box
from lockstep.check.bound.result import Entry
from lockstep.check.continuous.local import InitialSet
from lockstep.check.design_file.fixed import FixedClaims, fixed_claims_of
from lockstep.check.design_file.json_text import (
    above_zero,
    each,
    item,
    not_negative,
    number,
    one_of,
    only,
    optional,
    part,
    position,
    record,
)
from lockstep.check.design_file.messages import MessageClaims, message_claims_of
from lockstep.check.errors import ProblemError

LETTERS = ("A", "B", "C", "D")

SURE = 1 - 5e-10
"""What is proved of residuals is rounded up by 1e-9 of itself, of which its few operations need 1e-14: a file from another
machine may be below it by half of that."""

LATER = ("limits_gain", "clipped_radius")
"""Claims of the sampled controllers that files from before do not have."""

Scope = Literal["global", "local"]
Scales = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class SampledClaims:
    """What is claimed of the controllers sampled and rounded; None where nothing is.

    period: they agree when stepped so often, in s;  delay: periods until u acts;  decay: V shrinks by it from sample to
    sample (smaller is better);  rho: the disturbance gain (smaller is better);  residual, residual_rms, underflow: what
    remains of the disagreement (smaller is better);  rounding: per agent and letter, the gain error that stands for every
    rounding of a step (smaller is better);  max_period: the same gains, sampled anew, agree at it too (larger is better);
    radius: from disagreements up to it, controllers at rest, no input meets its limit (larger is better);  limits_gain: none
    does under a disturbance from agreement, of energy limits_gain^2 (larger is better);  clipped_radius: from disagreements
    up to it the loop converges with its inputs clipped (larger is better).
    """

    certified: bool = False
    period: float | None = None
    delay: int | None = None
    decay: float | None = None
    rho: float | None = None
    residual: float | None = None
    residual_rms: float | None = None
    underflow: float | None = None
    rounding: tuple[Mapping[str, float], ...] = ()
    max_period: float | None = None
    radius: float | None = None
    limits_gain: float | None = None
    clipped_radius: float | None = None

    def __post_init__(self) -> None:
        numbers = [
            self.period,
            self.delay,
            self.decay,
            self.rho,
            self.radius,
            self.limits_gain,
            self.clipped_radius,
        ]
        numbers += self._residuals().values()
        if not self.certified and (self.rounding or any(one is not None for one in numbers)):
            raise ProblemError(
                "numbers are claimed of controllers that are not claimed to be certified",
                where="claims, sampled",
                expected="`max_period` alone beside `certified` = false",
            )

    @property
    def proof(self) -> Literal["ball", "none"]:
        """How it is proved."""
        return "ball" if self.certified else "none"

    def _residuals(self) -> dict[str, float | None]:
        return {
            "residual_per_message_error": self.residual,
            "residual_rms_per_message_error": self.residual_rms,
            "residual_from_underflow": self.underflow,
        }

    def document(self) -> dict[str, Any]:
        """Return the claims as plain JSON types; those that came later only where they are made."""
        later = {key: getattr(self, key) for key in LATER if getattr(self, key) is not None}
        return {
            "certified": self.certified,
            "proof": self.proof,
            "period": self.period,
            "delay": self.delay,
            "decay": self.decay,
            "rho": self.rho,
            "max_period": self.max_period,
            "radius": self.radius,
            **self._residuals(),
            "rounding": [dict(one) for one in self.rounding],
            **later,
        }

    def better_than(self, proved: "SampledClaims") -> Iterator[str]:
        """Yield in words each claim that is better than what is proved; nothing where all of them are proved."""
        if self.certified and not proved.certified:
            yield "the file claims the sampled controllers certified, but they are not"
            return
        mine, theirs = self.document(), proved.document()
        for key in ("period", "delay"):
            if mine[key] is not None and mine[key] != theirs[key]:
                yield _unproved(key, mine[key], theirs[key])
        for key, room in (("decay", 1.0), ("rho", 1.0), *((key, SURE) for key in self._residuals())):
            if mine[key] is not None and (theirs[key] is None or not mine[key] >= room * theirs[key]):
                yield _unproved(key, mine[key], theirs[key])
        if self.max_period is not None and self.max_period > (proved.max_period or 0.0):
            yield _unproved("max_period", self.max_period, proved.max_period)
        if self.rounding and len(self.rounding) != len(proved.rounding):
            yield f"the file claims `rounding` of {len(self.rounding)} agents, not of {len(proved.rounding)}"
            return
        for i, (one, own) in enumerate(zip(self.rounding, proved.rounding, strict=False), start=1):
            for letter in LETTERS:
                if not one[letter] >= own[letter]:
                    yield _unproved(f"rounding of {letter} of agent {i}", one[letter], own[letter])


def _unproved(name: str, claimed: float, proved: float | None) -> str:
    found = "none" if proved is None else f"{proved:.10g}"
    return f"the file claims {name} = {claimed:.10g} of the sampled loop, but {found} is proved"


@dataclass(frozen=True)
class Claims:
    """What a design file claims.

    certified: whether its gains have a certificate;  rho: the disturbance gain that it proves (smaller is better);  alpha:
    for every phi with this incremental bound (larger is better);  fragility: delta by letter, for every gain error up to it
    (larger is better);  scope: for every state ("global", better) or while the agents stay in their domain;  scales: D_w and
    D_v that alpha is a bound in, where they are not all one;  entries: bounds of single slopes that are used besides;
    initial_set: states from which the agents stay in their domain;  floor: no controllers can certify less (larger is
    better);  decay: sigma in 1/s, by which e^(-sigma t) bounds every disagreement up to a constant (larger is better);
    controllers_stable: whether each controller is stable by itself, as designed and as it ships;  sampled: of the
    controllers that ship;  messages: of these where the network loses or delays messages;  fixed: of those in integers.
    """

    certified: bool
    rho: float | None
    alpha: float
    fragility: Mapping[str, float]
    scope: Scope | None = None
    scales: Scales | None = None
    entries: tuple[Entry, ...] = ()
    initial_set: InitialSet | None = None
    floor: float | None = None
    decay: float | None = None
    controllers_stable: bool = False
    sampled: SampledClaims = field(default_factory=SampledClaims)
    messages: MessageClaims | None = None
    fixed: FixedClaims | None = None

    def __post_init__(self) -> None:
        if not self.certified and any((self.rho, self.scope, self.initial_set, self.decay)):
            raise ProblemError(
                "`rho`, `scope`, `initial_set` or `decay` is claimed without a certificate",
                where="claims",
                expected="null beside `certified` = false",
            )
        if self.certified and self.rho is None:
            raise ProblemError("None", where="claims, `rho`", expected="a finite number")

    @property
    def proof(self) -> Literal["exact", "none"]:
        """How it is proved."""
        return "exact" if self.certified else "none"

    def document(self) -> dict[str, Any]:
        """Return the claims as plain JSON types; components, arguments and agents are counted from 1."""
        return {
            "certified": self.certified,
            "proof": self.proof,
            "rho": self.rho,
            "alpha": self.alpha,
            "fragility": dict(self.fragility),
            "scope": self.scope,
            "scales": None
            if self.scales is None
            else {key: list(d) for key, d in zip("GH", self.scales, strict=True)},
            "entries": [
                {"component": one.component + 1, "argument": one.argument + 1, "bound": one.bound}
                for one in self.entries
            ],
            "initial_set": None if self.initial_set is None else self.initial_set.claim(),
            "floor": self.floor,
            "decay": self.decay,
            "controllers_stable": self.controllers_stable,
            "sampled": self.sampled.document(),
            **({} if self.messages is None else {"messages": self.messages.document()}),
            **({} if self.fixed is None else {"fixed": self.fixed.document()}),
        }


def claims_of(content: Any) -> Claims:
    """Read `claims`.

    Raises:
        ProblemError: a key missing or unknown, or a value that cannot be one of its kind.
    """
    only(content, (*Claims(False, None, 0.0, {}).document(), "messages", "fixed"), "claims")
    certified = part(content, "certified", bool)
    one_of(item(content, "proof", "claims"), ("exact" if certified else "none",), "claims, `proof`")
    fragility = part(content, "fragility", dict)
    only(fragility, LETTERS, "claims, fragility")
    return Claims(
        certified,
        optional(content, "rho", above_zero),
        not_negative(content.get("alpha"), "claims, `alpha`"),
        {letter: not_negative(fragility.get(letter), f"claims, fragility `{letter}`") for letter in LETTERS},
        optional(content, "scope", lambda value, where: one_of(value, ("global", "local"), where)),
        optional(content, "scales", _scales),
        optional(content, "entries", partial(each, read=_entry)) or (),
        optional(content, "initial_set", _initial_set),
        optional(content, "floor", above_zero),
        optional(content, "decay", above_zero),
        part({"controllers_stable": False, **content}, "controllers_stable", bool),
        optional(content, "sampled", _sampled) or SampledClaims(),
        optional(content, "messages", message_claims_of),
        optional(content, "fixed", fixed_claims_of),
    )


def _scales(value: Any, where: str) -> Scales:
    G, H = record(value, where, dict.fromkeys("GH", partial(each, read=above_zero)))
    return G, H


def _entry(value: Any, where: str) -> Entry:
    readers = {"component": position, "argument": position, "bound": not_negative}
    return Entry(*record(value, where, readers))


def _initial_set(value: Any, where: str) -> InitialSet:
    figures = dict.fromkeys(("level", "radius", "energy"), above_zero)
    readers = {"leader": position, "box": _box, "inner": _box, **figures}
    leader, *others = record(value, where, readers)
    return InitialSet(leader + 1, *others)


def _box(value: Any, where: str) -> Box:
    if not isinstance(value, list) or any(not isinstance(side, list) or len(side) != 2 for side in value):
        raise ProblemError("it is missing or has another shape", where=where, expected="rows of two numbers")
    lower = tuple(-math.inf if low is None else number(low, where) for low, _ in value)
    upper = tuple(math.inf if high is None else number(high, where) for _, high in value)
    return Box(lower, upper)


def _sampled(value: Any, where: str) -> SampledClaims:
    certified = item(value, "certified", where)
    only(value, (*SampledClaims().document(), *LATER), where)
    if not isinstance(certified, bool):
        raise ProblemError(
            f"`certified` is a {type(certified).__name__}", where=where, expected="true or false"
        )
    one_of(value.get("proof"), ("ball" if certified else "none",), f"{where}, `proof`")
    delay = optional(value, "delay", lambda given, place: one_of(given, (0, 1), place), where)
    rounding = optional(value, "rounding", partial(each, read=_deltas, name="agent"), where) or ()
    numbers = {
        key: optional(value, name, not_negative, where)
        for key, name in (
            ("decay", "decay"),
            ("residual", "residual_per_message_error"),
            ("residual_rms", "residual_rms_per_message_error"),
            ("underflow", "residual_from_underflow"),
        )
    }
    lengths = {
        key: optional(value, key, above_zero, where)
        for key in ("period", "rho", "max_period", "radius", *LATER)
    }
    return SampledClaims(certified, delay=delay, rounding=rounding, **numbers, **lengths)


def _deltas(value: Any, where: str) -> dict[str, float]:
    return dict(zip(LETTERS, record(value, where, dict.fromkeys(LETTERS, not_negative)), strict=True))
