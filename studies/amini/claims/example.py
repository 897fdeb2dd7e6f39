"""The paper's example: (38), (39), Table 1 and Table 2 as printed, and its loop in any coordinates.

Facts of Amini, Azarbahram and Sojoodi, with which the claims are measured.
"""

from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.disagreement import Coordinates, disagreement
from lockstep.check.system.loop import Gains, Loop, Plant, build_loop
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

Source = Literal["theorem_1", "corollary_1"]

ALPHA = 3.33
"""Bound of -3.33 sin(theta_l) in (38)."""

DELTA = np.array([0.5, 0.2, 0.2, 0.2])
"""(delta_A, delta_B, delta_C, delta_D) of Section 4."""

A = np.array([[0.0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]])
B = np.array([[0.0], [21.6], [0.0], [0.0]])
C = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0]])
G = np.array([[0.0], [0.0], [0.0], [1.0]])
H = np.array([[0.0, 0, 1, 0]])

TABLE_1: dict[Source, Gains] = {
    "theorem_1": Gains(
        A=(
            np.array([[-1.1021, 0.0447], [0.0453, -1.0901]]),
            np.array([[-1.0819, 0.0649], [0.0645, -1.0628]]),
            np.array([[-1.121, 0.019], [0.019, -1.122]]),
        ),
        B=(
            np.array([[0.1262, 0.4236], [-1.1873, -1.1258]]),
            np.array([[-0.2333, -0.1823], [0.3441, 0.4822]]),
            np.array([[-0.0115, -0.01522], [-0.0069, -0.0027]]),
        ),
        C=(np.array([[-0.0163, 0.1477]]), np.array([[0.0364, -0.0339]]), np.array([[0.0011, 0.0007]])),
        D=(np.array([[-0.4987, -0.5512]]), np.array([[-0.4951, -0.5681]]), np.array([[0.009, 0.011]])),
    ),
    "corollary_1": Gains(
        A=(
            np.array([[-1.818, -0.0097], [-0.0099, -1.859]]),
            np.array([[-1.8164, -0.0087], [-0.0087, -1.8167]]),
            np.array([[-1.8184, -0.0103], [-0.0104, -1.8174]]),
        ),
        B=(
            np.array([[-0.0066, -0.0078], [-0.0082, -0.0088]]),
            np.array([[-0.0066, -0.0089], [-0.0069, -0.0038]]),
            np.array([[0.0012, 0.0044], [0.0015, 0.0059]]),
        ),
        C=(
            np.array([[0.508e-3, 0.639e-3]]),
            np.array([[0.627e-3, 0.641e-3]]),
            np.array([[0.415e-3, 0.371e-3]]),
        ),
        D=(np.array([[-0.739, -0.823]]), np.array([[-0.741, -0.853]]), np.array([[0.003, 0.009]])),
    ),
}
"""Case (I), Theorem 1, and case (II), Corollary 1."""

INDICES = ("ISE", "IAE", "ITSE", "ITAE")

TABLE_2: dict[str, Float[np.ndarray, "3 4"]] = {
    "theorem_1": np.array(
        [[1.703, 1.306, 0.563, 0.721], [0.457, 0.807, 0.259, 0.644], [0.0028, 0.052, 0.000892, 0.029]]
    ),
    "reference_25": np.array(
        [[334.8, 5.870, 4.656, 1.115], [171.4, 5.628, 5.538, 1.210], [148.7, 3.038, 1.319, 0.341]]
    ),
}
"""Indices of the control effort, one row per agent, columns as `INDICES`."""


@cache
def arm() -> Agent:
    """Return the agent (38)."""
    return Agent.from_expressions(
        "arm",
        states=["theta_m", "omega_m", "theta_l", "omega_l"],
        inputs=["u"],
        dynamics={
            "theta_m": "omega_m",
            "omega_m": "-48.6*theta_m - 1.25*omega_m + 48.6*theta_l + 21.6*u",
            "theta_l": "omega_l",
            "omega_l": "19.5*theta_m - 19.5*theta_l - 3.33*sin(theta_l)",
        },
        outputs={"y1": "theta_m", "y2": "omega_m"},
    )


@cache
def cycle() -> Graph:
    """Return the graph of (39): 1 listens to 2, 2 to 3, 3 to 1."""
    return Graph.topology("cycle", 3)


def network(coordinates: Coordinates = "orthonormal") -> Network:
    """Return the network of Section 4, its nonlinearity with the structure G = e_4, H = e_3'."""
    return Network(arm(), cycle(), coordinates=coordinates)


def loop(
    *,
    order: int = 2,
    structured: bool = True,
    coordinates: Coordinates = "laplacian_rows",
    exact_arithmetic: bool = False,
) -> Loop:
    """Return the loop (15); unstructured is G = H = I, the paper's H_hat = I_8."""
    plant = Plant(A, (B,) * 3, C, G if structured else np.eye(4), H if structured else np.eye(4))
    d = disagreement(cycle(), coordinates, exact_arithmetic=exact_arithmetic)
    return build_loop(plant.in_numbers(exact_arithmetic), d, order)


def claim(alpha: float = ALPHA, delta: float = 0.0, order: int = 2) -> Claim:
    """Return the claim of Section 4 with R = I, Q = 2 I and a fraction of its delta."""
    return Claim(alpha, np.eye(4), 2 * np.eye(order), np.tile(delta * DELTA, (3, 1)))


def slope(value: float) -> Float[np.ndarray, "14 14"]:
    """Return what phi = value * theta_l in all agents adds to A_cl."""
    added = np.zeros((14, 14))
    added[:8, :8] = value * np.kron(np.eye(2), G @ H)
    return added


def abscissa(matrix: Float[np.ndarray, "n n"]) -> float:
    """Return max Re lambda."""
    return float(np.linalg.eigvals(matrix).real.max())
