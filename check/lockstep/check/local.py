"""A certificate on a box: initial disagreements from which every agent provably stays in that box, behind a leader.

Where |phi(a, t) - phi(b, t)| <= alpha |a - b| is proved for a, b in a box only, the certificate speaks of trajectories
along which v_i = H x_i of every agent stays in it. V = x_cl' P x_cl bounds how far agents are apart and not where they
are together, so something else has to keep one of them inside. With a single root that is the root itself: it hears
nobody, r_root = 0, and with its controller at rest it moves by itself, x' = f(x, t), whatever the others do.

**Claim.** Let the certificate hold with alpha on the box. Let agent r be the only root, its controller start at rest, and
v_r(t) stay in an inner box whose side j is at least d_j inside the box. Then from every (x_d, x_C)(0) with V <= c, where

    c = min over agents i != r and arguments j of d_j^2 / (w_ij' P_0^-1 w_ij),       w_ij' x_cl = H_j (x_i - x_r),

P_0 being P without the rows and columns of the root's controller, every agent stays in the box for all t, V falls
exponentially, and all agents agree. With disturbances the same holds, short of the agreement, as long as V(0) + rho^2
times the energy of xi_d stays within c and v_r, now disturbed, stays in the inner box.

**Proof.** Continue phi outside of the box by its value at the nearest point of the box, phi~(v, t) = phi(clip(v), t).
Clipping brings no two components further apart, so phi~ has the bound alpha everywhere, in the scaled norm as well, and
the bounds of its entries, |phi~_k(a) - phi~_k(b)| <= sum_l r_kl |a_l - b_l|, which is all that is used of them. So the
certificate inequality applies at every state of the loop with phi~: V' <= rho^2 |xi_d|^2, and V' < 0 where xi_d = 0 and
x_cl != 0. Its trajectories therefore keep V <= c. The root's controller hears r_root = 0 and stays at rest, errors of
the gains included (they multiply x_C and r), so x_cl lives in the subspace on which V is P_0, and there
|H_j (x_i - x_r)|^2 <= w_ij' P_0^-1 w_ij V <= d_j^2 (Cauchy and Schwarz in the metric P_0). The root stays in the inner
box by assumption (phi~ is phi there, and a Lipschitz equation has one solution), hence every v_i stays in the box. There
phi~ is phi: this trajectory is the one of the loop itself. No continuation in t is needed, and the boundary counts.

Without a single root there is no such set. The roots hear each other, so their common motion is driven by what they
disagree about: the inputs, that do not add up to zero, and the mean of phi(v_i), that is not phi of the mean. A
certificate in x_d says nothing of it.

Everything is decided in rationals and rounded to the safe side. The certificate itself is taken as decided (`decide`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Context
from fractions import Fraction
from typing import Annotated, Any

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.bound.box import Box
from lockstep.check.disagreement import disagreement
from lockstep.check.errors import ProblemError
from lockstep.check.inequality import Certificate
from lockstep.check.modes import ModalCertificate
from lockstep.check.network import ExactNetwork
from lockstep.check.numbers import Matrix, Vector, as_floats, exact, exactly, eye, rounded_down
from lockstep.check.psd import decide_positive_definite


@dataclass(frozen=True)
class Domain:
    """Where a bound was proved, and what of it is left to a leader.

    H: (v, n), not scaled;  box: of v = H x of every agent;  inner: of the leader's;  arguments: what v_1, v_2, ... are, in
    the names of the states.
    """

    H: Annotated[np.ndarray, "v n"]
    box: Box
    inner: Box
    arguments: str = ""


@dataclass(frozen=True)
class Unavailable:
    """No set of initial disagreements can be given, and why."""

    reason: str

    def text(self) -> str:
        """Return what this says to people."""
        return f"no initial states can be given from which the agents stay in their domain: {self.reason}"

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON types."""
        return {"available": False, **self.remarks()}

    def remarks(self) -> dict[str, Any]:
        """Return what people are told of it."""
        return {"text": self.text(), "reason": self.reason}


