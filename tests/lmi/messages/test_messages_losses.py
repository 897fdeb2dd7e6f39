"""Losses of at most p: every link its own probability, which may change with time; or all alike where links are many."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from messages_cases import SLOPES, drawn, growth_in_turn, pendulums, strong
from sampled_cases import controllers, network

from lockstep.check.sampled import links
from lockstep.check.sampled import messages as checker
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.messages import Omega_2, Omegas_2, proves_messages
from lockstep.lmi.sampled.messages.witnesses import certify_messages
from lockstep.lmi.sampled.witnesses import in_doubles


def form(rng, size):
    half = rng.standard_normal((size, size))
    return half @ half.T


def any_witness(rng, loop):
    """Forms that prove nothing, for what is assembled of them."""
    n, links, q = loop.n_x, len(loop.differences), len(loop.network.plant.C)
    blocks = [np.vstack([form(rng, q) for _ in range(links // q)]) for _ in range(5)]
    numbers = (np.ones(3), np.zeros(len(loop.ways)), 0.9, 1.0, 1.0)
    return MessageWitness(form(rng, n + links), form(rng, n + links), *blocks[:2], *numbers, *blocks[2:])


def averaged(loop, messages, witness, losses):
    """The mean of the second half's left side, outcome by outcome, taken from the right side: a form on (x_cl, eps, eta)."""
    n, links, q, D = loop.n_x, len(loop.differences), len(loop.network.plant.C), messages.age
    x_cl, eps, eta = np.split(np.eye(n + 2 * links), [n, n + links])
    X, Xj, Xa = (checker.links_apart(one) for one in (witness.X, witness.X_jitter, witness.X_chance))
    total = witness.decay * np.vstack([x_cl, eps]).T @ witness.P @ np.vstack([x_cl, eps])
    total = total + witness.decay * eta.T @ Xj @ eta
    for lost in itertools.product((0, 1), repeat=links // q):
        chance = np.where(lost, losses, 1 - losses).prod()
        delta = np.diag(np.repeat(lost, q))
        zeta1 = delta @ eps + (np.eye(links) - delta) @ eta
        known, jump = np.vstack([x_cl, zeta1]), zeta1 - eps
        left = known.T @ witness.Gamma @ known + D * D * witness.decay ** (1 - D) * jump.T @ X @ jump
        left = left + (D + 1) * witness.decay**-D * zeta1.T @ Xa @ zeta1
        total = total - chance * left
    return total


@pytest.mark.parametrize("seed", range(3))
def test_the_mean_is_that_of_all_outcomes_and_affine_in_each_probability(seed):
    rng = np.random.default_rng(seed)
    loop = in_doubles(*pendulums())
    messages, witness = Messages(0.6, 1, (0, 1), 0.2), any_witness(rng, loop)
    corners = messages.losses(3)
    assert len({tuple(one) for one in corners}) == 8
    found = list(Omegas_2(loop, messages, witness))
    for corner, one in zip(corners, found, strict=True):
        np.testing.assert_allclose(one, averaged(loop, messages, witness, 0.6 * corner), atol=1e-8)
    parts = rng.uniform(0, 1, 3)
    between = sum(
        np.where(c > 0, parts, 1 - parts).prod() * one for c, one in zip(corners, found, strict=True)
    )
    np.testing.assert_allclose(averaged(loop, messages, witness, 0.6 * parts), between, atol=1e-8)
    np.testing.assert_allclose(Omega_2(loop, messages, witness, parts), between, atol=1e-8)


def test_links_that_lose_alike_have_the_coefficients_of_bernstein(monkeypatch):
    monkeypatch.setattr(links, "MOST_LINKS", 2)
    loop = in_doubles(*pendulums())
    messages, witness = Messages(0.6, 1, jitter=0.2), any_witness(np.random.default_rng(5), loop)
    first, middle, last = Omegas_2(loop, messages, witness)
    for t in (0.0, 0.3, 0.8, 1.0):
        between = (1 - t) ** 2 * first + 2 * t * (1 - t) * middle + t**2 * last
        np.testing.assert_allclose(averaged(loop, messages, witness, np.full(3, 0.6 * t)), between, atol=1e-8)


def excess(net, ones, messages, rng, random):
    """None where nothing is certified; else the largest growth of the mean square found, over what is proved."""
    found = certify_messages(net, ones, messages)
    if found is None:
        return None
    links, worst = sum(len(one.sources) for one in ones), 0.0
    for _ in range(random):
        box = [
            messages.loss * rng.choice([0.0, 1.0, rng.uniform()], links) for _ in range(rng.integers(1, 4))
        ]
        slope = rng.choice(SLOPES) * net.alpha
        worst = max(worst, growth_in_turn(net, ones, box, slope, int(rng.integers(0, messages.age + 1))))
    return worst / found.witness.decay


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 5])
def test_no_probabilities_of_the_box_contradict_a_certificate(seed):
    """Each link its own, and one vector of them after the other."""
    net, ones, messages, rng = drawn(seed)
    found = excess(net, ones, replace(messages, loss=messages.loss or 0.3), rng, random=6)
    assert found is None or found <= 1 + 1e-9


