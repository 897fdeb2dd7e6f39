"""The sampled loop for python-control: against brute force in other coordinates, fast sampling, and closed forms."""

from pathlib import Path

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.check.sampled.discretise import sampled_controllers as held_controllers
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.model.control.hybrid import Hybrid

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def arms() -> lockstep.Design:
    return lockstep.load(ROOT / "generated" / "flexible_joint_arms")


def nearest(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest distance from an expected pole to the one found that is paired with it."""
    left, worst = list(found), 0.0
    for pole in expected:
        k = int(np.argmin([abs(pole - other) for other in left]))
        worst = max(worst, abs(pole - left.pop(k)))
    return worst


def brute_force(design: lockstep.Design) -> np.ndarray:
    """One period of all N agents, column by column: u from the tables in the C, then e^(A T), agents side by side."""
    network, T = design.network, design.problem.controller.period
    held = sampled_controllers(design.stored, T)
    n, N, order, lure = network.agent.n, network.N, held[0].order, network.agent.lure
    M = np.zeros((N * (n + order),) * 2)
    for column, start in enumerate(np.eye(len(M))):
        x, x_C = start[: N * n].reshape(N, n), start[N * n :].reshape(N, order)
        for i, one in enumerate(held):
            r = sum(a * (lure.C @ (x[i] - x[j])) for j, a in zip(one.sources, one.weights, strict=True))
            out = one.table @ np.concatenate([x_C[i], np.broadcast_to(r, lure.C.shape[:1])])
            u = out[order:]
            whole = np.block([[lure.A, (network.B[i] @ u)[:, None]], [np.zeros((1, n + 1))]])
            M[i * n : (i + 1) * n, column] = (expm(whole * T) @ np.append(x[i], 1.0))[:n]
            M[N * n + i * order : N * n + (i + 1) * order, column] = out[:order]
    return M


def test_poles_of_the_sampled_arms_are_those_of_the_brute_force_to_1e_12(arms):
    system = arms.to_control(sampled=True)
    assert system.dt == 0.005
    # The agents side by side have, beside the disagreement, the common motion: e^(A T).
    common = np.exp(np.linalg.eigvals(arms.network.agent.lure.A) * 0.005)
    expected = np.linalg.eigvals(brute_force(arms))
    assert nearest(expected, np.concatenate([system.poles(), common])) < 1e-12
    other = arms.loop(period=0.006).closed().poles()
    assert nearest(other, system.poles()) > 1e-4


def test_a_delay_of_one_period_holds_the_input_before():
    """A double integrator pair, u = -(y_1 - y_2) and alike: by hand, with u computed one period ago in the state."""
    from lockstep.check.system.loop import Gains
    from lockstep.model import Agent, Graph, Network
    from lockstep.model.control.ports import PortedLoop

    cart = Agent.from_expressions(
        "cart", states=["p", "v"], inputs=["f"], outputs={"y1": "p", "y2": "v"}, dynamics={"p": "v", "v": "f"}
    )
    none = np.zeros((0, 0))
    gains = Gains(
        (none,) * 2, (np.zeros((0, 2)),) * 2, (np.zeros((1, 0)),) * 2, (np.array([[-1.0, -2.0]]),) * 2
    )
    held = held_controllers(gains, Graph.topology("complete", 2).edges, 0.1, "tustin", "float64")
    late = PortedLoop(Network(cart, Graph.topology("complete", 2)), held, 0.1, 1)
    # d = p_1 - p_2: d'' = f_1 - f_2 = -2 (d + 2 d') of one period ago, which is w.
    T = 0.1
    by_hand = np.array([[1, T, T**2 / 2], [0, 1, T], [-2, -4, 0]])
    # The sum of the two inputs is remembered too, and moves nothing: a pole at 0.
    assert nearest(np.append(np.linalg.eigvals(by_hand), 0.0), late.closed().poles()) < 1e-12


def test_one_period_is_what_an_integrator_makes_of_it(arms):
    """DOP853 over one period from random states, u from the tables: another way than the exponential."""
    loop, rng = arms.loop(), np.random.default_rng(1)
    system, held = loop.closed(), loop.controllers
    plant = loop.parts[0]
    state = rng.normal(size=system.nstates)
    z, x_C = state[: plant.nstates], state[plant.nstates :].reshape(3, -1)
    signals = dict(zip(plant.output_labels, plant.C @ z, strict=True))
    u = np.concatenate(
        [
            (one.table @ [*x_C[i], *(signals[s] for s in loop.relative_outputs_of(i + 1))])[one.order :]
            for i, one in enumerate(held)
        ]
    )
    run = solve_ivp(
        lambda _, z: plant.A @ z + plant.B[:, :3] @ u, (0, 0.005), z, method="DOP853", rtol=1e-13, atol=1e-14
    )
    after = system.A @ state
    np.testing.assert_allclose(after[: plant.nstates], run.y[:, -1], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(system.output(0.0, state)[-3:], u, rtol=1e-12)


def test_a_network_with_its_period_joins_with_sampled_controllers_by_name(arms):
    """control.interconnect itself, which refuses the continuous network."""
    controllers = arms.controllers_to_control(period=0.005, method="tustin")
    with pytest.raises(ValueError, match="time"):
        control.interconnect([arms.network.to_control(linear=True), *controllers], check_unused=False)
    whole = control.interconnect([arms.network.to_control(period=0.005), *controllers], check_unused=False)
    # These are not rounded to float32: 1e-4 apart. control.interconnect differences: 1e-8.
    assert nearest(whole.poles(), np.linalg.eigvals(brute_force(arms))) < 2e-4
    with pytest.raises(ProblemError, match="a period and gains"):
        arms.network.to_control(arms.gains, period=0.005)


PLANT = dict(inputs=["w", "u", "v"], outputs=["y", "z"], states=["p", "q"])


def two_rates() -> Hybrid:
    """A plant of two modes, a fast inner controller and a slow outer one with a state."""
    plant = control.ss(
        [[0.0, 1.0], [-4.0, -0.4]], [[0.0, 0.0, 0.5], [1.0, 1.0, 0.0]], np.eye(2), np.zeros((2, 3)), **PLANT
    )
    fast = control.ss([], [], [], [[-0.8]], 0.05, inputs="z", outputs="u")
    slow = control.ss(0.5, 0.3, 1.0, -0.4, 0.2, inputs="y", outputs="v", states="s")
    return Hybrid([plant, fast, slow], ["w"], ["y"])


def stepped(w, horizon: float, h: float, start=(0.0, 0.0, 0.0)) -> np.ndarray:
    """y on a grid, by hand: two controllers and RK4."""
    p, q, s = start
    u = v = 0.0
    out = []
    for k in range(round(horizon / h)):
        t = k * h
        if k % round(0.2 / h) == 0:
            v, s = s - 0.4 * p, 0.5 * s + 0.3 * p
        if k % round(0.05 / h) == 0:
            u = -0.8 * q
        out.append(p)

        def f(x, u=u, v=v, t=t):
            return np.array([x[1] + 0.5 * v, -4 * x[0] - 0.4 * x[1] + u + w(t)])

        x = np.array([p, q])
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        p, q = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(out)


def test_two_rates_have_the_period_of_the_slower_and_the_poles_of_a_simulated_one():
    loop = two_rates()
    assert loop.dt == 0.2
    assert [one.fires for one in loop.intervals] == [(0, 1), (1,), (1,), (1,)]
    columns = []
    for start in np.eye(3):
        p, q, s = start
        v, s = s - 0.4 * p, 0.5 * s + 0.3 * p
        x = np.array([p, q])
        for _ in range(4):
            u = -0.8 * x[1]
            whole = np.zeros((3, 3))
            whole[:2, :2], whole[:2, 2] = [[0, 1], [-4, -0.4]], [0.5 * v, u]
            x = (expm(whole * 0.05) @ np.append(x, 1))[:2]
        columns.append([*x, s])
    assert nearest(loop.poles(), np.linalg.eigvals(np.array(columns).T)) < 1e-12


def test_responses_between_samples_are_those_of_a_simulation():
    loop, h = two_rates(), 0.01
    t = np.arange(300) * h
    w = np.where(t < 1.0, 1.0, -0.5)
    found = loop.response(t, w[None, :], [0.3, -0.1, 0.2])
    by_hand = stepped(lambda at: 1.0 if at < 1.0 - 1e-9 else -0.5, 3.0, h, (0.3, -0.1, 0.2))
    assert isinstance(found, control.TimeResponseData)
    np.testing.assert_allclose(found.outputs[0], by_hand, atol=1e-8)
    np.testing.assert_allclose(
        loop.response([0.0, 0.03, 0.2, 0.31], 1.0).outputs[0],
        [0.0, *np.interp([0.03, 0.2, 0.31], np.arange(3100) * 1e-3, stepped(lambda _: 1.0, 3.1, 1e-3))],
        atol=1e-6,
    )


def fast_sampled_gain(loop: Hybrid, parts: int) -> float:
    """The norm by force: w held on `parts` pieces of each interval and y taken at their middles, lifted to one period.

    (Keller and Anderson 1992: fast sampling and fast hold converge to the norm.)
    """
    F, G = loop.field()
    H, _ = loop.rows(loop.outputs)
    steps = []
    for fires, length in loop.intervals:
        J, h = loop.jump(fires)[0], length / parts
        whole = np.block([[F, G], [np.zeros((1, len(F) + 1))]])
        full, half = expm(whole * h), expm(whole * h / 2)
        first = [M[: len(F), : len(F)] @ J for M in (full, half)]
        later = [M[: len(F), : len(F)] for M in (full, half)]
        steps += [(*first, full, half), *[(*later, full, half)] * (parts - 1)]
    n, K = len(F), len(steps)
    A, B, C, D = np.eye(n), np.zeros((n, K)), np.zeros((K, n)), np.zeros((K, K))
    for k, (Phi, middle, full, half) in enumerate(steps):
        C[k], D[k] = H @ middle @ A, H @ middle @ B
        D[k, k] += (H @ half[:n, n:]).item()
        A, B = Phi @ A, Phi @ B
        B[:, k] += full[:n, n]
    z = np.exp(1j * np.linspace(0, np.pi, 2000))
    return max(np.linalg.norm(C @ np.linalg.solve(point * np.eye(n) - A, B) + D, 2) for point in z)


def test_the_l2_norm_is_that_of_many_held_pieces():
    loop = two_rates()
    assert fast_sampled_gain(loop, 10) == pytest.approx(loop.norm(), rel=1e-3)


def test_norms_tend_to_the_continuous_ones_and_to_the_period_s_own():
    """1/(s + a) under u = -k y(t_k): continuous limits 1/(a + k) and 1/sqrt(2 (a + k))."""
    plant = control.ss(-1.0, [[1.0, 1.0]], 1.0, 0.0, inputs=["w", "u"], outputs="y")

    def loop(T: float) -> Hybrid:
        return Hybrid([plant, control.ss([], [], [], -2.0, T, inputs="y", outputs="u")], ["w"], ["y"])

    assert loop(1e-4).norm() == pytest.approx(1 / 3, rel=1e-3)
    assert loop(1e-4).norm(2) == pytest.approx(1 / np.sqrt(6), rel=1e-3)
    # By hand, T = 0.5: impulses at tau, x(T) = e^-(T - tau); then x+ = (e^-T - 2 (1 - e^-T)) x, energies by quadrature.
    T, f = 0.5, lambda t: np.exp(-t) - 2 * (1 - np.exp(-t))
    grid = (np.arange(20_000) + 0.5) * T / 20_000
    period = np.sum(f(grid) ** 2) * T / 20_000 / (1 - f(T) ** 2)
    inside = np.sum((1 - np.exp(-2 * (T - grid))) / 2) / 20_000
    after = np.sum(np.exp(-2 * (T - grid))) / 20_000 * period
    assert loop(0.5).norm(2) == pytest.approx(np.sqrt(inside + after), rel=1e-6)


def test_the_norm_of_the_arms_keeps_to_the_proved_rho(arms):
    """phi = 0 is within every sector: the L2 norm of the linear part is at most the proved sampled rho."""
    loop = arms.loop()
    x_d = loop.outputs[:8]
    found = arms.hybrid(loop.disturbances[:8], x_d).norm()
    assert 0.5 * arms.sampled["rho"] < found <= arms.sampled["rho"]


def test_loops_that_close_again(arms):
    """control.feedback(L, I) has the loop's own poles, wherever it was opened."""
    for loop in (arms.loop(), arms.loop(sampled=False)):
        expected = loop.closed().poles()
        for signals in (
            loop.inputs_of(1),
            loop.inputs_of(),
            loop.relative_outputs_of(2),
            loop.link(3, 1),
            loop.links(),
        ):
            L = loop.opened(signals)
            closed = control.feedback(L, np.eye(len(signals)))
            assert nearest(closed.poles(), expected) < 1e-7
            s = np.exp(0.03j) if L.dt else 2.0j
            np.testing.assert_allclose(
                loop.sensitivity(signals)(s, squeeze=False),
                np.linalg.inv(np.eye(len(signals)) + L(s, squeeze=False)),
                atol=1e-7,
            )


def test_the_gang_of_four_is_that_of_the_controller_and_what_it_sees(arms):
    """P from the loop without controller 2, by python-control; C = -K_2."""
    loop = arms.loop(sampled=False)
    found = loop.gang_of_four(2)
    u, r = loop.inputs_of(2), loop.relative_outputs_of(2)
    from lockstep.model.control.wiring import joined_systems

    rest = joined_systems([part for k, part in enumerate(loop.parts) if k != 2])
    columns, rows = [rest.inputs.index(s) for s in u], [rest.outputs.index(s) for s in r]
    P = control.ss(rest.A, rest.B[:, columns], rest.C[rows], rest.D[np.ix_(rows, columns)])
    g = arms.gains
    C = -control.ss(g.A[1], g.B[1], g.C[1], g.D[1])
    for w in (0.3, 4.0, 40.0):
        p, c = P(1j * w, squeeze=False), C(1j * w, squeeze=False)
        S = np.linalg.inv(np.eye(1) + c @ p)
        for name, value in (("S", S), ("T", c @ p @ S), ("PS", p @ S), ("CS", S @ c)):
            np.testing.assert_allclose(found[name](1j * w, squeeze=False), value, rtol=1e-7, atol=1e-9)


def test_a_hybrid_loop_may_be_part_of_another_and_refuses_what_does_not_fit():
    integrator = control.ss(0.0, 1.0, 1.0, 0.0, inputs="u", outputs="y")
    inner = Hybrid([integrator, control.ss([], [], [], -2.0, 0.25, inputs="y", outputs="u")])
    outer = Hybrid([inner, control.ss(-1.0, 1.0, 1.0, 0.0, inputs="y", outputs="z")])
    np.testing.assert_allclose(sorted(outer.poles().real), [0.5, np.exp(-0.25)], atol=1e-14)
    for arguments in ({"start": [1.0, 2.0]}, {"w": [1.0, 2.0, 3.0]}):
        with pytest.raises(ProblemError, match="shape"):
            inner.response([0.0, 1.0], **arguments)
    with pytest.raises(ProblemError, match="StateSpace"):
        Hybrid([inner, 1])


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ([control.ss(0.0, 1.0, 1.0, 0.0)], "time bases"),
        ([control.ss(0.0, 1.0, 1.0, 0.0, 0.1)], "time bases"),
        (
            [control.ss(-1.0, 1.0, 1.0, 0.0, outputs="y"), control.ss([], [], [], 1.0, 0.1, outputs="y")],
            "two parts",
        ),
        (
            [
                control.ss(-1.0, 1.0, 1.0, 0.0, inputs="u", outputs="y"),
                control.ss([], [], [], 1.0, 0.1, inputs="y", outputs="v"),
                control.ss([], [], [], 1.0, np.pi / 30, inputs="v", outputs="u"),
            ],
            "common period",
        ),
    ],
)
def test_loops_that_are_none_are_refused(parts, said):
    with pytest.raises(ProblemError, match=said):
        Hybrid(parts).poles()


