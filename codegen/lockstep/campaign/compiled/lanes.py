"""The arithmetic on lanes: `campaign-lanes.h`."""

import math

from lockstep.campaign.compiled.statements import BY_LANE_1, BY_LANE_2
from lockstep.codegen.emission.rendering import render

LANES = 8
"""Runs side by side: one AVX-512 register, two of AVX2, four of SSE2 or NEON."""


def lanes_header() -> str:
    """The arithmetic on lanes, with the constants of its sine computed, not looked up."""
    import flint

    bits = 33
    previous = flint.ctx.prec
    try:
        flint.ctx.prec = 256
        rest, parts = flint.arb.pi() / 2, []
        for _ in range(2):
            mantissa, exponent = math.frexp(float(rest))
            part = math.ldexp(math.floor(math.ldexp(mantissa, bits)), exponent - bits)
            parts.append(part)
            rest = rest - flint.arb(part)
        parts.append(float(rest))
        two_over_pi = float(2 / flint.arb.pi())
    finally:
        flint.ctx.prec = previous

    def series(start: int, last: int) -> list[str]:
        return [repr((-1) ** (k // 2) / math.factorial(k)) for k in range(start, last + 1, 2)]

    return render(
        "campaign/lanes.h.j2",
        lanes=LANES,
        by_lane_1=BY_LANE_1,
        by_lane_2=BY_LANE_2,
        bits=bits,
        parts=[repr(part) for part in parts],
        two_over_pi=repr(two_over_pi),
        # sin r = r + r q (-1/3! + q/5! - ...), cos r = 1 + q (-1/2! + q/4! - ...), q = r^2
        sine=series(3, 17),
        cosine=series(2, 18),
        limit="1e6",
    )
