"""The largest initial set, by a P of its own, for given gains or with gains that move.

With V scaled so that c = 1, the set of `lockstep.check.continuous.initial_set` is measured by

    radius^-2 = min t,   P_d <= t (T T')^-1 (x) I,   [P_0  w_ij; w_ij'  d_j^2] >= 0,   F(P, K, m, t, rho^2) < 0,

F without R, Q and W: it is homogeneous then, and a multiple of every such P is a certificate with R, Q and W. For given gains
this is a semidefinite program. With dP = P - P_0, dK = K - K_0 from a point (P_0, K_0) inside,

    He(J P flow(K)) = He(J P flow(K_0) + J P_0 U dK Y) + He(J dP U dK Y),    J = [I; 0],  He(a b) <= a a' + b' b,

and, by a Schur complement, a program in (P, K) together holds whatever its answer is: each stride is inside, and the
radius never falls. The leader's controller is at rest, and left out of P_0 and F; a multiple of its own P completes P.
Nothing here is trusted.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.initial_set import Domain, rows_within, squared_distance
from lockstep.check.numbers import as_floats
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import AffineF, solve_sdp
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks, GainLimit, Multipliers
from lockstep.model.network import Network

ROOM = 1e-5
"""By how much F stays below 0, where its diagonal is -1 at the point that a program begins from: for rounding."""

ENERGY = 1e-2
"""The weight of rho^2 / c, the inverse of the energy of a disturbance that the set has room for, beside radius^-2."""

LEAST = 1e-6
"""Multipliers and norms have units of at least this part of the largest."""

SURE = 1e-7
"""By how much it has to stay below 0 in its own coordinates to be worth a proof."""

SIZES = (1.0, 1e-2, 1e2, 1e4, 1e6)
"""Of the P of the leader's controller beside P_0, tried in this order."""

SOLVES = 4
"""At most so many programs for given gains: each is in the units of the answer before."""

WORTHWHILE = 3e-3
"""A radius that grows by less than this part of it is the last."""

STRIDES, FIRST, WIDER, NARROWER, NARROWEST = 60, 2.0, 1.2, 0.5, 0.1
"""At most so many strides; what the length of one is multiplied by after a success and after a failure; the shortest."""


@dataclass(frozen=True)
class SetPoint:
    """Gains and a certificate with c = 1, but for R, Q and W.

    K: (N, k, l);  P: P_0, without the leader's controller;  w: (m, m_entries, t, rho^2);  radius: of the set.
    """

    K: GainBlocks
    P: Float[np.ndarray, "n_0 n_0"]
    w: Multipliers
    radius: float


