"""Messages that are lost or late: what is certified against brute force, and against what should break it."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from messages_cases import (
    SLOPES,
    drawn,
    growth_of,
    mean_square_radius,
    patterns,
    pendulums,
    strong,
    worst_jitter,
    worst_pattern,
)  # fmt: skip

from lockstep.check.sampled.links import Messages
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.messages import proves_messages
from lockstep.lmi.design_json import witness_document
from lockstep.lmi.sampled.messages.witnesses import certify_messages

FEW, MANY = range(4), range(4, 100)


def contradicted(seed):
    """None where nothing is certified; else the largest growth of the square that brute force finds, over what is proved."""
    net, ones, messages, rng = drawn(seed)
    found = certify_messages(net, ones, messages)
    if found is None:
        return None
    growth = []
    for part in SLOPES:
        slope = part * net.alpha
        if messages.loss:
            ages = range(messages.age + 1)
            growth += [mean_square_radius(net, ones, messages.loss, slope, age) for age in ages]
        else:
            longest = 6 if messages.age < 3 else 4
            growth.append(worst_pattern(net, ones, messages.age, slope, longest, rng, random=30))
    return max(growth) / found.witness.decay


@pytest.mark.parametrize("seed", FEW)
def test_brute_force_never_contradicts_a_certificate(seed):
    excess = contradicted(seed)
    assert excess is None or excess <= 1 + 1e-9


@pytest.mark.by_hand
@pytest.mark.slow
def test_brute_force_contradicts_none_of_a_hundred_and_many_are_certified():
    """28 are certified, a loss being proved for all up to it: the loops, and what is asked of them, are drawn at random."""
    found = [contradicted(seed) for seed in MANY]
    assert all(one is None or one <= 1 + 1e-9 for one in found)
    assert sum(one is not None for one in found) >= 25


def contradicted_early(seed, random):
    """As `contradicted`, with jitter besides, and all of it at once: every link its own ages and early readings."""
    net, ones, messages, rng = drawn(seed)
    messages = replace(messages, jitter=float(rng.choice([0.1, 0.3, 0.6, 0.9])))
    found = certify_messages(net, ones, messages)
    if found is None:
        return None
    links = sum(len(one.sources) for one in ones)
    growth = [
        growth_of(net, ones, messages, part * net.alpha, pattern)
        for part in SLOPES
        for pattern in patterns(messages, links, rng, random)
    ]
    return max(growth) / found.witness.decay


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_brute_force_never_contradicts_a_certificate_with_jitter(seed):
    excess = contradicted_early(seed, random=2)
    assert excess is None or excess <= 1 + 1e-6


@pytest.mark.by_hand
@pytest.mark.slow
def test_brute_force_contradicts_none_of_a_hundred_with_jitter_and_many_are_certified():
    """24 are certified, a loss being proved for all up to it; of eight others Clarabel finds no witness either."""
    found = [contradicted_early(seed, random=6) for seed in range(100)]
    assert all(one is None or one <= 1 + 1e-6 for one in found)
    assert sum(one is not None for one in found) >= 20


@pytest.mark.parametrize(
    ("messages", "delay"),
    [(Messages(0.5), 0), (Messages(0.0, 1, (0, 1)), 0), (Messages(0.2, 1), 0), (Messages(0.3), 1)],
)
def test_what_is_certified_is_refused_beyond_what_brute_force_allows(messages, delay):
    net, ones = pendulums(delay)
    found, loop = certify_messages(net, ones, messages), sampled_loop(net, ones)
    assert found is not None
    assert proves_messages(loop, messages, found.witness)
    worse = [replace(messages, burst=messages.burst + 40)]
    if messages.loss:
        worse.append(replace(messages, loss=0.999))
    for one in worse:
        assert not proves_messages(loop, one, found.witness)
    assert not proves_messages(loop, messages, replace(found.witness, decay=found.witness.decay - 0.05))
    assert not proves_messages(loop, messages, replace(found.witness, decay=1.0)), "1 is for rho alone"


@pytest.mark.slow
def test_the_largest_loss_is_below_the_one_that_breaks_the_mean_square():
    """With three seconds' worth of gain the mean square grows from some loss on: the certificate ends before it."""
    net, ones = strong()
    breaks = next(p for p in np.arange(0.05, 1.0, 0.05) if max_growth(net, ones, p) >= 1)
    carried = [
        p for p in np.arange(0.05, 1.0, 0.05) if certify_messages(net, ones, Messages(float(p))) is not None
    ]
    assert 0.05 <= max(carried, default=0.0) < breaks


