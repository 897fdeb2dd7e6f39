"""Certificates of others: twenty of them, eight wrong within what a solver accepts, and twenty right verdicts."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats
from lockstep.lmi.external_lmi import (
    Lmi,
    decide_lmi,
    document_of_cvxpy,
    document_of_gram,
    document_of_matrices,
    rounded_gram,
)


def alone(matrix, sign: str = ">") -> dict:
    return {"constraints": [{"sign": sign, "constant": [[str(v) for v in row] for row in matrix]}]}


def lyapunov(A, P) -> dict:
    """P > 0 and -(A'P + P A) > 0, in the entries of P."""
    A = np.array(A, dtype=object)
    units = {"p11": [[1, 0], [0, 0]], "p12": [[0, 1], [1, 0]], "p22": [[0, 0], [0, 1]]}
    moved = {k: -(A.T @ np.array(U) + np.array(U) @ A) for k, U in units.items()}
    return {
        "variables": list(units),
        "constraints": [
            {"name": "P", "terms": units},
            {
                "name": "decrease",
                "terms": {k: [[str(v) for v in row] for row in M] for k, M in moved.items()},
            },
        ],
        "point": dict(zip(units, map(str, P), strict=True)),
    }


def hilbert(n: int):
    return [[Fraction(1, i + j + 1) for j in range(n)] for i in range(n)]


def pascal(n: int):
    return [[math.comb(i + j, i) for j in range(n)] for i in range(n)]


def lehmer(n: int):
    return [[Fraction(min(i, j), max(i, j)) for j in range(1, n + 1)] for i in range(1, n + 1)]


def moler(n: int):
    """Positive definite with determinant 1 and, of 12 rows, a smallest eigenvalue below 1e-6 (Nash 1979)."""
    return [[min(i, j) - 1 if i != j else i + 1 for j in range(n)] for i in range(n)]


def laplacian_of_a_ring(n: int):
    return [[2 * (i == j) - ((i - j) % n in (1, n - 1)) for j in range(n)] for i in range(n)]


THIRDS = [[Fraction(i * j, 9) for j in (1, 2, 3)] for i in (1, 2, 3)]

# Parrilo 2003: 2 x^4 + 2 x^3 y - x^2 y^2 + 5 y^4 in (x^2, y^2, xy), lambda = 3: of rank two.
QUARTIC = {(4, 0): 2, (3, 1): 2, (2, 2): -1, (0, 4): 5}
IN = [(2, 0), (0, 2), (1, 1)]
PARRILO = [["2", "-3", "1"], ["-3", "5", "0"], ["1", "0", "5"]]


def golden(t: str) -> dict:
    """t I >= [0 1; 1 1], whose largest eigenvalue is 1.618033988749894848..."""
    term = {"t": [[1, 0], [0, 1]]}
    one = {"sign": ">=", "constant": [[0, -1], [-1, -1]], "terms": term}
    return {"variables": ["t"], "constraints": [one], "point": {"t": t}}


def bounded_real(gamma: str) -> dict:
    """1/(s + 1) has the norm 1: with P = 1, -[-2 + 1, 1; 1, -gamma^2] > 0 for gamma > 1."""
    return alone([[1, -1], [-1, Fraction(gamma) ** 2]])


def solved() -> dict:
    cp = pytest.importorskip("cvxpy")
    A = np.array([[0.0, 1.0], [-2.0, -3.0]])
    P = cp.Variable((2, 2), symmetric=True, name="P")
    problem = cp.Problem(cp.Minimize(cp.trace(P)), [P >> np.eye(2), A.T @ P + P @ A << -0.1 * np.eye(2)])
    problem.solve(solver=cp.CLARABEL)
    document = document_of_cvxpy(problem, strict=True)
    # The claim is P > 0, not P > I: the solution of an optimum lies on its constraints.
    document["constraints"][0]["constant"] = [["0", "0"], ["0", "0"]]
    document["constraints"][1]["constant"] = [["0", "0"], ["0", "0"]]
    return document


def sum_of_squares() -> dict:
    """A Gram matrix off by 1e-7, as solvers leave it: rounded onto the polynomial."""
    solvers = np.array([[2.0, -2.0, 1.0], [-2.0, 5.0, 0.0], [1.0, 0.0, 3.0]]) + 1e-7
    return document_of_gram(rounded_gram(solvers, IN, QUARTIC), IN, QUARTIC)


RIGHT = {
    "Lyapunov, exact": lambda: lyapunov([[0, 1], [-2, -3]], ["5/4", "1/4", "1/4"]),
    "Hilbert 8": lambda: alone(hilbert(8)),
    "Pascal 10": lambda: alone(pascal(10)),
    "Lehmer 9": lambda: alone(lehmer(9)),
    "Moler 12": lambda: alone(moler(12)),
    "bounded real, 1.001": lambda: bounded_real("1.001"),
    "a sum of two squares": lambda: document_of_gram(PARRILO, IN, QUARTIC),
    "a rounded sum of squares": sum_of_squares,
    "a ring's Laplacian": lambda: alone(laplacian_of_a_ring(9), ">="),
    "a third of rank one": lambda: alone(THIRDS, ">="),
    "the golden ratio from above": lambda: golden("1.618033988749894849"),
    "a solver's Lyapunov function": solved,
}
WRONG = {
    "an eigenvalue of -1e-9": lambda: alone([["1", "1"], ["1", "0.999999998"]], ">="),
    "data that are not symmetric": lambda: alone([["2", "0.1"], ["0.1000000001", "2"]]),
    "a third in ten decimals": lambda: alone(
        [
            [v if (i, j) != (2, 2) else "0.9999999999" for j, v in enumerate(row)]
            for i, row in enumerate(THIRDS)
        ],
        ">=",
    ),
    "a Gram matrix a hair off": lambda: document_of_gram(
        [["2", "-3", "1"], ["-3", "5", "0"], ["1", "0", "5.0000000001"]], IN, QUARTIC
    ),
    "singular, claimed definite": lambda: alone(laplacian_of_a_ring(4)),
    "hardly unstable": lambda: lyapunov([[Fraction(1, 10**12), 0], [0, -1]], ["1", "0", "1"]),
    "the golden ratio from below": lambda: golden("1.618033988749894848"),
    "three tenths": lambda: {
        "variables": ["x"],
        "constraints": [{"sign": ">=", "constant": [["-0.3000000000000000001"]], "terms": {"x": [["3"]]}}],
        "point": {"x": "0.1"},
    },
}


def test_there_are_twenty_and_eight_of_them_are_wrong():
    assert (len(RIGHT), len(WRONG)) == (12, 8)


@pytest.mark.parametrize("name", RIGHT)
def test_what_holds_is_proved(name):
    found = decide_lmi(RIGHT[name]())
    assert found.ok, found.reason
    assert found.document()["proof"] == "exact"


@pytest.mark.parametrize("name", WRONG)
def test_what_fails_by_a_hair_is_refuted_and_the_witness_multiplies_out(name):
    lmi = Lmi.of(WRONG[name]())
    found = decide_lmi(lmi)
    assert not found.ok
    failed = next(one for one in found.constraints if one.found != "proved")
    assert failed.found == "refuted"
    F = failed.constraint.at(lmi.point)
    doubles = as_floats(F)
    if failed.constraint.sign != "=":  # a solver with a tolerance of 1e-8 accepts it
        assert np.linalg.eigvalsh((doubles + doubles.T) / 2)[0] > -1e-8 * max(1, np.abs(doubles).max())
    if failed.vector is not None:
        v = [Fraction(int(x.p), int(x.q)) for x in failed.vector]
        entries = [[Fraction(int(x.p), int(x.q)) for x in row] for row in F.tolist()]
        value = sum(a * entries[i][j] * b for i, a in enumerate(v) for j, b in enumerate(v))
        assert value == Fraction(int(failed.value.p), int(failed.value.q))
        assert value < 0 or (value == 0 and failed.constraint.sign == ">" and any(v))
    else:
        assert "not symmetric" in failed.method or failed.constraint.sign == "="


@pytest.fixture
def run(tmp_path, monkeypatch):
    from lockstep.cli.main import app

    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["certify", *map(str, words)])


