"""Designs of problems small enough to know the answer: closed forms, must-fails that say why, and every shape once.

Each design here is proved by the exact decision and then looked at again from outside: the gains' norms, the decision for the
agents' own equations by `exact_twin`, and where there is one the optimum in closed form.
"""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from exact_twin import Twin
from lmi_cases import DOUBLE_INTEGRATOR, problem

from lockstep.check.errors import BoundNotProved, Infeasible, NotCertified, ProblemError
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.system.loop import Gains
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of, parse
from lockstep.lmi.methods import certified
from lockstep.lmi.proposal import Proposal, proved_bound
from lockstep.lmi.search import SearchResult
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem

PATH_2 = 'agents = 2\ntopology = "path"'
CYCLE_3 = 'agents = 3\ntopology = "cycle"'
BOTH = {"y1": "a", "y2": "b"}
PENDULUM = {"a": "b", "b": "-a - sin(a) + u"}


def scalar(design_table: str) -> Problem:
    """x' = sin x + u, y = x, two agents that hear each other: x_d' = -(d_1 + d_2) x_d + phi_d + xi_d."""
    return problem(
        dynamics={"x": "sin(x) + u"},
        outputs={"y": "x"},
        network=PATH_2,
        design=design_table,
        agent="centre = false",
    )


def checked(made: Proposal) -> Proposal:
    """Decide the design again: by the checker from its text, and by the twin from the agents' equations."""
    assert made.certified
    assert made.certificate is not None
    stored = parse(json.loads(json.dumps(design_file_of(made).document())), "memory")
    assert certify(stored).certified
    blocks = [{letter: getattr(made.gains, letter)[i] for letter in "ABCD"} for i in range(made.gains.N)]
    if (
        made.network.coordinates == "orthonormal"
    ):  # the twin's metric: V and rho of rows of L are other numbers
        twin = Twin(made.network.plant, made.network.graph.adjacency, blocks)
        assert twin.holds(made.claim, made.certificate)
    if made.problem.design.method == "certified":
        assert max(made.problem.gain_norms(made.gains.blocks)) <= made.problem.design.gain_limit
    assert made.floor is None or made.floor.rho <= made.certificate.rho
    return made


@pytest.mark.parametrize("order", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_the_scalar_loop_reaches_its_optimum(order: int) -> None:
    """rho = 1 / (2 d - alpha) at the gain limit d = 10: 1/19, whatever the order; the certificate rounds up."""
    made = checked(design(scalar(f"order = {order}\nstarts = 1\ngain_limit = 10.0"), jobs=1))
    assert made.certificate is not None
    assert 1 / 19 <= made.certificate.rho <= 1.003 / 19


@pytest.mark.slow
def test_the_largest_alpha_is_told_in_the_units_of_the_file() -> None:
    """rho = 1 / (2 d - alpha) at the gain limit d = 10, so 10 is the largest alpha for rho = 0.1; the search divides by 8."""
    design_table = 'order = 0\nstarts = 1\ngain_limit = 10.0\nobjective = "alpha"\nrho = 0.1'
    posed = problem(
        dynamics={"x": "8*sin(x) + u"},
        outputs={"y": "x"},
        network=PATH_2,
        design=design_table,
        agent="centre = false",
    )
    made = checked(design(posed, jobs=1))
    assert made.certificate is not None
    assert made.certificate.rho <= 0.1
    assert 9.9 <= made.claim.alpha <= 10.0


@pytest.mark.slow
def test_a_gain_limit_that_is_too_small_says_how_far_it_reaches() -> None:
    """2 d = 0.6 < 1 = alpha: alpha up to 0.6 is reachable, and no further."""
    with pytest.raises(Infeasible) as error:
        design(scalar("order = 0\nstarts = 1\ngain_limit = 0.3"), jobs=1)
    assert 0.58 <= error.value.figures["reachable_alpha"] <= 0.6
    assert "gain_limit" in str(error.value)


@pytest.mark.slow
def test_a_rho_out_of_reach_says_which_one_is_in_reach() -> None:
    with pytest.raises(Infeasible) as error:
        design(scalar('order = 0\nstarts = 1\ngain_limit = 10.0\nobjective = "alpha"\nrho = 0.05'), jobs=1)
    assert error.value.figures["reachable_rho"] == pytest.approx(1 / 19, rel=1e-3)


@pytest.mark.slow
def test_double_integrators_that_measure_position_and_speed() -> None:
    """Linear: alpha is 0 and rho close to the floor, 1: x' = v + xi leaves v no say in the first instant."""
    made = checked(
        design(
            problem(
                dynamics=DOUBLE_INTEGRATOR,
                outputs={"y1": "p", "y2": "v"},
                design="order = 1\nstarts = 1\ngain_limit = 50.0",
            ),
            jobs=1,
        )
    )
    assert made.claim.alpha == 0.0
    assert made.certificate is not None
    assert made.certificate.m.tolist() == [0.0, 0.0, 0.0]
    assert made.floor is not None
    assert 0.995 <= made.floor.rho <= 1.0
    assert made.certificate.rho < 1.1


def test_double_integrators_that_measure_position_alone_need_a_memory() -> None:
    """No static gain moves the trace of A_cl, 0: the must-fail beside the one above, with the abscissa it gets stuck at."""
    with pytest.raises(Infeasible) as error:
        design(
            problem(dynamics=DOUBLE_INTEGRATOR, outputs={"y1": "p"}, design="order = 0\nstarts = 2"), jobs=1
        )
    assert error.value.figures["abscissa"] == pytest.approx(0.0, abs=1e-3)
    assert "order" in str(error.value)


@pytest.mark.slow
def test_double_integrators_behind_a_leader_with_position_alone() -> None:
    """Issue 4: certified at order 1 on a leader-follower path of four. The leader hears no one: it must stay idle."""
    made = checked(
        design(
            problem(
                dynamics=DOUBLE_INTEGRATOR,
                outputs={"y1": "p"},
                network='agents = 4\ntopology = "leader_path"',
                design="order = 1\nstarts = 2",
            )
        )
    )
    assert made.certificate is not None
    assert made.certificate.rho < 3


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "decay"), [(20.0, 3.0), (0.5, None)])
def test_a_leader_that_hears_no_one_is_in_the_way_of_neither_a_decay_nor_a_small_gain_limit(
    limit: float, decay: float | None
) -> None:
    """Its idle controller was x_C' = -x_C: slower than a decay of 3 1/s, and of norm 1."""
    asked = f"gain_limit = {limit}" + (f"\ndecay = {decay}" if decay else "")
    made = checked(
        design(
            problem(
                dynamics={"p": "-4*p + 0.1*sin(p) + u"},
                outputs={"y1": "p"},
                network='agents = 2\ntopology = "leader_path"',
                design=f"order = 1\nstarts = 1\n{asked}",
            )
        )
    )
    idle = made.gains.blocks[0]
    assert -limit <= idle[0, 0] < -0.9 * limit
    assert np.count_nonzero(idle) == 1
    if decay:
        assert made.guarantees.decay is not None
        assert made.guarantees.decay[0] >= decay


