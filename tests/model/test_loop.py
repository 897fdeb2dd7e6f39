"""The reduced loop (15) against slow assemblies of (2), (9) and (14), and the gains' own checks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, null_space

from lockstep.check.continuous.inequality import Claim, performance_weight
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats, converter
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Gains, Loop, Plant, build_loop
from lockstep.model.graphs.graph import Graph

ARM = Plant(
    A=np.array([[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]),  # (38)
    B=(np.array([[0.0], [21.6], [0.0], [0.0]]),) * 3,
    C=np.eye(2, 4),
    G=np.array([[0.0], [0.0], [0.0], [1.0]]),
    H=np.array([[0.0, 0.0, 1.0, 0.0]]),
)
CYCLE = Graph.topology("cycle", 3)


def random_case(
    seed: int, N: int, n: int, m: int, q: int, order: int, r: int = 1
) -> tuple[Plant, Graph, Gains]:
    """Integers in quarters throughout, so that doubles and rationals must agree to the bit."""
    generator = np.random.default_rng(seed)

    def entries(*shape: int) -> np.ndarray:
        return generator.integers(-8, 9, size=shape) / 4.0

    plant = Plant(
        entries(n, n), tuple(entries(n, m) for _ in range(N)), entries(q, n), entries(n, r), entries(r, n)
    )
    a = generator.integers(0, 3, size=(N, N)) / 2.0
    np.fill_diagonal(a, 0.0)
    for i in range(1, N):
        a[i, i - 1] = 1.0
    shapes = ((order, order), (order, q), (m, order), (m, q))
    return plant, Graph(a), Gains(*(tuple(entries(*shape) for _ in range(N)) for shape in shapes))


def full_loop(plant: Plant, L: np.ndarray, gains: Gains) -> np.ndarray:
    """The linear part of (12), all agents, before any reduction: written with Kronecker products on (x, x_C)."""
    N = len(L)
    B, Lq = block_diag(*plant.B), np.kron(L, plant.C)
    blocks = [block_diag(*getattr(gains, letter)) for letter in "ABCD"]
    shapes = [(N * rows, N * columns) for rows, columns in _gain_shapes(gains)]
    A, B_C, C_C, D = (block.reshape(shape) for block, shape in zip(blocks, shapes, strict=True))
    return np.block([[np.kron(np.eye(N), plant.A) + B @ D @ Lq, B @ C_C], [B_C @ Lq, A]])


def _gain_shapes(gains: Gains) -> list[tuple[int, int]]:
    return [getattr(gains, letter)[0].shape for letter in "ABCD"]


def orthonormal_loop(plant: Plant, L: np.ndarray, gains: Gains) -> np.ndarray:
    """(14), (15) in an orthonormal T, with the pseudo-inverse for C_r: another road to the same poles."""
    N, n = len(L), plant.A.shape[0]
    T = null_space(np.ones((1, N))).T
    big = block_diag(np.kron(T, np.eye(n)), np.eye(gains.order * N))
    return big @ full_loop(plant, L, gains) @ np.linalg.pinv(big)


@pytest.mark.parametrize("coordinates", ["orthonormal", "laplacian_rows"])
@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32),
    N=st.integers(2, 4),
    n=st.integers(1, 3),
    m=st.integers(1, 2),
    q=st.integers(1, 2),
    order=st.integers(0, 2),
)
def test_the_reduced_loop_is_the_disagreement_of_the_full_one(
    coordinates: str, seed: int, N: int, n: int, m: int, q: int, order: int
) -> None:
    """(T x, x_C)' = A_cl (T x, x_C) for every (x, x_C): not a pole comparison but the equation itself."""
    plant, graph, gains = random_case(seed, N, n, m, q, order)
    loop = build_loop(plant, disagreement(graph, coordinates), order)
    to_x_cl = block_diag(np.kron(loop.d.T, np.eye(n)), np.eye(order * N)).reshape(loop.n_x, (n + order) * N)
    np.testing.assert_allclose(
        loop.A_cl(gains.blocks) @ to_x_cl, to_x_cl @ full_loop(plant, graph.laplacian, gains), atol=1e-8
    )


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32), N=st.integers(2, 4), order=st.integers(0, 2), q=st.integers(1, 2))
def test_exact_and_float_loops_are_the_same(seed: int, N: int, order: int, q: int) -> None:
    plant, graph, gains = random_case(seed, N, 2, 1, q, order)
    exact = build_loop(plant.in_numbers(True), disagreement(graph, exact_arithmetic=True), order)
    floats = build_loop(plant, disagreement(graph), order)
    assert exact.exact
    assert not floats.exact
    for name in ("A_0", "E"):
        np.testing.assert_array_equal(as_floats(getattr(exact, name)), getattr(floats, name))
    exact_A = as_floats(exact.A_cl(converter(True)(gains.blocks)))
    np.testing.assert_allclose(exact_A, floats.A_cl(gains.blocks), rtol=1e-13, atol=1e-13)
    assert exact.E.shape == (2 * (N - 1) + order * N, 2 * (N - 1))


