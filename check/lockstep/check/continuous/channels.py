"""One inequality, a list of channels: everything that is proved of a loop in continuous time has this form.

Along  x' = A_0 x + sum_i U_i K_i y_i + sum_c E_c w_c,  y_i = Y_i x + sum_c Y_ci w_c,  with V = x' P x,

    V' + sum_c (Pi_c0 + sum_k tau_ck Pi_ck) < 0    whenever (x, w) != 0,                 tau_ck >= 0,
    Pi = z' Pi_z z - w_c' C_w' Pi_w C_w w_c,    z = C_z x + sum_i D_zi K_i y_i.

A channel c is a signal w_c with what is known of it: that sum_k tau_ck Pi_ck >= 0 along the loop for all tau_ck >= 0,
its cone; Pi_c0 is what is claimed beside it. F, the matrix of the left side in (x, w_1, w_2, ...), is

    F = He([I; 0] P flow) + F_0 + sum tau_ck F_ck,      flow = [A_0 + sum_i U_i K_i Y_i, E_c + sum_i U_i K_i Y_ci, ...],

in doubles or in rationals, as its parts are. A new guarantee is a new channel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.numbers import Matrix, Stack, Vector, product, zeros


class Term(NamedTuple):
    """The form Pi = z' Pi_z z - w' C_w' Pi_w C_w w with z = C_z x + sum_i D_zi K_i y_i, w being the signal of its channel.

    C_z: (z, n_x), or with more columns, for the signals of the first channels that z holds as well;  Pi_z: (z, z);
    C_w: (k, w);  Pi_w: (k, k);  D_z: (z, n_C + m) for each agent, or none where z holds no output of a controller.
    """

    C_z: Matrix
    Pi_z: Matrix
    C_w: Matrix
    Pi_w: Matrix
    D_z: tuple[Matrix, ...] = ()


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

    def flow(self, K: Stack) -> Annotated[np.ndarray, "n_x n_F"]:
        """Return [A_cl, E_c + sum_i U_i K_i Y_ci, ...], with x' = flow (x, w)."""
        total = np.hstack([self.A_0, *[channel.E for channel in self.channels]])
        for U, block, given in zip(self.U, K, self.given(), strict=True):
            total[:, : given.shape[1]] += product(U, product(block, given))
        return total

    def F(self, P: Matrix, K: Stack, multipliers: Vector) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F for stacked gain blocks and the multipliers of all channels, one channel after the other."""
        F = self.quadratic(K, multipliers)
        side = product(P, self.flow(K))
        F[: len(P)] += side
        F[:, : len(P)] += side.T
        return F

    def quadratic(self, K: Stack, multipliers: Vector) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F_0 + sum tau_ck F_ck."""
        if len(multipliers) != self.multipliers:
            raise ValueError(f"{len(multipliers)} multipliers for {self.multipliers} terms")
        weights, weighted = iter(multipliers), []
        for place, channel in self._placed():
            weighted += [(1, place, term) for term in channel.fixed]
            weighted += [(next(weights), place, term) for term in channel.cone]
        return self._sum(K, weighted)

    @property
    def multipliers(self) -> int:
        """How many multipliers there are."""
        return sum(len(channel.cone) for channel in self.channels)

    def constant(self, K: Stack) -> Annotated[np.ndarray, "n_F n_F"]:
        """Return F_0."""
        return self._sum(K, [(1, place, term) for place, one in self._placed() for term in one.fixed])

    def slopes(self, K: Stack) -> Annotated[np.ndarray, "tau n_F n_F"]:
        """Return every F_ck, one channel after the other: with the flow and F_0, all that a program in P and tau needs."""
        found = [self._sum(K, [(1, at, term)]) for at, one in self._placed() for term in one.cone]
        return np.stack(found) if found else np.zeros((0, self.size, self.size))

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
        seen = [(weight, self._seen(K, term), term.Pi_z) for weight, _, term in weighted if len(term.C_z)]
        width = max((rows.shape[1] for _, rows, _ in seen), default=0)
        seen = [(weight, widened(rows, width), Pi) for weight, rows, Pi in seen]
        total[:width, :width] += _weighted_squares(seen, width, self.A_0)
        for place in sorted({(place.start, place.stop) for _, place, _ in weighted}):
            part = slice(*place)
            here = [(weight, term.C_w, term.Pi_w) for weight, at, term in weighted if at == part]
            total[part, part] -= _weighted_squares(here, place[1] - place[0], self.A_0)
        return total

    def _seen(self, K: Stack, term: Term) -> Matrix:
        """Return the rows of z in x, or in (x, w) where it holds outputs of controllers that see w."""
        if not term.D_z:
            return term.C_z
        u = [product(D, product(block, Y)) for D, block, Y in zip(term.D_z, K, self.given(), strict=True)]
        total = sum(u[1:], start=u[0])
        width = max(total.shape[1], term.C_z.shape[1])
        return np.asarray(widened(total, width) + widened(term.C_z, width))


def _weighted_squares(parts: Sequence[tuple[object, Matrix, Matrix]], width: int, like: Matrix) -> Matrix:
    """Return sum weight rows' Pi rows."""
    parts = [(weight, rows, Pi) for weight, rows, Pi in parts if len(rows)]
    if not parts or not width:
        return zeros(width, width, like)
    weighted = [weight * product(Pi, rows) for weight, rows, Pi in parts]
    return product(np.vstack([rows for _, rows, _ in parts]).T, np.vstack(weighted))


def widened(rows: Matrix, width: int) -> Matrix:
    """Return rows with columns of zeros behind them, up to a width."""
    return np.hstack([rows, zeros(len(rows), width - rows.shape[1], rows)])
