"""Slopes of phi that hide a mode from every controller: no faster decay is certified, which is said before any search."""

import pytest
from lmi_cases import first_wishes, problem

from lockstep.check.errors import Infeasible
from lockstep.lmi.design import design
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.checks import check_problem
from lockstep.model.checks.lost_modes import LostMode, slowest_lost_mode
from lockstep.model.checks.report import CheckRow
from lockstep.model.problem import Problem


def heated(
    said: str = "", agent: str = "", phi: str = "tanh(T)", outputs: tuple[str, ...] = ("x",)
) -> Problem:
    """T' = u - 0.25 T, x' = phi - 2 x: where phi is flat x says nothing of T, which decays at 0.25 1/s."""
    return problem(
        dynamics={"x": f"{phi} - 2*x", "T": "u - 0.25*T"},
        outputs={f"y{k}": state for k, state in enumerate(outputs)},
        network='agents = 2\ntopology = "path"',
        design=f"order = 1\nstarts = 1\n{said}",
        agent=agent,
    )


def lost(posed: Problem) -> tuple[float, str] | None:
    bound = proved_bound(posed)
    claim = claim_of(posed, bound)
    found = slowest_lost_mode(network_of(posed, bound), claim.alpha, claim.entries)
    return found and (found.decay, found.said)


def test_a_flat_nonlinearity_hides_what_only_it_shows() -> None:
    for agent in ("", "centre = false"):
        found = lost(heated(agent=agent))
        assert found is not None
        assert found[0] == pytest.approx(0.25, rel=1e-12)
        assert "phi1 has the slope 0 along v1 (v1 = T) no output shows the mode at -0.25 1/s" in found[1]
    # The proved bound of this slope is rounded up: its end is 1e-10 beyond what is flat, and hides nothing.
    logistic = lost(heated(phi="5/(1 + exp(-0.15*T))"))
    assert logistic is not None
    assert logistic[0] == pytest.approx(0.25, rel=1e-12)
    measured = lost(heated(outputs=("x", "T")))
    assert measured is not None
    assert measured[0] == pytest.approx(2.0), "T is seen, and x, then, is what no input moves"
    # Its least slope on the domain is 1/cosh(1)^2 = 0.42.
    assert lost(heated(agent="domain = { T = [-1.0, 1.0] }")) is None
    assert lost(heated(phi="T")) is None, "linear"


def test_what_no_input_moves_counts_too_and_an_end_of_a_slope_where_nothing_is_flat() -> None:
    """x' = (T - sin T)/2 - 2 x: the slope 1 of sin T, an end of its slopes, hides T, which a flat sin T does not."""
    found = lost(heated(phi="0.5*T - 0.5*sin(T)"))
    assert found is not None
    assert found[0] == pytest.approx(0.25)
    stirred = problem(
        dynamics={"a": "u*1.0 - a", "b": "tanh(a) - 0.5*b"},
        outputs={"y1": "a", "y2": "b"},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
    )
    found = lost(stirred)
    assert found is not None
    assert found[0] == pytest.approx(0.5)
    assert "no input moves" in found[1]


def test_slopes_beyond_their_own_bounds_hide_nothing() -> None:
    """q T with q from 0.5 to 0.9: alpha is 1 and more, of what T does to it, and would hold a q of 0 as well."""
    posed = problem(
        dynamics={"x": "q*T - 2*x", "T": "u - 0.25*T", "q": "u - q"},
        outputs={"y0": "x", "y1": "q"},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
        agent="domain = { q = [0.5, 0.9], T = [-1.0, 1.0] }",
    )
    assert lost(posed) is None


def test_it_holds_back_what_is_not_much_slower() -> None:
    """A hidden lag of a millisecond is no reason for a decay of 1/s."""
    mode = LostMode(200.0, "")
    assert mode.holds_back(150.0)
    assert not mode.holds_back(1.0)
    assert not mode.holds_back(None)


