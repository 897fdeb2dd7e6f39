"""The floor: closed forms, the arms' 1.97, and that no certificate is below it."""

from dataclasses import replace

import numpy as np
import pytest
from flint import fmpq
from floor_cases import floor, plain
from lmi_cases import ALPHA, arms, claim, published

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.inequality import Claim
from lockstep.check.floor.witness import proves_floor
from lockstep.check.numbers import exactly
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.decimals import round_down
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.floor.bisection import largest_floor, proves_that_none_carries
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import exact_network, network_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem

BELOW = 5e-3
"""How far below a closed form a floor may stay: bisection and four digits leave 0.3 %."""


def network(
    dynamics: dict[str, str],
    outputs: dict[str, str],
    B: tuple[np.ndarray, ...] = (),
    inputs: tuple[str, ...] = ("u",),
) -> Network:
    agent = Agent.from_expressions(
        "a", states=list(dynamics), inputs=inputs, dynamics=dynamics, outputs=outputs
    )
    return Network(agent, Graph.topology("cycle", 3), B)


CHAIN = network({"x": "v", "v": "u"}, {"y1": "x", "y2": "v"})
UNACTUATED = network({"x": "u", "z": "-z + 0.5*sin(z)"}, {"y1": "x", "y2": "z"})
UNMEASURED = network({"x": "u", "z": "-z + 0.5*sin(z) + w"}, {"y": "x"}, inputs=("u", "w"))
ALMOST_Z = np.diag([1e-6, 1.0])


@pytest.mark.parametrize(
    ("posed", "alpha", "R", "least"),
    [
        # x'' = u + xi_2, x' = v + xi_1, full state: unlimited gain on v makes v the input of x' = v + xi_1. The game
        # min over v of integral (x^2 + v^2 - rho^2 xi^2) has the Riccati equation 1 - p^2 (1 - 1/rho^2) = 0: rho > 1.
        (CHAIN, 0.0, np.eye(2), 1.0),
        (CHAIN, 0.0, 0.25 * np.eye(2), 0.5),  # the cost is as many times larger
        (CHAIN, 0.0, 4.0 * np.eye(2), 2.0),
        # z' = -z + phi + xi with |phi| <= |z| / 2 out of reach of u: the gain is 1 / (1 - 1/2). Only the dual side speaks.
        (UNACTUATED, 0.5, ALMOST_Z, 2.0),
        # The same where z is not measured and its own input never knows: only the primal side speaks.
        (UNMEASURED, 0.5, ALMOST_Z, 2.0),
        (UNMEASURED, 0.0, ALMOST_Z, 1.0),
    ],
)
def test_closed_forms(posed: Network, alpha: float, R: np.ndarray, least: float) -> None:
    found = floor(posed, plain(3, alpha, R))
    assert least * (1 - BELOW) <= found <= least


@pytest.mark.parametrize(
    ("w", "d", "s"), [(1.0, 1.0, 1.0), (0.25, 4.0, 1.0), (4.0, 0.0, 0.5), (0.0, 1.0, 3.0), (1.0, 2.0, 2.0)]
)
def test_noise_weighed_inputs_and_scaled_disturbances(w: float, d: float, s: float) -> None:
    """x' = u + s xi, y = x + sqrt(d) nu, cost x^2 + w u^2: X^2 (1/w - s^2 / rho^2) = 1, Y^2 (1/d - 1 / rho^2) = s^2 and
    X Y < rho^2 (Doyle, Glover, Khargonekar and Francis, IEEE TAC 34, 1989) leave rho^2 > s^2 w + d.
    """
    scalar = network({"x": "u"}, {"y": "x"})
    weighed = replace(
        plain(3, 0.0, np.eye(1)), W=w * np.eye(1), outputs=np.array([np.sqrt(d)]), states=np.array([s])
    )
    least = np.sqrt(s * s * w + d)
    assert least * (1 - BELOW) <= floor(scalar, weighed) <= least * (1 + 1e-15)


def least_with_all_states(A: np.ndarray, E: np.ndarray, B: np.ndarray, W: np.ndarray) -> float:
    """Of any u that sees x and xi: the least gamma for which A'X + X A + I + X (E E'/gamma^2 - B W^-1 B') X = 0 has a
    stabilising X >= 0 (Doyle, Glover, Khargonekar and Francis, IEEE TAC 34, 1989), by its Hamiltonian matrix.
    """
    n, low, high = len(A), 1e-3, 1e3
    while high / low > 1 + 1e-6:
        gamma = float(np.sqrt(low * high))
        S = E @ E.T / gamma**2 - B @ np.linalg.inv(W) @ B.T
        values, vectors = np.linalg.eig(np.block([[A, S], [-np.eye(n), -A.T]]))
        stable = vectors[:, values.real < -1e-9]
        X = stable[n:] @ np.linalg.inv(stable[:n]) if stable.shape[1] == n else None
        carries = X is not None and np.linalg.eigvalsh((X + X.conj().T).real / 2).min() > -1e-9
        low, high = (low, gamma) if carries else (gamma, high)
    return high