@pytest.mark.parametrize("signals", [[], ["arm1_u", "arm1_u"], ["arm1_torque"], ["d1_theta_m"]])
@pytest.mark.parametrize("sampled", [True, False])
def test_a_loop_is_opened_at_signals_that_it_has(arms, signals, sampled):
    loop = arms.loop(sampled=sampled)
    for open_at in (loop.opened, loop.sensitivity, loop.complementary):
        with pytest.raises(ProblemError, match="one or more, each once"):
            open_at(signals)
    np.testing.assert_array_equal(loop.opened("arm2_u").A, loop.opened(["arm2_u"]).A)


def test_norms_that_do_not_exist_are_refused(arms):
    plant = control.ss(1.0, [[1.0, 1.0]], 1.0, 0.0, inputs=["w", "u"], outputs="y")
    weak = control.ss([], [], [], -0.5, 0.1, inputs="y", outputs="u")
    with pytest.raises(ProblemError, match="not stable"):
        Hybrid([plant, weak], ["w"], ["y"]).norm()
    with pytest.raises(ProblemError, match="without a state"):
        arms.hybrid(["arm1_r_y1_e"]).norm()
    with pytest.raises(ProblemError, match="listener, source among"):
        arms.loop().link(1, 3)
    with pytest.raises(ProblemError, match="1 to 3"):
        arms.loop().inputs_of(4)
