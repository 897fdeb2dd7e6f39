"""The closed loop in disagreement coordinates, affine in the controllers' gains.

With x_cl = (x_d, x_C) and K_i = [A_Ci B_Ci; C_Ci D_Ci], the paper's (15) is

    x_cl' = A_cl x_cl + E_G phi_d + E xi_d,      A_cl = A_0 + sum_i U_i K_i Y_i,

where x_d = (T (x) I) x, C_r = L_r (x) C, A_0 = diag(I (x) A, 0), U_i = [0, (T e_i) (x) B_i; e_i (x) I, 0] and
Y_i = [0, e_i' (x) I; (e_i' L_r) (x) C, 0].
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, Stack, block_diagonal, converter, eye, is_exact, product, zeros
from lockstep.check.system.disagreement import Disagreement


@dataclass(frozen=True)
class Gains:
    """The gains (10) of every agent's controller (9): x_C' = A x_C + B r, u = C x_C + D r, r = (L_q y)_i.

    A: per agent (n_C, n_C);  B: (n_C, q);  C: (m, n_C);  D: (m, q).
    """

    A: tuple[Annotated[np.ndarray, "n_C n_C"], ...]
    B: tuple[Annotated[np.ndarray, "n_C q"], ...]
    C: tuple[Annotated[np.ndarray, "m n_C"], ...]
    D: tuple[Annotated[np.ndarray, "m q"], ...]

    def __post_init__(self) -> None:
        """Check that the blocks of every agent fit together."""
        counts = [len(self.A), len(self.B), len(self.C), len(self.D)]
        found = f"gains for {', '.join(map(str, counts))} agents (A, B, C, D)"
        demand(counts[0] > 0 and len({*counts}) == 1, found, "gains", "one A, B, C and D per agent")
        n_C, (m, q) = self.A[0].shape[0], self.D[0].shape
        shapes = {"A": (n_C, n_C), "B": (n_C, q), "C": (m, n_C), "D": (m, q)}
        remedy = "every agent has the same order, inputs and outputs"
        for i in range(len(self.A)):
            for letter, (rows, columns) in shapes.items():
                block, where = getattr(self, letter)[i], f"gains of agent {i + 1}"
                found = f"`{letter}` is {block.shape[0]} x {block.shape[1]}"
                demand(block.shape == (rows, columns), found, where, f"{rows} x {columns}", remedy)
                found = f"`{letter}` holds a number that is not finite"
                demand(np.isfinite(block).all(), found, where, "finite numbers")

    @classmethod
    def from_blocks(cls, K: Annotated[np.ndarray, "N k l"], n_C: int) -> "Gains":
        """Split K_i = [A B; C D] of every agent into its blocks."""
        return cls(
            A=tuple(k[:n_C, :n_C].copy() for k in K),
            B=tuple(k[:n_C, n_C:].copy() for k in K),
            C=tuple(k[n_C:, :n_C].copy() for k in K),
            D=tuple(k[n_C:, n_C:].copy() for k in K),
        )

    @property
    def N(self) -> int:
        """Number of agents."""
        return len(self.A)

    @property
    def order(self) -> int:
        """Order n_C of each controller; 0 is static output feedback (Remark 1)."""
        return int(self.A[0].shape[0])

    @cached_property
    def blocks(self) -> Annotated[np.ndarray, "N k l"]:
        """K_i = [A_Ci B_Ci; C_Ci D_Ci] of every agent, stacked."""
        return np.stack([np.block([[self.A[i], self.B[i]], [self.C[i], self.D[i]]]) for i in range(self.N)])


@dataclass(frozen=True)
class Plant:
    """The matrices of the agents (2) with h = G phi(H x, t): A (n, n), B_i (n, m), C (q, n), G (n, r), H (v, n)."""

    A: Matrix
    B: tuple[Matrix, ...]
    C: Matrix
    G: Matrix
    H: Matrix

    @property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """(n, m, q, r, v)."""
        return self.A.shape[0], self.B[0].shape[1], self.C.shape[0], self.G.shape[1], self.H.shape[0]

    def in_numbers(self, exact_arithmetic: bool) -> "Plant":
        """Return the same plant in doubles or in the rationals that its doubles are."""
        number = converter(exact_arithmetic)
        return Plant(
            number(self.A), tuple(number(b) for b in self.B), number(self.C), number(self.G), number(self.H)
        )


@dataclass(frozen=True)
class Loop:
    """A_cl = A_0 + sum_i U_i K_i Y_i and the way in for xi_d; phi_d enters by E (I (x) G).

    A_0: (n_x, n_x) with n_x = n (N-1) + n_C N;  U[i]: (n_x, n_C + m);  Y[i]: (n_C + q, n_x);
    E: (n_x, n_d), n_d = n (N-1) being the length of x_d.
    """

    plant: Plant
    d: Disagreement
    order: int
    A_0: Matrix
    U: tuple[Matrix, ...]
    Y: tuple[Matrix, ...]
    E: Matrix

    @property
    def n_x(self) -> int:
        """Length n (N-1) + n_C N of x_cl."""
        return int(self.A_0.shape[0])

    @property
    def exact(self) -> bool:
        """Whether the matrices hold rationals."""
        return is_exact(self.A_0)

    def A_cl(self, K: Stack) -> Matrix:
        """Return A_0 + sum_i U_i K_i Y_i for stacked gain blocks K (N, n_C + m, n_C + q)."""
        total = self.A_0
        for U, block, Y in zip(self.U, K, self.Y, strict=True):
            total = total + product(product(U, block), Y)
        return total


def build_loop(plant: Plant, d: Disagreement, order: int, decay: float = 0.0) -> Loop:
    """Assemble the loop matrices from a plant and coordinates in the same kind of number; with a decay, A_0 + decay I.

    There is a controller for each B_i: one for each agent, or a single one in the coordinates of a mode.
    """
    n, m, q, _, _ = plant.sizes
    like, n_d, rest = plant.A, n * (d.N - 1), order * len(plant.B)
    unit, nothing = eye(d.N - 1, like), zeros(rest, 0, like)
    A_0 = block_diagonal(np.kron(unit, like), zeros(rest, rest, like))
    E = block_diagonal(eye(n_d, like), nothing)
    if decay:
        A_0 = A_0 + converter(is_exact(like))(np.array([decay]))[0] * eye(len(A_0), like)
    U, Y = [], []
    for i, B in enumerate(plant.B):
        Ui, Yi = zeros(len(A_0), order + m, like), zeros(order + q, len(A_0), like)
        own = slice(n_d + i * order, n_d + (i + 1) * order)
        Ui[own, :order] = Yi[:order, own] = eye(order, like)
        Ui[:n_d, order:] = np.kron(d.T[:, i : i + 1], B)
        Yi[order:, :n_d] = np.kron(d.L_r[i : i + 1, :], plant.C)
        U.append(Ui)
        Y.append(Yi)
    return Loop(plant, d, order, A_0, tuple(U), tuple(Y), E)
