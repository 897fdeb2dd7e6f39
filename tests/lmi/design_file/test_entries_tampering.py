"""Tampered design files with entries: the checker's verdict is that of the twin and of slopes known in closed form."""

import json
from copy import deepcopy
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from exact_twin import Twin
from test_entries import pair
from test_tampering import FACTORS, checker_says

from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of


@pytest.fixture(scope="module")
def file() -> dict[str, Any]:
    """Three agents on a directed cycle: a' = u + 2 sin a + 0.02 sin b, b' = 20 a - b."""
    made: dict[str, Any] = json.loads(json.dumps(design_file_of(design(pair(3, "cycle"))).document()))
    return made


def twin_says(file: dict[str, Any]) -> bool:
    """Decide a file from the agents' equations and its own numbers."""
    alpha, entries = (
        Fraction(file["claims"]["alpha"]),
        [Fraction(one["bound"]) for one in file["claims"]["entries"]],
    )
    if alpha < 0 or alpha**2 < 4 + Fraction(0.02) ** 2 or entries[0] < 2 or entries[1] < Fraction(0.02):
        return False
    plant = SimpleNamespace(A=[[0, 0], [20, -1]], B=[[[1], [0]]] * 3, C=np.eye(2), G=[[1], [0]], H=np.eye(2))
    places = [
        SimpleNamespace(component=0, argument=k, bound=one["bound"])
        for k, one in enumerate(file["claims"]["entries"])
    ]
    claim = SimpleNamespace(
        alpha=file["claims"]["alpha"], R=np.eye(2), Q=np.zeros((0, 0)), delta=[[0.0] * 4] * 3, entries=places
    )
    found = file["proofs"]["certificate"]
    certificate = SimpleNamespace(
        rho=file["claims"]["rho"], P=found["P"], m=found["m"], t=[], m_entries=found["m_entries"]
    )
    adjacency = np.roll(np.eye(3), 1, axis=1)
    return Twin(plant, adjacency, file["gains"]).holds(claim, certificate)


def tampered(file: dict[str, Any], generator: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Change one number by a random factor."""
    file, factor = deepcopy(file), float(generator.choice(FACTORS))
    kind = str(generator.choice(["bound", "bound", "m_entries", "m_entries", "m", "P", "rho", "alpha"]))
    found = file["proofs"]["certificate"]
    if kind == "bound":
        file["claims"]["entries"][int(generator.integers(2))]["bound"] *= abs(factor)
    elif kind == "m_entries":
        found["m_entries"][int(generator.integers(2))][int(generator.integers(3))] *= factor
    elif kind == "m":
        found["m"][int(generator.integers(3))] *= factor
    elif kind == "P":
        i, j = generator.integers(4, size=2)
        found["P"][i][j] *= factor
        found["P"][j][i] = found["P"][i][j]
    else:
        file["claims"][kind] *= factor
    return f"{kind} x {factor:g}", file


def test_the_graph_and_the_file_are_those_of_the_twin(file: dict[str, Any]) -> None:
    assert twin_says(file)
    assert checker_says(file)


def test_tampered_files_are_accepted_exactly_when_the_twin_accepts_them(file: dict[str, Any]) -> None:
    generator, answers = np.random.default_rng(2), {True: 0, False: 0}
    for _ in range(40):
        what, changed = tampered(file, generator)
        expected = twin_says(changed)
        assert checker_says(changed) is expected, what
        answers[expected] += 1
    assert min(answers.values()) >= 8
