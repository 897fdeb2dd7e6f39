"""From a solver's numbers to a certificate in short decimals that is decided exactly.

A certificate is a witness: any P, m, t that prove the inequality will do, so the shortest decimals that still
prove it are taken. They are doubles, and the proof is about those doubles.
"""

from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.decide import decide
from lockstep.check.continuous.inequality import Certificate, Claim, F_matrix
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains, Loop
from lockstep.lmi.analysis.certificate_sdp import MOST_OF_GIVEN, eliminates_P, least_rho, tight_certificate
from lockstep.lmi.analysis.decimals import round_up, rounded_storage, significant
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.analysis.unit_scaling import Units, scaled
from lockstep.lmi.shapes import GainBlocks, GainLimit
from lockstep.model.network import Network

SLACKS = (5e-4, 2e-3, 1e-2, 2e-2, 5e-2)
"""How far above the least rho the certificate is taken, so that rounding fits: 0.05 % first, more only if
need be."""

GAIN_DIGITS = 6
"""Significant decimals of designed gains: people read them, and a certificate is found for them as rounded."""

NO_GAIN = 1e-12
"""The part of the largest gain of all below which an entry is a rounding error of the search."""

ALIKE = 1e-4
"""Between the gains of two agents, relative to each entry: on a ring of four a search ends 5e-6 apart."""

ROOM_FOR_ROUNDING = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1)
"""What is taken off a gain limit before rounding, the first that suffices: an entry moves by up to 5e-6 of the largest
one, a norm by as much times the root of the number of entries."""

NORM_ERROR = 1e-12
"""Relative error of a norm in doubles, generously: the checker decides the limit exactly."""

FEWEST_DIGITS, MOST_DIGITS = 3, 15


def rounded(certificate: Certificate, digits: int) -> Certificate:
    """Round P to `digits` decimals relative to its largest entry, and m and t to as many significant ones."""
    weights = (significant(one, digits) for one in (certificate.m, certificate.t, certificate.m_entries))
    return Certificate(certificate.rho, rounded_storage(certificate.P, digits), *weights)


def short_gains(K: GainBlocks, gain_limit: GainLimit) -> GainBlocks:
    """Round each gain to so many significant decimals, staying within the limit of each block.

    Those that a search leaves next to equal are those of the first agent: what equal controllers do sums up to nothing.
    Entry by entry: B_C and C_C of a controller whose A_C is fast may be a thousandth of it, and decide as much.
    """
    size = np.abs(K / gain_limit)
    kept = np.where(size > NO_GAIN * size.max(), K, 0.0)
    short = np.stack([_short_block(block, gain_limit) for block in kept])
    return np.repeat(short[:1], len(K), axis=0) if np.allclose(short, short[0], ALIKE, 0.0) else short


def _short_block(K: Float[np.ndarray, "k l"], limit: GainLimit) -> Float[np.ndarray, "k l"]:
    """Round one agent's gains; where rounding takes them beyond the limit, they are made smaller first."""
    for part in ROOM_FOR_ROUNDING:
        short = significant(limited(K[None], (1 - part) * limit)[0], GAIN_DIGITS)
        if np.linalg.norm(short / limit, 2) <= 1 - NORM_ERROR:
            return np.asarray(short)
    return np.zeros_like(K)


