"""The largest floor that can be proved: bisection in rho, and at each rho pieces that cover all mu.

A dual point is sought in doubles by `program` and accepted by the exact decision of `witness` alone, so that what comes out
is proved, and what is missed is missed on the low side. For one mu the problem is convex, without a gap: where no point is
found for a single mu, that rho is given up. Where an interval of mu has none, it is cut where mu stands in the way.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from flint import fmpq
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.floor.projected import FloorAgent, Projected, side
from lockstep.check.floor.witness import FloorWitness, Piece, exact_agent, excludes, of_piece
from lockstep.check.numbers import as_floats, zeros
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork
from lockstep.lmi.analysis.decimals import round_down, significant
from lockstep.lmi.floor.program import FloorProgram, FloorSolution, Scales, largest_margin

STEP = 4.0
"""By how much rho is lowered or raised until it is between one that is proved and one that is not."""

MOST_STEPS = 10
"""Lower than so many steps below a certified rho, or below a first guess, a floor says nothing; so high, it says all."""

TOLERANCE = 2e-3
"""How near to each other the rho that is proved and the one that is not are brought, relative to them."""

DIGITS = (5, 7, 9, 12, 17)
"""Significant decimals that a witness is stored with: the first that prove it."""

SOLVED = 1e-9
"""The margin of a point may fall short of 0 by this, which the solver leaves open, and is still decided exactly."""

SWEEPS, HIGHER = 2, 1.01
"""How often the slopes of all entries are tried at both ends, and by what part a floor has to rise for new slopes."""

INSIDE = 1 - 2.0**-20
"""|J| is kept below alpha by so much, which the exact decision asks for strictly."""

TURNS = 3
"""How often a point is sought, each time in the scales of the one before."""

MOST_TRIED = 60
"""Intervals tried at one rho; near the least rho a piece is as narrow as the root of the distance from it."""

NEAR_AN_END = 0.15
"""An interval is cut no nearer to an end than this part of its length in logarithms."""

FIRST_CUT = 10.0
"""An interval to 0 or to infinity is cut at least this factor from its other end."""


def largest_floor(
    network: ExactNetwork, claim: Claim, *, certified: float | None = None
) -> FloorWitness | None:
    """Return the largest rho for which it is proved that no controllers certify less; None where no proof is found.

    With entries, phi is one linear function of slopes within their bounds, so chosen that the floor is high.

    Args:
        network: the agents as the checker reads them (`exact_network`): near the least rho the nearest doubles of A are
            agents of another one. Of the graph only that it has a spanning tree is used.
        claim: alpha, the entries, and what rho is a gain to and from.
        certified: a rho that is certified, above which there is nothing to look for.
    """
    slopes = (0.0,) * len(claim.entries)
    found = _of_slopes(network, claim, slopes, certified)
    for c, sign in SWEEPS * [(c, sign) for c in range(len(slopes)) for sign in (1.0, -1.0)]:
        J = _with_entry(claim, slopes, c, sign)
        agent = None if slopes == J else exact_agent(network, claim, J)
        if agent is None or (found and _Cover(agent, HIGHER * found.rho).pieces() is None):
            continue
        if higher := _of_slopes(network, claim, J, certified):
            found, slopes = higher, J
    return found


def _with_entry(claim: Claim, slopes: tuple[float, ...], c: int, sign: float) -> tuple[float, ...]:
    """Return slopes with the entry c at an end of its bounds; all of them less where |J| would not be below alpha."""
    places = [(one.component, one.argument) for one in claim.entries]
    J = np.zeros(1 + np.max(places, axis=0))
    for i, place in enumerate(places):
        J[place] = sign * claim.entries[c].bound if i == c else slopes[i]
    J *= min(1.0, INSIDE * claim.alpha / max(float(np.linalg.norm(J, 2)), 1e-300))
    return tuple(float(J[place]) for place in places)


def _of_slopes(
    network: ExactNetwork, claim: Claim, slopes: tuple[float, ...], certified: float | None
) -> FloorWitness | None:
    agent = exact_agent(network, claim, slopes)
    if agent is None:
        return None
    proved: dict[float, tuple[Piece, ...]] = {}

    def is_proved(rho: float) -> bool:
        pieces = _Cover(agent, rho).pieces()
        if pieces is not None:
            proved[rho] = pieces
        return pieces is not None

    low, high = _bracket(is_proved, certified, _guess(network, claim.R))
    if low is None:
        return None
    while high is not None and high / low > 1 + TOLERANCE:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_proved(middle) else (low, middle)
    short = round_down(low)
    rho = short if short in proved or is_proved(short) else low
    return _shortened(agent, FloorWitness(rho, proved[rho], slopes))


def proves_that_none_carries(network: ExactNetwork, claim: Claim) -> bool:
    """Tell whether a proof is found that no controllers certify a claim without entries, with whatever rho and weights.

    Such a proof needs phi to reach, and to be reached from, all that the controllers cannot move: else none is found here.
    """
    agent = exact_agent(network, claim, ())
    if agent is None or not agent.plant.G.shape[1]:
        return False
    stated = without_rho(agent.plant, agent.alpha)
    return _point(FloorProgram(stated), stated, 1.0, 1.0)[1]


def without_rho(plant: Plant, alpha: fmpq) -> Projected:
    """Return the two sides without disturbance and weight: what a certificate with any rho and any R satisfies.

    They are homogeneous in (P_d, mu) and in (P_*, 1/mu), so that mu = 1 stands for all mu.
    """
    n = len(plant.A)
    B, H = np.hstack(plant.B), alpha * plant.H
    nothing, border = zeros(n, n, plant.A), (zeros(n, 0, plant.A), zeros(0, 0, plant.A))
    primal = side(plant.A, plant.C, nothing, H.T @ H, border, plant.G)
    return Projected(primal, side(plant.A.T, B.T, nothing, plant.G @ plant.G.T, border, H.T))


def _guess(network: ExactNetwork, R: Float[np.ndarray, "n n"]) -> float:
    """Return what rho is of the size of: that of x' = -|A| x + xi."""
    fastest = float(np.abs(np.linalg.eigvals(as_floats(network.plant.A))).max())
    return math.sqrt(float(np.linalg.norm(R, 2))) / (fastest or 1.0)


