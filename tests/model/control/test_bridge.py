"""The bridge to python-control: the same poles, the same trajectories, names that join by themselves."""

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.from_control import agent_from_control
from lockstep.model.control.bridge import controllers_to_control
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.simulation import Scenario, simulate
from lockstep.model.simulation.disturbance import Sines

GAINS = Gains(
    # Table 1 (II) of the paper, with D of agent 3 that of agent 1 so that every agent acts.
    A=(np.array([[-1.818, -0.0097], [-0.0099, -1.859]]),) * 3,
    B=(
        np.array([[-0.0066, -0.0078], [-0.0082, -0.0088]]),
        np.array([[0.5, -0.2], [0.1, 0.3]]),
        np.ones((2, 2)),
    ),
    C=(np.array([[0.508, 0.639]]), np.array([[0.627, 0.641]]), np.array([[-0.4, 0.3]])),
    D=(np.array([[-0.739, -0.823]]), np.array([[-0.741, -0.853]]), np.array([[-0.739, -0.823]])),
)


def arm(**changes: object) -> Agent:
    given = {
        "name": "arm",
        "states": ["theta_m", "omega_m", "theta_l", "omega_l"],
        "inputs": ["u"],
        "dynamics": {
            "theta_m": "omega_m",
            "omega_m": "-48.6*theta_m - 1.25*omega_m + 48.6*theta_l + 21.6*u",
            "theta_l": "omega_l",
            "omega_l": "19.5*theta_m - 19.5*theta_l - 3.33*sin(theta_l)",
        },
        "outputs": {"y1": "theta_m", "y2": "omega_m"},
    }
    return Agent.from_expressions(**{**given, **changes})


def network(coordinates: str = "orthonormal", **changes: object) -> Network:
    return Network(arm(**changes), Graph.topology("cycle", 3), coordinates=coordinates)


def sorted_poles(values: np.ndarray) -> np.ndarray:
    return np.array(sorted(values, key=lambda s: (round(s.real, 7), round(s.imag, 7))))


def test_an_agent_keeps_its_names_and_its_right_hand_side() -> None:
    system = arm().to_control()
    assert system.name == "arm"
    assert system.state_labels == ["theta_m", "omega_m", "theta_l", "omega_l"]
    assert (system.input_labels, system.output_labels) == (["u"], ["y1", "y2"])
    x = np.array([0.1, -0.2, 0.7, 0.4])
    expected = [
        -0.2,
        -48.6 * 0.1 + 1.25 * 0.2 + 48.6 * 0.7 + 21.6 * 0.5,
        0.4,
        19.5 * 0.1 - 19.5 * 0.7 - 3.33 * np.sin(0.7),
    ]
    np.testing.assert_allclose(system.dynamics(0.0, x, np.array([0.5])), expected, rtol=1e-14)
    np.testing.assert_array_equal(system.output(0.0, x, np.array([0.5])), x[:2])


def test_time_reaches_the_right_hand_side() -> None:
    driven = Agent.from_expressions(
        "cart", states=["p"], inputs=["f"], dynamics={"p": "f + sin(t)*cos(p)"}, outputs={"p": "p"}
    ).to_control()
    np.testing.assert_allclose(
        driven.dynamics(0.5, np.array([0.2]), np.array([0.0])), np.sin(0.5) * np.cos(0.2), rtol=1e-14
    )


@pytest.mark.parametrize("coordinates", ["orthonormal", "laplacian_rows"])
def test_the_exported_loop_has_the_poles_of_the_symbolic_one(coordinates: str) -> None:
    net = network(coordinates)
    exported = net.to_control(GAINS, linear=True)
    symbolic = np.linalg.eigvals(net.loop(2).A_cl(GAINS.blocks))
    np.testing.assert_allclose(sorted_poles(exported.poles()), sorted_poles(symbolic), rtol=1e-9, atol=1e-9)
    other = Gains(GAINS.A, GAINS.B, GAINS.C, tuple(1.01 * D for D in GAINS.D))
    moved = net.to_control(other, linear=True).poles()
    assert np.abs(sorted_poles(moved) - sorted_poles(symbolic)).max() > 1e-4


