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

With |x_d|^2 = sum_i |x_i - mean|^2 = x_d' ((T T')^-1 (x) I) x_d, all |x_d| <= radius are in the set if c / radius^2 (T T')^-1
(x) I - P_d > 0, P_d being P on x_d; with half-axes a, each in the unit of its state, and diag(a)^-2 in the place of I /
radius^2, the ellipsoid sum_i sum_k ((x_ik - mean_k) / a_k)^2 <= 1 is. Everything is decided in rationals; the largest figures
are looked for elsewhere. The certificate itself is taken as decided (`decide`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, Vector, as_fraction, exactly
from lockstep.check.psd import decide_positive_definite
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.network import ExactNetwork


@dataclass(frozen=True)
class Domain:
    """Where a bound was proved: H (v, n), not scaled, the box of v = H x of every agent, and the names of x."""

    H: Annotated[np.ndarray, "v n"]
    box: Box
    states: Sequence[str] = ()


@dataclass(frozen=True)
class InitialSet:
    """If the leader stays in the inner box, all agents stay in the box and agree from V(x_d, x_C)(0) <= level.

    leader: the only root, counted from 1, its controller at rest;  box, inner: for v = H x of every agent, and of the
    leader;  level: c;  radius: |x_d(0)| <= radius is inside the set if all controllers start at rest, where |x_d|^2 =
    sum_i |x_i - mean|^2;  energy: of xi_d, that agents in agreement can take;  half_axes: of an ellipsoid inside the set as
    well, in the unit of each state.
    """

    leader: int
    box: Box
    inner: Box
    level: float
    radius: float
    energy: float
    half_axes: tuple[float, ...] | None = None


def better_than_proved(
    network: ExactNetwork, certificate: Certificate | ModalCertificate, domain: Domain, claimed: InitialSet
) -> str | None:
    """Say what a claimed set has that is not proved; None where all of it is.

    Raises:
        ProblemError: as `largest_level`.
    """
    if (reason := unavailable(network, certificate, domain.box)) or isinstance(certificate, ModalCertificate):
        return reason
    if claimed.leader != network.graph.roots[0]:
        return f"agent {network.graph.roots[0]} leads, not {claimed.leader}"
    if not contains(claimed.box, domain.box):
        return f"the agents are shown to stay in {box_text(domain.box)}, not in {box_text(claimed.box)}"
    c, _, _ = largest_level(network, certificate, domain, claimed.inner)
    for name, most in (("level", c), ("energy", c / Fraction(certificate.rho) ** 2)):
        if Fraction(own := getattr(claimed, name)) > most:
            return f"the {name} is {own:.10g}, which is more than is proved"
    if not holds_ball(network, certificate, c, claimed.radius):
        return f"the radius is {claimed.radius:.10g}, which is more than is proved"
    if claimed.half_axes is not None and not holds_ball(network, certificate, c, claimed.half_axes):
        return f"the half-axes are {claimed.half_axes}, which is more than is proved"
    return None


def holds_ball(
    network: ExactNetwork, certificate: Certificate, c: Fraction, radii: float | Sequence[float]
) -> bool:
    """Decide whether x_d' P x_d <= c wherever sum_i sum_k ((x_ik - mean_k) / a_k)^2 <= 1, a the radius or its n half-axes."""
    P = on_disagreement(network, certificate)
    if np.shape(radii) not in ((), (len(network.plant.A),)):
        return False
    a, ratio = exactly(np.resize(radii, len(P))), fmpq(c.numerator, c.denominator)
    return decide_positive_definite(ratio * squared_distance(network) / np.outer(a, a) - P).positive


def unavailable(network: ExactNetwork, certificate: Certificate | ModalCertificate, box: Box) -> str | None:
    """Say why there is no such set; None where there may be one."""
    roots = network.graph.roots
    if box == Box.everywhere(box.size):
        return "the domain has no sides: a bound on it holds everywhere, and every state will do"
    if len(roots) != 1:
        return (
            f"agents {', '.join(map(str, roots[:8]))} hear each other, and what they do together, which their disagreement "
            "drives, is in no certificate; with a single leader it is"
        )
    modal = isinstance(certificate, ModalCertificate)
    return "a modal certificate has no one P for the whole network" if modal else None


def largest_level(
    network: ExactNetwork, certificate: Certificate, domain: Domain, inner: Box
) -> tuple[Fraction, int, int]:
    """Return c, and which agent would be the first to reach a side of which v_j, both from 0.

    Raises:
        ProblemError: an inner box that is not inside the box on every side, or a P that does not fit the network.
    """
    order = _order(network, certificate.P)
    found = rows_within(network, order, domain, inner)
    P_0 = at_rest(exactly(certificate.P), network, order)
    spread = _squares(P_0, [w for *_, w in found])
    return min((d * d / q, i, j) for (i, j, d, _), q in zip(found, spread, strict=True) if q)


def rows_within(
    network: ExactNetwork, order: int, domain: Domain, inner: Box
) -> list[tuple[int, int, Fraction, Vector]]:
    """Return (i, j, d_j, w_ij) for each agent behind the leader and each side it keeps to, both from 0.

    Raises:
        ProblemError: an inner box that is not inside the box on every side.
    """
    margins, root = _margins(domain.box, inner), network.graph.roots[0] - 1
    return [
        (i, j, d, at_rest(_row(network, order, root, i, domain.H[j]), network, order))
        for i in range(network.N)
        for j, d in enumerate(margins)
        if i != root and d is not None
    ]


def on_disagreement(network: ExactNetwork, certificate: Certificate) -> Matrix:
    """Return P on x_d, in rationals."""
    n_d = len(network.plant.A) * (network.N - 1)
    return exactly(certificate.P[:n_d, :n_d])


def contains(outer: Box, inner: Box) -> bool:
    """Tell whether one box holds another."""
    if outer.size != inner.size:
        return False
    low = all(a <= b for a, b in zip(outer.lower, inner.lower, strict=True))
    return low and all(a >= b for a, b in zip(outer.upper, inner.upper, strict=True))


def _margins(box: Box, inner: Box) -> list[Fraction | None]:
    """Return d_j, by how much the inner box is inside on its nearer side, None where there is no side to keep to."""
    said = f"the inner box has {inner.size} components"
    demand(inner.size == box.size, said, "the inner box", f"{box.size}, one per row of H")
    found: list[Fraction | None] = []
    for j, (low, high, a, b) in enumerate(zip(box.lower, box.upper, inner.lower, inner.upper, strict=True)):
        inside = (a > low or not math.isfinite(low)) and (b < high or not math.isfinite(high))
        where = f"the inner box, component {j + 1}"
        wanted = f"an interval inside [{low:g}, {high:g}], away from its ends"
        demand(inside, f"[{a:g}, {b:g}]", where, wanted)
        sides = [Fraction(a) - Fraction(low)] if math.isfinite(low) else []
        sides += [Fraction(high) - Fraction(b)] if math.isfinite(high) else []
        found.append(min(sides, default=None))
    return found


def _order(network: ExactNetwork, P: Annotated[np.ndarray, "n_x n_x"]) -> int:
    """Return n_C from the size n (N - 1) + n_C N of P."""
    n = len(network.plant.A)
    rest = P.shape[0] - n * (network.N - 1)
    fits, wanted = rest >= 0 and rest % network.N == 0, f"{n} (N - 1) + n_C N, N = {network.N}"
    demand(fits, f"P has {P.shape[0]} rows", "the certificate", wanted)
    return int(rest // network.N)


def _row(network: ExactNetwork, order: int, root: int, i: int, h: Vector) -> Vector:
    """Return w with w' x_cl = h (x_i - x_root), in rationals: x_i - x_root = ((right_i - right_root) (x) I) x_d."""
    d = disagreement(network.graph, network.coordinates, exact_arithmetic=True)
    w = np.kron(d.right[i] - d.right[root], exactly(h))
    return np.concatenate([w, exactly(np.zeros(order * network.N))])


def at_rest(
    array: Annotated[np.ndarray, "..."], network: ExactNetwork, order: int
) -> Annotated[np.ndarray, "..."]:
    """Leave the root's controller out of a vector or matrix over x_cl."""
    start = len(network.plant.A) * (network.N - 1) + (network.graph.roots[0] - 1) * order
    keep = [k for k in range(array.shape[0]) if not start <= k < start + order]
    return array[np.ix_(*[keep] * array.ndim)]


def _squares(P: Matrix, rows: Sequence[Vector]) -> list[Fraction]:
    """Return w' P^-1 w for each row w, exactly."""
    given = fmpq_mat(np.column_stack(rows).tolist())
    solved = fmpq_mat(P.tolist()).solve(given)
    return [
        as_fraction(sum((given[k, c] * solved[k, c] for k in range(given.nrows())), start=fmpq(0)))
        for c in range(given.ncols())
    ]


def squared_distance(network: ExactNetwork) -> Matrix:
    """Return (T T')^-1 (x) I, with x_d' ((T T')^-1 (x) I) x_d = sum_i |x_i - mean|^2, in rationals."""
    d = disagreement(network.graph, network.coordinates, exact_arithmetic=True)
    return d.squared_distance(len(network.plant.A))


def axes_text(
    half_axes: Sequence[float], states: Sequence[str], units: Mapping[str, str] | None = None
) -> str:
    """Return an ellipsoid of disagreements, x_i - mean of all x_j, with each half-axis, its unit, and its state.

    >>> axes_text((80.0, 0.06), ("x", "v"), {"x": "m"})
    'sum over agents and states of ((x - mean)/a)^2 <= 1, a = 80 m (x), 0.06 (v)'
    """
    known = {name: f" {unit}" for name, unit in (units or {}).items() if unit != "1"}
    sizes = (f"{a:g}{known.get(name, '')} ({name})" for a, name in zip(half_axes, states, strict=True))
    return f"sum over agents and states of ((x - mean)/a)^2 <= 1, a = {', '.join(sizes)}"


def box_text(box: Box) -> str:
    """Return a box as inequalities in v1, v2, ..."""
    return ", ".join(
        f"{low:.4g} <= v{k} <= {high:.4g}"
        for k, (low, high) in enumerate(zip(box.lower, box.upper, strict=True), start=1)
    )
