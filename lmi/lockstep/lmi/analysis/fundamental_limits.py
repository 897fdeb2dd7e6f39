"""What no controller can do, said before any search: limits that follow from the agent alone.

Order 0: A_cl = A_0 + sum_i U_i D_i Y_i has the trace (N - 1) tr A + sum_i l_ii tr(D_i C B_i). Where C B_i = 0 for every
agent that hears somebody, no D_i moves it, and with tr A >= 0 some mode never decays. This is decided in rationals.

Any order: the disagreement is N - 1 copies of one agent, so a certificate for any controllers, however connected, is
one for a single agent with a full-order controller (see `floor.projected`): with V' >= 0 otherwise,

    N_C' (A'X + X A) N_C, X G, H' bordered by -gamma diag(I, I)   < 0,
    N_B' (A Y + Y A') N_B, Y H', G  bordered by -gamma diag(I, I) < 0,      [X I; I Y] >= 0,

and the largest alpha is 1 / gamma for the least gamma (Gahinet and Apkarian 1994). This figure comes from a solver: a
problem is refused only where `floor.bisection.proves_that_none_carries` its alpha.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import exactly
from lockstep.check.system.loop import Plant
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.model.network import Network

SIZES = (1e4, 1e6)
"""Traces that X and Y may have. Where gamma has no positive lower bound it falls with them, and there is no limit."""

SETTLED = 1e-2
"""By how much the gammas of the two sizes may differ, relative to them, and still count as a limit."""


def static_gains_cannot_stabilise(network: Network) -> bool:
    """Tell, exactly, whether the trace of A_cl is (N - 1) tr A >= 0 whatever the static gains are.

    >>> from lockstep.model.agents.agent import Agent
    >>> from lockstep.model.graphs.graph import Graph
    >>> cart = Agent.from_expressions("cart", states=["p", "v"], inputs=["f"], outputs={"y": "p"},
    ...                               dynamics={"p": "v", "v": "f"})
    >>> static_gains_cannot_stabilise(Network(cart, Graph.topology("path", 3)))
    True
    """
    plant = network.plant
    heard = [exactly(B) for B, degree in zip(plant.B, network.graph.in_degrees, strict=True) if degree]
    C = exactly(plant.C)
    moved = any(entry != 0 for B in heard for entry in (C @ B).ravel())
    return not moved and sum(np.diag(exactly(plant.A))) >= 0


def largest_alpha_of_any_controller(network: Network) -> float:
    """Return about the largest alpha that any controllers can certify, computed; infinite where no limit is seen."""
    plant = network.plant
    if not plant.G.shape[1] or not plant.H.shape[0]:
        return float("inf")
    small, large = (_least_gamma(plant, size) for size in SIZES)
    if small is None or large is None or abs(large - small) > SETTLED * small:
        return float("inf")
    return 1 / large


def _least_gamma(plant: Plant, size: float) -> float | None:
    """Return the least L2 gain from w to H x for x' = A x + B u + G w, y = C x; None where the solver finds none."""
    import cvxpy as cp
    from scipy.linalg import null_space

    A, C, G, H = plant.A, plant.C, plant.G, plant.H
    n, r, v = len(A), G.shape[1], H.shape[0]
    N_B, N_C = null_space(np.hstack(plant.B).T), null_space(C)
    X, Y = cp.Variable((n, n), symmetric=True), cp.Variable((n, n), symmetric=True)
    gamma = cp.Variable()
    primal = _bordered(N_C, A.T @ X + X @ A, X @ G, H.T, gamma * np.eye(r), gamma * np.eye(v))
    dual = _bordered(N_B, A @ Y + Y @ A.T, Y @ H.T, G, gamma * np.eye(v), gamma * np.eye(r))
    coupled = cp.bmat([[X, np.eye(n)], [np.eye(n), Y]])
    conditions = [primal << 0, dual << 0, coupled >> 0, cp.trace(X) <= size, cp.trace(Y) <= size]
    problem = cp.Problem(cp.Minimize(gamma), conditions)
    return float(gamma.value) if solve_sdp(problem) and gamma.value is not None else None


def _bordered(
    basis: Float[np.ndarray, "n k"], head: Any, a: Any, b: Any, corner_a: Any, corner_b: Any
) -> Any:
    """Return [basis' head basis, basis' a, basis' b; *, -corner_a, 0; *, 0, -corner_b], symmetrised."""
    import cvxpy as cp

    head, a, b = basis.T @ head @ basis, basis.T @ a, basis.T @ b
    empty = np.zeros((a.shape[1], b.shape[1]))
    whole = cp.bmat([[head, a, b], [a.T, -corner_a, empty], [b.T, empty.T, -corner_b]])
    return (whole + whole.T) / 2
