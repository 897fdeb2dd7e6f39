"""A slow twin of the certificate inequality, in Python's own fractions, from the definitions and not from their matrices.

With T = [I, -1] the disagreement x_d has the blocks d_i = x_i - x_N. Put x_N = 0: then x_i = d_i for i < N, every relative
quantity follows from the agents' equations (2), (9), and F is the matrix of the quadratic form

    2 x_cl' P x_cl' + sum_i (x_i - mean)' R (x_i - mean) + sum_i x_Ci' Q x_Ci
      + sum_ij m_ij (alpha^2 |H (x_i - x_j)|^2 - |phi_i - phi_j|^2) - rho^2 sum_i |xi_i - mean|^2
      + sum_kl sum_ij m_kl,ij (r_kl^2 (H_l (x_i - x_j))^2 - (w_kl,ij)^2)
      + sum_j t_j (delta_j^2 |Y_j x_cl|^2 - |w_j|^2)

in z = (x_d, x_C, xi_d, phi_d, w_kl, w), the last of the w_kl,ij of a component k and a pair being what the others leave of
phi_k,i - phi_k,j. No T, no right inverse, no Kronecker product, no metric S is formed. Whether -F is positive
definite is then decided by the signs of its leading minors (Sylvester), computed in integers by Bareiss' elimination.
"""

from collections.abc import Sequence
from fractions import Fraction
from math import lcm
from typing import Any

Vector = list[Fraction]
Form = list[Vector]
"""A signal as a linear form: one row per component, one column per component of z."""


def fractions(matrix: Any) -> Form:
    """Return the fractions that the doubles of a matrix are."""
    return [[Fraction(float(value)) for value in row] for row in matrix]


def times(matrix: Form, signal: Form) -> Form:
    """Return matrix @ signal, skipping zeros."""
    width = len(signal[0]) if signal else 0
    out = []
    for row in matrix:
        total = [Fraction(0)] * width
        for weight, form in zip(row, signal, strict=True):
            if weight:
                total = [a + weight * b if b else a for a, b in zip(total, form, strict=True)]
        out.append(total)
    return out


def plus(*signals: Form) -> Form:
    """Return the sum of signals of one size."""
    return [
        [sum(column, Fraction(0)) for column in zip(*rows, strict=True)]
        for rows in zip(*signals, strict=True)
    ]


def scaled(weight: Fraction | int, signal: Form) -> Form:
    """Return weight * signal."""
    return [[weight * value for value in row] for row in signal]