def test_the_poles_with_agreement_are_those_of_the_interconnection() -> None:
    """Built twice: eig of the joined full system is eig(A_cl) and, for the motion in agreement, eig(A)."""
    net = network()
    whole = control.interconnect(
        [net.to_control(linear=True), *net.controllers_to_control(GAINS)], check_unused=False
    )
    expected = [*net.to_control(GAINS, linear=True).poles(), *np.linalg.eigvals(net.agent.lure.A)]
    np.testing.assert_allclose(sorted_poles(whole.poles()), sorted_poles(np.array(expected)), atol=1e-7)


def test_the_disagreement_system_is_the_linear_network_seen_in_orthonormal_coordinates() -> None:
    """Frequency response from xi to x of the full network, projected on the complement of 1 by hand."""
    net = network()
    reduced = net.to_control(GAINS, linear=True)
    n, T = 4, np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
    L, lure, s = net.graph.laplacian, net.agent.lure, 1.3j
    K = [
        C @ np.linalg.solve(s * np.eye(2) - A, B) + D
        for A, B, C, D in zip(GAINS.A, GAINS.B, GAINS.C, GAINS.D, strict=True)
    ]
    feedback = np.zeros((12, 12), dtype=complex)
    for i in range(3):
        feedback[i * n : (i + 1) * n] = lure.B @ K[i] @ np.kron(L[i : i + 1], lure.C)
    full = np.linalg.inv(s * np.eye(12) - np.kron(np.eye(3), lure.A) - feedback)
    by_hand = np.kron(T, np.eye(n)) @ full @ np.kron(T.T, np.eye(n))
    exported = reduced(s)[:8, :8]
    np.testing.assert_allclose(
        np.linalg.svd(exported, compute_uv=False), np.linalg.svd(by_hand, compute_uv=False), rtol=1e-9
    )


def test_phi_enters_and_leaves_the_disagreement_system_where_the_model_says() -> None:
    net = network()
    system = net.to_control(GAINS, linear=True)
    assert system.input_labels[8:] == ["d1_w1", "d2_w1"]
    assert system.output_labels[8:10] == ["d1_v1", "d2_v1"]
    np.testing.assert_array_equal(system.B[:8, 8:], np.kron(np.eye(2), net.plant.G))
    np.testing.assert_array_equal(system.C[8:10, :8], np.kron(np.eye(2), net.plant.H))


def disturbance(t: float) -> np.ndarray:
    return 0.3 * np.sin(1.7 * t + np.arange(12.0))


def test_the_exported_loop_moves_as_the_symbolic_one() -> None:
    """input_output_response against DOP853 on Network.closed_loop, 1e-6."""
    net, horizon = network(), 3.0
    x0 = np.concatenate([np.linspace(-0.8, 0.9, 12), np.linspace(0.1, -0.2, 6)])
    f = net.closed_loop(GAINS)

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        dx, dx_C, _ = f(x[:12], x[12:], t, disturbance(t))
        return np.concatenate([np.asarray(dx).ravel(), np.asarray(dx_C).ravel()])

    ours = solve_ivp(rhs, (0.0, horizon), x0, method="DOP853", rtol=1e-10, atol=1e-12, t_eval=[1.0, 2.0, 3.0])
    # python-control interpolates the input linearly: 1e-4 s keeps that error below 1e-8.
    times = np.linspace(0.0, horizon, 30_001)
    options = {"rtol": 1e-9, "atol": 1e-11, "max_step": 0.05}
    theirs = control.input_output_response(
        net.to_control(GAINS),
        times,
        disturbance(times[None, :].T).T,
        x0,
        solve_ivp_kwargs=options,
        t_eval=[0.0, 1.0, 2.0, 3.0],
    )
    np.testing.assert_allclose(theirs.outputs[:12, 1:], ours.y[:12], atol=1e-6)
    np.testing.assert_allclose(theirs.outputs[12:18, -1], ours.y[[0, 1, 4, 5, 8, 9], -1], atol=1e-6)
    u = np.asarray(f(ours.y[:12, -1], ours.y[12:, -1], 3.0, np.zeros(12))[2]).ravel()
    np.testing.assert_allclose(theirs.outputs[18:, -1], u, atol=1e-5)
    without = solve_ivp(
        lambda t, x: rhs(t, x) - 3.33e-3 * np.eye(18)[11] * np.sin(x[10]),
        (0.0, horizon),
        x0,
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    )
    assert np.abs(without.y[:12, -1] - theirs.outputs[:12, -1]).max() > 1e-5


