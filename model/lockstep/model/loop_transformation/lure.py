"""The agent of (2) in doubles: a linear part and a nonlinearity with structure, h(t, x) = G phi(H x, t) + offset(t).

The split is made exactly by `lockstep.check.system.agent`; here each of its numbers becomes the nearest double, and phi and
the offset become CasADi functions. All agents share the offset, so it cancels in their disagreement; what the certificate
needs is how phi grows from one state to another. (3) at the origin needs h(t, 0) = G phi(0, t) + offset(t) = 0
besides: `Lure.at_origin`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import as_fraction, is_double
from lockstep.check.system.agent import ExactAgent
from lockstep.model.formulas.symbolic import rounds_a_coefficient, symbolic, to_double


@dataclass(frozen=True, eq=False)
class Lure:
    """One agent, x' = A x + B u + G phi(H x, t) + offset(t), y = C x."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m"]
    C: Float[np.ndarray, "q n"]
    G: Float[np.ndarray, "n r"]
    H: Float[np.ndarray, "v n"]
    phi: ca.Function
    """(v, t) -> (w): v numbers and the time in, r numbers out; all three may be empty (a linear agent)."""
    offset: ca.Function
    """(t) -> (c): n numbers that depend on no state, common to all agents."""
    at_origin: ca.Function
    """(t) -> (h): h(t, 0) = G phi(0, t) + offset(t), which (3) requires to be 0 and consensus does not."""
    rounded: tuple[str, ...] = ()
    """The entries that no double holds exactly once the terms are collected: each is rounded once."""

    def __post_init__(self) -> None:
        for letter in "ABCGH":
            matrix = np.array(getattr(self, letter), dtype=float)
            matrix.flags.writeable = False
            object.__setattr__(self, letter, matrix)

    @property
    def is_linear(self) -> bool:
        """Whether there is no nonlinearity: phi has no components."""
        return bool(self.G.shape[1] == 0)


def lure_form(agent: ExactAgent) -> Lure:
    """Return the doubles nearest to an exact agent, and its phi and offset as functions.

    Raises:
        ProblemError: a coefficient above all doubles.
    """
    r, size = agent.G.shape[1], agent.H.shape[0]
    v, t = ca.SX.sym("v", size), ca.SX.sym("t")
    symbols = dict(enumerate([*ca.vertsplit(v), t])) if size else {0: t}
    parts = symbolic([*agent.phi.outputs, *agent.offset], symbols)
    w, drive = ca.vertcat(*parts[:r], ca.SX(0, 1)), ca.vertcat(*parts[r:])
    matrices = {letter: _doubles(getattr(agent, letter)) for letter in "ABCGH"}
    origin = drive + ca.mtimes(ca.SX(ca.DM(matrices["G"])), ca.substitute(w, v, ca.SX.zeros(size)))
    return Lure(
        **matrices,
        phi=ca.Function("phi", [v, t], [ca.densify(w)], ["v", "t"], ["w"]),
        offset=ca.Function("offset", [t], [ca.densify(drive)], ["t"], ["c"]),
        at_origin=ca.Function("at_origin", [t], [ca.densify(origin)], ["t"], ["h"]),
        rounded=(
            *_rounded(agent),
            *(f"phi{k}" for k, part in enumerate(agent.phi.outputs, start=1) if rounds_a_coefficient(part)),
        ),
    )


def _doubles(matrix: np.ndarray) -> Float[np.ndarray, "rows columns"]:
    out = np.zeros(matrix.shape)
    for place, value in np.ndenumerate(matrix):
        out[place] = to_double(as_fraction(value))
    return out


def _rounded(agent: ExactAgent) -> Iterator[str]:
    """Yield the names of the entries that no double holds: the equations' first, row by row."""
    for letters in ("AB", "C", "G", "H"):
        found = [
            (i, letter, j)
            for letter in letters
            for (i, j), value in np.ndenumerate(getattr(agent, letter))
            if not is_double(as_fraction(value))
        ]
        for i, letter, j in sorted(found, key=lambda one: one[:2]):
            yield f"{letter}[{i + 1},{j + 1}]"