@pytest.mark.parametrize(("B", "C", "idle"), [(0.0, 3.0, True), (2.0, 0.0, True), (2.0, 3.0, False)])
def test_a_state_that_reads_nothing_or_moves_nothing_is_as_fast_as_it_may_be(
    B: float, C: float, idle: bool
) -> None:
    """Behind B_C = 0 or C_C = 0 it is no part of u: its own rate was what a decay was proved of."""
    small = problem(dynamics={"p": "u"}, outputs={"y1": "p"}, network=PATH_2, design="order = 1")
    network = network_of(small, proved_bound(small))
    gains = Gains.from_blocks(np.array([[[-0.3, B], [C, -1.0]]] * 2), 1)
    found = certified.without_idle_parts(gains, network, fastest=9.0)
    np.testing.assert_array_equal(found.blocks[0], [[-9.0, 0.0], [0.0, -1.0]] if idle else gains.blocks[0])


SHAPES = {
    "the whole state": dict(
        dynamics=PENDULUM, outputs=BOTH, network=CYCLE_3, design="order = 0\nstarts = 1\ngain_limit = 10.0"
    ),
    "agents with inputs of their own on a weighted digraph": dict(
        dynamics={"a": "b", "b": "-a - sin(a) + k*u"},
        outputs=BOTH,
        agent="parameters = { k = 1.0 }",
        network="agents = 3\nedges = [[1, 2, 0.5], [2, 3, 2.0], [3, 1, 1.0], [1, 3, 0.25]]\n"
        "parameters = [{ k = 1.0 }, { k = 2.0 }, { k = 0.5 }]",
        design="order = 0\nstarts = 1\ngain_limit = 10.0",
    ),
    "a leader": dict(
        dynamics=PENDULUM,
        outputs=BOTH,
        network='agents = 3\ntopology = "star"',
        design="order = 0\nstarts = 1\ngain_limit = 10.0",
    ),
    "rows of L as coordinates": dict(
        dynamics=PENDULUM,
        outputs=BOTH,
        network=CYCLE_3,
        design='order = 0\nstarts = 1\ngain_limit = 10.0\ncoordinates = "laplacian_rows"',
    ),
    "weights as lists": dict(
        dynamics=PENDULUM,
        outputs=BOTH,
        network=PATH_2,
        design="order = 1\nstarts = 2\ngain_limit = 10.0\nweights = { state = [2.0, 0.5], controller = [0.1] }",
    ),
    "gains that may be off": dict(
        dynamics=PENDULUM,
        outputs=BOTH,
        network=PATH_2,
        design="order = 1\nstarts = 2\ngain_limit = 10.0\nfragility = { A = 0.1, B = 0.1, C = 0.1, D = 0.1 }",
    ),
    "two inputs, two components of phi, time": dict(
        dynamics={"a": "-a + sin(b)*cos(t) + u", "b": "tanh(a) - b + w + cos(t)"},
        inputs=["u", "w"],
        outputs=BOTH,
        network=PATH_2,
        design="order = 0\nstarts = 1\ngain_limit = 10.0",
    ),
}


