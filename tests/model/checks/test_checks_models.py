"""The checks that prove on twenty models, against dense sampling and what is known of them.

Sampling uses CasADi's numbers, not the enclosures.
"""

from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from lockstep.model.checks.proved.all_checks import prove
from lockstep.model.checks.proved.vector_field import as_written
from lockstep.model.problem import load_problem

MODELS = Path(__file__).parents[2] / "models"

COUNTS = {  # equilibria on the domain, each by hand
    "chua": 3,  # y = 0, z = -x; 0.59 x = 0.32 x near 0, and x = +-0.59/0.32 outside
    "van_der_pol": 1,  # y = 0, x = 0
    "lorenz": 3,  # y = x, z = 3 x^2/8, x (27 - z) = 0
    "rossler": 2,  # z = -y = x/a, x^2 - c x + a b = 0
    "fitzhugh_nagumo": 1,  # v - v^3/3 - (v + 0.7)/0.8 + 0.5 has the slope -0.25 - v^2
    "duffing": 3,  # x = 0, +-1
    "pendulum": 3,  # theta = 0, +-pi
    "lotka_volterra": 2,  # (0, 0) and (1, 1/2)
    # 2.092 of T - 300 and 1 of T - 350 against 209.2 s(T), s = 1/(1 + exp(E/T - E/Tr)/k): the left side is a line, and
    # s'' has the sign of 1/2 - T/E - s, which falls: one inflexion, three crossings at most. There are signs for three.
    "cstr": 3,
    "glucose": 1,  # I = Ib, X = 0, G = Gb
    "four_tanks": 1,  # h3 and h4 from their own rows, then h1 and h2
    "buck_converter": 1,  # v^2 - E v + R P = 0, of which one is above 40 V
    "acrobot": 9,  # q1 and q2 each 0, +-pi
    "dc_motor": 1,  # R Fc/K tanh(w/ws) + K w = 0 rises with w
}
FAST = ("van_der_pol", "pendulum", "dc_motor", "fitzhugh_nagumo", "lotka_volterra")
ALL = sorted(path.stem for path in MODELS.glob("*.toml"))


def test_there_are_twenty_models():
    assert len(ALL) == 20


@cache
def findings(name):
    posed = load_problem(MODELS / f"{name}.toml")
    return posed.agent(), {finding.name: finding for finding in prove(posed)}


def held_against_samples(name):
    agent, found = findings(name)
    lower, upper = (np.clip(end, -10.0, 10.0) if np.isinf(end).any() else end for end in agent.box.T)
    random = np.random.default_rng(7)
    x = lower + (upper - lower) * random.uniform(size=(4000, agent.n))
    x[:2000] = np.where(
        random.uniform(size=(2000, agent.n)) < 0.5,
        np.round((x[:2000] - lower) / (upper - lower)) * (upper - lower) + lower,
        x[:2000],
    )
    zero = np.zeros((agent.m, len(x)))
    f = np.asarray(agent.dynamics(x.T, zero, 0.0)).T
    near = np.clip(x + 1e-3 * (upper - lower) * random.normal(size=x.shape), lower, upper)
    pairs = [
        (x[::2], f[::2], x[1::2], f[1::2]),
        (x, f, near, np.asarray(agent.dynamics(near.T, zero, 0.0)).T),
    ]
    written = as_written(agent)
    A = np.array([[int(v.p) / int(v.q) for v in row] for row in written.A])
    for a, fa, b, fb in pairs:
        check_pairs(found, agent, a - b, fa - fb, (fa - fb) - (a - b) @ A.T, random)
    check_equilibria(found["equilibria"], agent, x[:200], lower, upper)
    check_slopes(found, agent, x[:500])
    return found


def check_pairs(found, agent, d, df, dh, random):
    size, close = (d**2).sum(axis=1), 1e-9
    inner = (d * dh).sum(axis=1)
    scale = (np.abs(d) * (np.abs(dh) + np.abs(df))).sum(axis=1) + size  # of what rounding is relative to
    rho = found["one-sided Lipschitz"]
    if rho.status == "proved":
        assert (inner <= rho.value["rho"] * size + close * scale).all()
    inner_bound = found["quadratic inner-boundedness"]
    if inner_bound.status == "proved":
        beta, gamma = inner_bound.value["beta"], inner_bound.value["gamma"]
        assert (
            (dh**2).sum(axis=1)
            <= beta * size
            + gamma * inner
            + close * ((df**2).sum(axis=1) + (dh**2).sum(axis=1) + abs(gamma) * scale)
        ).all()
    metric = found["contraction"]
    if metric.status == "proved":
        P = np.array(metric.value["P"])
        assert (
            ((d @ P) * df).sum(axis=1) <= -metric.value["rate"] * ((d @ P) * d).sum(axis=1) * (1 - 1e-6)
        ).all()
    B, C = agent.lure.B, agent.lure.C
    du = random.normal(size=(len(d), agent.m)) * random.choice([1e-2, 1.0, 1e2], size=(len(d), 1))
    dy = d @ C.T
    for name in ("incremental passivity", "incremental L2 gain"):
        finding = found[name]
        if finding.status == "proved":
            P = np.array(finding.value["P"])
            rate = 2 * ((d @ P) * (df + du @ B.T)).sum(axis=1)
            passive = name.endswith("passivity")
            supply = (
                2 * (dy * du).sum(axis=1)
                if passive
                else finding.value["gain"] ** 2 * (du**2).sum(axis=1) - (dy**2).sum(axis=1)
            )
            assert (
                rate
                <= supply
                + 1e-9 * (np.abs(rate) + np.abs(supply) + (np.abs(d @ P) * np.abs(du @ B.T)).sum(axis=1))
            ).all()