PUBLISHED = Gains(  # Table 1 of the paper, Corollary 1
    A=tuple(
        np.array(a)
        for a in (
            [[-1.818, -0.0097], [-0.0099, -1.859]],
            [[-1.8164, -0.0087], [-0.0087, -1.8167]],
            [[-1.8184, -0.0103], [-0.0104, -1.8174]],
        )
    ),
    B=tuple(
        np.array(b)
        for b in (
            [[-0.0066, -0.0078], [-0.0082, -0.0088]],
            [[-0.0066, -0.0089], [-0.0069, -0.0038]],
            [[0.0012, 0.0044], [0.0015, 0.0059]],
        )
    ),
    C=tuple(np.array(c) for c in ([[0.000508, 0.000639]], [[0.000627, 0.000641]], [[0.000415, 0.000371]])),
    D=tuple(np.array(d) for d in ([[-0.739, -0.823]], [[-0.741, -0.853]], [[0.003, 0.009]])),
)


def test_the_arms_with_the_published_gains() -> None:
    """Abscissa -0.965, measured independently in the reference; the poles of a slow orthonormal twin are the same."""
    loop = build_loop(ARM, disagreement(CYCLE), 2)
    reduced = np.linalg.eigvals(loop.A_cl(PUBLISHED.blocks))
    twin = np.linalg.eigvals(orthonormal_loop(ARM, CYCLE.laplacian, PUBLISHED))
    np.testing.assert_allclose(np.sort_complex(reduced), np.sort_complex(twin), rtol=1e-6)
    assert reduced.real.max() == pytest.approx(-0.965, abs=5e-4)


def test_without_gains_the_disagreement_of_the_arms_does_not_settle() -> None:
    """(38) has det A = 0: a motor and link turned by the same angle stay there."""
    loop = build_loop(ARM, disagreement(CYCLE), 0)
    assert abs(np.linalg.eigvals(loop.A_cl(np.zeros((3, 1, 2)))).real.max()) < 1e-6


def test_A_cl_is_affine_in_each_agent_s_own_gains_only() -> None:
    plant, graph, gains = random_case(7, 3, 2, 2, 1, 1)
    loop = build_loop(plant, disagreement(graph), 1)
    K, step = gains.blocks, np.random.default_rng(1).standard_normal(gains.blocks.shape)
    both = loop.A_cl(K + step) - loop.A_cl(K)
    apart = sum(loop.U[i] @ step[i] @ loop.Y[i] for i in range(3))
    np.testing.assert_allclose(both, apart, atol=1e-12)
    # Agent 2's controller states are moved by no other agent's gains.
    moved = loop.A_cl(K + step * np.array([1, 0, 1])[:, None, None]) - loop.A_cl(K)
    assert not moved[loop.E.shape[1] + 1].any()


def test_weights_of_the_disagreement_leave_the_controllers_alone() -> None:
    loop: Loop = build_loop(ARM, disagreement(CYCLE), 2)
    weight = performance_weight(loop, Claim(0.0, np.ones((4, 4)), np.zeros((2, 2)), np.zeros((3, 4))))
    assert weight[:8, :8].all()
    assert not weight[8:].any()


def test_gains_and_their_blocks() -> None:
    _, _, gains = random_case(3, 3, 2, 2, 1, 2)
    again = Gains.from_blocks(gains.blocks, 2)
    for letter in "ABCD":
        for a, b in zip(getattr(gains, letter), getattr(again, letter), strict=True):
            np.testing.assert_array_equal(a, b)
    assert (gains.N, gains.order) == (3, 2)


@pytest.mark.parametrize(
    ("letter", "block", "says"),
    [
        ("A", np.zeros((2, 1)), "`A` is 2 x 1"),
        ("B", np.zeros((1, 2)), "`B` is 1 x 2"),
        ("C", np.zeros((1, 2)), "`C` is 1 x 2"),
        ("D", np.zeros((2, 1)), "`D` is 2 x 1"),
        ("D", np.array([[np.nan]]), "not finite"),
        ("A", np.array([[np.inf]]), "not finite"),
    ],
)
def test_gains_that_do_not_fit_are_refused(letter: str, block: np.ndarray, says: str) -> None:
    one = np.ones((1, 1))
    blocks = {key: [one, one] for key in "ABCD"}
    Gains(**{key: tuple(value) for key, value in blocks.items()})
    blocks[letter][1] = block
    with pytest.raises(ProblemError, match="gains of agent 2") as error:
        Gains(**{key: tuple(value) for key, value in blocks.items()})
    assert says in str(error.value)


def test_gains_for_unequal_numbers_of_agents_are_refused() -> None:
    one = np.ones((1, 1))
    with pytest.raises(ProblemError, match="one A, B, C and D per agent"):
        Gains((one,), (one, one), (one,), (one,))
    with pytest.raises(ProblemError):
        Gains((), (), (), ())
