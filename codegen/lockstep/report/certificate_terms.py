"""The certificate in figures: each with its name, its value, how it is known, and what it says."""

from collections.abc import Iterator
from dataclasses import dataclass

from lockstep.lmi.analysis.decimals import above
from lockstep.lmi.document import sampled_answer
from lockstep.lmi.initial_set import sampled_rate
from lockstep.model.bound_search import slopes_of
from lockstep.report.report_data import Facts

EXACT = "proved, exact rational arithmetic"
BALL = "proved, ball arithmetic"
DOUBLES = "computed in doubles, not proved"
GIVEN = "asked for"


@dataclass(frozen=True)
class DatasheetTerm:
    """A figure of the certificate."""

    name: str
    value: str
    known: str
    meaning: str


def terms_of(facts: Facts) -> list[DatasheetTerm]:
    """Return the figures in the order in which they are worth reading."""
    return [*_continuous(facts), *_sampled(facts), *_gains(facts)]


def _continuous(facts: Facts) -> Iterator[DatasheetTerm]:
    claims, bound = facts.stored.claims, facts.checks.bound
    yield DatasheetTerm(
        "ρ",
        "none" if claims.rho is None else above(claims.rho, 6),
        EXACT,
        "gain from the disagreement of the disturbances to what is weighed: disagreement of the states, states of the"
        " controllers, inputs; continuous controllers",
    )
    if claims.floor is not None:
        yield DatasheetTerm(
            "lower bound of ρ",
            f"{claims.floor:.10g}",
            EXACT,
            "no controllers of any order, however connected, can certify less in this form of certificate",
        )
    linear = facts.problem.agent().lure.is_linear
    reached = f"a slope of {bound.lower:.6g} is reached"
    yield DatasheetTerm(
        "α",
        f"{claims.alpha:.9g}",
        "proved, interval arithmetic" if not linear else "by the form of the equations",
        f"incremental bound of the nonlinearity; {'the agents here are linear' if linear else reached}",
    )
    slopes = slopes_of(claims.entries, claims.scales)
    for one, slope in zip(claims.entries, slopes, strict=True):
        yield DatasheetTerm(
            f"|∂φ{one.component + 1}/∂v{one.argument + 1}|",
            above(slope, 9),
            "proved, interval arithmetic",
            "bound of this slope of the nonlinearity, in the units of the file",
        )
    for letter, delta in claims.fragility.items():
        if delta:
            yield DatasheetTerm(
                f"δ of {letter}",
                f"{delta:g}",
                EXACT,
                f"uncertainty of {letter} of each continuous controller, a spectral norm",
            )
    if not any(claims.fragility.values()):
        yield DatasheetTerm("δ", "0", GIVEN, "the continuous gains are taken exactly as they stand")


def _sampled(facts: Facts) -> Iterator[DatasheetTerm]:
    sampled = facts.stored.claims.sampled
    if sampled.rho is not None:
        yield DatasheetTerm(
            "ρ, sampled",
            above(sampled.rho, 6),
            BALL,
            "the same gain of the loop with the controllers that ship",
        )
    if sampled.period is None or sampled.decay is None:
        reason = sampled_answer(facts.stored).get("reason")
        yield DatasheetTerm("sampled loop", "not certified", "no proof", str(reason or "not looked at"))
        return
    yield DatasheetTerm(
        "period", f"{sampled.period:g} s", BALL, "stepped so often, the loop agrees, between the samples too"
    )
    if sampled.max_period is not None:
        yield DatasheetTerm(
            "longest period", f"{sampled.max_period:g} s", BALL, "the same gains, discretised for it"
        )
    if rate := sampled_rate(sampled.period, sampled.decay, sampled.fastest_decay):
        said = "every disagreement shrinks so at least in the long run, of the loop with the controllers that ship"
        yield DatasheetTerm("convergence, sampled", f"{rate:g} 1/s", BALL, said)
    yield DatasheetTerm(
        "decay of V",
        above(sampled.decay, 6),
        BALL,
        "from one sample to the next, of the storage function that bounds what rounded messages do; another proves the rate",
    )
    largest = {letter: max(one[letter] for one in sampled.rounding) for letter in "ABCD"}
    yield DatasheetTerm(
        "rounding",
        ", ".join(f"{letter} {above(value, 2)}" for letter, value in largest.items()),
        BALL,
        "every rounding of a step, as an error of the gains that the proof allows",
    )
    for residual, name in (
        (sampled.residual_per_message_error, "ultimate bound"),
        (sampled.residual_rms_per_message_error, "ultimate bound, rms"),
    ):
        if residual is None:
            continue
        yield DatasheetTerm(
            name,
            f"{above(residual, 2)} e",
            BALL,
            "distance from agreement at the sampling instants that may remain if messages are off by up to e; not tight",
        )


def _gains(facts: Facts) -> Iterator[DatasheetTerm]:
    figures = facts.stored.info["figures"]
    asked, norms = facts.problem.design, facts.problem.gain_norms(facts.stored.gains.blocks)
    said = ", ".join(f"{norm:.4g}" for norm in norms[:12]) + (", ..." if len(norms) > 12 else "")
    yield DatasheetTerm(
        "gain norms",
        said,
        DOUBLES,
        f"spectral norm of each [A B; C D]{' in [design.gain_units]' * (asked.gain_units is not None)}; the limit asked for"
        f" is {asked.gain_limit:g}",
    )
    yield DatasheetTerm(
        "slowest pole", f"{figures['abscissa']:.4g} 1/s", DOUBLES, "real part, linear part of the loop"
    )