def check_equilibria(finding, agent, starts, lower, upper):
    from scipy.optimize import root

    def f(x):
        return np.asarray(agent.dynamics(x, np.zeros(agent.m), 0.0)).ravel()

    if finding.status == "proved":
        points = np.array([one["x"] for one in finding.value["points"]]).reshape(-1, agent.n)
        for point in points:
            assert np.abs(f(point)).max() <= 1e-6 * (1 + np.abs(point).max())
        for start in starts:
            end = root(f, start)
            if (
                end.success
                and np.abs(f(end.x)).max() < 1e-9
                and (lower <= end.x).all()
                and (end.x <= upper).all()
            ):
                assert len(points)
                # fsolve stops early at a double zero: compare in the size of the domain
                assert (np.abs(points - end.x) <= 1e-4 * (upper - lower)).all(axis=1).any(), (end.x, points)


def check_slopes(found, agent, points):
    J = ca.Function("J", [agent.x, agent.u, agent.t], [ca.densify(ca.jacobian(agent.rhs, agent.x))])

    def eigenvalues(x):
        return np.linalg.eigvals(np.asarray(J(x, np.zeros(agent.m), 0.0)))

    fastest = (found["stiffness"].value or {}).get("fastest")
    if fastest is not None:
        assert max(np.abs(eigenvalues(x)).max() for x in points) <= fastest * (1 + 1e-9)
    if found["contraction"].status == "refuted" and "point" in found["contraction"].witness:
        witness = found["contraction"].witness
        assert eigenvalues(witness["point"]).real.max() == pytest.approx(witness["real_part"], rel=1e-6)
    for one in (found["equilibria"].value or {}).get("points", []):
        real = eigenvalues(one["x"]).real
        assert one["stable"] is None or one["stable"] == (real.max() < 0)


@pytest.mark.parametrize("name", FAST)
def test_five_models_against_samples_and_facts(name):
    found = held_against_samples(name)
    assert found["equilibria"].value["count"] == COUNTS[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_twenty_models_against_samples_and_facts(name):
    found = held_against_samples(name)
    if name in COUNTS:
        assert found["equilibria"].status == "proved"
        assert found["equilibria"].value["count"] == COUNTS[name]


def test_facts_by_hand():
    """Of the models above, where more is known than how many equilibria there are."""
    _, motor = findings("dc_motor")
    assert motor["incremental passivity"].status == "proved"  # voltage to current, with monotone friction
    _, oscillator = findings("van_der_pol")
    assert [one["stable"] for one in oscillator["equilibria"].value["points"]] == [False]
    _, pendulum = findings("pendulum")
    assert sorted(one["stable"] for one in pendulum["equilibria"].value["points"]) == [False, False, True]


@pytest.mark.slow
def test_more_facts_by_hand():
    tanks = findings("four_tanks")[1]
    # A tank loses a sqrt(2 g h), with what the one above it gets from its pump; (1 + T_3 s) (1 + T_4 s) = d_1 d_2/(c_1 c_2)
    # at a zero, T_i = A_i/a_i sqrt(2 h_i/g).
    A, a, g = np.array([28.0, 32.0] * 2), np.array([0.071, 0.057] * 2), 981.0
    left, right = 3.0 * 3.33, 3.0 * 3.35  # cm^3/s of each pump
    flows = np.array([0.7 * left + 0.4 * right, 0.6 * right + 0.3 * left, 0.4 * right, 0.3 * left])
    h = (flows / a) ** 2 / (2 * g)
    assert tanks["equilibria"].value["points"][0]["x"] == pytest.approx(h, rel=1e-9)
    T = A / a * np.sqrt(2 * h / g)
    zeros = sorted(re for re, _ in tanks["zero dynamics"].value["zeros"])
    wanted = np.roots([T[2] * T[3], T[2] + T[3], 1 - 0.3 * 0.4 / (0.7 * 0.6)])
    assert zeros == pytest.approx(sorted(wanted), rel=1e-9)
    quadrotor = findings("quadrotor")[1]
    assert (
        quadrotor["relative degree"].status == "refuted"
    )  # singular until the thrust is a double integrator
    lorenz = findings("lorenz")[1]["equilibria"].value["points"]
    side = np.sqrt(72)
    expected = [[-side, -side, 27], [0, 0, 0], [side, side, 27]]
    assert np.allclose(sorted(one["x"] for one in lorenz), expected)


def test_three_steady_states_of_the_reactor_by_signs():
    """T above and below the balance in turn, at the middle state of 350 K and on both sides of it."""

    def gained(T):
        s = 0.9994 * np.exp(25 - 8750 / T)
        return 209.2 * s / (1 + s) - (T - 350) - 2.092 * (T - 300)

    signs = np.sign([gained(T) for T in (305, 340, 360, 420)])
    assert signs.tolist() == [1, -1, 1, -1]
