"""Controllers to generate code from: the paper's arms (Table 1, Corollary 1), and random ones."""

import numpy as np

from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant, Neighbour, Signal

# Table 1, Corollary 1: [A_C B_C; C_C D_C] of the three agents
TABLE_1 = [
    (
        [[-1.818, -0.0097], [-0.0099, -1.859]],
        [[-0.0066, -0.0078], [-0.0082, -0.0088]],
        [[0.000508, 0.000639]],
        [[-0.739, -0.823]],
    ),
    (
        [[-1.8164, -0.0087], [-0.0087, -1.8167]],
        [[-0.0066, -0.0089], [-0.0069, -0.0038]],
        [[0.000627, 0.000641]],
        [[-0.741, -0.853]],
    ),
    (
        [[-1.8184, -0.0103], [-0.0104, -1.8174]],
        [[0.0012, 0.0044], [0.0015, 0.0059]],
        [[0.000415, 0.000371]],
        [[0.003, 0.009]],
    ),
]
# (38) without its sine
ARM = (
    [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]],
    [[0], [21.6], [0], [0]],
    np.eye(2, 4),
)


def arms(**options):
    """The three arms on the directed cycle (39), with the plants' linear parts for closed-loop data."""
    agents = tuple(
        Controller(
            f"arm{i + 1}",
            *gains,
            (Neighbour(f"arm{(i + 1) % 3 + 1}"),),
            (Signal("theta_m", "rad"), Signal("omega_m", "rad/s")),
            (Signal("u", "V"),),
        )
        for i, gains in enumerate(TABLE_1)
    )
    plants = tuple(LinearPlant(*ARM, np.array([0.3 * i, 0, 0.2 - 0.1 * i, 0])) for i in range(3))
    return CodegenSpec(**{"agents": agents, "period": 0.005, "name": "arms", "plants": plants, **options})


def random_controller(name, order, outputs, inputs, neighbours=2, seed=0, zeros=0.2):
    """A stable controller with some zero, unit and minus-unit gains, which the kernel prints specially."""
    random = np.random.default_rng([seed, order, outputs, inputs])
    A = random.normal(size=(order, order)) - (2 + order) * np.eye(order)
    B, C, D = (random.normal(size=shape) for shape in ((order, outputs), (inputs, order), (inputs, outputs)))
    for M in (A, B, C, D):
        M[random.random(M.shape) < zeros] = 0.0
        M[random.random(M.shape) < 0.1] = random.choice([1.0, -1.0, 2.0])
    sources = tuple(Neighbour(f"peer{j}", w) for j, w in enumerate(random.uniform(0.1, 3, neighbours)))
    return Controller(name, A, B, C, D, sources)


def shapes(orders, outputs, inputs, **options):
    """One folder with an agent of every shape; the number of neighbours goes from 0 to 3."""
    agents = tuple(
        random_controller(f"c{n}{q}{m}", n, q, m, neighbours=(n + q + m) % 4)
        for n in orders
        for q in outputs
        for m in inputs
    )
    return CodegenSpec(agents, **{"period": 0.01, "discretization": "zoh", "name": "shapes", **options})