@dataclass(frozen=True)
class SetProgram:
    """The programs of one loop.

    loop, claim: in the units of the file;  rows: w_ij / d_j;  kept: x_cl without the leader's controller;  D: of |x_d|^2;
     moving: agents whose gains may move;  gain_limit: of each;  rate: that each A_Ci
    is to have by itself, or None.
    """

    loop: Loop
    claim: Claim
    rows: Float[np.ndarray, "places n_0"]
    kept: Int[np.ndarray, " n_0"]
    D: Float[np.ndarray, "n_d n_d"]
    moving: tuple[int, ...] = ()
    gain_limit: GainLimit = np.inf
    rate: float | None = None

    @classmethod
    def of(
        cls,
        network: Network,
        order: int,
        claim: Claim,
        domain: Domain,
        inner: Box,
        *,
        gain_limit: GainLimit = np.inf,
        rate: float | None = None,
    ) -> "SetProgram":
        """Return the programs of a network behind a single leader.

        Raises:
            ProblemError: an inner box that is not inside the domain.
        """
        exact, loop = network.matrices, network.loop(order)
        found = [as_floats(w) / float(d) for _, _, d, w in rows_within(exact, order, domain, inner)]
        start = loop.E.shape[1] + (network.graph.roots[0] - 1) * order
        kept = np.delete(np.arange(loop.n_x), np.arange(start, start + order))
        moving = tuple(i for i, degree in enumerate(network.graph.in_degrees) if degree)
        D = as_floats(squared_distance(exact))
        return cls(loop, claim, np.array(found), kept, D, moving, gain_limit, rate)

    def at(self, K: GainBlocks, certificate: Certificate) -> SetPoint:
        """Return a certificate as a point."""
        form = AffineF(self.loop, K, self.claim)
        w = np.array([*certificate.pair_weights[: form.pairs], *certificate.t, certificate.rho**2])
        return self._of_level_one(SetPoint(K, certificate.P[np.ix_(self.kept, self.kept)], w, 0.0))

    def certificate(self, point: SetPoint) -> Certificate | None:
        """Return the point as a certificate with R, Q and W, a multiple of it; None where none is found."""
        form, n_x = AffineF(self.loop, point.K, self.claim), self.loop.n_x
        left = np.setdiff1d(np.arange(n_x), self.kept)
        try:
            own = _storage(form.Z[np.ix_(left, left)])
        except np.linalg.LinAlgError:
            return None
        for size in SIZES if len(left) else (0.0,):
            P = np.zeros((n_x, n_x))
            P[np.ix_(self.kept, self.kept)] = point.P
            P[np.ix_(left, left)] = size * np.linalg.norm(point.P, 2) * own
            found = _inside(P, point.w, form.Z, form.slopes)
            if found is not None:
                F, T = found
                weight = float(np.linalg.eigvalsh(T @ form.constant @ T.T)[-1])
                multiple = -2 * weight / float(np.linalg.eigvalsh(F)[-1])
                return form.certificate(multiple * P, multiple * point.w)
        return None

    def largest(self, point: SetPoint) -> SetPoint:
        """Return the largest set for the gains of a point."""
        for _ in range(SOLVES):
            found = self.solved(point, None)
            if found is None or found.radius <= (1 + 1e-9) * point.radius:
                break
            gained, point = found.radius / point.radius - 1, found
            if gained < WORTHWHILE:
                break
        return point

    def enlarged(
        self, point: SetPoint, allowed: Callable[[SetPoint], bool], deadline: Deadline = NEVER
    ) -> SetPoint:
        """Return a larger set, by moving the gains as long as they are allowed.

        Args:
            point: where to begin.
            allowed: whether gains will do in every other respect.
            deadline: when to end.
        """
        point, length = self.largest(point), FIRST
        for _ in range(STRIDES):
            if deadline.over or length < NARROWEST:
                break
            found = self.solved(point, length)
            new = None if found is None else self.solved(found, None) or found
            if new is not None and new.radius > (1 + WORTHWHILE) * point.radius and allowed(new):
                point, length = new, WIDER * length
            else:
                length *= NARROWER
        return point

    def solved(self, point: SetPoint, length: float | None) -> SetPoint | None:
        """Return the answer of one program from a point; with a length, its gains move, the further the larger it is."""
        import cvxpy as cp

        form, n_0, n_d = AffineF(self.loop, point.K, self.claim), len(self.kept), len(self.D)
        Z, slopes = self._reduced(form)
        inside = _inside(point.P, point.w, Z, slopes)
        if inside is None:
            return None
        L, T, n_F = np.linalg.cholesky(point.P), inside[1], Z.shape[1]
        side = np.linalg.inv(np.linalg.cholesky(self.D)) @ L[:n_d] * point.radius
        # In the coordinates of the point P is 1, w is 1, and the diagonal of F is -1 at the signals.
        norms = 1 / np.maximum(point.w, LEAST * point.w[:-1].max(initial=0.0))
        P, w, t = cp.Variable((n_0, n_0), symmetric=True), cp.Variable(len(norms)), cp.Variable()
        J, slopes = np.eye(n_F)[:, :n_0], T @ slopes @ T.T / norms[:, None, None]
        half = J @ P @ (L.T @ Z @ T.T)
        conditions, moves, borders = [w >= 0], dict[int, Any](), list[Any]()
        for i in self.moving if length is not None else ():
            seen = form.stated.given()[i]
            Y = np.hstack([seen, np.zeros((len(seen), form.Z.shape[1] - seen.shape[1]))])
            U, Y = L.T @ self.loop.U[i][self.kept], Y[:, self._places(form)] @ T.T
            u, y = _sizes(U), _sizes(Y.T)
            move = cp.Variable(point.K[i].shape)
            acts = move @ (Y / y[:, None])
            half = half + J @ (U / u) @ acts
            borders += [length * (J @ (P - np.eye(n_0)) @ (U / u)), acts.T / length]
            moves[i] = cp.multiply(1 / np.outer(u, y), move)
            conditions += self._limits(point.K[i], moves[i])
        weighted = cp.reshape(slopes.reshape(len(norms), -1).T @ w, (n_F, n_F), order="C")
        F = (half + half.T) + weighted + ROOM * np.eye(n_F)
        if borders:
            columns = cp.hstack(borders)
            F = cp.bmat([[F, columns], [columns.T, -np.eye(columns.shape[1])]])
        conditions += [(F + F.T) / 2 << 0, side @ P @ side.T << t * np.eye(n_d)]
        for row in np.linalg.solve(L, self.rows.T).T:
            conditions.append(cp.bmat([[P, row[:, None]], [row[None, :], np.eye(1)]]) >> 0)
        if not solve_sdp(cp.Problem(cp.Minimize(t + ENERGY * w[-1]), conditions)) or P.value is None:
            return None
        K = point.K.copy()
        for i, move in moves.items():
            K[i] += move.value
        found = SetPoint(K, L @ P.value @ L.T, np.maximum(w.value, 0.0) / norms, 0.0)
        there = _inside(found.P, found.w, *self._reduced(AffineF(self.loop, K, self.claim)))
        return None if there is None else self._of_level_one(found)

    def _limits(self, K: Float[np.ndarray, "k l"], move: Any) -> list[Any]:
        """Return that the gains of an agent keep to their limit, and its controller to its rate with the P_C it has."""
        import cvxpy as cp

        found, n_C = [], self.loop.order
        if np.isfinite(self.gain_limit).all():
            unit = np.broadcast_to(self.gain_limit, K.shape)
            found.append(cp.sigma_max(cp.multiply(1 / unit, K + move)) <= 1)
        if self.rate is not None and n_C:
            own = K[:n_C, :n_C] + self.rate * np.eye(n_C)
            L = np.linalg.cholesky(_storage(own))
            half = L.T @ (own + move[:n_C, :n_C]) @ np.linalg.inv(L.T)
            found.append(half + half.T << 0)
        return found

    def _of_level_one(self, point: SetPoint) -> SetPoint:
        """Return a point scaled to c = 1, with its radius."""
        c = 1 / max(float(row @ np.linalg.solve(point.P, row)) for row in self.rows)
        side, n_d = np.linalg.inv(np.linalg.cholesky(self.D)), len(self.D)
        ratio = float(np.linalg.eigvalsh(side @ point.P[:n_d, :n_d] @ side.T)[-1])
        return SetPoint(point.K, point.P / c, point.w / c, float(np.sqrt(c / ratio)))

    def _places(self, form: AffineF) -> Int[np.ndarray, " k"]:
        """Return the columns of F without those of the leader's controller."""
        return np.concatenate([self.kept, np.arange(self.loop.n_x, form.Z.shape[1])])

    def _reduced(self, form: AffineF) -> tuple[Float[np.ndarray, "n_0 k"], Float[np.ndarray, "w k k"]]:
        """Return Z and the F_k without the leader's controller."""
        places = self._places(form)
        return form.Z[np.ix_(self.kept, places)], form.slopes[:, places][:, :, places]


