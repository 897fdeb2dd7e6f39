"""The loop with clipped inputs: its sector, the certified radius, and the energy that meets no limit, by brute force."""

import dataclasses

import numpy as np
import pytest
from sampled_cases import controllers, network, random_problem
from scipy.linalg import expm, solve_discrete_lyapunov

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import as_floats, exactly
from lockstep.check.sampled.inequality import metric, step_matrix
from lockstep.check.sampled.inputs.input_limits import proves_gain, proves_radius
from lockstep.check.sampled.inputs.saturation import ClippedWitness, clipped, proves_clipped_radius
from lockstep.check.sampled.lifting import copies
from lockstep.check.sampled.loop import sampled_loop
from lockstep.lmi.sampled import input_limits
from lockstep.lmi.sampled.input_limits import largest_gain, largest_radius
from lockstep.lmi.sampled.loop_gain import _step_of_state
from lockstep.lmi.sampled.saturation import largest_clipped_radius
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles

LIMITS = np.array([1.0])
WEIGHTS = np.ones(1)
"""Of one pair: what a large loop is proved with, a common factor being free."""
BOTH = [(1, 2, 1.0), (2, 1, 1.0)]


def unstable_pair(a: float, k: float, *, period: float = 0.02, delay: int = 0):
    """Two agents x' = a x + u, u = -k (x_i - x_j): their difference d grows unless |d| < 2 / a, with |u| <= 1."""
    net = network([[a]], [[1.0]], [[1.0]], [[0.0]], [[0.0]], BOTH, N=2, alpha=0.0, period=period, delay=delay)
    return net, controllers([[[-k]], [[-k]]], 0, BOTH)


def test_the_sector_holds_where_it_is_said_to():
    """q (q - h x) <= 0 with q = v - clip(v) wherever |v - h x| <= u_max; and not everywhere."""
    rng = np.random.default_rng(0)
    v, h = rng.normal(scale=3, size=(2, 100_000))
    q = v - np.clip(v, -1.0, 1.0)
    inside = np.abs(v - h) <= 1
    assert (q * (q - h))[inside].max() <= 0
    assert (q * (q - h))[~inside].max() > 0


