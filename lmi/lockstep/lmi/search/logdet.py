"""-log det(-F) in the gains and the certificate together: its value, slope and curvature, by linear algebra alone.

With -F = C C', W = C^-1 and S = W'W, the barrier phi = -log det(-F) of `inequality`'s F has

    d phi = tr(S dF),      d^2 phi = tr(S dF S dF) + tr(S d^2F).

The first term is the square of |W dF W'|: never negative. F is bilinear, so the second one holds what couples P with K,
f_a with m and f_d with t, and nothing else; it alone can be negative. An entry of P or K enters as He(u v') with u a
column of W [I; 0] (of W P U_i for K) and v one of W Z' (of W Y_i'), and

    <He(u v'), He(p q')> = 2 (u'p v'q + u'q v'p),

so that the products of these columns with each other, a matrix of a few dozen rows, give all of the curvature.

Where u weighs something, u' W u = |z|^2 makes F quadratic in K; by Schur's complement

    [ F     z' ]
    [ z    -I  ],      z = L S K (Y, Y_w),  L'L = W,

takes its place, of which all of the above holds: an entry of K has W [P U_i; S_i'L'] in place of W P U_i.

Everything is in the coordinates in which a given P is the identity.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, Shaped

from lockstep.check.continuous.channels import Inequality, Term
from lockstep.check.continuous.inequality import Certificate, Claim, inequality
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import split_multipliers
from lockstep.lmi.shapes import GainBlocks, Vector

Slopes = tuple[Vector, Float[np.ndarray, "x x"], Float[np.ndarray, "x x"]]
"""A slope, the part of the curvature that is never negative, and the rest of it."""


@dataclass(frozen=True)
class BalancedF:
    """F of a loop and claim as a function of x = (P, K, m, t, rho^2, f_a, f_d), with P = root P^ root'.

    m: the pair weights of alpha and of each entry;  f_a and f_d scale alpha^2, the entries with it, and delta^2;
    P^ is kept as its upper triangle, row by row.
    """

    loop: Loop
    claim: Claim
    root: Float[np.ndarray, "n_x n_x"]

    @cached_property
    def place(self) -> dict[str, slice]:
        """Where each unknown is in x."""
        loop = self.loop
        counts = {
            "P": loop.n_x * (loop.n_x + 1) // 2,
            "K": int(np.prod(self.shape_K)),
            "m": len(self._stated.channels[1].cone),
            "t": len(self._stated.channels) - 2,
            "r2": 1,
            "f_a": 1,
            "f_d": 1,
        }
        ends = np.cumsum([0, *counts.values()])
        return {name: slice(int(a), int(b)) for name, a, b in zip(counts, ends[:-1], ends[1:], strict=True)}

    @property
    def size(self) -> int:
        """Length of x."""
        return int(self.place["f_d"].stop)

    @cached_property
    def shape_K(self) -> tuple[int, int, int]:
        """(N, n_C + m, n_C + q)."""
        return self.loop.d.N, self.loop.U[0].shape[1], self.loop.Y[0].shape[0]

    def pack(self, K: GainBlocks, c: Certificate, f_a: float, f_d: float) -> Vector:
        """Return x for gains, a certificate and the fractions; what the certificate has no multipliers for gets ones."""
        inverse = np.linalg.inv(self.root)
        P, m, t = (inverse @ c.P @ inverse.T)[self._upper], self.place["m"], self.place["t"]
        ways = c.t if len(c.t) == t.stop - t.start else np.ones(t.stop - t.start)
        return np.concatenate([P, K.ravel(), c.pair_weights[: m.stop - m.start], ways, [c.rho**2, f_a, f_d]])

    def P(self, x: Vector) -> Float[np.ndarray, "n_x n_x"]:
        """Return P^."""
        P = np.zeros((self.loop.n_x, self.loop.n_x))
        P[self._upper] = x[self.place["P"]]
        return P + np.triu(P, 1).T

    def K(self, x: Vector) -> GainBlocks:
        """Return the gains."""
        return np.asarray(x[self.place["K"]].reshape(self.shape_K))

    def certificate(self, x: Vector) -> Certificate:
        """Return the witnesses, back in the coordinates of the loop."""
        m, m_entries = split_multipliers(self.loop, self.claim, x[self.place["m"]])
        P, rho = self.root @ self.P(x) @ self.root.T, float(np.sqrt(x[self.place["r2"]][0]))
        return Certificate(rho, (P + P.T) / 2, m, x[self.place["t"]], m_entries)

    def F(self, x: Vector) -> Float[np.ndarray, "n_F n_F"]:
        """Return F, in the balanced coordinates of the state."""
        n_x, K = self.loop.n_x, self.K(x)
        half = np.zeros((self._n_F, self._n_F))
        half[:n_x] = self.P(x) @ self._Z(K)
        half[self._rows :] = self._weighed + self._of_gains(self._D_z, K)
        constant, basis = self._weights, self._basis(x)
        linear = np.concatenate([x[self.place["m"]], x[self.place["t"]], x[self.place["r2"]]])
        return np.asarray(half + half.T + constant + np.tensordot(linear, basis, 1))

    def slopes(self, x: Vector) -> Slopes:
        """Return the slope of -log det(-F) and the two parts of its curvature.

        Raises:
            numpy.linalg.LinAlgError: -F is not positive definite.
        """
        from scipy.linalg import solve_triangular

        W = solve_triangular(np.linalg.cholesky(-self.F(x)), np.eye(self._n_F), lower=True)
        slope, square = np.zeros(self.size), np.zeros((self.size, self.size))
        left, right = self._columns(x, W)
        entries = slice(0, self.place["K"].stop)
        rest = slice(entries.stop, self.size)
        slope[entries], square[entries, entries] = self._of_P_and_K(left, right)
        V = self._of_the_rest(x, W)
        slope[rest] = np.trace(V, axis1=1, axis2=2)
        flat = V.reshape(len(V), -1)
        square[rest, rest] = flat @ flat.T
        square[rest, entries] = self._across(left.T @ V @ right)
        square[entries, rest] = square[rest, entries].T
        return slope, square, self._couplings(W)

    @cached_property
    def _stated(self) -> Inequality:
        """The inequality without the weight of u."""
        return inequality(self.loop, replace(self.claim, W=np.zeros((0, 0))))

    @cached_property
    def _u(self) -> Term | None:
        """How u is weighed."""
        return inequality(self.loop, self.claim).channels[0].fixed[1] if len(self.claim.W) else None

    @cached_property
    def _root_of_W(self) -> Float[np.ndarray, "z Nm"]:
        """L with L'L = W of all u, without rows of zeros."""
        if self._u is None:
            return np.zeros((0, 0))
        values, vectors = np.linalg.eigh(self._u.Pi_z)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T[values > 0])

    @property
    def _rows(self) -> int:
        """Rows of F without those of z."""
        return self._stated.size

    @cached_property
    def _D_z(self) -> list[Float[np.ndarray, "z k"]]:
        """How the outputs of each agent enter z."""
        if self._u is None:
            return [np.zeros((0, self.shape_K[1]))] * self.shape_K[0]
        return [self._root_of_W @ D for D in self._u.D_z]

    @cached_property
    def _weighed(self) -> Float[np.ndarray, "z n_F"]:
        """What of z does not depend on the gains: their errors."""
        total = np.zeros((len(self._root_of_W), self._n_F))
        if self._u is not None:
            total[:, : self._u.C_z.shape[1]] = self._root_of_W @ self._u.C_z
        return total

    def _of_gains(self, into: list[Float[np.ndarray, "a k"]], K: GainBlocks) -> Float[np.ndarray, "a n_F"]:
        """Return sum_i into_i K_i (Y_i, Y_wi)."""
        return np.asarray(
            sum(left @ block @ right for left, block, right in zip(into, K, self._Y, strict=True))
        )

    @cached_property
    def _upper(self) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
        return np.triu_indices(self.loop.n_x)

    @cached_property
    def _inverse(self) -> Float[np.ndarray, "n_x n_x"]:
        return np.asarray(np.linalg.inv(self.root))

    @cached_property
    def _U(self) -> list[Float[np.ndarray, "n_x k"]]:
        return [self.root.T @ U for U in self.loop.U]

    @cached_property
    def _Y(self) -> list[Float[np.ndarray, "l n_F"]]:
        """(Y_i, Y_wi)."""
        n_x, noise = self.loop.n_x, self._stated.channels[0].Y
        rows = [np.zeros((self.shape_K[2], self._n_F)) for _ in self.loop.Y]
        for i, (row, Y) in enumerate(zip(rows, self.loop.Y, strict=True)):
            row[:, :n_x] = Y @ self._inverse.T
            if noise:
                row[:, n_x : n_x + noise[i].shape[1]] = noise[i]
        return rows

    @cached_property
    def _in(self) -> Float[np.ndarray, "n_x w"]:
        return np.asarray(self.root.T @ np.hstack([channel.E for channel in self._stated.channels]))

    @property
    def _n_F(self) -> int:
        return self._rows + len(self._root_of_W)

    @cached_property
    def _weights(self) -> Float[np.ndarray, "n_F n_F"]:
        found = self._balanced(self._stated.constant(np.zeros(self.shape_K)))
        found[self._rows :, self._rows :] = -np.eye(self._n_F - self._rows)
        return found

    @cached_property
    def _slopes(self) -> Float[np.ndarray, "w n_F n_F"]:
        """What m, t and rho^2 multiply."""
        return self._balanced(np.roll(self._stated.slopes(np.zeros(self.shape_K)), -1, axis=0))

    def _balanced(self, forms: Float[np.ndarray, "*k n n"]) -> Float[np.ndarray, "*k n_F n_F"]:
        D = np.eye(self._n_F, self._rows)
        D[: self.loop.n_x, : self.loop.n_x] = self._inverse
        return np.asarray(D @ forms @ D.T)

    def _Z(self, K: GainBlocks) -> Float[np.ndarray, "n_x n_F"]:
        Z = self._of_gains(self._U, K)
        Z[:, : self._rows] += np.hstack([self.root.T @ self.loop.A_0 @ self._inverse.T, self._in])
        return Z

    @cached_property
    def _diagonal(self) -> Float[np.ndarray, "w n_F n_F"]:
        """What m, t and rho^2 multiply besides alpha^2 and delta^2: the squares of the signals."""
        squares = self._slopes.copy()
        first = self.loop.n_x + self._stated.channels[0].E.shape[1]
        squares[:-1, :first] = squares[:-1, :, :first] = 0.0
        return squares

    @cached_property
    def _bounds(self) -> dict[str, Float[np.ndarray, "k n_F n_F"]]:
        """What f_a m_ij and f_d t_j multiply, by the letter of the multiplier."""
        beside, pairs = (self._slopes - self._diagonal)[:-1], self.place["m"].stop - self.place["m"].start
        return {"m": beside[:pairs], "t": beside[pairs:]}

    def _basis(self, x: Vector) -> Float[np.ndarray, "w n_F n_F"]:
        """Return what m, t and rho^2 multiply."""
        basis, pairs = self._diagonal.copy(), len(self._bounds["m"])
        basis[:pairs] += x[self.place["f_a"]][0] * self._bounds["m"]
        basis[pairs:-1] += x[self.place["f_d"]][0] * self._bounds["t"]
        return basis

    @cached_property
    def _entries(self) -> tuple[Shaped[np.ndarray, " e"], ...]:
        """For each entry of P and K its u and v, those of its mirror image, and whether it has one."""
        n_x, (N, k, l) = self.loop.n_x, self.shape_K
        a, b = self._upper
        agent, row, column = (index.ravel() for index in np.indices((N, k, l)))
        none = np.zeros(N * k * l, dtype=int)
        return (
            np.concatenate([a, n_x + agent * k + row]),
            np.concatenate([b, n_x + agent * l + column]),
            np.concatenate([b, none]),
            np.concatenate([a, none]),
            np.concatenate([1.0 * (a != b), 0.0 * none]),
        )

    def _columns(
        self, x: Vector, W: Float[np.ndarray, "n_F n_F"]
    ) -> tuple[Float[np.ndarray, "n_F u"], Float[np.ndarray, "n_F v"]]:
        J, P = W[:, : self.loop.n_x], self.P(x)
        last = W[:, self._rows :]
        left = np.hstack([J, *[J @ (P @ U) + last @ D for U, D in zip(self._U, self._D_z, strict=True)]])
        return left, np.hstack([W @ self._Z(self.K(x)).T, *[W @ Y.T for Y in self._Y]])

    def _of_P_and_K(
        self, left: Float[np.ndarray, "n_F u"], right: Float[np.ndarray, "n_F v"]
    ) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, "e e"]]:
        u, v, u2, v2, twice = self._entries
        LL, RR, LR = left.T @ left, right.T @ right, left.T @ right

        def products(i: slice, j: slice, mirror_i: bool, mirror_j: bool) -> Float[np.ndarray, "i j"]:
            ui, vi = (u2[i], v2[i]) if mirror_i else (u[i], v[i])
            uj, vj = (u2[j], v2[j]) if mirror_j else (u[j], v[j])
            # take, one axis after the other: half the time of an index of both, and a fourth of a step's
            total = LL.take(ui, 0).take(uj, 1)
            total *= RR.take(vi, 0).take(vj, 1)
            crossed = LR.take(ui, 0).take(vj, 1)
            crossed *= LR.T.take(vi, 0).take(uj, 1)
            total += crossed
            return np.asarray(total)

        every, of_P = slice(0, len(u)), self.place["P"]
        total = products(every, every, False, False)
        across = products(every, of_P, False, True) * twice[of_P]
        total[:, of_P] += across
        total[of_P] += across.T
        total[of_P, of_P] += twice[of_P, None] * products(of_P, of_P, True, True) * twice[of_P]
        return 2 * (LR[u, v] + twice * LR[u2, v2]), 2 * total

    def _of_the_rest(self, x: Vector, W: Float[np.ndarray, "n_F n_F"]) -> Float[np.ndarray, "w n_F n_F"]:
        """Return W dF W' for each of m, t, rho^2, f_a and f_d."""
        extra = [np.tensordot(x[self.place[name]], bounds, 1) for name, bounds in self._bounds.items()]
        return np.asarray(W @ np.concatenate([self._basis(x), np.stack(extra)]) @ W.T)

    def _across(self, G: Float[np.ndarray, "w u v"]) -> Float[np.ndarray, "w e"]:
        u, v, u2, v2, twice = self._entries
        return np.asarray(2 * (G[:, u, v] + twice * G[:, u2, v2]))

    def _couplings(self, W: Float[np.ndarray, "n_F n_F"]) -> Float[np.ndarray, "x x"]:
        """Return tr(S d^2F): of P with K, of m with f_a, of t with f_d."""
        n_x, found = self.loop.n_x, np.zeros((self.size, self.size))
        S = W.T @ W
        a, b = self._upper
        u, v, _, _, twice = self._entries
        U, YS = np.hstack(self._U), np.vstack(self._Y) @ S[:, :n_x]
        of_K, of_P = self.place["K"], self.place["P"]
        c, d = u[of_K] - n_x, v[of_K] - n_x
        found[of_P, of_K] = 2 * (
            U[np.ix_(b, c)] * YS[np.ix_(d, a)].T + twice[of_P, None] * U[np.ix_(a, c)] * YS[np.ix_(d, b)].T
        )
        for linear, fraction in (("m", "f_a"), ("t", "f_d")):
            each = np.einsum("kij,ij->k", self._bounds[linear], S)
            found[self.place[linear], self.place[fraction].start] = each
        return found + found.T