@dataclass(frozen=True)
class InitialSet:
    """If the leader stays in the inner box, all agents stay in the box and agree from V(x_d, x_C)(0) <= level.

    leader: the only root, counted from 1, its controller at rest;  box, inner: for v = H x of every agent, and of the
    leader;  level: c;  radius: |x_d(0)| <= radius is inside the set if all controllers start at rest, where |x_d|^2 =
    sum_i |x_i - mean|^2;  energy: of xi_d, that agents in agreement can take;  agent, argument: which v_j, from 1, of which
    agent would reach a side first, 0 where it is not known;  arguments: what v_1, v_2, ... are, in the names of the states.
    """

    leader: int
    box: Box
    inner: Box
    level: float
    radius: float
    energy: float
    agent: int = 0
    argument: int = 0
    arguments: str = ""

    def __post_init__(self) -> None:
        if not (0 < self.level < math.inf and 0 < self.radius < math.inf and 0 < self.energy < math.inf):
            raise ValueError(f"a set of level {self.level}, radius {self.radius}, energy {self.energy}")

    def text(self) -> str:
        """Return what this says to people."""
        return (
            f"agent {self.leader} leads. While it stays in {_box_text(self.inner)} ({self.arguments}), every agent stays "
            f"in its domain, and all agree, from |x_d(0)| <= {_below(self.radius)} with all controllers at rest "
            f"(|x_d|^2 = sum |x_i - mean|^2), or from V(0) <= {_below(self.level)} with the leader's at rest"
        )

    def claim(self) -> dict[str, Any]:
        """Return what is claimed, as plain JSON types; a side without a limit is None."""
        return {
            "leader": self.leader,
            "inner": _sides(self.inner),
            "box": _sides(self.box),
            "level": self.level,
            "radius": self.radius,
            "energy": self.energy,
        }

    def document(self) -> dict[str, Any]:
        """Return it with what people are told of it."""
        return {"available": True, **self.remarks(), **self.claim()}

    def remarks(self) -> dict[str, Any]:
        """Return what people are told of it, beyond the claim."""
        first = {"first": {"agent": self.agent, "argument": self.argument}} if self.agent else {}
        return {"text": self.text(), "arguments": self.arguments, **first}


def initial_set(
    network: ExactNetwork, certificate: Certificate | ModalCertificate, domain: Domain
) -> InitialSet | Unavailable:
    """Return the largest set V <= c of initial disagreements from which the agents stay in their domain.

    Args:
        network: the agents and the graph.
        certificate: decided for the bound that was proved on the domain.
        domain: the box, and the part of it that the leader is to stay in.

    Raises:
        ProblemError: an inner box that is not inside the box on every side, or a P that does not fit the network.
    """
    graph = network.graph
    if domain.box == Box.everywhere(domain.box.size):
        return Unavailable("the domain has no sides: a bound on it holds everywhere, and every state will do")
    if len(graph.roots) != 1:
        return Unavailable(
            f"agents {', '.join(map(str, graph.roots[:8]))} hear each other, so none of them moves by itself: their common "
            "motion follows from their disagreement, and the certificate does not bound it; a single leader would do"
        )
    if isinstance(certificate, ModalCertificate):
        return Unavailable("a modal certificate has no one P for the whole network")
    return _largest(network, certificate, domain, _margins(domain.box, domain.inner))


