"""One inequality, a list of channels: everything that is proved of a loop in continuous time has this form.

Along  x' = A_0 x + sum_i U_i K_i y_i + sum_c E_c w_c,  y_i = Y_i x + sum_c Y_ci w_c,  with V = x' P x,

    V' + sum_c (Pi_c0 + sum_k lambda_ck Pi_ck) < 0    whenever (x, w) != 0,                 lambda_ck >= 0,
    Pi = z' Q z - w_c' W' M W w_c,    z = C x + sum_i S_i K_i y_i.

A channel c is a signal w_c with what is known of it: that sum_k lambda_ck Pi_ck >= 0 along the loop for all lambda_ck >= 0,
its cone; Pi_c0 is what is claimed beside it. F, the matrix of the left side in (x, w_1, w_2, ...), is

    F = He(J P Z) + F_0 + sum lambda_ck F_ck,      J = [I; 0],   Z = [A_0 + sum_i U_i K_i Y_i, E_c + sum_i U_i K_i Y_ci, ...],

in doubles, rationals or balls, as its parts are. A new guarantee is a new channel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.numbers import Matrix, Stack, Vector, product, zeros


class Term(NamedTuple):
    """The form Pi = z' Q z - w' W' M W w with z = C x + sum_i S_i K_i y_i, w being the signal of its channel.

    C: (z, n_x), or with more columns, for the signals of the first channels that z holds as well;  Q: (z, z);  W: (v, w);
    M: (v, v);  S: (z, n_C + m) for each agent, or none where z holds no output of a controller.
    """

    C: Matrix
    Q: Matrix
    W: Matrix
    M: Matrix
    S: tuple[Matrix, ...] = ()


class Channel(NamedTuple):
    """A signal w, how it enters, and the cone of forms that are not negative along the loop.

    name: for people;  E: (n_x, w);  cone: one term for each multiplier;  fixed: terms without one;  Y: (n_C + q, w) for
    each agent, or none where the controllers do not see w.
    """

    name: str
    E: Matrix
    cone: tuple[Term, ...]
    fixed: tuple[Term, ...] = ()
    Y: tuple[Matrix, ...] = ()


@dataclass(frozen=True)
class Inequality:
    """A loop, affine in its gains, and the channels: A_0 (n_x, n_x), U_i (n_x, n_C + m), Y_i (n_C + q, n_x)."""

    A_0: Matrix
    U: tuple[Matrix, ...]
    Y: tuple[Matrix, ...]
    channels: tuple[Channel, ...]

    @property
    def size(self) -> int:
        """Rows of F."""
        return len(self.A_0) + sum(int(channel.E.shape[1]) for channel in self.channels)

    def Z(self, K: Stack) -> Annotated[np.ndarray, "n_x n_F"]:
        """Return [A_cl, E_c + sum_i U_i K_i Y_ci, ...], with x' = Z (x, w)."""
        total = np.hstack([self.A_0, *[channel.E for channel in self.channels]])
        for U, block, given in zip(self.U, K, self.given(), strict=True):
            total[:, : given.shape[1]] += product(U, product(block, given))
        return total

    def F(self, P: Matrix, K: Stack, multipliers: Vector) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F for stacked gain blocks and the multipliers of all channels, one channel after the other."""
        F = self.quadratic(K, multipliers)
        side = product(P, self.Z(K))
        F[: len(P)] += side
        F[:, : len(P)] += side.T
        return F

    def quadratic(self, K: Stack, multipliers: Vector) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F_0 + sum lambda_ck F_ck."""
        if len(multipliers) != self.multipliers:
            raise ValueError(f"{len(multipliers)} multipliers for {self.multipliers} terms")
        weights, weighted, one = iter(multipliers), [], self._one
        for place, channel in self._placed():
            weighted += [(one, place, term) for term in channel.fixed]
            weighted += [(next(weights), place, term) for term in channel.cone]
        return self._sum(K, weighted)

    @property
    def multipliers(self) -> int:
        """How many multipliers there are."""
        return sum(len(channel.cone) for channel in self.channels)

    def constant(self, K: Stack) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F_0."""
        return self._sum(K, [(self._one, place, term) for place, one in self._placed() for term in one.fixed])

    def slopes(self, K: Stack) -> Annotated[np.ndarray, "lambda n_F n_F"]:
        """Return every F_ck, one channel after the other: with Z and F_0, all that a program in P and lambda needs."""
        found = [self._sum(K, [(self._one, at, term)]) for at, one in self._placed() for term in one.cone]
        return np.stack(found) if found else np.zeros((0, self.size, self.size))

    @property
    def _one(self) -> object:
        return self.A_0[0, 0] * 0 + 1

    def _placed(self) -> Iterable[tuple[slice, Channel]]:
        at = len(self.A_0)
        for channel in self.channels:
            width = channel.E.shape[1]
            yield slice(at, at + width), channel
            at += width

    def given(self) -> list[Matrix]:
        """Return [Y_i, Y_ci, ...] of each agent, without the signals where no controller sees any."""
        if not any(channel.Y for channel in self.channels):
            return list(self.Y)
        nothing = [zeros(len(self.Y[0]), one.E.shape[1], self.A_0) for one in self.channels]
        return [
            np.hstack(
                [Y, *[one.Y[i] if one.Y else none for one, none in zip(self.channels, nothing, strict=True)]]
            )
            for i, Y in enumerate(self.Y)
        ]

    def _sum(
        self, K: Stack, weighted: Sequence[tuple[object, slice, Term]]
    ) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return the matrix of the sum of weighted terms, each with the place of its signal."""
        total = zeros(self.size, self.size, self.A_0)
        seen = [(weight, self._seen(K, term), term.Q) for weight, _, term in weighted if len(term.C)]
        width = max((rows.shape[1] for _, rows, _ in seen), default=0)
        seen = [(weight, _widened(rows, width), Q) for weight, rows, Q in seen]
        total[:width, :width] += _weighted_squares(seen, width, self.A_0)
        for place in sorted({(place.start, place.stop) for _, place, _ in weighted}):
            here = [(weight, term.W, term.M) for weight, at, term in weighted if (at.start, at.stop) == place]
            part = slice(*place)
            total[part, part] -= _weighted_squares(here, place[1] - place[0], self.A_0)
        return total

    def _seen(self, K: Stack, term: Term) -> Matrix:
        """Return the rows of z in x, or in (x, w) where it holds outputs of controllers that see w."""
        if not term.S:
            return term.C
        outputs = [
            product(S, product(block, given)) for S, block, given in zip(term.S, K, self.given(), strict=True)
        ]
        total = sum(outputs[1:], start=outputs[0])
        width = max(total.shape[1], term.C.shape[1])
        return np.asarray(_widened(total, width) + _widened(term.C, width))


def _weighted_squares(parts: Sequence[tuple[object, Matrix, Matrix]], width: int, like: Matrix) -> Matrix:
    """Return sum weight rows' Q rows."""
    parts = [(weight, rows, Q) for weight, rows, Q in parts if len(rows)]
    if not parts or not width:
        return zeros(width, width, like)
    weighted = [weight * product(Q, rows) for weight, rows, Q in parts]
    return product(np.vstack([rows for _, rows, _ in parts]).T, np.vstack(weighted))


def _widened(rows: Matrix, width: int) -> Matrix:
    return np.hstack([rows, zeros(len(rows), width - rows.shape[1], rows)])
