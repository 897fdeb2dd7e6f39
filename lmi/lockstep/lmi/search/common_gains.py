"""Gains that are the same for all agents: a search over some modes of the graph, whose size does not grow with N.

With the same gains for all agents and the same weight for all pairs the loop of a graph whose Laplacian is normal falls apart
into its modes A_0 + U K Y(lambda), in orthonormal coordinates, with mu on each and the mean of the controllers beside them.
Some of the modes are a small loop (`loop_of`), and `search.smoothed_norm` does the rest. Method `modal` ends with such
gains; the search for many agents' own gains begins with them, whatever the graph: there they are looked at in the whole loop.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Shaped

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes
from lockstep.check.system.disagreement import Disagreement
from lockstep.check.system.loop import Loop, build_loop
from lockstep.lmi.analysis.gain_limit import limit_in_units, limited
from lockstep.lmi.analysis.unit_scaling import scaled
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.search.smoothed_norm import Descended, SmoothedNorm, norm_descent, refined_to_maximum
from lockstep.lmi.search.stabilise import OutputFeedback, real_part
from lockstep.lmi.shapes import GainLimit, Vector

GAIN_WEIGHTS = (1e-3, 1e-5, 0.0)
"""Weights of the mean square of the gains while the abscissa is lowered, tried until the loop is stable. Small gains
make the better starts; a long path, whose slowest mode needs all the gain there is, is only stabilised without."""

ONE = 1e-6
"""Eigenvalues this close to each other, relatively, are one mode of the search."""

SQUARED = 1e100
"""The largest limit that is squared, as doubles go: a larger one limits nothing."""

FEW = 4
"""Eigenvalues of a directed graph that stand for all."""


@dataclass(frozen=True)
class ModalSearch:
    """What is searched: some modes, such as those at the ends of segments, and their smoothed norm in units near one."""

    modes: Modes
    claim: Claim
    ends: Shaped[np.ndarray, " s"]
    gain_limit: GainLimit
    norm: SmoothedNorm

    @classmethod
    def of(
        cls,
        modes: Modes,
        claim: Claim,
        ends: Shaped[np.ndarray, " s"],
        gain_limit: GainLimit,
        rate: float | None = None,
    ) -> "ModalSearch":
        """Return the search over the modes of a plant at the ends of segments; A_C is to have a rate of its own if given."""
        loop = loop_of(modes, ends.astype(complex))
        few = replace(claim, delta=np.zeros((len(loop.U), 4)))
        loop, few, units = scaled(loop, few)
        norm = SmoothedNorm(loop, few, gain_limit, units.gains, shared=True, rate=rate)
        return cls(modes, claim, ends, gain_limit, norm)

    def stable(self, generator: np.random.Generator) -> Float[np.ndarray, "a b"] | None:
        """Return random gains made stable at every end, or None."""
        ends, L = self.ends, self.gain_limit
        size = generator.choice([0.5, 1.0, 2.0]) / np.abs(ends[0] * ends[-1]) ** 0.25
        drawn = L / limit_in_units(L) * size * generator.standard_normal(self.norm.shape[1:])
        K = limited(stabilised(self, drawn)[None], 0.9 * L)[0]
        return None if _worst(_ways(self), K)[0] >= 0 else K

    def down(self, K: Float[np.ndarray, "a b"], *, far: bool = True) -> Descended:
        """Return stable gains after the descents: K of its first agent is that of all; far: to next to the maximum, too."""
        at = norm_descent(self.norm, np.repeat(K[None], self.norm.shape[0], axis=0))
        return refined_to_maximum(self.norm, at) if far and np.isfinite(at.rho) else at


def loop_of(modes: Modes, values: Complex[np.ndarray, " s"]) -> Loop:
    """Return some modes of a graph and the mean of the controllers beside each other, in orthonormal coordinates.

    An eigenvalue a + bi stands for itself and a - bi: the block [a b; -b a], two coordinates. There is a controller for each
    coordinate, which hears and moves it alone, and one more for the mean, which hears nothing. All pairs weigh alike:
    sum_(i < j) M_ij = (s + 1) I.
    """
    from scipy.linalg import block_diag, helmert

    blocks = [
        [[one.real]] if not one.imag else [[one.real, one.imag], [-one.imag, one.real]] for one in values
    ]
    L_r = block_diag(*blocks, np.zeros((1, 0)))
    s = L_r.shape[1]
    T = np.eye(s, s + 1)
    d = Disagreement(T, helmert(s + 1).T, np.eye(s), np.zeros((s + 1, s + 1)), L_r)
    return build_loop(replace(modes.plant, B=modes.plant.B[:1] * (s + 1)), d, modes.order, modes.decay)


def representative_eigenvalues(eigenvalues: Shaped[np.ndarray, " N"]) -> Complex[np.ndarray, " s"]:
    """Return a few of the eigenvalues of L, the smallest first, each then the farthest from those before it.

    Which is far is told by the logarithm. Of a pair a +- bi one is taken, of those that are one, too; the smallest of all,
    which is 0, is none.

    >>> representative_eigenvalues(np.array([0.0, 1.0, 1.0, 2.0])).tolist()
    [(1+0j), (2+0j)]
    """
    rising = eigenvalues[np.argsort(np.abs(eigenvalues), kind="stable")][1:]
    turn = np.abs(rising.imag)
    values = np.where(turn > ONE * np.abs(rising), rising.real + 1j * turn, rising.real)
    found = [values[0]]
    while len(found) < FEW:
        apart = np.abs(np.log(values[:, None] / np.array(found))).min(axis=1)
        if apart.max() < ONE:
            break
        found.append(values[int(np.argmax(apart))])
    return np.array(found, dtype=complex)


def stabilised(search: ModalSearch, K: Float[np.ndarray, "a b"]) -> Float[np.ndarray, "a b"]:
    """Lower the largest abscissa over the ends of the segments, and over A_C + rate I, within the gain limit, in its units.

    The gains are L Z / sqrt(1 + |Z|^2), entry by entry, so that every Z is allowed.
    """
    ways, L = _ways(search), np.minimum(search.gain_limit, SQUARED)
    for weight in GAIN_WEIGHTS:
        size = max(0.9, float(np.linalg.norm(K / L)))
        K = _lowered(ways, 0.9 / size * K, L, weight * limit_in_units(L) ** 2)
        if _worst(ways, K)[0] < 0:
            break
    return K


def _lowered(
    ways: list[OutputFeedback], K: Float[np.ndarray, "a b"], L: GainLimit, weight: float
) -> Float[np.ndarray, "a b"]:
    each = np.broadcast_to(L, K.shape).ravel()

    def objective(flat: Vector) -> tuple[float, Vector]:
        root = float(np.sqrt(1 + flat @ flat))
        part = flat / root
        worst, slope = _worst(ways, (each * part).reshape(K.shape))
        total = each * slope.ravel() + 2 * weight * part / flat.size
        return worst + weight * float(np.mean(part**2)), (total - part * (part @ total)) / root

    first = (K / L).ravel()
    Z = descend(objective, first / np.sqrt(1 - first @ first), 100)
    return np.asarray(each * Z / np.sqrt(1 + Z @ Z)).reshape(K.shape)


def loops_at(modes: Modes, values: Shaped[np.ndarray, " s"]) -> list[OutputFeedback]:
    """Return A_0, U and Y of the mode of each eigenvalue of L, real or complex."""
    one, n, found = modes.at(1.0), len(modes.plant.A), []
    for value in values:
        seen = np.array(one.Y[0], dtype=values.dtype)
        seen[modes.order :, :n] *= value
        found.append((one.A_0, one.U[0], seen))
    return found


def _ways(search: ModalSearch) -> list[OutputFeedback]:
    """Return those of the ends, and of A_C + rate I."""
    found, n_C = loops_at(search.modes, search.ends), search.modes.order
    (rows, columns), rate = search.norm.shape[1:], max(search.modes.decay, search.norm.rate)
    return [*found, (rate * np.eye(n_C), np.eye(n_C, rows), np.eye(columns, n_C))] if n_C else found


def _worst(ways: list[OutputFeedback], K: Float[np.ndarray, "a b"]) -> tuple[float, Float[np.ndarray, "a b"]]:
    """Return the largest abscissa of A_0 + U K Y and its slope in K."""
    value, slope = max(
        (real_part(A_0 + U @ K @ Y, [U], [Y]) for A_0, U, Y in ways), key=lambda found: found[0]
    )
    return value, slope[0]