def test_the_command_proves_refutes_and_refuses(run, tmp_path):
    for content, status in (
        (RIGHT["Hilbert 8"](), 0),
        (WRONG["an eigenvalue of -1e-9"](), 1),
        ({"constraints": []}, 2),
    ):
        (tmp_path / "lmi.json").write_text(json.dumps(content))
        result = run("--lmi", "lmi.json", "--json")
        assert result.exit_code == status, result.output
        answer = json.loads(result.stdout)
        assert answer["ok"] is (status == 0)
        if status == 1:
            assert answer["constraints"][0]["vector"]
            assert answer["error"]["kind"] == "NotCertified"
        assert run("--lmi", "lmi.json").exit_code == status
    assert run("--lmi", "none.json").exit_code == 2
    assert run().exit_code == 2
    assert run("design.json", "--lmi", "lmi.json").exit_code == 2


def test_a_number_in_a_file_is_the_decimal_as_written(tmp_path):
    """0.1 is 1/10: as doubles 3 x 0.1 - 0.3 is 5.6e-17, as written it is 0."""
    claim = '{"sign": "=", "constant": [[-0.3]], "terms": {"x": [[3]]}}'
    text = f'{{"variables": ["x"], "constraints": [{claim}], "point": {{"x": 0.1}}}}'
    (tmp_path / "tenths.json").write_text(text)
    assert lockstep.decide_lmi(tmp_path / "tenths.json").ok


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"constraints": [{"constant": [["1", "2"]]}]}, "square"),
        ({"constraints": [{"constant": [["1", "2"], ["3"]]}]}, "no matrix"),
        ({"constraints": [{"constant": [["one"]]}]}, "row 1, column 1"),
        ({"constraints": [{"constant": [["1/0"]]}]}, "number"),
        ({"constraints": [{"constant": [["nan"]]}]}, "number"),
        ({"constraints": [{"constant": [[float("nan")]]}]}, "number"),
        ({"constraints": [{"constant": [["1e999999999"]]}]}, "exponent"),
        ({"constraints": [{"constant": [[True]]}]}, "number"),
        ({"constraints": [{"constant": [["1"]], "sign": "<"}]}, "sign"),
        ({"constraints": [{"constant": [["1"]], "term": {}}]}, "unknown"),
        ({"constraints": [{"constant": [["1"]], "terms": {"x": [["1"]]}}]}, "variables alone"),
        ({"variables": ["x"], "constraints": [{"constant": [["1"]]}]}, "point"),
        (
            {"variables": ["x", "x"], "constraints": [{"constant": [["1"]]}], "point": {"x": 1}},
            "different names",
        ),
        ({"constraints": [{"terms": {}}]}, "no matrix"),
        ({"format": "other", "constraints": [{"constant": [["1"]]}]}, "format"),
        ([], "object"),
    ],
)
def test_what_is_no_lmi_is_refused_with_its_place(content, said):
    with pytest.raises(ProblemError, match=said):
        Lmi.of(content)