def better_than_proved(
    network: ExactNetwork, certificate: Certificate | ModalCertificate, domain: Domain, claimed: InitialSet
) -> str | None:
    """Say what a claimed set has that is not proved; None where all of it is.

    Everything is decided in rationals for the inner box of the claim: no eigenvalue in doubles has a say.
    """
    proved = initial_set(network, certificate, replace(domain, inner=claimed.inner))
    if isinstance(proved, Unavailable) or isinstance(certificate, ModalCertificate):
        return proved.text()
    if claimed.leader != proved.leader:
        return f"agent {proved.leader} leads, not {claimed.leader}"
    if not _contains(claimed.box, proved.box):
        return f"the agents are shown to stay in {_box_text(proved.box)}, not in {_box_text(claimed.box)}"
    for name in ("level", "energy"):
        own, found = getattr(claimed, name), getattr(proved, name)
        if own > found:
            return f"the {name} is {own:.10g}, but {found:.10g} is proved"
    if claimed.radius > proved.radius:
        n_d = len(network.plant.A) * (network.N - 1)
        ratio = Fraction(proved.level) / Fraction(claimed.radius) ** 2
        excess = fmpq(ratio.numerator, ratio.denominator) * _squared_distance(network)
        if not decide_positive_definite(excess - exactly(certificate.P[:n_d, :n_d])).positive:
            return f"the radius is {claimed.radius:.10g}, but {proved.radius:.10g} is proved"
    return None


def _contains(outer: Box, inner: Box) -> bool:
    if outer.size != inner.size:
        return False
    low = all(a <= b for a, b in zip(outer.lower, inner.lower, strict=True))
    return low and all(a >= b for a, b in zip(outer.upper, inner.upper, strict=True))


def _largest(
    network: ExactNetwork, certificate: Certificate, domain: Domain, margins: Sequence[Fraction | None]
) -> InitialSet | Unavailable:
    root = network.graph.roots[0] - 1
    order = _order(network, certificate.P)
    P = exactly(certificate.P)
    places = [(i, j) for i in range(network.N) for j, d in enumerate(margins) if i != root and d is not None]
    rows = [_row(network, order, root, i, domain.H[j]) for i, j in places]
    spread = _squares(_at_rest(P, network, order, root), [_at_rest(w, network, order, root) for w in rows])
    levels = [
        (margin * margin / q, i, j)
        for (i, j), q in zip(places, spread, strict=True)
        if (margin := margins[j]) is not None and q
    ]
    c, i, j = min(levels)
    level, n_d = rounded_down(c), len(network.plant.A) * (network.N - 1)
    radius = _radius(network, P[:n_d, :n_d], level)
    energy = rounded_down(Fraction(level) / Fraction(certificate.rho) ** 2)
    if not all(0 < figure < math.inf for figure in (level, radius, energy)):
        return Unavailable("its figures are beyond the range of doubles")
    return InitialSet(
        root + 1, domain.box, domain.inner, level, radius, energy, i + 1, j + 1, domain.arguments
    )


def _margins(box: Box, inner: Box) -> list[Fraction | None]:
    """Return d_j, by how much the inner box is inside on its nearer side, None where there is no side to keep to."""
    if inner.size != box.size:
        raise ProblemError(
            f"the inner box has {inner.size} components",
            where="the inner box",
            expected=f"{box.size}, one per row of H",
        )
    found: list[Fraction | None] = []
    for j, (low, high, a, b) in enumerate(zip(box.lower, box.upper, inner.lower, inner.upper, strict=True)):
        if (math.isfinite(low) and not a > low) or (math.isfinite(high) and not b < high):
            raise ProblemError(
                f"[{a:g}, {b:g}]",
                where=f"the inner box, component {j + 1}",
                expected=f"an interval inside [{low:g}, {high:g}], away from its ends",
            )
        sides = [Fraction(a) - Fraction(low)] if math.isfinite(low) else []
        sides += [Fraction(high) - Fraction(b)] if math.isfinite(high) else []
        found.append(min(sides, default=None))
    return found