@pytest.mark.by_hand
@pytest.mark.slow
def test_no_probabilities_of_the_box_contradict_any_of_a_hundred_certificates():
    found = []
    for seed in range(100):
        net, ones, messages, rng = drawn(seed)
        found.append(excess(net, ones, replace(messages, loss=messages.loss or 0.3), rng, random=12))
    assert all(one is None or one <= 1 + 1e-9 for one in found)
    assert any(one is not None for one in found)


@pytest.mark.slow
def test_a_witness_proves_every_smaller_loss_and_none_that_breaks_the_loop():
    net, ones = strong()
    loop = sampled_loop(net, ones)
    carried = [p for p in np.arange(0.05, 0.5, 0.05) if certify_messages(net, ones, Messages(p))]
    most = float(max(carried))
    found = certify_messages(net, ones, Messages(most)).witness
    for p in (most / 2, most / 7, 0.0):
        assert proves_messages(loop, Messages(p), found)
    breaks = next(
        p
        for p in np.arange(most, 1.0, 0.01)
        if max(growth_in_turn(net, ones, [np.full(3, p)], part * net.alpha) for part in SLOPES) >= 1
    )
    assert most < breaks
    assert not proves_messages(loop, Messages(float(breaks)), found)


def test_a_witness_of_one_very_probability_proves_no_smaller_ones(monkeypatch):
    """The mean with p itself says nothing of p = 0: this storage grows where each message arrives."""
    net, ones = pendulums()
    loop = sampled_loop(net, ones)
    with monkeypatch.context() as patched:
        patched.setattr(Messages, "losses", lambda _, links: np.ones((1, links)))
        found = certify_messages(net, ones, Messages(0.8)).witness
        assert proves_messages(loop, Messages(0.8), found)
    assert not proves_messages(loop, Messages(0.8), found)


def test_a_little_more_is_refused():
    net, ones = pendulums()
    loop, witness = sampled_loop(net, ones), certify_messages(net, ones, Messages(0.6)).witness
    low, high = 0.6, 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if proves_messages(loop, Messages(middle), witness) else (low, middle)
    assert high < 0.999
    assert not proves_messages(loop, Messages(high + 1e-3), witness)
    assert not Messages(np.nextafter(0.6, 1.0)).within(Messages(0.6))


def four_that_all_listen():
    """Twelve links: too many for the corners."""
    edges = [(i, j, 0.5) for i in range(1, 5) for j in range(1, 5) if i != j]
    A, B, H = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    net = network(A, B, [[1.0, 0.5]], B, H, edges, N=4, alpha=0.5, period=0.05)
    return net, controllers([[[-1.0]]] * 4, 0, edges)


def test_many_links_are_proved_to_lose_alike():
    net, ones = four_that_all_listen()
    messages, loop = Messages(0.3), sampled_loop(net, ones)
    assert messages.alike(12) and not messages.alike(8) and not Messages().alike(12)
    witness = certify_messages(net, ones, messages).witness
    assert len(list(Omegas_2(in_doubles(net, ones), messages, witness))) == 3
    assert proves_messages(loop, Messages(0.1), witness)
    assert not proves_messages(loop, Messages(0.9999), witness)