def test_the_exported_loop_moves_as_our_simulation() -> None:
    """input_output_response against `simulate`, with a sine as disturbance, 1e-6."""
    net, horizon, frequency = network(), 3.0, 0.4
    start = np.linspace(-0.8, 0.9, 12).reshape(3, 4)
    amplitude = np.linspace(0.1, 0.3, 12).reshape(3, 4)
    sines = Sines(amplitude, np.zeros((3, 4)), frequency)
    ours = simulate(net, GAINS, Scenario(start, horizon, step=0.01, disturbance=sines))
    times = np.linspace(0.0, horizon, 30_001)
    theirs = control.input_output_response(
        net.to_control(GAINS),
        times,
        sines.at(times, times).reshape(len(times), 12).T,
        np.concatenate([start.ravel(), np.zeros(6)]),
        solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-11, "max_step": 0.05},
        t_eval=ours.t,
    )
    difference = np.abs(theirs.outputs[:12] - ours.x.reshape(-1, 12).T).max()
    assert difference < 1e-6
    assert np.abs(theirs.outputs[12:18] - ours.y.reshape(-1, 6).T).max() < 1e-6
    quiet = simulate(net, GAINS, Scenario(start, horizon, step=0.01))
    assert np.abs(theirs.outputs[:12] - quiet.x.reshape(-1, 12).T).max() > 1e-3


def test_network_and_controllers_join_by_name_to_the_closed_loop() -> None:
    net = network()
    parts = [net.to_control(), *net.controllers_to_control(GAINS)]
    inputs = [f"arm{i}_xi_{s}" for i in (1, 2, 3) for s in net.agent.states]
    joined = control.interconnect(parts, inputs=inputs, outputs=["arm1_u", "arm3_y2"], check_unused=False)
    closed = net.to_control(GAINS)
    x = np.concatenate([np.linspace(-0.8, 0.9, 12), np.linspace(0.1, -0.2, 6)])
    xi = np.linspace(1.0, 2.0, 12)
    np.testing.assert_allclose(
        joined.dynamics(0.0, x, xi), closed.dynamics(0.0, x, xi), rtol=1e-12, atol=1e-12
    )
    out = closed.output(0.0, x, xi)
    wanted = [out[closed.output_labels.index(name)] for name in ("arm1_u", "arm3_y2")]
    np.testing.assert_allclose(joined.output(0.0, x, xi), wanted, rtol=1e-12)


@pytest.mark.parametrize("method", ["tustin", "zoh"])
def test_sampled_controllers_have_their_period_and_the_right_response(method: str) -> None:
    T, w = 0.01, 3.0
    sampled = network().controllers_to_control(GAINS, period=T, method=method)[1]
    assert sampled.dt == T
    assert sampled.isdtime(strict=True)
    assert sampled.input_labels == ["arm2_r_y1", "arm2_r_y2"]
    A, B, C, D = GAINS.A[1], GAINS.B[1], GAINS.C[1], GAINS.D[1]
    z = np.exp(1j * w * T)
    if method == "tustin":  # the continuous response at s = 2/T (z - 1)/(z + 1)
        expected = C @ np.linalg.solve(2 / T * (z - 1) / (z + 1) * np.eye(2) - A, B) + D
    else:
        from scipy.linalg import expm

        A_d = expm(A * T)
        expected = C @ np.linalg.solve(z * np.eye(2) - A_d, np.linalg.solve(A, A_d - np.eye(2)) @ B) + D
    np.testing.assert_allclose(sampled(z), expected, rtol=1e-9)


def test_gains_of_sampled_controllers_are_taken_as_they_are() -> None:
    system = controllers_to_control(arm(), GAINS, period=0.005)[0]
    np.testing.assert_array_equal(system.A, GAINS.A[0])
    assert system.dt == 0.005