class Twin:
    """The inequality of one network with given gains, rebuilt from the agents' own equations.

    A, B (one per agent), C, G, H, adjacency, gains (dicts of A, B, C, D per agent), R, Q: anything matrix-like, in doubles.
    """

    def __init__(self, plant: Any, adjacency: Any, gains: Sequence[dict[str, Any]]) -> None:
        self.A, self.C, self.G, self.H = (fractions(getattr(plant, letter)) for letter in "ACGH")
        self.B = [fractions(b) for b in plant.B]
        self.a, self.gains = (
            fractions(adjacency),
            [{k: fractions(v) for k, v in one.items()} for one in gains],
        )
        self.N, self.n, self.r = len(self.a), len(self.A), len(self.G[0]) if self.G else 0
        self.n_C = len(self.gains[0]["A"])

    def F(self, claim: Any, certificate: Any) -> Form:
        """Return F for a claim (alpha, R, Q, delta, entries) and a certificate (rho, P, m, t, m_entries)."""
        N, n, n_C, r = self.N, self.n, self.n_C, self.r
        gaps = [(i, k) for i in range(N) for k in range(4) if claim.delta[i][k] > 0 and all(self._gap(i, k))]
        pairs = [(i, j) for i in range(N) for j in range(i + 1, N)]
        split = [c for c, one in enumerate(claim.entries) if c not in _last_of_each(claim.entries)]
        sizes = (
            [n] * (N - 1)
            + [n_C] * N
            + [n] * (N - 1)
            + [r] * (N - 1)
            + [1] * (len(split) * len(pairs))
            + [self._gap(i, k)[0] for i, k in gaps]
        )
        blocks = _unknowns(sizes)
        nothing = [[Fraction(0)] * sum(sizes) for _ in range(max(n, r, 1))]
        x, x_C = [*blocks[: N - 1], nothing[:n]], blocks[N - 1 : 2 * N - 1]
        xi, phi = [*blocks[2 * N - 1 : 3 * N - 2], nothing[:n]], [*blocks[3 * N - 2 : 4 * N - 3], nothing[:r]]
        parts = dict(zip([(c, pair) for c in split for pair in pairs], blocks[4 * N - 3 :], strict=False))
        errors = dict(zip(gaps, blocks[4 * N - 3 + len(parts) :], strict=True))
        dx, dx_C, seen = self._rates(x, x_C, xi, phi, errors)
        state = [row for block in (*x[:-1], *x_C) for row in block]
        rate = [row for block in (*[_minus(d, dx[-1]) for d in dx[:-1]], *dx_C) for row in block]
        F = _zero(sum(sizes))
        _add_product(F, times(fractions(certificate.P), state), rate, Fraction(1))
        alpha, rho = Fraction(float(claim.alpha)), Fraction(float(certificate.rho))
        R, Q = fractions(claim.R), fractions(claim.Q)
        for weight, signal in [(R, x), (scaled(-rho * rho, _one(n)), xi)]:
            for part in _from_mean(signal):
                _add_square(F, part, weight)
        for part in x_C:
            _add_square(F, part, Q)
        for c, entry in enumerate(claim.entries):
            for m, (i, j) in zip(certificate.m_entries[c], pairs, strict=True):
                m, own = Fraction(float(m)), parts.get((c, (i, j)))
                if own is None:
                    k = entry.component
                    taken = [
                        s
                        for (o, pair), s in parts.items()
                        if pair == (i, j) and claim.entries[o].component == k
                    ]
                    own = plus([_minus(phi[i], phi[j])[k]], *[scaled(-1, one) for one in taken])
                seen_l = [times(self.H, _minus(x[i], x[j]))[entry.argument]]
                _add_square(F, seen_l, [[m * Fraction(float(entry.bound)) ** 2]])
                _add_square(F, own, [[-m]])
        for m, (i, j) in zip(certificate.m, pairs, strict=True):
            if r:
                _add_square(
                    F,
                    times(self.H, _minus(x[i], x[j])),
                    scaled(Fraction(float(m)) * alpha**2, _one(len(self.H))),
                )
                _add_square(F, _minus(phi[i], phi[j]), scaled(-Fraction(float(m)), _one(r)))
        for t, (i, k) in zip(certificate.t, gaps, strict=True):
            delta, t = Fraction(float(claim.delta[i][k])), Fraction(float(t))
            _add_square(F, seen[i, k], scaled(t * delta**2, _one(len(seen[i, k]))))
            _add_square(F, errors[i, k], scaled(-t, _one(len(errors[i, k]))))
        return F

    def holds(self, claim: Any, certificate: Any) -> bool:
        """Tell whether rho > 0, m >= 0 (of alpha and the entries), t >= 0, P > 0 and F < 0."""
        weights = [*certificate.m, *certificate.t, *[m for row in certificate.m_entries for m in row]]
        if not certificate.rho > 0 or min(weights, default=0) < 0:
            return False
        if not positive_definite(fractions(certificate.P)):
            return False
        return positive_definite(scaled(-1, self.F(claim, certificate)))

    def _gap(self, i: int, k: int) -> tuple[int, int]:
        """Return the size of Delta A, B, C or D of agent i."""
        m, q = len(self.B[i][0]), len(self.C)
        return ((self.n_C, self.n_C), (self.n_C, q), (m, self.n_C), (m, q))[k]

    def _rates(self, x: Any, x_C: Any, xi: Any, phi: Any, errors: Any) -> Any:
        """Return (2) and (9) with (4): x_i', x_Ci', and what each gain error multiplies."""
        dx, dx_C, seen = [], [], {}
        for i, gain in enumerate(self.gains):
            heard = [times(self.C, scaled(a, _minus(x[i], x[j]))) for j, a in enumerate(self.a[i]) if a]
            y = plus(*heard) if heard else times(self.C, scaled(0, x[i]))
            seen |= {(i, 0): x_C[i], (i, 1): y, (i, 2): x_C[i], (i, 3): y}
            into = [errors[i, k] for k in (0, 1) if (i, k) in errors]
            asked = [errors[i, k] for k in (2, 3) if (i, k) in errors]
            u = plus(times(gain["D"], y), *([times(gain["C"], x_C[i])] if self.n_C else []), *asked)
            dx.append(
                plus(
                    times(self.A, x[i]),
                    times(self.B[i], u),
                    xi[i],
                    *([times(self.G, phi[i])] if self.r else []),
                )
            )
            dx_C.append(plus(times(gain["A"], x_C[i]), times(gain["B"], y), *into) if self.n_C else [])
        return dx, dx_C, seen


def positive_definite(matrix: Form) -> bool:
    """Tell whether all leading minors of a symmetric matrix are positive; Bareiss' elimination keeps them integers."""
    if any(matrix[i][j] != matrix[j][i] for i in range(len(matrix)) for j in range(i)):
        raise AssertionError("the twin builds symmetric forms only")
    common = lcm(*[value.denominator for row in matrix for value in row]) if matrix else 1
    work = [[int(value * common) for value in row] for row in matrix]
    previous = 1
    for k in range(len(work)):
        pivot = work[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, len(work)):
            for j in range(i, len(work)):
                work[j][i] = (work[j][i] * pivot - work[i][k] * work[j][k]) // previous
        previous = pivot
    return True


def _last_of_each(entries: Sequence[Any]) -> set[int]:
    return {max(c for c, other in enumerate(entries) if other.component == one.component) for one in entries}


def _unknowns(sizes: Sequence[int]) -> list[Form]:
    total, place, blocks = sum(sizes), 0, []
    for size in sizes:
        blocks.append([[Fraction(int(j == place + i)) for j in range(total)] for i in range(size)])
        place += size
    return blocks


def _minus(a: Form, b: Form) -> Form:
    return plus(a, scaled(-1, b))


def _one(n: int) -> Form:
    return [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def _zero(n: int) -> Form:
    return [[Fraction(0)] * n for _ in range(n)]


def _from_mean(signals: list[Form]) -> list[Form]:
    mean = scaled(Fraction(1, len(signals)), plus(*signals))
    return [_minus(signal, mean) for signal in signals]


def _add_square(F: Form, signal: Form, weight: Form) -> None:
    """Add signal' weight signal."""
    _add_product(F, times(weight, signal), signal, Fraction(1, 2))


def _add_product(F: Form, left: Form, right: Form, half: Fraction) -> None:
    """Add half (left' right + right' left), so that half = 1 is the form 2 left' right."""
    for a, b in zip(left, right, strict=True):
        rows = [(i, value) for i, value in enumerate(a) if value]
        columns = [(j, value) for j, value in enumerate(b) if value]
        for i, p in rows:
            for j, q in columns:
                product = half * p * q
                F[i][j] += product
                F[j][i] += product