def _order(network: ExactNetwork, P: Annotated[np.ndarray, "n_x n_x"]) -> int:
    """Return n_C from the size n (N - 1) + n_C N of P."""
    n = len(network.plant.A)
    rest = P.shape[0] - n * (network.N - 1)
    if rest < 0 or rest % network.N:
        raise ProblemError(
            f"P has {P.shape[0]} rows",
            where="the certificate",
            expected=f"{n} (N - 1) + n_C N, N = {network.N}",
        )
    return int(rest // network.N)


def _row(network: ExactNetwork, order: int, root: int, i: int, h: Vector) -> Vector:
    """Return w with w' x_cl = h (x_i - x_root), in rationals: x_i - x_root = ((right_i - right_root) (x) I) x_d."""
    d = disagreement(network.graph, network.coordinates, exact_arithmetic=True)
    w = np.kron(d.right[i] - d.right[root], exactly(h))
    return np.concatenate([w, exactly(np.zeros(order * network.N))])


def _at_rest(
    array: Annotated[np.ndarray, "..."], network: ExactNetwork, order: int, root: int
) -> Annotated[np.ndarray, "..."]:
    """Leave the root's controller out of a vector or matrix over x_cl."""
    start = len(network.plant.A) * (network.N - 1) + root * order
    keep = [k for k in range(array.shape[0]) if not start <= k < start + order]
    return array[np.ix_(*[keep] * array.ndim)]


def _squares(P: Matrix, rows: Sequence[Vector]) -> list[Fraction]:
    """Return w' P^-1 w for each row w, exactly."""
    W = fmpq_mat(np.column_stack(rows).tolist())
    X = fmpq_mat(P.tolist()).solve(W)
    return [
        _fraction(sum((W[k, c] * X[k, c] for k in range(W.nrows())), start=fmpq(0))) for c in range(W.ncols())
    ]


def _radius(network: ExactNetwork, P: Matrix, level: float) -> float:
    """Return r with x_d' P x_d <= level for every sum_i |x_i - mean|^2 <= r^2: level / r^2 is above the largest ratio."""
    return _root_below(Fraction(level) / _ratio_above(P, _squared_distance(network)))


def _squared_distance(network: ExactNetwork) -> Matrix:
    """Return D with x_d' D x_d = sum_i |x_i - mean|^2."""
    right = disagreement(network.graph, network.coordinates, exact_arithmetic=True).right
    centred = right - right.sum(axis=0) / network.N
    return np.kron(centred.T @ centred, eye(len(network.plant.A), right))


def _ratio_above(P: Matrix, D: Matrix) -> Fraction:
    """Return a number k with z' P z <= k z' D z for all z, P > 0 and D > 0: close to the least, and proved.

    Doubles propose it and the rationals decide; each step asks for ten times more room. The trace of D^-1 P, the sum of
    all ratios, is no less than the largest and needs no doubles.
    """
    largest = _largest_ratio(as_floats(P), as_floats(D))
    for room in 10.0 ** np.arange(-12, 0):
        ratio = largest * (1.0 + float(room))
        if math.isfinite(ratio) and decide_positive_definite(exact(ratio) * D - P).positive:
            return Fraction(ratio)
    ratios = fmpq_mat(D.tolist()).solve(fmpq_mat(P.tolist()))
    return _fraction(sum((ratios[k, k] for k in range(len(P))), start=fmpq(0)))


def _largest_ratio(P: Annotated[np.ndarray, "n n"], D: Annotated[np.ndarray, "n n"]) -> float:
    try:
        factor = np.linalg.inv(np.linalg.cholesky(D))
        return float(np.linalg.eigvalsh(factor @ P @ factor.T)[-1])
    except np.linalg.LinAlgError:
        return math.nan


def _root_below(square: Fraction) -> float:
    """Return a double whose square is at most that: the square root, rounded down."""
    r = math.sqrt(rounded_down(square))
    while Fraction(r) * Fraction(r) > square:
        r = math.nextafter(r, 0.0)
    return r


def _fraction(value: Any) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def _below(value: float) -> str:
    """Return a number to four digits, not above itself."""
    return f"{float(Context(prec=4, rounding=ROUND_FLOOR).create_decimal_from_float(value)):.4g}"


def _box_text(box: Box) -> str:
    return ", ".join(
        f"{low:.4g} <= v{k} <= {high:.4g}"
        for k, (low, high) in enumerate(zip(box.lower, box.upper, strict=True), start=1)
    )


def _sides(box: Box) -> list[list[float | None]]:
    return [
        [x if math.isfinite(x) else None for x in side] for side in zip(box.lower, box.upper, strict=True)
    ]
