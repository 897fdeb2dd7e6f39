"""The certificate in figures: each with its name, its value, how it is known, and what it says."""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context

from lockstep.report.facts import Facts

EXACT = "proved, exact rational arithmetic"
BALL = "proved, ball arithmetic"
DOUBLES = "computed in doubles, not proved"
GIVEN = "asked for"


@dataclass(frozen=True)
class Term:
    """A figure of the certificate."""

    name: str
    value: str
    known: str
    meaning: str


def terms_of(facts: Facts) -> list[Term]:
    """Return the figures in the order in which they are worth reading."""
    return [*_continuous(facts), *_sampled(facts), *_gains(facts)]


def up(value: float, digits: int) -> str:
    """Return an upper bound in so many digits, rounded up: rounded down it would claim more than is proved.

    >>> up(1137429.5, 2), up(3.449, 4), up(3.44901, 4)
    ('1.2e+06', '3.449', '3.45')
    """
    return f"{float(Context(prec=digits, rounding=ROUND_CEILING).create_decimal(repr(value))):.{digits}g}"


def _continuous(facts: Facts) -> Iterator[Term]:
    content, bound = facts.content, facts.checks.bound
    yield Term(
        "ρ",
        up(content["rho"], 6),
        EXACT,
        "gain from the disagreement of the disturbances to the weighted disagreement of the states, continuous"
        " controllers",
    )
    if content.get("floor") is not None:
        yield Term(
            "floor of ρ",
            f"{content['floor']:.10g}",
            EXACT,
            "no controllers of any order, however connected, can certify less in this form of certificate",
        )
    linear = facts.problem.agent().lure.is_linear
    reached = f"a slope of {bound.lower:.6g} is reached"
    yield Term(
        "α",
        f"{content['alpha']:.9g}",
        "proved, interval arithmetic" if not linear else "by the form of the equations",
        f"incremental bound of the nonlinearity; {'the agents here are linear' if linear else reached}",
    )
    for one in content.get("entries", ()):
        yield Term(
            f"r of φ{one['component']} by v{one['argument']}",
            f"{one['bound']:.9g}",
            "proved, interval arithmetic",
            "bound of this slope of the nonlinearity, in the scales of G and H",
        )
    for letter, delta in content["fragility"].items():
        if delta:
            yield Term(
                f"δ of {letter}",
                f"{delta:g}",
                EXACT,
                f"{letter} of each continuous controller may be off by this, as a spectral norm",
            )
    if not any(content["fragility"].values()):
        yield Term("δ", "0", GIVEN, "the continuous gains are taken exactly as they stand")


def _sampled(facts: Facts) -> Iterator[Term]:
    sampled = facts.content["sampled"]
    how = {"ball": BALL, "exact": EXACT}.get(sampled.get("proof", ""), DOUBLES)
    if sampled.get("rho"):
        yield Term(
            "ρ, sampled",
            up(sampled["rho"], 6),
            how,
            "the same gain of the loop with the controllers that ship",
        )
    if not sampled["certified"]:
        yield Term("sampled loop", "not certified", "no proof", str(sampled.get("reason") or "not looked at"))
        return
    yield Term(
        "period",
        f"{sampled['period']:g} s",
        how,
        "stepped so often, the loop agrees, between the samples too",
    )
    if sampled.get("max_period"):
        yield Term("longest period", f"{sampled['max_period']:g} s", how, "the same gains, sampled anew")
    yield Term(
        "decay",
        up(sampled["decay"], 6),
        how,
        "of the Lyapunov function from one sample to the next, up to the noise of rounded messages",
    )
    largest = {letter: max(one[letter] for one in sampled["rounding"]) for letter in "ABCD"}
    yield Term(
        "rounding",
        ", ".join(f"{letter} {up(value, 2)}" for letter, value in largest.items()),
        how,
        "every rounding of a step, as an error of the gains that the proof allows",
    )
    for key, name in (
        ("residual_per_message_error", "residue"),
        ("residual_rms_per_message_error", "residue, rms"),
    ):
        yield Term(
            name,
            f"{up(sampled[key], 2)} e",
            how,
            "distance from agreement at the sampling instants that may remain if messages are off by up to e; not tight",
        )


def _gains(facts: Facts) -> Iterator[Term]:
    figures = facts.content["figures"]
    norms = figures["gain_norms"]
    limit = facts.problem.design.gain_limit
    said = ", ".join(f"{norm:.4g}" for norm in norms[:12]) + (", ..." if len(norms) > 12 else "")
    yield Term(
        "gain norms", said, DOUBLES, f"spectral norm of each [A B; C D]; the limit asked for is {limit:g}"
    )
    yield Term(
        "slowest pole", f"{figures['abscissa']:.4g} 1/s", DOUBLES, "real part, linear part of the loop"
    )