def _inside(
    P: Float[np.ndarray, "k k"],
    w: Multipliers,
    Z: Float[np.ndarray, "k F"],
    slopes: Float[np.ndarray, "w F F"],
) -> tuple[Float[np.ndarray, "F F"], Float[np.ndarray, "F F"]] | None:
    """Return T F T', without R, Q and W, and T, with which P is 1 and the diagonal -1 at the signals; None where P > 0 and
    F < 0 do not hold."""
    F, k = np.tensordot(w, slopes, 1), len(P)
    F[:k] += P @ Z
    F[:, :k] += (P @ Z).T
    if (np.diag(F) >= 0).any():
        return None
    T = np.diag(1 / np.sqrt(-np.diag(F)))
    try:
        T[:k, :k] = np.linalg.inv(np.linalg.cholesky(P))
    except np.linalg.LinAlgError:
        return None
    F = T @ F @ T.T
    return (F, T) if np.linalg.eigvalsh(F)[-1] < -SURE else None


def _storage(A: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Return P with A'P + P A = -I.

    Raises:
        LinAlgError: it is not positive definite.
    """
    from scipy.linalg import solve_continuous_lyapunov

    P = solve_continuous_lyapunov(A.T, -np.eye(len(A))) if len(A) else A
    np.linalg.cholesky((P + P.T) / 2)
    return np.asarray((P + P.T) / 2)


def _sizes(columns: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, " columns"]:
    """Return the norms of columns, none of them 0."""
    norms = np.linalg.norm(columns, axis=0)
    return np.asarray(np.maximum(norms, LEAST * max(norms.max(), LEAST)))