def _bracket(
    is_proved: Callable[[float], bool], certified: float | None, guess: float
) -> tuple[float | None, float | None]:
    """Return a rho that is proved and one that is not, at most `STEP` apart, each None where there is none in reach."""
    high, rho = certified, guess if certified is None else certified / STEP
    low: float | None = None
    for _ in range(MOST_STEPS):
        if is_proved(rho):
            low = rho
        else:
            high = rho
        if low is not None and high is not None:
            break
        rho = rho * STEP if high is None else rho / STEP
    return low, high


@dataclass
class _Cover:
    """The pieces for one rho, and the programs they come from."""

    agent: FloorAgent
    rho: float
    tried: int = 0
    programs: dict[tuple[bool, bool], tuple[Projected, FloorProgram]] = field(default_factory=dict)

    def pieces(self) -> tuple[Piece, ...] | None:
        """Return proved pieces that cover all mu > 0, or None where some mu stands in the way."""
        return self._between(0.0, math.inf)

    def _between(self, lower: float, upper: float) -> tuple[Piece, ...] | None:
        self.tried += 1
        if self.tried > MOST_TRIED:
            return None
        found, proved = self._point(lower, upper)
        if found is None or proved:
            return None if found is None else (found.piece,)
        mu = cut_point(lower, upper, found.mu)
        if not lower < mu < upper or not self._point(mu, mu)[1]:
            return None
        left = self._between(lower, mu)
        right = None if left is None else self._between(mu, upper)
        return None if left is None or right is None else (*left, *right)

    def _point(self, lower: float, upper: float) -> tuple[FloorSolution | None, bool]:
        key = lower == 0, math.isinf(upper)
        if key not in self.programs:
            stated = of_piece(self.agent, self.rho, lower, upper)
            self.programs[key] = stated, FloorProgram(stated)
        stated, program = self.programs[key]
        return _point(program, stated, lower, upper)


def _point(
    program: FloorProgram, stated: Projected, lower: float, upper: float
) -> tuple[FloorSolution | None, bool]:
    """Return the dual point of the last turn, and whether it is proved; None where there is nothing to find."""
    scales, found = Scales.ones(stated), None
    for _ in range(TURNS if program.count else 0):
        turn = largest_margin(program, scales, lower, upper)
        if turn is None:
            break
        if turn.t > -SOLVED and excludes(stated, turn.piece, lower):
            return turn, True
        found, scales = turn, turn.scales
    return found, False


def cut_point(lower: float, upper: float, mu: float) -> float:
    """Return where to cut [lower, upper], near mu, which may be none.

    >>> cuts = (0.0, math.inf, 2.0), (1.0, math.inf, 2.0), (0.0, 1.0, 0.05), (1.0, 100.0, math.nan)
    >>> tuple(cut_point(*one) for one in cuts)
    (2.0, 10.0, 0.05, 10.0)
    """
    known = math.isfinite(mu) and mu > 0
    if lower == 0:
        if math.isinf(upper):
            return mu if known else 1.0
        return min(mu, upper / FIRST_CUT) if known else upper / FIRST_CUT
    if math.isinf(upper):
        return max(mu, lower * FIRST_CUT) if known else lower * FIRST_CUT
    part = math.log(mu / lower) / math.log(upper / lower) if known else 0.5
    return float(lower * (upper / lower) ** min(max(part, NEAR_AN_END), 1 - NEAR_AN_END))


def _shortened(agent: FloorAgent, witness: FloorWitness) -> FloorWitness:
    """Return the witness in the fewest of `DIGITS`, piece by piece."""
    ends = [0.0, *(piece.upper for piece in witness.pieces)]
    pieces = []
    for lower, piece in zip(ends, witness.pieces, strict=False):
        stated = of_piece(agent, witness.rho, lower, piece.upper)
        shorter = (rounded_piece(piece, digits) for digits in DIGITS)
        pieces.append(next((one for one in shorter if excludes(stated, one, lower)), piece))
    return replace(witness, pieces=tuple(pieces))


def rounded_piece(piece: Piece, digits: int) -> Piece:
    """Return a piece whose numbers have so many significant decimals."""
    return Piece(piece.upper, *(significant(M, digits) for M in (piece.Z, piece.Z_dual, piece.k)))