def prove(
    network: Network, gains: Gains, claim: Claim, *, rho: float | None = None, near: Certificate | None = None
) -> Certificate:
    """Find a certificate for given gains and prove it exactly.

    Args:
        network: the agents and their graph.
        gains: the controllers, taken as they are.
        claim: alpha, R, Q, delta.
        rho: the rho to certify; by default the least one found, rounded up with a little slack.
        near: of gains next to these, in the units of the file, for a loop that the solver has trouble with.

    Raises:
        NotCertified: no certificate was found; the figures say how near the search came.
    """
    loop, exact_loop = network.loop(gains.order), network.loop(gains.order, exact_arithmetic=True)
    K = gains.blocks
    found = [
        (one, replace(c, rho=c.rho * one.units.rho))
        for one in _in_all_units(loop, claim, near)
        if (c := least_rho(one.loop, K, one.claim, one.near, most=one.most)) is not None
    ]
    if not found:
        raise NotCertified(
            f"no certificate was found for these gains at alpha = {claim.alpha:.6g}",
            alpha=claim.alpha,
            abscissa=float(np.linalg.eigvals(loop.A_cl(K)).real.max()),
        )
    slacks = SLACKS if rho is None else (0.0,)
    # The solver may stop far above the least rho in some units, so the levels are tried from the least on.
    levels: list[tuple[float, _Asked | None, Certificate]] = [
        (rho or round_up(least.rho * (1 + slack)), one, least) for slack in slacks for one, least in found
    ]
    # What a search came with is inside already; that of gains before they were rounded, so a little above its rho.
    levels += [] if near is None else [(rho or round_up(near.rho * (1 + s)), None, near) for s in slacks]
    for level, one, least in sorted(levels, key=itemgetter(0)):
        here = replace(least, rho=level)
        if one is not None:
            candidate = tight_certificate(
                one.loop, K, one.claim, level / one.units.rho, least, one.near, most=one.most
            )
            if candidate is None:
                continue
            here = replace(one.units.certificate(candidate), rho=level)
        proved = shortest_that_proves(loop, exact_loop, K, claim, here)
        if proved is not None:
            return proved
    reached = min(least.rho for _, least in found)
    raise NotCertified(
        f"the solver's candidate at rho = {reached:.6g} did not survive the exact check",
        rho=reached,
        alpha=claim.alpha,
    )


def may_be_proved(network: Network, gains: Gains, claim: Claim, *, quick: bool = False) -> bool:
    """Tell whether a certificate with any rho is found in some units that `prove` looks in; quick: with P eliminated."""
    loop, K = network.loop(gains.order), gains.blocks
    return any(
        least_rho(one.loop, K, one.claim, any_rho=True, most=one.most) is not None
        for one in _in_all_units(loop, claim, None)[-1 if quick else 0 :]
    )


class _Asked(NamedTuple):
    """What the solver is asked, and the units it is in."""

    loop: Loop
    claim: Claim
    units: Units
    near: Certificate | None = None
    most: int = MOST_OF_GIVEN


def _in_all_units(loop: Loop, claim: Claim, near: Certificate | None) -> list[_Asked]:
    """Return the problem as it is, in units in which its numbers are near one, and in those of a point near one known; and
    in the second once more, P eliminated.

    The solver's accuracy decides which serves: the first for numbers that were near one already, the second for time
    constants of hours, the third for poles far apart. Powers of two bring its answer back exactly. In units that do not
    serve, its rho may be far off, so each is tried at its own. Where P is eliminated anyway, one suffices.
    """
    ones = np.ones((loop.U[0].shape[1], loop.Y[0].shape[0]))
    plain = Units(ones, np.ones(loop.n_x), 1.0, 1.0, 1.0, 1.0)
    asked = [_Asked(loop, claim, plain), _Asked(*scaled(loop, claim))]
    if near is not None:
        asked.append(asked[1]._replace(near=asked[1].units.scaled(near)))
    return asked[-1:] if eliminates_P(loop, MOST_OF_GIVEN) else [*asked, asked[1]._replace(most=0)]


def shortest_that_proves(
    loop: Loop, exact_loop: Loop, K: GainBlocks, claim: Claim, candidate: Certificate
) -> Certificate | None:
    """Return the candidate rounded to the fewest digits with which it proves the inequality, or None."""
    short = [rounded(candidate, digits) for digits in range(FEWEST_DIGITS, MOST_DIGITS + 1)]
    # Units of the states may be so far apart that the decimals of the largest entry of P leave nothing of the others.
    for trial in (*short, replace(short[-1], P=significant(candidate.P, MOST_DIGITS))):
        passes_in_doubles = _definite(trial.P) and _definite(-F_matrix(loop, K, claim, trial))
        if passes_in_doubles and decide(exact_loop, K, claim, trial).positive:
            return trial
    return None


def _definite(matrix: Float[np.ndarray, "n n"]) -> bool:
    """Tell in doubles whether a matrix is positive definite, with its diagonal scaled to one, whatever its units."""
    diagonal = np.diag(matrix)
    if (diagonal <= 0).any() or not np.isfinite(matrix).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(scale[:, None] * (matrix + matrix.T) / 2 * scale)[0] > 0)
