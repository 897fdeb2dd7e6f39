"""Tampered design files: the checker's verdict is that of an independent decision, in both directions.

The file holds the published Corollary 1 gains, once for exact controllers and once for ones whose D may be off by 0.01. One
number in it is changed: a gain, an entry of P, m, t, rho, alpha, a delta, gravity, a weight, the weight of an edge. The twin
(`exact_twin`) starts from the changed text and the paper's (38); it decides in fractions, with no code of the package.
"""

import json
from collections import Counter
from copy import deepcopy
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from exact_twin import Twin
from lmi_cases import table_1_problem

from lockstep.check.errors import ProblemError
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of, parse
from lockstep.model.problem import Problem

FACTORS = (
    1 - 1e-12,
    1 + 1e-12,
    1 - 1e-6,
    1 + 1e-6,
    0.999,
    1.001,
    0.99,
    1.01,
    0.9,
    1.1,
    0.5,
    1.5,
    2.0,
    10.0,
    0.0,
    -1.0,
)


@pytest.fixture(scope="module")
def files() -> list[dict[str, Any]]:
    """The two design files, as JSON gives them back."""
    made = [table_1_problem()]
    fragile = made[0].document()
    fragile["design"]["fragility"] = {"D": 0.01}
    made.append(Problem.from_document(fragile))
    files = [json.loads(json.dumps(design_file_of(design(problem)).document())) for problem in made]
    for file in files:  # the decay is another inequality with a P of its own, which the twin does not decide
        file["claims"]["decay"] = file["proofs"]["decay"] = None
    return files


def twin_says(file: dict[str, Any]) -> bool:
    """Decide a file from (38) and its own numbers; what the schema refuses counts as no."""
    N, table = 3, file["problem"]
    gravity, weights = table["agent"]["parameters"]["gravity"], table["design"]["weights"]
    adjacency = np.zeros((N, N))
    for listener, source, *weight in table["network"]["edges"]:
        adjacency[listener - 1, source - 1] = weight[0] if weight else 1.0
    delta = [file["claims"]["fragility"][letter] for letter in "ABCD"]
    if min(weights["state"], weights["controller"]) <= 0 or min(delta) < 0 or file["claims"]["alpha"] < 0:
        return False
    if any(len(edge) == 3 and edge[2] <= 0 for edge in table["network"]["edges"]):
        return False
    if Fraction(abs(gravity)) > Fraction(
        file["claims"]["alpha"]
    ):  # |d/dtheta (gravity sin theta)| <= |gravity|, and it is reached
        return False
    plant = SimpleNamespace(  # (38)
        A=[[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]],
        B=[[[0], [21.6], [0], [0]]] * N,
        C=[[1, 0, 0, 0], [0, 1, 0, 0]],
        G=[[0], [0], [0], [1]] if gravity else [[]] * 4,
        H=[[0, 0, 1, 0]] if gravity else [],
    )
    claim = SimpleNamespace(
        alpha=file["claims"]["alpha"],
        R=np.eye(4) * weights["state"],
        Q=np.eye(2) * weights["controller"],
        delta=[delta] * N,
        entries=(),
    )
    asked = table["design"].get("fragility", dict.fromkeys("ABCD", 0.0))
    if any(own < asked[letter] for own, letter in zip(delta, "ABCD", strict=True)):
        return False  # less than the file's own problem asks for
    found = file["proofs"]["certificate"]
    ways = N * sum(d > 0 for d in delta)
    if len(found["t"]) != ways:
        return False  # a delta of 0 takes its multipliers out of the inequality: the file no longer fits together
    certificate = SimpleNamespace(
        rho=file["claims"]["rho"], P=found["P"], m=found["m"], t=found["t"], m_entries=[]
    )
    return Twin(plant, adjacency, file["gains"]).holds(claim, certificate)


def checker_says(file: dict[str, Any]) -> bool:
    try:
        return certify(parse(file, "memory")).certified
    except ProblemError:
        return False


def tampered(file: dict[str, Any], generator: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Change one number by a random factor; a number that is 0 stays out of reach of factors, so 1e-3 is added to it."""
    file = deepcopy(file)
    factor = float(generator.choice(FACTORS))

    def change(container: Any, key: Any) -> float:
        container[key] = container[key] * factor if container[key] else 1e-3
        return float(container[key])

    def any_of(values: list[Any]) -> int:
        return int(generator.integers(len(values)))

    kind = str(
        generator.choice(["gain", "P", "P", "m", "t", "rho", "alpha", "delta", "gravity", "weight", "edge"])
    )
    found, table = file["proofs"]["certificate"], file["problem"]
    if kind == "gain":
        block = file["gains"][any_of(file["gains"])][str(generator.choice(list("ABCD")))]
        row = block[any_of(block)]
        change(row, any_of(row))
    elif kind == "P":
        i, j = any_of(found["P"]), any_of(found["P"])
        found["P"][j][i] = change(found["P"][i], j)
    elif kind in ("m", "t"):
        values = found[kind] or found["m"]
        change(values, any_of(values))
    elif kind in ("rho", "alpha"):
        change(file["claims"], kind)
    elif kind == "delta":
        change(file["claims"]["fragility"], "D")
    elif kind == "gravity":
        change(table["agent"]["parameters"], "gravity")
    elif kind == "weight":
        change(table["design"]["weights"], str(generator.choice(["state", "controller"])))
    else:
        edge = table["network"]["edges"][any_of(table["network"]["edges"])]
        edge[:] = [*edge[:2], (edge[2] if len(edge) == 3 else 1.0) * factor]
    return f"{kind} x {factor:g}", file


def agree(files: list[dict[str, Any]], seed: int, count: int) -> Counter[bool]:
    """Tamper `count` times and compare; return how often the answer was yes and how often no."""
    generator, answers = np.random.default_rng(seed), Counter[bool]()
    while answers.total() < count:
        what, file = tampered(files[0] if generator.uniform() < 0.8 else files[1], generator)
        expected = twin_says(file)
        assert checker_says(file) is expected, what
        answers[expected] += 1
    return answers


def test_the_files_themselves_are_accepted_by_both(files: list[dict[str, Any]]) -> None:
    for file in files:
        assert twin_says(file)
        assert checker_says(file)


def test_tampered_files_are_accepted_exactly_when_the_twin_accepts_them(files: list[dict[str, Any]]) -> None:
    answers = agree(files, seed=1, count=24)
    assert min(answers[True], answers[False]) >= 5  # both kinds were met


@pytest.mark.by_hand
@pytest.mark.slow
def test_a_thousand_tampered_files_of_either_kind(files: list[dict[str, Any]]) -> None:
    """Issue 4: none of 1000 that break the inequality is accepted, none of 1000 that do not is rejected."""
    answers: Counter[bool] = Counter()
    for seed in range(100, 260):
        answers += agree(files, seed=seed, count=30)
        if min(answers[True], answers[False]) >= 1000:
            return
    raise AssertionError(f"only {answers} were met")


@pytest.mark.slow
def test_the_last_bit_decides(files: list[dict[str, Any]]) -> None:
    """The twin bisects rho down to two neighbouring doubles, one that holds and one that does not: the checker agrees."""
    file = deepcopy(files[0])
    low, high = 0.9 * file["claims"]["rho"], file["claims"]["rho"]
    while np.nextafter(low, high) < high:
        file["claims"]["rho"] = float((low + high) / 2)
        low, high = (low, file["claims"]["rho"]) if twin_says(file) else (file["claims"]["rho"], high)
    for rho, holds in ((low, False), (high, True)):
        file["claims"]["rho"] = float(rho)
        assert checker_says(file) is holds
