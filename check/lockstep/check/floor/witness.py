"""The proof of a floor: points of the dual cone that no certificate can get around, decided exactly.

Let Z > 0, Z_* > 0 be of the sizes of the two sides of `projected`, k any matrix of the size of C_perp'B_perp, and

    rows flow Z e = 0,  k_11 = He(kernel^+ flow Z e),     likewise k_22 of the dual side,     Z_c = [k_11 k; k' k_22] > 0.

Then the terms in P_d and P_* of <Z, primal> + <Z_*, dual> - <Z_c, [C_perp'P_d C_perp, C_perp'B_perp; *, B_perp'P_* B_perp]>
cancel, and what is left is

    g(mu) = c_0 + c_1 mu + c_2 / mu,     c_0 = <Z, constant> + <Z_*, constant_*> - 2 <k, C_perp'B_perp>,
    c_1 = <Z, slope>,  c_2 = <Z_*, slope_*>.

A certificate with this mu would make the first two terms negative and the third not positive: so wherever g(mu) >= 0 there
is none. Pieces that cover all mu > 0 prove that there is none at this rho, nor at a smaller one, whose F is larger.

The numbers of a file are doubles, which satisfy rows flow Z e = 0 only nearly: the nearest symmetric Z that satisfies it
exactly is taken, in rationals. Nothing rests on how the numbers were found.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.continuous.decide import decide_weights
from lockstep.check.continuous.inequality import Claim, Performance
from lockstep.check.floor.projected import FloorAgent, Projected, Side, left_inverse, with_rho
from lockstep.check.numbers import Matrix, exact, exactly, eye, zeros
from lockstep.check.psd import decide_positive_definite
from lockstep.check.system.network import ExactNetwork


@dataclass(frozen=True)
class Piece:
    """A dual point for all mu / rho from the end of the piece before it up to `upper`, which may be infinite.

    Z: (size, size) of the primal side;  Z_dual: of the dual side;  k: (k_C, k_B).
    """

    upper: float
    Z: Annotated[np.ndarray, "a a"]
    Z_dual: Annotated[np.ndarray, "b b"]
    k: Annotated[np.ndarray, "c d"]


@dataclass(frozen=True)
class FloorWitness:
    """What proves that no certificate has a rho below `rho`.

    slopes: J of `projected`, one for each entry of the claim; None where the noise and the weights of the inputs are left
    out, as in files that were written before they counted.
    """

    rho: float
    pieces: tuple[Piece, ...]
    slopes: tuple[float, ...] | None = None


def proves_floor(network: ExactNetwork, claim: Claim, witness: FloorWitness) -> bool:
    """Decide exactly whether a witness proves that no controllers can certify a rho of this claim below its own."""
    if not decide_weights(claim).positive:
        return False
    ends = [piece.upper for piece in witness.pieces]
    if not witness.rho > 0 or not ends or ends != sorted(set(ends)) or ends[0] <= 0 or np.isfinite(ends[-1]):
        return False
    agent = exact_agent(network, claim, witness.slopes)
    if agent is None:
        return False
    lower = 0.0
    for piece in witness.pieces:
        stated = of_piece(agent, witness.rho, lower, piece.upper)
        if not excludes(stated, piece, lower):
            return False
        lower = piece.upper
    return True


def exact_agent(network: ExactNetwork, claim: Claim, slopes: tuple[float, ...] | None) -> FloorAgent | None:
    """Return the agent whose floor is one of the claim, phi being J v for given slopes; None where there is none.

    slopes: as of `FloorWitness`.
    """
    plant, alpha, performance = network.plant.in_numbers(True), exact(claim.alpha), claim.performance
    if slopes is None:
        if not performance.covers_xi:
            return None
        performance = Performance(performance.R, performance.Q)
    elif network.coordinates != "orthonormal":
        performance = performance._replace(W=performance.W[:0, :0])
    if claim.entries:
        J = zeros(plant.G.shape[1], len(plant.H), plant.A)
        given = exactly(np.array(slopes or [0.0] * len(claim.entries)))
        if len(given) != len(claim.entries):
            return None
        for entry, slope in zip(claim.entries, given, strict=True):
            place = entry.component, entry.argument
            if abs(slope) > exact(entry.bound) or place not in np.ndindex(J.shape):
                return None
            J[place] = slope
        if not decide_positive_definite(alpha * alpha * eye(len(J), J) - J @ J.T).positive:
            return None
        plant, alpha = replace(plant, A=plant.A + plant.G @ J @ plant.H), fmpq(0)
    elif slopes:
        return None
    if alpha == 0 or not plant.G.shape[1]:
        plant = replace(plant, G=plant.G[:, :0], H=plant.H[:0])
    return FloorAgent(plant, alpha, performance)


def of_piece(agent: FloorAgent, rho: float, lower: float, upper: float) -> Projected:
    """Return the sides that hold on a piece.

    Where phi acts on a side through its border alone, that border says nothing as mu tends to the end at which its corner
    grows, and any Z > 0 on it would make g negative there: on such a piece it is left out.
    """
    whole = with_rho(agent, exact(rho))
    k, k_dual = whole.primal.k, whole.dual.k
    idle = np.isinf(upper) and not np.any(whole.primal.slope[:k, :k])
    idle_dual = lower == 0 and not np.any(whole.dual.slope[:k_dual, :k_dual])
    less = idle or idle_dual
    return with_rho(agent, exact(rho), primal_phi=not idle, dual_phi=not idle_dual) if less else whole


def excludes(stated: Projected, piece: Piece, lower: float) -> bool:
    """Decide exactly whether no mu from `lower` to the end of the piece is that of a certificate."""
    sides = stated.primal, stated.dual
    points = [exactly(Z) for Z in (piece.Z, piece.Z_dual)]
    if any(
        Z.shape != (side.size, side.size) or (Z != Z.T).any() for Z, side in zip(points, sides, strict=True)
    ):
        return False
    shape = stated.coupling.shape
    if piece.k.size != stated.coupling.size or (piece.k.size and piece.k.shape != shape):
        return False
    if not any(side.size for side in sides):
        return False
    points = [restored(side, Z) for side, Z in zip(sides, points, strict=True)]
    k = exactly(piece.k).reshape(shape)
    both = coupled(sides, points, k)
    if not all(decide_positive_definite(matrix).positive for matrix in (*points, both)):
        return False
    coefficients = bound(stated, points[0], points[1], k)
    return not_negative(coefficients, exact(lower), None if np.isinf(piece.upper) else exact(piece.upper))


def coupled(sides: tuple[Side, Side], points: list[Matrix], k: Matrix) -> Matrix:
    """Return Z_c."""
    corners = []
    for side, Z in zip(sides, points, strict=True):
        half = left_inverse(side.kernel) @ side.flow @ Z[:, : side.k] if side.k else zeros(0, 0, Z)
        corners.append(half + half.T)
    return np.block([[corners[0], k], [k.T, corners[1]]])


def bound(stated: Projected, Z: Matrix, Z_dual: Matrix, k: Matrix) -> tuple[Any, Any, Any]:
    """Return (c_0, c_1, c_2) of g."""
    primal, dual = stated.primal, stated.dual
    c_0 = _inner(Z, primal.constant) + _inner(Z_dual, dual.constant) - 2 * _inner(k, stated.coupling)
    return c_0, _inner(Z, primal.slope), _inner(Z_dual, dual.slope)


def _inner(a: Matrix, b: Matrix) -> Any:
    """Return <a, b>; 0 where the side says nothing, so that a is empty."""
    return sum((a * b).ravel(), start=fmpq(0)) if a.size else fmpq(0)


def not_negative(coefficients: tuple[Any, Any, Any], lower: Any, upper: Any | None) -> bool:
    """Decide c_0 + c_1 mu + c_2 / mu >= 0 for all mu > 0 from `lower` to `upper`, or to infinity where that is None.

    It is decided for q(mu) = c_1 mu^2 + c_0 mu + c_2.

    >>> not_negative((fmpq(-2), fmpq(1), fmpq(1)), fmpq(0), None), not_negative((fmpq(-3), fmpq(1), fmpq(1)), fmpq(0), None)
    (True, False)
    """
    c_0, c_1, c_2 = coefficients
    values = [c_1 * end * end + c_0 * end + c_2 for end in (lower, upper) if end is not None]
    if min(values) < 0:
        return False
    if upper is None and (c_1 < 0 or (c_1 == 0 and c_0 < 0)):
        return False
    least_inside = c_1 > 0 and -c_0 > 2 * c_1 * lower and (upper is None or -c_0 < 2 * c_1 * upper)
    return not least_inside or 4 * c_1 * c_2 >= c_0 * c_0


def restored(side: Side, Z: Matrix) -> Matrix:
    """Return the symmetric matrix nearest to Z, entry by entry of a triangle, with rows flow Z e = 0 exactly."""
    size, k, held = side.size, side.k, side.rows @ side.flow
    if not size or not len(held):
        return Z
    where = [(i, j) for i in range(size) for j in range(i + 1)]
    equations = [_equation(held, a, b, where) for a in range(len(held)) for b in range(k)]
    reduced, rank = fmpq_mat(equations).rref()
    if not rank:
        return Z
    kept = fmpq_mat(reduced.tolist()[:rank])
    z = fmpq_mat([[Z[place]] for place in where])
    z -= kept.transpose() * (kept * kept.transpose()).solve(kept * z)
    found = zeros(size, size, Z)
    for (i, j), row in zip(where, z.tolist(), strict=True):
        found[i, j] = found[j, i] = row[0]
    return found


def _equation(held: Matrix, a: int, b: int, where: list[tuple[int, int]]) -> list[Any]:
    """Return the coefficients of (held Z)_ab in the entries of the lower triangle of Z."""
    zero = fmpq(0)
    return [held[a, i] if j == b else held[a, j] if i == b else zero for i, j in where]