@pytest.mark.parametrize("seen", ["p", "p + f"])
def test_what_is_known_in_the_end_without_noise(seen: str) -> None:
    """A load at the rate v alone, and no noise on the place p: v = p' is known, and f, which forgets at what it began.

    No dual point is strict unless what is known is left out of the kernel of C: no floor was found.
    """
    posed = network({"p": "v", "v": "u - 4*p - v", "f": "v - f"}, {"y": seen})
    asked = replace(plain(3, 0.0, np.eye(3)), W=np.array([[0.01]]), states=np.array([0.0, 1.0, 0.0]))
    plant = posed.plant
    least = least_with_all_states(plant.A, np.eye(3)[:, 1:2], plant.B[0], asked.W)
    assert least * (1 - BELOW) <= floor(posed, asked) <= least * (1 + 1e-6)


def test_what_nothing_drives_is_known_in_the_end() -> None:
    """x' = u + z + xi, z' = -z: of z nothing is left, and rho^2 > w + d as without it."""
    posed = network({"x": "u + z", "z": "-z"}, {"y": "x"})
    asked = replace(
        plain(3, 0.0, np.eye(2)), W=np.array([[0.25]]), outputs=np.array([2.0]), states=np.array([1.0, 0.0])
    )
    least = np.sqrt(0.25 + 4.0)
    assert least * (1 - BELOW) <= floor(posed, asked) <= least


@pytest.mark.parametrize("own", [False, True])
def test_inputs_that_are_weighed_together(own: bool) -> None:
    """x' = u + w + xi with u'W u: the cheapest u + w = v costs v^2 / (b W^-1 b'), b = [1, 1]: 1/20, and rho^2 > 1/20.

    With a B of its own one agent has three quarters of v by u: all may use all columns, whose sum of b W^-1 b' counts.
    """
    W, rows = np.array([[1.0, -0.9], [-0.9, 1.0]]), [np.array([[1.0, 1.0]])] * 3
    if own:
        rows[2] = np.array([[0.75, 1.0]])
    scalar = network({"x": "u + w"}, {"y": "x"}, tuple(rows) if own else (), inputs=("u", "w"))
    every = rows if own else rows[:1]
    least = 1 / np.sqrt(sum(float((b @ np.linalg.inv(W) @ b.T)[0, 0]) for b in every))
    asked = replace(plain(3, 0.0, np.eye(1)), W=W)
    assert least * (1 - BELOW) <= floor(scalar, asked) <= least
    gains = np.tile(-16.0 * np.ones((2, 1)), (3, 1, 1))
    whole = Network(scalar.agent, Graph.topology("complete", 3), scalar.B)
    certain = prove(whole, Gains.from_blocks(gains, 0), asked)
    assert floor(whole, asked) <= certain.rho
    assert certain.rho < 0.25
    witness = largest_floor(whole.matrices, asked)
    assert witness is not None
    for unfit in (-W, np.array([[1.0, 1.0], [1.0, 1.0]])):
        assert not proves_floor(whole.matrices, replace(asked, W=unfit), witness)


def test_inputs_that_weigh_something_in_other_coordinates() -> None:
    """|T u| may be above |u| in the rows of the Laplacian: no input counts as weighed there, and noise does."""
    scalar, asked = network({"x": "u"}, {"y": "x"}), plain(3, 0.0, np.eye(1))
    rows = replace(scalar, coordinates="laplacian_rows")
    weighed, noisy = replace(asked, W=np.eye(1)), replace(asked, outputs=np.ones(1))
    assert floor(scalar, weighed) > 1 - BELOW
    assert (floor(rows, weighed), floor(rows, noisy)) == (0.0, floor(scalar, noisy))


TWO_SLOPES = network({"x": "u", "z": "-z + 0.5*sin(z) + 0.01*sin(x)"}, {"y1": "x", "y2": "z"})


def of_two_slopes() -> Claim:
    arguments = [int(np.flatnonzero(row)[0]) for row in TWO_SLOPES.agent.lure.H]
    entries = tuple(Entry(0, k, (0.01, 0.5)[state]) for k, state in enumerate(arguments))
    return replace(plain(3, 0.6, ALMOST_Z), entries=entries)


def test_slopes_of_their_own_count_at_their_worst() -> None:
    """z' = -z + J_z z + J_x x + xi with |J_z| <= 1/2 and x at will: 1 / (1 - 1/2) at J_z = 1/2; without phi 1."""
    assert 2 * (1 - BELOW) <= floor(TWO_SLOPES, of_two_slopes()) <= 2


def test_slopes_beyond_the_claim_prove_nothing() -> None:
    asked = of_two_slopes()
    witness = largest_floor(TWO_SLOPES.matrices, asked)
    assert witness is not None
    assert witness.slopes is not None
    assert proves_floor(TWO_SLOPES.matrices, asked, witness)
    narrow = [replace(one, bound=min(one.bound, 0.4)) for one in asked.entries]
    assert not proves_floor(TWO_SLOPES.matrices, replace(asked, entries=tuple(narrow)), witness)
    assert not proves_floor(TWO_SLOPES.matrices, replace(asked, alpha=0.4), witness)
    for slopes in (
        None,
        (),
        witness.slopes[:1],
        (*witness.slopes, 0.0),
        tuple(2 * J for J in witness.slopes),
    ):
        assert not proves_floor(TWO_SLOPES.matrices, asked, replace(witness, slopes=slopes))