QUICK = ("agents with inputs of their own on a weighted digraph", "a leader")


@pytest.mark.parametrize(
    "shape", [shape if shape in QUICK else pytest.param(shape, marks=pytest.mark.slow) for shape in SHAPES]
)
def test_every_shape_of_problem_is_designed_and_proved(shape: str) -> None:
    made = checked(design(problem(**SHAPES[shape]), jobs=1))
    assert made.certificate is not None
    assert np.isfinite(made.certificate.rho)
    assert len(made.certificate.t) == (4 * made.gains.N if "off" in shape else 0)


@pytest.mark.slow
def test_less_is_asked_more_is_reached() -> None:
    """Certain gains reach a smaller rho than gains that may be off; a smaller alpha a smaller one still."""
    asked = dict(dynamics=PENDULUM, outputs=BOTH, network=PATH_2, agent="centre = false")
    table = "order = 0\nstarts = 1\ngain_limit = 10.0"
    rho = {}
    for name, more in (
        ("certain", ""),
        ("fragile", "\nfragility = { D = 0.5 }"),
        ("larger alpha", "\nalpha = 3.0"),
    ):
        certificate = design(problem(**asked, design=table + more), jobs=1).certificate
        assert certificate is not None
        rho[name] = certificate.rho
    assert rho["certain"] < rho["fragile"]
    assert rho["certain"] < rho["larger alpha"]


def given(D: float, more: str = "") -> Problem:
    return scalar(
        f'method = "given"\n{more}\n' + "\n".join(f"[[design.gains]]\nD = [[{D}]]" for _ in range(2))
    )


def test_given_gains_are_proved_or_refused() -> None:
    """d_1 + d_2 = 4: rho = 1/3; at 1.0 the loop's margin is 1/2 * 2 - 1 = 0, and there is nothing to prove."""
    made = checked(design(given(-2.0)))
    assert made.certificate is not None
    assert 1 / 3 <= made.certificate.rho <= 1.002 / 3
    with pytest.raises(NotCertified):
        design(given(-0.5))
    with pytest.raises(NotCertified) as error:
        design(given(2.0))
    assert error.value.figures["abscissa"] == pytest.approx(4.0)


def test_a_rho_below_what_the_given_gains_have_is_refused() -> None:
    assert design(given(-2.0, 'objective = "alpha"\nrho = 0.34')).certified
    with pytest.raises(NotCertified) as error:
        design(given(-2.0, 'objective = "alpha"\nrho = 0.33'))
    assert error.value.figures["rho"] == pytest.approx(1 / 3, rel=1e-3)


def test_an_alpha_below_the_true_bound_is_refuted() -> None:
    with pytest.raises(BoundNotProved):
        design(scalar("order = 0\nstarts = 1\nalpha = 0.9"), jobs=1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (dict(network="agents = 4\nedges = [[1, 2], [3, 4]]"), "no spanning tree"),
        (dict(dynamics={"a": "b + u", "b": "b"}), "not stabilisable"),
        (dict(outputs={"y1": "b"}, dynamics={"a": "u", "b": "u - b"}), "not detectable"),
        (dict(dynamics={"a": "b", "b": "a**3 + u"}), "no finite bound"),
    ],
)
def test_what_cannot_be_posed_is_bad_input(change: dict, says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        design(
            problem(**(dict(dynamics=PENDULUM, outputs=BOTH, network=PATH_2, design="order = 0") | change)),
            jobs=1,
        )


ONE_START = problem(
    dynamics={"x": "sin(x) + u"}, outputs={"y": "x"}, design="order = 0\nstarts = 1\ngain_limit = 50.0"
)


def seeds_searched(monkeypatch: pytest.MonkeyPatch, *, first_finds: bool) -> list[int]:
    """Return the seeds with which starts are drawn for `ONE_START`, and whose design is certified."""
    seeds: list[int] = []
    real = certified.search_gains

    def search(*given: Any, seed: int, **options: Any) -> SearchResult:
        seeds.append(seed)
        found = real(*given, seed=seed, **options)
        return found if first_finds or len(seeds) > 1 else replace(found, outcomes=())

    monkeypatch.setattr(certified, "search_gains", search)
    assert design(ONE_START, jobs=1).certified
    return seeds


@pytest.mark.slow
def test_where_no_start_leads_anywhere_as_many_are_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    assert seeds_searched(monkeypatch, first_finds=False) == [0, certified.DRAWN_ANEW]


@pytest.mark.slow
@pytest.mark.parametrize(("very_far", "more"), [(0.5, [certified.DRAWN_ANEW]), (1e9, [])])
def test_far_above_the_floor_as_many_are_drawn_anew(
    monkeypatch: pytest.MonkeyPatch, very_far: float, more: list[int]
) -> None:
    """A rho is above half its floor, and never above 1e9 times it."""
    monkeypatch.setattr("lockstep.lmi.by_method.VERY_FAR", very_far)
    monkeypatch.setattr("lockstep.lmi.by_method._floor", lambda *_given: FloorWitness(1e-3, (), ()))
    assert seeds_searched(monkeypatch, first_finds=True) == [0, *more]
