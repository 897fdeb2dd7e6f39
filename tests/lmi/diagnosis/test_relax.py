"""What stands in the way of a design is named: each obstacle alone, on problems whose obstacle is known by hand."""

import numpy as np
import pytest
from lmi_cases import problem

from lockstep.check.errors import Infeasible, NotCertified, OutOfTime, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.by_method import _not_carried
from lockstep.lmi.design import design
from lockstep.lmi.diagnosis.active_constraint import hint
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem

STATIC = "order = 0\nstarts = 1\n"


def unstable(design_table: str, agents: int = 4, topology: str = "path") -> Problem:
    """x' = x + u, y = x: the mode of lambda is 1 + lambda d, and |d| > 1 / lambda is needed."""
    return problem(
        dynamics={"x": "x + u"},
        outputs={"y": "x"},
        network=f'agents = {agents}\ntopology = "{topology}"',
        design=STATIC + design_table,
    )


def softened(design_table: str) -> Problem:
    """x' = sin x + u, y = x, two agents: alpha = 1, and d_1 + d_2 > 1 is needed."""
    return problem(
        dynamics={"x": "sin(x) + u"},
        outputs={"y": "x"},
        network='agents = 2\ntopology = "path"',
        design=STATIC + design_table,
        agent="centre = false",
    )


@pytest.mark.slow
def test_the_eigenvalue_of_the_graph_that_is_not_stabilised_is_named() -> None:
    """A path of four: lambda = 2 - sqrt 2, 2, 2 + sqrt 2. Gains of 1 do for the last two only, gains of 10 for all."""
    with pytest.raises(Infeasible, match=r"eigenvalue 0\.5858 of L") as error:
        design(unstable("gain_limit = 1.0"), jobs=1)
    figures = error.value.figures
    assert [value for value, _ in figures["blocking_eigenvalues"]] == pytest.approx([2 - 2**0.5])
    assert figures["cause"] == "gain_limit"
    assert figures["sufficient_gain_limit"] == 10.0
    assert design(unstable("gain_limit = 10.0"), jobs=1).certified


@pytest.mark.slow
def test_every_eigenvalue_is_named_where_the_gain_does_for_none() -> None:
    with pytest.raises(Infeasible, match="every eigenvalue of L"):
        design(unstable("gain_limit = 0.1"), jobs=1)


@pytest.mark.slow
def test_a_gain_limit_that_blocks_is_named_with_one_that_does_not() -> None:
    with pytest.raises(Infeasible, match=r"gain_limit = 0\.3 is what blocks: with 3 there is") as error:
        design(softened("gain_limit = 0.3"), jobs=1)
    assert error.value.figures["sufficient_gain_limit"] == pytest.approx(3.0)


@pytest.mark.slow
def test_a_delta_that_blocks_is_named_with_a_part_that_does_not() -> None:
    """Gains of 2 each leave 4 - 1 = 3 to lose, 1.5 each; delta = 4 is beyond that and beyond half of it, 0.8 is not."""
    with pytest.raises(Infeasible, match=r"delta is what blocks.*with 0.2 of it") as error:
        design(softened("gain_limit = 2.0\nfragility = { D = 4.0 }"), jobs=1)
    assert error.value.figures["cause"] == "fragility"
    assert error.value.figures["reachable_delta"] == pytest.approx([0.0, 0.0, 0.0, 0.8])


@pytest.mark.slow
def test_where_nothing_blocks_nothing_is_named() -> None:
    """The must-fail: a zero on the right carries no alpha beyond 2, whatever the gain; see `test_limits`."""
    posed = problem(
        dynamics={"a": "-a + u + 2.1*sin(a - b)", "b": "-2*b + 1.5*u"},
        outputs={"y1": "a", "y2": "b"},
        network='agents = 2\ntopology = "path"',
        design="order = 0\nstarts = 1",
        agent="centre = false",
    )
    bound = proved_bound(posed)
    assert hint(posed, network_of(posed, bound), claim_of(posed, bound)) == ("", {})


def test_no_time_is_an_error_of_its_own() -> None:
    with pytest.raises(OutOfTime, match=r"time limit was over.* in 1e-06 s.*allow more time") as error:
        design(softened("gain_limit = 10.0"), jobs=1, time_limit=1e-6)
    assert error.value.figures["time_limit"] == 1e-6


@pytest.mark.slow
def test_enough_time_changes_nothing_and_says_nothing() -> None:
    free, limited = (design(softened("gain_limit = 10.0"), jobs=1, time_limit=t) for t in (None, 600.0))
    assert free.gains.blocks.tolist() == limited.gains.blocks.tolist()
    assert "time_limit" not in limited.figures


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_limit_that_is_no_time_is_bad_input(limit: float) -> None:
    with pytest.raises(ProblemError, match="seconds above 0"):
        design(softened("gain_limit = 10.0"), time_limit=limit)


def test_a_modal_search_cannot_be_cut() -> None:
    with pytest.raises(ProblemError, match="modal"):
        design(unstable('gain_limit = 10.0\nmethod = "modal"'), time_limit=5.0)


@pytest.mark.slow
@pytest.mark.parametrize("key", ["decay", "search_decay"])
def test_a_decay_that_blocks_is_named_and_no_gain_is_promised(key: str) -> None:
    """x_d' = -(d_1 + d_2) x_d + phi_d with |d| <= 2 and alpha = 1: a decay of 3 at most, so that 5 is none."""
    with pytest.raises(Infeasible, match=rf"\] {key} is what blocks: without it gains were found") as error:
        design(softened(f"gain_limit = 2.0\n{key} = 5.0"), jobs=1)
    assert error.value.figures["cause"] == key
    assert "sufficient_gain_limit" not in error.value.figures


def test_gains_whose_proof_failed_are_not_said_to_be_unstable() -> None:
    """What the exact check refuses has no abscissa among its figures: nothing is known to be unstable then."""
    posed = softened("gain_limit = 10.0")
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound), claim_of(posed, bound)
    gains = Gains.from_blocks(np.full((network.N, 1, 1), -2.0), 0)
    said = _not_carried(network, gains, asked, NotCertified("the candidate did not survive"))
    assert "unstable" not in str(said)
    assert "one is computed for slopes up to" in str(said)