def test_a_file_that_is_no_json_or_says_a_thing_twice(tmp_path):
    for text, said in (("{", "not JSON"), ('{"point": {}, "point": {}}', "twice"), ("[" * 5000, "not JSON")):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises(ProblemError, match=said):
            Lmi.read(tmp_path / "bad.json")


def test_cvxpy_problems_of_every_kind_come_out_as_they_are():
    cp = pytest.importorskip("cvxpy")
    X, y = cp.Variable((3, 3), PSD=True, name="X"), cp.Variable(2, name="y")
    constraints = [cp.trace(X) == 2, y <= 3, X[0, 1] + y[0] >= 0.25, cp.bmat([[y[0], 1.0], [1.0, y[1]]]) >> 0]
    problem = cp.Problem(cp.Minimize(cp.sum(y) + X[2, 2]), constraints)
    problem.solve(solver=cp.CLARABEL)
    before = X.value.copy()
    document = document_of_cvxpy(problem)
    np.testing.assert_array_equal(X.value, before)
    signs = [one["sign"] for one in document["constraints"]]
    assert signs == [">=", "=", ">=", ">=", ">=", ">="]
    lmi = Lmi.of(document)
    for one, expected in zip(
        lmi.constraints,
        [X.value, [[np.trace(X.value) - 2]], [[3 - y.value[0]]], [[3 - y.value[1]]]],
        strict=False,
    ):
        found = as_floats(one.at(lmi.point))
        assert np.allclose(np.abs(found), np.abs(expected), atol=1e-12)
    with pytest.raises(ProblemError, match="solve it first"):
        document_of_cvxpy(cp.Problem(cp.Minimize(0), [cp.Variable((2, 2), symmetric=True) >> 0]))
    z = cp.Variable(name="z")
    cone = cp.Problem(cp.Minimize(z), [cp.SOC(z, cp.hstack([z, 1.0])), z >= 2])
    z.value = 3.0
    with pytest.raises(ProblemError, match="constraint 1 is a"):
        document_of_cvxpy(cone)


def test_matrices_of_any_origin_and_polynomials_that_are_no_sums():
    assert decide_lmi(document_of_matrices({"P": np.eye(3), "Q": [[2.0, 1.0], [1.0, 2.0]]})).ok
    with pytest.raises(ProblemError, match="symmetric Gram"):
        document_of_gram([["1", "2", "0"], ["0", "1", "0"], ["0", "0", "1"]], IN, QUARTIC)
    with pytest.raises(ProblemError, match="product of two"):
        rounded_gram(np.eye(3), IN, {(5, 0): 1})


@pytest.mark.parametrize("seed", range(40))
def test_random_matrices_on_the_edge_are_decided_as_sums_of_squares_are(seed):
    """B'B of whole numbers, of low rank: semidefinite, not definite; less a tenth of a million: neither."""
    rng = np.random.default_rng(seed)
    n, rank = int(rng.integers(2, 7)), int(rng.integers(1, 4))
    B = rng.integers(-3, 4, size=(min(rank, n - 1), n))
    F = (B.T @ B).tolist()
    assert decide_lmi(alone(F, ">=")).ok
    assert not decide_lmi(alone(F, ">")).ok
    k = int(rng.integers(n))
    F[k][k] = Fraction(F[k][k]) - Fraction(1, 10**7)
    minor_holds = decide_lmi(alone(F, ">=")).ok
    # Row k spans a direction of its own in B'B if and only if e_k is in the row space of B.
    assert minor_holds == (np.linalg.matrix_rank(np.vstack([B, np.eye(n)[k]])) == np.linalg.matrix_rank(B))