def max_growth(net, ones, loss):
    return max(mean_square_radius(net, ones, float(loss), part * net.alpha) for part in SLOPES)


def test_a_second_bound_that_is_split_wrongly_proves_nothing():
    net, ones = pendulums()
    messages, loop = Messages(0.3, 1), sampled_loop(net, ones)
    witness = certify_messages(net, ones, messages).witness
    assert proves_messages(loop, messages, witness)
    chance, change, both = witness.seconds
    wrong = [{"X_sum": both + chance}, {"X_chance": 0 * chance}, {"X_change": -change}, {"X_sum": None}]
    for one in wrong:
        assert not proves_messages(loop, messages, replace(witness, **one)), one


@pytest.mark.parametrize("change", ["P", "Gamma", "X", "m", "t", "kappa", "kappa_mu", "decay"])
def test_a_witness_that_is_changed_proves_nothing(change):
    net, ones = pendulums()
    messages, loop = Messages(0.3, 1), sampled_loop(net, ones)
    witness = certify_messages(net, ones, messages).witness
    value = getattr(witness, change)
    for other in (-value, value[..., :-1] if isinstance(value, np.ndarray) else -1.0):
        assert not proves_messages(loop, messages, replace(witness, **{change: other}))
    if isinstance(value, np.ndarray) and value.ndim == 2:
        crooked = value.copy()
        crooked[0, -1] += 1e-9
        assert not proves_messages(loop, messages, replace(witness, **{change: crooked}))


@pytest.mark.parametrize(
    "messages", [Messages(jitter=0.5), Messages(0.3, jitter=0.3), Messages(0.0, 1, jitter=0.2)]
)
def test_jitter_is_carried_and_brute_force_agrees(messages):
    net, ones = pendulums()
    found, loop = certify_messages(net, ones, messages), sampled_loop(net, ones)
    assert found is not None
    slopes = (-net.alpha, net.alpha) if not messages.loss else (net.alpha,)
    longest = 3 if not messages.loss else 1
    assert max(worst_jitter(net, ones, messages, slope, longest) for slope in slopes) <= found.witness.decay
    assert not proves_messages(loop, replace(messages, jitter=0.999, burst=8), found.witness)


def test_jitter_is_not_certified_where_it_breaks_the_loop():
    """Of gains that no late reading is good for: a pattern of early readings makes the disagreement grow."""
    net, ones = strong()
    broken = [j for j in (0.2, 0.5, 0.9) if worst_jitter(net, ones, Messages(jitter=j), 0.0, longest=2) >= 1]
    assert broken == [0.5, 0.9]
    assert all(certify_messages(net, ones, Messages(jitter=j)) is None for j in broken)


DECIDED = """
import json, sys
import numpy as np
from messages_cases import pendulums
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.messages import proves_messages
net, ones = pendulums()
stored = json.load(open(sys.argv[1]))
witness = MessageWitness(**{k: np.array(v) if isinstance(v, list) else v for k, v in stored.items()})
loop = sampled_loop(net, ones)
print([proves_messages(loop, Messages(p, 1), witness) for p in np.linspace(0.25, 0.35, 21)])
"""


@pytest.mark.slow
def test_the_checker_decides_alike_with_other_kernels(tmp_path):
    import json

    net, ones = pendulums()
    witness = certify_messages(net, ones, Messages(0.3, 1)).witness
    (tmp_path / "witness.json").write_text(json.dumps(witness_document(witness)))
    said = set()
    for kernel in ("Haswell", "Nehalem", ""):
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        environment["PYTHONPATH"] = os.pathsep.join([os.path.dirname(__file__), *sys.path])
        command = [sys.executable, "-c", DECIDED, str(tmp_path / "witness.json")]
        said.add(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    assert len(said) == 1
    assert "True" in said.pop()