def test_of_many_slopes_all_flat_is_looked_at() -> None:
    """Four components, each of an argument of its own: what is hidden is so where the first is flat."""
    states = {f"s{k}": f"u - {k}*s{k} - 0.1*sin(s{k})" for k in (1, 2, 3)}
    posed = problem(
        dynamics={"x": "tanh(T) - 2*x", "T": "u - 0.25*T", **states},
        outputs={"y": "x", **{f"y{k}": f"s{k}" for k in (1, 2, 3)}},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
    )
    found = lost(posed)
    assert found is not None
    assert found[0] == pytest.approx(0.25)
    assert "all of phi is flat (v1 = T" in found[1]


@pytest.mark.slow
def test_a_decay_beyond_is_refused_before_any_search_and_one_below_is_certified() -> None:
    said: list[str] = []
    with pytest.raises(
        Infeasible, match=r"decay of 0\.3 1/s: where phi1 has the slope 0.*\[agent.domain\]"
    ) as error:
        design(heated("decay = 0.3"), jobs=1, progress=lambda what, _part: said.append(what))
    assert error.value.figures["decay"] == pytest.approx(0.25)
    assert said
    assert not any("searching" in what for what in said)
    found = design(heated("decay = 0.2\ngain_limit = 10.0"), jobs=1)
    assert found.guarantees.decay is not None
    assert 0.2 <= found.guarantees.decay[0] <= 0.25


def rotating(domain: float) -> Problem:
    """x' = sin w - x, w' = u: where cos w = 0 the output x shows nothing of w, which does not decay by itself."""
    return problem(
        dynamics={"x": "sin(w) - x", "w": "u"},
        outputs={"y": "x"},
        network='agents = 3\ntopology = "leader_path"',
        design="order = 1\nstarts = 1",
        agent=f"domain = {{ w = [-{domain}, {domain}] }}",
    )


def lagging() -> Problem:
    """w' = u - 50 w is hidden where tanh w is flat, and x, which the output shows, decays at 1 1/s by itself."""
    return problem(
        dynamics={"x": "tanh(w) + u - x", "w": "u - 50*w"},
        outputs={"y": "x"},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
    )


def row_of(posed: Problem) -> CheckRow | None:
    return next((row for row in check_problem(posed).rows if row.name == "modes out of reach"), None)


def test_a_mode_that_does_not_decay_and_is_hidden_is_refused_at_once() -> None:
    """cos w is from cos 2 = -0.42 to 1 on [-2, 2], and from cos 1.5 = 0.07 on [-1.5, 1.5], where nothing is hidden."""
    with pytest.raises(
        Infeasible, match=r"can certify that agents agree: where phi1 has the slope 0 "
    ) as error:
        design(
            rotating(2.0),
            jobs=1,
            progress=lambda what, _part: None if "searching" not in what else pytest.fail(what),
        )
    assert error.value.figures["decay"] == pytest.approx(0.0, abs=1e-12)
    assert lost(rotating(1.5)) is None


def test_check_says_it_first() -> None:
    """Of an integrator that nothing shows no agreement is certified; of the slowest mode no faster one; nothing of others."""
    fails = row_of(rotating(2.0))
    assert fails is not None
    assert fails.verdict == "fails"
    assert "no output shows the mode at 0 1/s: no agreement is certified" in fails.figure
    assert row_of(rotating(1.5)) is None
    note = row_of(heated())
    assert note is not None
    assert note.verdict == "note"
    assert note.figure.endswith("the mode at -0.25 1/s: no decay beyond 0.25 1/s is certified")
    beyond = row_of(heated("decay = 0.3"))
    assert beyond is not None
    assert beyond.verdict == "fails"
    assert row_of(heated("alpha = 2.0")) is not None, "any phi of this alpha may be flat"
    # A lag that is hidden and faster than what is left holds nothing back.
    assert row_of(lagging()) is None


def test_the_decay_that_is_searched_for_by_default_is_one_that_can_be_had() -> None:
    """A fast agent beside a slow hidden mode: 0.037 per unit of time would be beyond half of it."""
    slow = problem(
        dynamics={"x": "500*(u - x) + tanh(T)", "T": "u - 0.02*T"},
        outputs={"y": "x"},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
    )
    assert first_wishes(slow)["search_decay"] == 0.01
