"""The sampled, rounded loop of identical controllers, mode by mode: its size does not depend on the number of agents.

Along an orthonormal basis of eigenvectors of a symmetric L the loop of `loop` splits, with one multiplier mu for all
pairs (M = mu I), into one copy for each lambda_k, in which r_k = lambda_k C x_k + zeta_k, and into the mean of the
controllers, which is a mode of an agent without states. The errors do not split, but their bounds do. With d_ij =
a_ij (y_i - y_j), one error e_i of a coefficient for each agent, e = (e_i), and prices t that all agents share,

    |e_A,i| <= delta_A |x_C,i|   implies   sum_k |e_A,k|^2 <= delta_A^2 sum_k |x_C,k|^2,    and likewise C;
    |e_B,i| <= delta_B |(d_ij + zeta_ij)_j|   implies
        sum_k |e_B,k|^2 <= 2 delta_B^2 (sum_ij |d_ij|^2 + sum_ij |zeta_ij|^2),    and likewise D.

For an edge, lambda_N >= (e_i - e_j)' L (e_i - e_j) / 2 >= 2 a_ij, so that a_ij <= b / 2 if the spectrum ends at b, and

    sum_ij |d_ij|^2 <= (b / 2) sum_ij a_ij |y_i - y_j|^2 = b sum_k lambda_k |C x_k|^2 <= sum_k b^2 |C x_k|^2:

a gain error sqrt(2) b delta_B of C x_k; likewise in the units D_c <= 1 of `controller`, which are those of all agents.
zeta_i = sum_j zeta_ij has |zeta_i|^2 <= h sum_j |zeta_ij|^2, h being the most neighbours of an agent: so |zeta_ij|^2
counts h kappa + 2 (t_B delta_B^2 + t_D delta_D^2) in all.

Omega of `inequality` is then one matrix for each lambda, with its own P on each segment of lambda and the same mu, t, kappa
and weight for all. **Two ends suffice**: start(lambda), A_z(lambda) and the applied u are affine in lambda and everything
else is constant, and they enter Omega by start' C_d'C_d start and u'W u, subtracted, and by P A_z. C_d'C_d >= 0, since a'
C_d'C_d a is the largest value of int |z|^2 - |w|^2 from a, and w = 0 gives one that is not negative. Hence Omega is concave
in lambda: positive at both ends, it is on all of the segment. With one segment, V = sum_k x_cl,k' P x_cl,k is the same for
all graphs, whatever their eigenvectors: they may be switched at every sampling instant.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import Annotated

import numpy as np

from lockstep.check.continuous.inequality import LETTERS, Performance
from lockstep.check.continuous.modes import Segment
from lockstep.check.errors import demand
from lockstep.check.numbers import converter, exact, eye, rounded_down, zeros
from lockstep.check.sampled import balls, certificate
from lockstep.check.sampled.controller import PRECISIONS, HeldController, SampledNetwork, spectral_bound
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import NO_NOISE, Columns, SampledLoop, step_rows, way_of
from lockstep.check.system.disagreement import single_difference
from lockstep.check.system.graph import Digraph
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.check.system.laplacian_spectrum import metric
from lockstep.check.system.loop import Plant

NUMBERS = ("lower", "mu", "decay", "kappa", "weight", "ratio", "kappa_mu")

OFF = 2.0**-23
"""By how much, relatively, weights in float32 may be off: eigenvalues of L then are, too, and no more (L' <= (1 + OFF) L)."""


@dataclass(frozen=True, eq=False)
class SampledModalWitness:
    """P of each segment of [lower, upper] and of the mean, one mu, t of A, B, C, D, and the numbers of `Witness`."""

    segments: tuple[Segment, ...]
    P_mean: Annotated[np.ndarray, "n_m n_m"]
    t: Annotated[np.ndarray, " 4"]
    lower: float
    mu: float
    decay: float
    kappa: float
    weight: float = 0.0
    ratio: float = math.inf
    kappa_mu: float = math.inf

    @property
    def ends(self) -> tuple[float, ...]:
        """Where the segments begin and end."""
        return (self.lower, *(one.upper for one in self.segments))

    def covers(self, lower: float, upper: float) -> bool:
        """Tell whether the segments follow each other from `lower` at most to `upper` at least."""
        ends = self.ends
        rising = len(ends) > 1 and all(a <= b for a, b in pairwise(ends))
        return rising and 0 < ends[0] <= lower and upper <= ends[-1]

    def of(self, P: Annotated[np.ndarray, "n_x n_x"], loop: SampledLoop) -> Witness:
        """Return the witness of one mode."""
        t = np.array([self.t[LETTERS.index(way.letter)] for way in loop.ways])
        numbers = (self.decay, self.kappa, self.weight, self.ratio, self.kappa_mu)
        return Witness(P, np.array([self.mu]), t, *numbers)


@dataclass(frozen=True, eq=False)
class ModalLoop:
    """Identical sampled controllers on a graph, or on every graph, with its spectrum in [lower, upper].

    network: the agents, with the coordinates of `single_difference`;  controllers: one per agent, or one that stands for
    all, with the most neighbours and weights as large as there can be.
    """

    network: SampledNetwork
    controllers: tuple[HeldController, ...]
    lower: float
    upper: float

    def __post_init__(self) -> None:
        """Check that the agents and their controllers are alike."""
        first, plant = self.controllers[0], self.network.plant
        same = all(np.array_equal(one.table, first.table) for one in self.controllers)
        demand(same, "they differ", "gains", "the same for all agents, with a modal witness")
        alike = all(np.array_equal(B, plant.B[0]) for B in plant.B)
        demand(alike, "the agents have input matrices of their own", "sampled loop", "one B for all agents")

    def deltas(self, letter: str) -> float:
        """Return the bound on e of A or C over x_C,k, or of B or D over C x_k: sqrt(2) b delta, rounded up."""
        most = max(one.errors[letter].delta for one in self.controllers)
        if letter in "AC":
            return most
        one = exact(most) * exact(self.upper)
        return spectral_bound(np.array([[one, one]], dtype=object))

    def at(
        self, value: float, noise: Annotated[np.ndarray, " q"] = NO_NOISE, *, exact: bool = True
    ) -> SampledLoop:
        """Return the mode of an eigenvalue lambda; the one of 0 is the mean of the controllers."""
        plant = self.network.plant.in_numbers(exact)
        one, first = eye(1, plant.A), self.controllers[0]
        n, m, q, r, v = plant.sizes
        if value == 0:
            n, A = 0, plant.A
            B, C = (zeros(0, m, A),), zeros(q, 0, A)
            plant, noise = Plant(zeros(0, 0, A), B, C, zeros(0, r, A), zeros(v, 0, A)), np.zeros(0)
        network = replace(self.network, plant=plant, d=single_difference(one))
        number, n_C, noisy = converter(exact), first.order, np.flatnonzero(noise)
        widths = {"x": n, "x_C": n_C, "last": m if network.delay else 0}
        widths |= {k: n_C if k in "AB" else m for k in LETTERS}
        at = Columns(widths | {"zeta": q, "mu": n_C + m, "nu": len(noisy)}, one)
        seen = plant.C @ at.rows("x") if n else zeros(q, at.width, one)
        seen[noisy] = seen[noisy] + number(noise[noisy])[:, None] * at.rows("nu")
        differences = number(np.array([value]))[0] * seen
        received = np.vstack([at.rows("x_C"), differences + at.rows("zeta")])
        rows = step_rows(first, received, at.rows("mu"), {k: at.rows(k) for k in LETTERS})
        states, u = rows[:n_C], rows[n_C:]
        applied = at.rows("last") if network.delay else u
        ways = tuple(
            way_of(first, 0, k, at.of[k], at.rows("x_C") if k in "AC" else seen)._replace(
                delta=self.deltas(k)
            )
            for k in LETTERS
            if widths[k]
        )
        advanced = np.vstack([states, u]) if network.delay else states
        return SampledLoop(
            network, self.controllers[:1], n, at.of["last"].stop, plant.B[0], applied, advanced, ways, (received,),
            at.of["zeta"], at.of["mu"], at.of["nu"], applied, u, differences,
        )  # fmt: skip


def decide_modal_sampled(loop: ModalLoop, witness: SampledModalWitness | None) -> certificate.SampledVerdict:
    """Decide the sampled nonlinear loop, every rounding included, for every lambda in [lower, upper], by a stored witness."""
    network, at = loop.network, f"at {loop.network.period:g} s"
    if witness is None:
        return certificate.refused(network, loop.controllers, f"{at} there is no witness")
    if not witness.covers(loop.lower, loop.upper):
        said = f"the witness is for eigenvalues from {witness.lower:g} to {witness.ends[-1]:g}"
        said += f", not from {loop.lower:g} to {loop.upper:g}"
        return certificate.refused(network, loop.controllers, said)
    with balls.working_precision():
        for P, mode in _modes(loop, witness):
            one = certificate.lifted_agent(mode)
            if not certificate.proves(mode, one, witness.of(P, mode)):
                said = certificate.TOO_LONG if one is None else "no candidate survived the proof"
                return certificate.refused(network, loop.controllers, f"{at} {said}")
    return _accepted(loop, witness)


def proves_modal_rho(loop: ModalLoop, weights: Performance, rho: float, witness: SampledModalWitness) -> bool:
    """Decide in balls whether a witness (decay 1, no weight) proves a rho of the sampled loop for every such lambda."""
    if not witness.covers(loop.lower, loop.upper):
        return False
    none = np.zeros((0, 0))
    for P, mode in _modes(loop, witness, weights.outputs):
        # The mean of the controllers weighs what it is and what it applies: no x is part of it.
        own = weights if mode.n_d else weights._replace(R=none, states=np.zeros(0))
        if not proves_rho(mode, own, rho, witness.of(P, mode)):
            return False
    return True


def _modes(
    loop: ModalLoop, witness: SampledModalWitness, noise: Annotated[np.ndarray, " q"] = NO_NOISE
) -> Iterator[tuple[Annotated[np.ndarray, "n_x n_x"], SampledLoop]]:
    """Yield both ends of each segment with its P, and the mean of the controllers."""
    for start, segment in zip(witness.ends, witness.segments, strict=False):
        for value in (start, segment.upper):
            yield segment.P, loop.at(value, noise)
    yield witness.P_mean, loop.at(0.0)


def _accepted(loop: ModalLoop, witness: SampledModalWitness) -> certificate.SampledVerdict:
    """State what follows; of one controller that stands for all, for the root of the mean square over the agents."""
    kappa = max(len(one.sources) for one in loop.controllers) * Fraction(witness.kappa)
    for letter in "BD":
        delta = max(one.errors[letter].delta for one in loop.controllers)
        kappa += 2 * Fraction(float(witness.t[LETTERS.index(letter)])) * Fraction(delta) ** 2
    full = replace(witness, kappa=certificate.ROUNDED_UP * -rounded_down(-kappa))
    said = "no conjugate point in the period, P > 0 and Omega > 0 at the ends of every segment, decided in ball arithmetic"
    bounds = full.of(np.zeros((0, 0)), loop.at(0.0))
    return certificate.accepted(loop.network, loop.controllers, bounds, said, witness)


def common_controller(
    table: Annotated[np.ndarray, "k l"], order: int, spectrum: SpectrumRange, real: str
) -> HeldController:
    """Return one controller that stands for all on graphs with a spectrum up to b, with the most neighbours.

    sum_j a_ij^2 <= (b / 2) sum_j a_ij <= b^2 / 2, since the largest in-degree is below lambda_N: so many equal weights,
    none of them 1, have the square sum b^2 / 2 or more, and each product is rounded. Fewer neighbours round less.
    """
    neighbours = spectrum.neighbours
    weight = certificate.ROUNDED_UP * spectrum.upper / math.sqrt(2 * neighbours)
    weight = math.nextafter(weight, math.inf) if weight == 1 else weight
    sources = tuple(range(1, neighbours + 1))
    return HeldController.row_by_row(table, order, sources, np.full(neighbours, weight), PRECISIONS[real])


def modal_loop(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    spectrum: tuple[float, float] | None,
    ends: tuple[float, float] | None,
    graph: Digraph,
) -> ModalLoop:
    """Return the loop of every graph with a spectrum, or of the one graph whose modes a certificate of rho covers.

    Args:
        network: in the coordinates of `single_difference`.
        controllers: as in the code.
        spectrum: of many graphs; then the graph does not count.
        ends: of the eigenvalues that the certificate was decided to cover; None where it is none of modes.
        graph: one graph.

    Raises:
        ProblemError: a graph that does not split into modes once its weights are rounded.
    """
    if spectrum is not None:
        return ModalLoop(network, controllers, *spectrum)
    where = "the modal witness of the sampled loop"
    demand(ends is not None, "the certificate is none of modes", where, "a modal one")
    plain = max(metric(graph)) == 1 and are_rounded(controllers, graph.edges)
    demand(plain, "L is not symmetric with the weights in the code", where, "an undirected graph")
    return ModalLoop(network, controllers, *widened(*ends or (0.0, 0.0)))


def widened(lower: float, upper: float) -> tuple[float, float]:
    """Return the ends of an interval of eigenvalues with weights that may be off by OFF, rounded outwards."""
    return math.nextafter((1 - OFF) * lower, 0.0), math.nextafter((1 + OFF) * upper, math.inf)


def are_rounded(controllers: Sequence[HeldController], edges: Sequence[tuple[int, int, float]]) -> bool:
    """Tell whether the controllers' weights are those of the edges, symmetric, none off by more than OFF of itself."""
    given = {(i - 1, j - 1): a for i, j, a in edges}
    heard = [(i, zip(one.sources, one.weights, strict=True)) for i, one in enumerate(controllers)]
    theirs = {(i, j): float(a) for i, row in heard for j, a in row}
    return given.keys() == theirs.keys() and all(
        abs(Fraction(theirs[key]) - Fraction(a)) <= Fraction(OFF) * Fraction(a)
        and theirs[key] == theirs.get((key[1], key[0]))
        for key, a in given.items()
    )