def test_the_floor_of_the_arms() -> None:
    """1.97 to three digits was measured apart from this code; published gains are far above it."""
    found = floor(arms(), plain(3, ALPHA, np.eye(4)))
    assert 1.965 * (1 - 2 * BELOW) <= found <= 1.975
    least = least_rho(arms().loop(2), published().blocks, claim(arms(), 2, ALPHA))
    assert least is not None
    assert found < least.rho


def test_the_rows_of_the_laplacian_have_the_same_floor() -> None:
    """The statement is about one agent: no coordinates enter it."""
    rows = arms(coordinates="laplacian_rows")
    witness = largest_floor(arms().matrices, plain(3, ALPHA, np.eye(4)))
    assert witness is not None
    assert proves_floor(rows.matrices, plain(3, ALPHA, np.eye(4)), witness)


def test_the_floor_is_of_the_rationals_of_the_file() -> None:
    """Thirds and sevenths are no doubles: a witness for the nearest of them need not be one for the agents of the file."""
    problem = Problem.parse(
        '[agent]\nstates = ["x", "v"]\ninputs = ["u"]\noutputs = { y = "x" }\n'
        'dynamics = { x = "v", v = "-x/3 - v/7 + u/7 + sin(x)/11" }\n'
        '[network]\nagents = 3\ntopology = "cycle"\n[design]\norder = 1'
    )
    posed = network_of(problem, proved_bound(problem))
    exact = exact_network(problem, posed)
    assert exact.plant.A.tolist() == [[0, 1], [fmpq(-1, 3), fmpq(-1, 7)]]
    assert (exactly(posed.plant.A) != exact.plant.A).any()
    asked = claim_of(problem, proved_bound(problem))
    witness = largest_floor(exact, asked)
    assert witness is not None
    assert proves_floor(exact, asked, witness)


def test_where_gains_reach_everything_there_is_no_floor() -> None:
    """x' = u + x with outputs x, 2 x, -3 x: a solver's error once stood here as 0.01429, with a design of 0.003579 below."""
    scalar = network({"x": "u + x"}, {"y1": "x", "y2": "2*x", "y3": "-3*x"})
    gains = np.tile(-300.0 * np.array([[[1.0, 0.0, 0.0]]]), (3, 1, 1))
    certain = Claim(0.0, np.eye(1), np.zeros((0, 0)), np.zeros((3, 4)))
    proved = prove(scalar, Gains.from_blocks(gains, 0), certain)
    assert proved.rho < 0.01429
    assert largest_floor(scalar.matrices, plain(3, 0.0, np.eye(1))) is None
    assert largest_floor(scalar.matrices, plain(3, 0.0, np.eye(1)), certified=proved.rho) is None


@pytest.mark.slow
def test_more_alpha_and_more_weight_raise_the_floor() -> None:
    posed = arms()
    assert (
        floor(posed, plain(3, 0.0, np.eye(4)))
        < floor(posed, plain(3, ALPHA, np.eye(4)))
        < floor(posed, plain(3, 2 * ALPHA, np.eye(4)))
    )
    assert floor(posed, plain(3, ALPHA, 4 * np.eye(4))) == pytest.approx(
        2 * floor(posed, plain(3, ALPHA, np.eye(4))), rel=BELOW
    )


def test_different_inputs_are_pooled() -> None:
    """B_1 and B_2 each reach one state, together both: the floor may use both for every agent."""
    unit = np.eye(2)
    dynamics, outputs = {"x": "x + u", "z": "z"}, {"y1": "x", "y2": "z"}
    pooled = network(dynamics, outputs, (unit[:, :1], unit[:, 1:], unit[:, :1]))
    assert floor(pooled, plain(3, 0.0, np.eye(2))) == 0.0
    # Alone, z' = z is out of reach of all of them: every rho is excluded, and so the largest that is tried.
    assert floor(network(dynamics, outputs), plain(3, 0.0, np.eye(2))) > 1e4


def test_an_alpha_that_none_carries_and_one_that_some_do() -> None:
    """z' = -z + phi, out of reach: |phi| <= alpha |z| allows phi = alpha z, which is stable for alpha < 1 only."""
    assert proves_that_none_carries(UNACTUATED.matrices, plain(3, 1.01, np.eye(2)))
    assert not proves_that_none_carries(UNACTUATED.matrices, plain(3, 0.99, np.eye(2)))
    assert proves_that_none_carries(UNMEASURED.matrices, plain(3, 1.01, np.eye(2)))
    assert not proves_that_none_carries(UNMEASURED.matrices, plain(3, 0.99, np.eye(2)))


def test_a_floor_is_rounded_down() -> None:
    for rho in (1.9999, 1.0, 123456.0, 9.999999e-7, 0.00123449):
        assert rho * (1 - 1e-3) <= round_down(rho) <= rho
