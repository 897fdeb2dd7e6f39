"""Agents that join, leave and rewire: no simulated sequence exceeds what one certificate promises for all of them."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest

from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of
from lockstep.model.problem import Problem

PATH = Path(__file__).parents[3] / "benchmarks" / "joins.py"

PROBLEM = """
[agent]
states = ["q", "w"]
inputs = ["u"]
dynamics = { q = "w", w = "u - 0.5*sin(q)" }
outputs = { y1 = "q", y2 = "w" }
[network]
spectrum = [1.0, 4.0]
[design]
method = "modal"
order = 0
starts = 1
gain_limit = 10.0
"""


@pytest.fixture(scope="module")
def joins():
    spec = importlib.util.spec_from_file_location("joins", PATH)
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["joins"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def stored():
    return design_file_of(design(Problem.parse(PROBLEM)))


def test_no_sequence_breaks_the_bound(joins, stored):
    assert 0.05 < joins.largest(stored, 3, most=20) < 1


def test_a_smaller_rho_is_seen_to_be_exceeded(joins, stored):
    """The same simulation can fail: a storage function and a rho^2 a hundred times smaller promise too little."""
    certificate = stored.proofs.certificate
    (one,) = certificate.segments
    less = replace(certificate, rho=certificate.rho / 10, segments=(replace(one, P=one.P / 100),))
    claims = replace(stored.claims, rho=less.rho)
    tampered = replace(stored, claims=claims, proofs=replace(stored.proofs, certificate=less))
    assert joins.largest(tampered, 3, most=20) > 1


@pytest.mark.slow
@pytest.mark.by_hand
def test_a_thousand_sequences_do_not_break_the_bound(joins, stored):
    assert joins.largest(stored, 1000, seed=7) < 1