@pytest.mark.parametrize("seed", range(6))
def test_the_clipped_step_is_the_step_of_the_clipped_loop(seed):
    """Without phi: from any state, agent by agent with the input held, against the matrices with q put in."""
    net, ones = random_problem(seed)
    net = dataclasses.replace(net, alpha=0.0)
    loop = in_doubles(net, ones)
    one, wide = period_in_doubles(loop), clipped(loop)
    N = step_matrix(wide, copies(one, np.eye(net.d.N - 1)))
    rng = np.random.default_rng(seed)
    A, C, T = as_floats(net.plant.A), as_floats(net.plant.C), loop.network.d.T
    B = [as_floats(b) for b in net.plant.B]
    n, n_C, agents = len(A), ones[0].order, net.d.N
    x, x_C, last = rng.normal(size=(agents, n)), rng.normal(size=(agents, n_C)), rng.normal(size=(agents, 1))
    u, next_C = [], []
    for i, controller in enumerate(ones):
        heard = zip(controller.sources, controller.weights, strict=True)
        r = sum((a * (C @ (x[i] - x[j])) for j, a in heard), start=np.zeros(len(C)))
        out = controller.table @ np.concatenate([x_C[i], r])
        next_C.append(out[:n_C])
        u.append(out[n_C:])
    v = np.array(u)
    applied = last if net.delay else np.clip(v, -1, 1)
    flow = [
        expm(np.block([[A, b], [np.zeros((1, n + 1))]]) * net.period)[:n] @ np.concatenate([x_i, ui])
        for b, x_i, ui in zip(B, x, applied, strict=True)
    ]
    z = np.zeros(wide.n_z)
    rest = [last.ravel()] if net.delay else []
    z[: wide.n_x] = np.concatenate([(T @ x).ravel(), x_C.ravel(), *rest])
    z[wide.n_z - agents :] = (v - np.clip(v, -1, 1)).ravel()
    rest = [np.clip(v, -1, 1).ravel()] if net.delay else []
    expected = np.concatenate([(T @ np.array(flow)).ravel(), np.ravel(next_C), *rest])
    np.testing.assert_allclose(N @ z, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("delay", [0, 1])
def test_the_radius_of_an_unstable_difference(delay):
    """d' = a d + u_1 - u_2 can be held only for |d| <= 2 / a, that is |x_d| <= sqrt(2) / a: found nearly, never beyond."""
    a, k = 0.5, 1.5
    net, ones = unstable_pair(a, k, delay=delay)
    truth = np.sqrt(2) / a
    radius, witness = largest_clipped_radius(net, ones, LIMITS)
    unclipped, _ = largest_radius(net, ones, LIMITS, WEIGHTS)
    assert 0.84 * truth <= radius <= truth
    assert unclipped <= 1.001 / (np.sqrt(2) * k), "u = -k d, and |x_d| = |d| / sqrt(2)"
    exact = sampled_loop(net, ones)
    assert proves_clipped_radius(exact, witness, LIMITS, radius)
    assert not proves_clipped_radius(exact, witness, LIMITS, 1.02 * radius)
    assert not proves_clipped_radius(exact, witness, 0.98 * LIMITS, radius)
    assert not proves_radius(exact, witness.storage, LIMITS, radius)


def test_a_leader_hears_nobody_and_its_input_of_zero_meets_no_limit():
    """u_2 = -k d, u_1 = 0 (until then no radius was proved where an input is identically 0): |d| = 1 / k once more."""
    alone, k = [(2, 1, 1.0)], 1.5
    net = network([[-0.1]], [[1.0]], [[1.0]], [[0.0]], [[0.0]], alone, N=2, alpha=0.0, period=0.02, delay=0)
    ones = controllers([[[0.0]], [[-k]]], 0, alone)
    radius, witness = largest_radius(net, ones, LIMITS, WEIGHTS)
    truth, exact = 1 / (np.sqrt(2) * k), sampled_loop(net, ones)
    assert 0.9 * truth <= radius <= truth
    assert proves_radius(exact, witness, LIMITS, radius)
    assert not proves_radius(exact, witness, LIMITS, 1.001 * truth)


@pytest.mark.parametrize("delay", [0, 1])
def test_the_radius_of_a_large_loop(monkeypatch, delay):
    """With P of one number nothing is lost by pair weights that are given: u = -k d meets its limit at |d| = 1 / k."""
    monkeypatch.setattr(input_limits, "is_large", lambda _loop: True)
    monkeypatch.setattr(input_limits, "step_program", None)
    net, ones = unstable_pair(-0.1, 1.5, delay=delay)
    radius, witness = largest_radius(net, ones, LIMITS, 7.0 * WEIGHTS)
    truth = 1 / (np.sqrt(2) * 1.5)
    assert 0.9 * truth <= radius <= truth
    assert proves_radius(sampled_loop(net, ones), witness, LIMITS, radius)
    assert not proves_radius(sampled_loop(net, ones), witness, LIMITS, 1.001 * truth)


@pytest.mark.parametrize("seed", range(1, 5))
def test_given_pair_weights_reach_no_further_than_free_ones(monkeypatch, seed):
    net, ones = random_problem(seed)
    free = largest_radius(net, ones, LIMITS, WEIGHTS)
    assert free is not None
    monkeypatch.setattr(input_limits, "is_large", lambda _loop: True)
    found = largest_radius(net, ones, LIMITS, free[1].m)
    assert found is not None
    # Of these four 0.67 to 0.87 are reached; above, `KEPT` leaves either within half a per cent of what it found.
    assert 0.6 * free[0] <= found[0] <= 1.01 * free[0]
    assert proves_radius(sampled_loop(net, ones), found[1], LIMITS, found[0])


def test_what_is_no_witness():
    net, ones = unstable_pair(0.5, 1.5)
    radius, witness = largest_clipped_radius(net, ones, LIMITS)
    exact = sampled_loop(net, ones)
    changed = {
        "tau": [-witness.tau, witness.tau[:1], 0 * witness.tau, 100 * witness.tau, np.full(2, np.nan)],
        "h": [0 * witness.h, 2 * witness.h, witness.h.T[:, :1], np.full_like(witness.h, np.nan)],
        "storage": [
            dataclasses.replace(witness.storage, decay=1.0),
            dataclasses.replace(witness.storage, P=witness.storage.P / 2),
        ],
    }
    for name, values in changed.items():
        for value in values:
            other = dataclasses.replace(witness, **{name: value})
            assert not proves_clipped_radius(exact, other, LIMITS, radius), name


def test_with_no_sector_nothing_is_clipped():
    """h = 0 and a large tau: the radius of `limits.radius`, by its own witness."""
    net, ones = random_problem(1)
    radius, storage = largest_radius(net, ones, LIMITS, WEIGHTS)
    count = len(ones)
    same = ClippedWitness(
        storage, np.full(count, 1e6 * np.linalg.norm(storage.P)), np.zeros((count, len(storage.P)))
    )
    assert proves_clipped_radius(sampled_loop(net, ones), same, LIMITS, radius)
    assert not proves_clipped_radius(sampled_loop(net, ones), same, LIMITS, 1.05 * radius)


def worst_end(net, ones, radius: float, rng, runs: int = 64, steps: int = 4000) -> float:
    """The largest disagreement at the end, over starts at a radius and constant slopes, inputs clipped at 1."""
    A, G, H, C = (as_floats(M) for M in (net.plant.A, net.plant.G, net.plant.H, net.plant.C))
    B = [as_floats(b) for b in net.plant.B]
    N, n, n_C = net.d.N, len(A), ones[0].order
    worst = 0.0
    for slope in np.linspace(-net.alpha, net.alpha, 5):
        block = [np.block([[A + slope * G @ H, b], [np.zeros((1, n + 1))]]) for b in B]
        flow = [expm(each * net.period)[:n] for each in block]
        x = rng.normal(size=(runs, N, n))
        x -= x.mean(axis=1, keepdims=True)
        x *= radius / np.linalg.norm(x.reshape(runs, -1), axis=1)[:, None, None]
        x_C, last = np.zeros((runs, N, n_C)), np.zeros((runs, N, 1))
        for _ in range(steps):
            y, v = x @ C.T, np.zeros((runs, N, 1))
            for i, one in enumerate(ones):
                heard = zip(one.sources, one.weights, strict=True)
                r = sum((a * (y[:, i] - y[:, j]) for j, a in heard), start=np.zeros_like(y[:, i]))
                out = np.hstack([x_C[:, i], r]) @ one.table.T
                x_C[:, i], v[:, i] = out[:, :n_C], np.clip(out[:, n_C:], -1, 1)
            applied, last = (last, v) if net.delay else (v, v)
            x = np.stack([np.hstack([x[:, i], applied[:, i]]) @ flow[i].T for i in range(N)], axis=1)
            x -= x.mean(axis=1, keepdims=True)
        worst = max(worst, float(np.linalg.norm(x.reshape(runs, -1), axis=1).max()))
    return worst


def check_random(seed: int) -> float | None:
    """Hold one random problem against simulation; return what clipping gains, None where no radius is found."""
    net, ones = random_problem(seed)
    unclipped = largest_radius(net, ones, LIMITS, WEIGHTS)
    found = largest_clipped_radius(net, ones, LIMITS, unclipped)
    if found is None or unclipped is None:
        return None
    assert found[0] >= unclipped[0]
    horizon = min(4000, int(60 / net.period) + 200)
    end = worst_end(net, ones, found[0], np.random.default_rng(seed), steps=horizon)
    assert end <= 0.5 * found[0], seed
    return float(found[0] / unclipped[0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_no_random_loop_fails_to_converge(seed):
    check_random(seed)


@pytest.mark.by_hand
@pytest.mark.slow
def test_none_of_a_hundred_random_loops_fails_to_converge():
    gains = [gain for gain in (check_random(seed) for seed in range(100)) if gain is not None]
    assert len(gains) >= 20
    assert np.median(gains) > 1.1


def largest_energy(net, ones, slope: float, noise: float) -> float:
    """The root of the least energy that drives an input to its limit, for phi = slope H x: by the reachability Gramian."""
    plant = dataclasses.replace(
        net.plant, A=net.plant.A + exactly(np.array([[slope]]))[0, 0] * net.plant.G @ net.plant.H
    )
    loop = in_doubles(dataclasses.replace(net, plant=plant, alpha=0.0), ones, np.array([noise, noise]))
    one = period_in_doubles(loop)
    step, n, T = _step_of_state(loop, one), loop.n_x, net.period
    if np.abs(np.linalg.eigvals(step)).max() >= 1:
        return 0.0
    A = as_floats(plant.A)
    size = len(A)
    van_loan = expm(np.block([[-A, np.eye(size)], [np.zeros((size, size)), A.T]]) * T)
    S_d = van_loan[size:, size:].T @ van_loan[:size, size:]
    inner = np.linalg.inv(np.asarray(loop.network.d.S, dtype=float))
    reach = np.zeros((n, n))
    reach[: loop.n_d, : loop.n_d] = np.kron(inner, S_d)
    price = np.kron(inner, np.eye(2)) / T if noise else np.zeros((0, 0))
    noisy = step_matrix(loop, copies(one, np.eye(net.d.N - 1)))[:, loop.outputs]
    X = solve_discrete_lyapunov(step, reach + noisy @ price @ noisy.T)
    k, d = loop.computed[:, :n], loop.computed[:, loop.outputs]
    return float(1 / np.sqrt(np.diag(k @ X @ k.T + d @ price @ d.T).max()))


def energy_ratio(seed: int) -> float | None:
    """Claimed over true energy root, the truth being over constant slopes; None where nothing is claimed."""
    net, ones = random_problem(seed)
    noise = 0.1 * (seed % 2)
    outputs = np.array([noise, noise]) if noise else np.zeros(0)
    weights = Performance(np.eye(2), np.eye(1), outputs=outputs)
    truth = min(largest_energy(net, ones, s * net.alpha, noise) for s in np.linspace(-1, 1, 9))
    best = None
    for size in (0.01, 1.0, 100.0):
        found = largest_gain(net, ones, LIMITS, weights, size * np.ones(3))
        if found is not None and (best is None or found[0] > best[0]):
            best = found
    if best is None:
        return None
    loop = sampled_loop(net, ones, outputs)
    assert best[0] <= truth, seed
    assert proves_gain(loop, best[1], LIMITS, weights, best[0])
    assert not proves_gain(loop, best[1], LIMITS, weights, 1.2 * best[0])
    return best[0] / truth


@pytest.mark.parametrize("seed", [1, 2, 4, 5])
def test_no_claimed_energy_is_above_the_true_one(seed):
    energy_ratio(seed)


@pytest.mark.by_hand
@pytest.mark.slow
def test_of_a_hundred_random_loops_no_claimed_energy_is_above_the_true_one():
    ratios = [ratio for ratio in map(energy_ratio, range(100)) if ratio is not None]
    assert len(ratios) >= 20
    assert np.median(ratios) >= 1 / 1.5


def test_where_the_best_scale_leaves_rounding_nothing_another_does(monkeypatch):
    """The largest energy lies near an edge, where there may be no witness with the rounding priced: less is claimed then."""
    net, ones = random_problem(1)
    weights, plain = Performance(np.eye(2), np.eye(1)), input_limits._Disturbed.witnesses
    best = largest_gain(net, ones, LIMITS, weights, np.ones(3))
    calls = []

    def barren(problem):
        calls.append(problem)
        return plain(problem) if len(calls) > 2 else iter(())

    monkeypatch.setattr(input_limits._Disturbed, "witnesses", barren)
    found = largest_gain(net, ones, LIMITS, weights, np.ones(3))
    assert best is not None
    assert found is not None
    assert len(calls) > 2
    assert 0.1 * best[0] < found[0] <= best[0]


def test_a_linear_loop_claims_nearly_the_true_energy():
    """Without phi the largest P is the inverse of the reachability Gramian, up to the decay and the rounding."""
    net, ones = random_problem(1)
    net = dataclasses.replace(net, alpha=1e-3)
    weights = Performance(np.eye(2), np.eye(1))
    truth = min(largest_energy(net, ones, s, 0.0) for s in (-1e-3, 1e-3))
    found = max(largest_gain(net, ones, LIMITS, weights, size * np.ones(3))[0] for size in (1.0, 1e3))
    assert 0.9 * truth <= found <= truth
    assert np.asarray(metric(in_doubles(net, ones))).shape == (4, 4)


def test_what_a_witness_leaves_of_a_radius_is_claimed(monkeypatch):
    """No part of what was found is proved: what its witness does prove is, and a large radius was lost with it."""
    net, ones = unstable_pair(0.5, 1.5)
    plain, wide = largest_radius(net, ones, LIMITS, WEIGHTS), largest_clipped_radius(net, ones, LIMITS)
    monkeypatch.setattr(input_limits, "KEPT", (3.0, 2.0))
    left, of_clipped = largest_radius(net, ones, LIMITS, WEIGHTS), largest_clipped_radius(net, ones, LIMITS)
    assert left[0] == pytest.approx(plain[0], rel=0.02)
    assert of_clipped[0] == pytest.approx(wide[0], rel=0.02)