def test_static_controllers_work() -> None:
    gains = Gains.from_blocks(np.stack(GAINS.D), 0)
    net = network()
    for options in ({}, {"period": 0.1, "method": "tustin"}):
        np.testing.assert_array_equal(net.controllers_to_control(gains, **options)[2].D, GAINS.D[2])
    np.testing.assert_allclose(
        sorted_poles(net.to_control(gains, linear=True).poles()),
        sorted_poles(np.linalg.eigvals(net.loop(0).A_cl(gains.blocks))),
        atol=1e-9,
    )


def test_bode_and_step_response_take_the_exports() -> None:
    net = network()
    reduced = net.to_control(GAINS, linear=True)
    response = control.frequency_response(reduced, [0.1, 1.0, 10.0])
    assert response.magnitude.shape == (reduced.noutputs, reduced.ninputs, 3)
    step = control.step_response(reduced["d1_theta_l", "d1_xi_theta_l"], T=np.linspace(0.0, 1.0, 20))
    assert np.isfinite(step.outputs).all()
    s = 2.0j
    one = control.frequency_response(arm().to_control(linear=True), [2.0])
    # By elimination: theta_l = 19.5/(s^2 + 19.5) theta_m, and the motor carries the spring's torque.
    by_hand = 21.6 / (s**2 + 1.25 * s + 48.6 - 48.6 * 19.5 / (s**2 + 19.5))
    assert one.magnitude[0, 0, 0] == pytest.approx(abs(by_hand), rel=1e-10)
    assert one.magnitude[1, 0, 0] == pytest.approx(abs(s * by_hand), rel=1e-10)


def test_a_linear_agent_comes_back_double_by_double() -> None:
    linear = arm().to_control(linear=True)
    agent = agent_from_control(linear)
    again = agent.to_control(linear=True)
    for letter in "ABCD":
        np.testing.assert_array_equal(getattr(again, letter), getattr(linear, letter))
    assert (again.name, again.state_labels) == ("arm", linear.state_labels)
    assert (again.input_labels, again.output_labels) == (linear.input_labels, linear.output_labels)
    assert agent.lure.is_linear


def test_control_s_own_names_become_names() -> None:
    generator = np.random.default_rng(4)
    A, B, C = generator.normal(size=(3, 3)), generator.normal(size=(3, 2)), generator.normal(size=(1, 3))
    agent = agent_from_control(control.ss(A, B, C, np.zeros((1, 2))), name="plant")
    assert (agent.states, agent.inputs, agent.outputs) == (("x_0", "x_1", "x_2"), ("u_0", "u_1"), ("y_0",))
    np.testing.assert_array_equal(agent.lure.A, A)
    np.testing.assert_array_equal(agent.lure.B, B)


@pytest.mark.parametrize(
    ("system", "says"),
    [
        (lambda: control.ss([[1.0]], [[1.0]], [[1.0]], [[1.0]]), "D is not zero"),
        (lambda: control.ss([[1.0]], [[1.0]], [[1.0]], [[0.0]], 0.1), "dt = 0.1"),
        (lambda: control.tf([1.0], [1.0, 1.0]), "TransferFunction"),
        (lambda: arm().to_control(), "NonlinearIOSystem"),
    ],
)
def test_what_is_no_agent_is_refused(system: object, says: str) -> None:
    with pytest.raises(ProblemError) as raised:
        agent_from_control(system(), name="plant")
    assert says in str(raised.value)


def test_gains_that_do_not_fit_are_refused() -> None:
    other = arm(outputs={"y1": "theta_m"})
    with pytest.raises(ProblemError, match="`D` is 1 x 2"):
        controllers_to_control(other, GAINS)
    with pytest.raises(ProblemError, match="without a period"):
        controllers_to_control(arm(), GAINS, method="tustin")


def test_symbolic_and_exported_disagreement_matrices_agree_in_gain() -> None:
    """|E| and |E_G| keep their form under the change of coordinates: a check of F x_d itself."""
    net = network()
    loop, system = net.loop(2), net.to_control(GAINS, linear=True)
    F = np.linalg.cholesky(as_floats(loop.d.S)).T
    T = np.kron(F, np.eye(4)) @ as_floats(loop.E[:8]) @ np.linalg.inv(np.kron(F, np.eye(4)))
    np.testing.assert_allclose(system.B[:8, :8], T, atol=1e-14)
