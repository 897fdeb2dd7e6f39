"""A network as the checker knows it: the matrices of the agents, who listens to whom, and the coordinates of the claim."""

from dataclasses import dataclass, field

from lockstep.check.errors import demand
from lockstep.check.system.disagreement import Coordinates, disagreement
from lockstep.check.system.graph import Digraph
from lockstep.check.system.loop import Loop, Plant, build_loop


@dataclass(frozen=True, eq=False)
class ExactNetwork:
    """N agents x_i' = A x_i + B_i u_i + G phi(H x_i, t) + xi_i, y_i = C x_i on a graph (2), (4).

    Args:
        plant: A, B_i, C, G, H, with G and H scaled as the bound on phi was proved; doubles are taken exactly.
        graph: who listens to whom; it must have a spanning tree.
        coordinates: "orthonormal" (default) or "laplacian_rows" (the paper's (14)).
        decay: sigma, in 1/s: the loop is then that of e^(sigma t) x_cl, with A_0 + sigma I in place of A_0, and what is
            proved of it is proved of x_cl with that decay: V' + 2 sigma V in place of V'.
        spectrum: [a, b] where every connected undirected graph with its nonzero eigenvalues there is meant; `graph` is
            then one of them, of which nothing is decided, and there is no loop of one graph.

    Raises:
        ProblemError: no spanning tree, or matrices that do not fit each other or the graph.
    """

    plant: Plant
    graph: Digraph
    coordinates: Coordinates = "orthonormal"
    decay: float = 0.0
    spectrum: tuple[float, float] | None = None
    _loops: dict[tuple[int, bool], Loop] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self.graph.check_spanning_tree()

    @property
    def N(self) -> int:
        """Number of agents."""
        return self.graph.N

    def decaying(self, decay: float) -> "ExactNetwork":
        """Return the network of e^(decay t) x_cl."""
        return ExactNetwork(self.plant, self.graph, self.coordinates, decay, self.spectrum)

    def loop(self, order: int, *, exact_arithmetic: bool) -> Loop:
        """Return the loop (15) for controllers of an order, in doubles or in the same rationals."""
        remedy = "name a graph, or decide mode by mode"
        one = self.spectrum is None
        demand(one, "`spectrum` stands for many graphs", "[network]", "one graph for a loop of all", remedy)
        key = (order, exact_arithmetic)
        if key not in self._loops:
            d = disagreement(self.graph, self.coordinates, exact_arithmetic=exact_arithmetic)
            self._loops[key] = build_loop(self.plant.in_numbers(exact_arithmetic), d, order, self.decay)
        return self._loops[key]
