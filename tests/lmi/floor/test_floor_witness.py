"""What proves a floor, and what does not: a witness for its own problem, unchanged; the identities it rests on."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from flint import fmpq
from floor_cases import plain, quarters
from lmi_cases import ALPHA, arms, table_1_problem

from lockstep.check.continuous.inequality import Certificate, Claim, Performance
from lockstep.check.continuous_claims import decide_floor
from lockstep.check.design_file.proofs import floor_witness_of
from lockstep.check.errors import ProblemError
from lockstep.check.floor.projected import FloorAgent, with_rho
from lockstep.check.floor.witness import FloorWitness, bound, coupled, not_negative, proves_floor, restored
from lockstep.check.numbers import as_floats, exactly
from lockstep.check.system.loop import Plant
from lockstep.lmi.design import design
from lockstep.lmi.design_json import floor_document
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of, parse
from lockstep.lmi.floor.bisection import largest_floor


@pytest.fixture(scope="module")
def proved() -> FloorWitness:
    witness = largest_floor(arms().matrices, plain(3, ALPHA, np.eye(4)))
    assert witness is not None
    return witness


def changed(witness: FloorWitness, **changes: object) -> FloorWitness:
    """Return the witness with its first piece changed."""
    first, *others = witness.pieces
    return replace(witness, pieces=(replace(first, **changes), *others))


@pytest.mark.parametrize(
    "tampered",
    [
        lambda w: replace(w, rho=1.01 * w.rho),
        lambda w: replace(w, rho=0.0),
        lambda w: replace(w, rho=-w.rho),
        lambda w: replace(w, pieces=()),
        lambda w: replace(w, pieces=w.pieces[1:]),
        lambda w: replace(w, pieces=w.pieces[:-1]),
        lambda w: replace(w, pieces=w.pieces[::-1]),
        lambda w: changed(w, upper=w.pieces[1].upper),
        lambda w: changed(w, upper=1e6 * w.pieces[0].upper),
        lambda w: changed(w, Z=-w.pieces[0].Z),
        lambda w: changed(w, Z=w.pieces[0].Z[:-1, :-1]),
        lambda w: changed(w, Z=np.triu(w.pieces[0].Z)),
        lambda w: changed(w, Z_dual=0.0 * w.pieces[0].Z_dual),
        lambda w: changed(w, k=w.pieces[0].k.T),
        lambda w: changed(w, k=10.0 * w.pieces[0].k),
    ],
)
def test_a_tampered_witness_proves_nothing(
    proved: FloorWitness, tampered: Callable[[FloorWitness], FloorWitness]
) -> None:
    assert proves_floor(arms().matrices, plain(3, ALPHA, np.eye(4)), proved)
    assert not proves_floor(arms().matrices, plain(3, ALPHA, np.eye(4)), tampered(proved))


def test_a_witness_is_about_its_own_problem(proved: FloorWitness) -> None:
    assert not proves_floor(arms().matrices, plain(3, 0.97 * ALPHA, np.eye(4)), proved)
    assert not proves_floor(arms().matrices, plain(3, ALPHA, 0.97 * np.eye(4)), proved)
    asked = plain(3, ALPHA, np.eye(4))
    for one in (proved, replace(proved, slopes=None)):
        assert proves_floor(arms().matrices, asked, floor_witness_of(one.rho, floor_document(one), "memory"))
    assert not proves_floor(arms().matrices, asked, replace(proved, slopes=(0.0,)))
    claim = Claim(ALPHA, np.eye(4), np.eye(2), np.zeros((3, 4)))
    assert decide_floor(arms().matrices, claim, proved).proved
    assert decide_floor(arms().matrices, replace(claim, alpha=0.97 * ALPHA), proved).status == "undecided"


@pytest.mark.parametrize(
    ("pieces", "said"),
    [
        (None, "floor"),
        ([1], "piece 1"),
        ([{"upper": None, "Z": [[1.0], [1.0]], "Z_dual": [], "k": []}], "`Z`"),
        ([{"upper": None, "Z": [], "Z_dual": [["1"]], "k": []}], "`Z_dual`"),
        ([{"upper": True, "Z": [], "Z_dual": [], "k": []}], "`upper`"),
        ([{"upper": None, "Z": [], "Z_dual": [], "k": [], "K": []}], "`K`"),
        ({"slopes": [0.0]}, "`pieces`"),
        ({"slopes": ["0"], "pieces": []}, "`slopes`"),
        ({"slopes": [], "pieces": [], "J": []}, "`J`"),
    ],
)
def test_a_floor_that_is_none_by_its_form(file: dict[str, Any], pieces: Any, said: str) -> None:
    proofs = {**file["proofs"], "floor": pieces}
    with pytest.raises(ProblemError, match=said):
        parse({**file, "proofs": proofs}, "memory")
    unclaimed = {**file, "claims": {**file["claims"], "floor": None}, "proofs": proofs}
    assert parse(unclaimed, "memory").proofs.floor is None


def test_the_certificate_has_the_form_that_the_floor_is_about() -> None:
    """A new multiplier in F may certify less: `floor.projected` is to be stated anew with it before this list grows.

    W, the noise of outputs and the scales of states are in the projected sides; with entries phi is one linear function.
    """
    assert {one.name for one in fields(Claim)} == {
        *("alpha", "R", "Q", "delta", "entries"),
        *("W", "states", "outputs"),
    }
    assert {one.name for one in fields(Certificate)} == {"rho", "P", "m", "t", "m_entries"}


@pytest.fixture(scope="module")
def file(proved: FloorWitness) -> dict[str, Any]:
    """The published gains, whose method looks for no floor, with that of the arms."""
    content = json.loads(json.dumps(design_file_of(design(table_1_problem())).document()))
    assert (content["claims"]["floor"], content["proofs"]["floor"]) == (None, None)
    content["claims"]["floor"] = proved.rho
    content["proofs"]["floor"] = floor_document(proved)
    return content


def test_the_checker_decides_the_floor_of_a_file(file: dict[str, Any]) -> None:
    assert certify(parse(file, "memory")).certified
    floor, proof = file["claims"]["floor"], file["proofs"]["floor"]
    for claimed, witness in ((1.01 * floor, proof), (floor, {**proof, "pieces": proof["pieces"][1:]})):
        claims, proofs = {**file["claims"], "floor": claimed}, {**file["proofs"], "floor": witness}
        verdict = certify(parse({**file, "claims": claims, "proofs": proofs}, "memory"))
        assert not verdict.certified
        assert "does not prove it" in verdict.reason


def test_what_is_left_of_the_sum_is_g() -> None:
    """The identity that the proof rests on, with the inequalities written out again, for random numbers."""
    rng, n, m, q, r, rho, mu = np.random.default_rng(5), 4, 1, 2, 1, 1.75, 0.5
    A, B, C, G, H = (quarters(rng, *shape) for shape in ((n, n), (n, m), (q, n), (n, r), (r, n)))
    C[:, :2], B[0] = np.eye(2), 1.0
    L, half = np.tril(quarters(rng, n, n)) + 3 * np.eye(n), fmpq(1, 2)
    R = L @ L.T
    plant = Plant(A, (B,), C, G, H).in_numbers(True)
    stated = with_rho(FloorAgent(plant, half, Performance(R, np.eye(0))), fmpq(7, 4))
    sides = stated.primal, stated.dual
    points = []
    for side in sides:
        half_point = quarters(rng, side.size, side.size)
        points.append(restored(side, exactly(half_point + half_point.T)))
        assert not np.any(side.rows @ side.flow @ points[-1][:, : side.k])
    k = exactly(quarters(rng, sides[0].k, sides[1].k))
    X, Y = (one + one.T for one in (quarters(rng, n, n), quarters(rng, n, n)))
    N, N_dual = (as_floats(side.kernel) for side in sides)
    written = [
        bordered(
            N,
            X @ A + A.T @ X + R / rho + mu * 0.25 * H.T @ H,
            [(X, rho * np.eye(n)), (X @ G, mu * np.eye(r))],
        ),
        bordered(
            N_dual,
            Y @ A.T + A @ Y + np.eye(n) / rho + G @ G.T / mu,
            [(Y @ R / rho, R / rho), (Y @ H.T / 2, np.eye(r) / mu)],
        ),
    ]
    coupling = np.block([[N.T @ X @ N, N.T @ N_dual], [N_dual.T @ N, N_dual.T @ Y @ N_dual]])
    K = as_floats(coupled(sides, points, k))
    total = sum(np.sum(as_floats(Z) * M) for Z, M in zip(points, written, strict=True)) - np.sum(K * coupling)
    c_0, c_1, c_2 = as_floats(np.array(bound(stated, points[0], points[1], k), dtype=object))
    assert total == pytest.approx(c_0 + c_1 * mu + c_2 / mu, rel=1e-9)


def bordered(N: np.ndarray, head: np.ndarray, borders: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return [N' head N, N' side ...; *, -corner, ...]."""
    sides = np.hstack([N.T @ side for side, _ in borders])
    corners = np.zeros((sides.shape[1],) * 2)
    place = 0
    for _, corner in borders:
        corners[place : place + len(corner), place : place + len(corner)] = corner
        place += len(corner)
    return np.block([[N.T @ head @ N, sides], [sides.T, -corners]])


def test_a_sign_on_an_interval_is_that_of_a_fine_grid() -> None:
    """Quadratics with small whole coefficients; the grid holds their roots and vertices, which are halves of ratios."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        c_0, c_1, c_2 = (int(c) for c in rng.integers(-4, 5, 3))
        lower, upper = sorted(rng.choice(np.arange(0, 12), 2, replace=False))
        grid = np.linspace(float(lower), float(upper), 481)
        q = [fmpq(c) for c in (c_0, c_1, c_2)]
        least = (c_1 * grid**2 + c_0 * grid + c_2).min()
        if abs(least) > 1e-3:
            assert not_negative(tuple(q), fmpq(int(lower)), fmpq(int(upper))) == (least > 0)
        far = np.concatenate([grid, np.geomspace(upper, 1e4, 2000)])
        least = (c_1 * far**2 + c_0 * far + c_2).min()
        if abs(least) > 1e-3:
            assert not_negative(tuple(q), fmpq(int(lower)), None) == (least > 0)
