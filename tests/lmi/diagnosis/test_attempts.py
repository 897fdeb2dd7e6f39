"""One specification after the other: which gains are taken, and what is said of those that are not."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lmi_cases import PATH_2, problem

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.errors import Infeasible
from lockstep.check.floor.witness import FloorWitness
from lockstep.lmi import design as lmi_design
from lockstep.lmi.design import design
from lockstep.lmi.proposal import Proposal
from lockstep.lmi.specification import attempts
from lockstep.lmi.specification.within_limits import within_limits
from lockstep.model.problem import Problem

POSED = problem(
    dynamics={"x": "sin(x) + u"}, outputs={"y": "x"}, network=PATH_2, design="order = 0\nstarts = 1"
)
"""Its floor is set to 1 below: rho is so many floors."""

WITHIN = problem(
    dynamics={"x": "sin(x) + u"},
    outputs={"y": "x"},
    network=PATH_2,
    agent="limits = { u = [-1.0, 1.0] }",
    design="order = 0\nstarts = 1\n[simulation]\ninitial = [[-1.0], [1.0]]",
)
"""The same agents, with actuators and where they start: gains are first sized for these."""


@pytest.fixture(scope="module")
def found() -> Proposal:
    """Gains of one specification, with a certificate."""
    return design(POSED, jobs=1)


@pytest.fixture
def led_to(monkeypatch: pytest.MonkeyPatch, found: Proposal) -> Any:
    """Design where the specifications come to (rho, sampled rho) one after the other, or to nothing where it is None."""
    assert isinstance(found.certificate, Certificate)

    def proposals(figures: list[tuple[float, float] | None]) -> Iterator[Proposal | None]:
        for one in figures:
            if one is None:
                yield None
                continue
            certificate = replace(found.certificate, rho=one[0])
            yield replace(
                found, certificate=certificate, sampled=one[1], floor=FloorWitness(1.0, ()), figures={}
            )

    def designed(*figures: tuple[float, float] | None, posed: Problem = POSED) -> Proposal:
        given = proposals(list(figures))

        def proposed(posed: Problem, *_: object) -> Proposal:
            if (one := next(given)) is None:
                raise Infeasible("none", fraction=0.5)
            return replace(one, problem=posed)

        monkeypatch.setattr(lmi_design, "_proposed", proposed)
        made = design(posed, jobs=1)
        assert next(given, "all were tried") == "all were tried"
        return made

    return designed


def test_gains_near_their_floor_are_taken_at_once(led_to: Any) -> None:
    made = led_to((3.9, 4.0))
    assert made.figures["defaults"].keys() & {"given_up", "not_taken"} == set()


def test_gains_far_from_it_that_larger_ones_do_not_halve_are_kept_and_it_is_said(led_to: Any) -> None:
    made = led_to((9.0, 9.1), (6.0, 6.0))
    assert made.certificate.rho == 9.0
    assert "rho was 6 times its lower bound" in made.figures["defaults"]["not_taken"]
    assert made.figures["defaults"]["gain_limit"] < 50


UNNAMED = problem(dynamics={"x": "sin(x) + u"}, outputs={"y": "x"}, network=PATH_2, design="starts = 1")
"""No order: static gains are tried first."""


def test_static_gains_near_a_floor_of_every_order_are_taken_where_no_order_is_named(led_to: Any) -> None:
    """A floor is one of controllers of any order: states could not lower 1.2 floors by more than a sixth."""
    made = led_to((1.2, 1.2), posed=UNNAMED)
    assert made.problem.design.order == made.figures["defaults"]["order"] == 0
    assert led_to((1.2, 2.0), (1.1, 1.1), posed=UNNAMED).certificate.rho == 1.1, "their period spoils them"


def test_static_gains_within_limits_are_near_where_others_are_not_sized_for_these(led_to: Any) -> None:
    """Without limits 9 floors are far. Limits of 1000 leave controllers with states those that they have by default."""
    assert led_to((9.0, 9.0), (2.0, 2.0), posed=UNNAMED).certificate.rho == 2.0
    for limit, then in ((1.0, [(8.5, 8.5)]), (1000.0, [])):
        posed = problem(
            dynamics={"x": "sin(x) + u"},
            outputs={"y": "x"},
            network=PATH_2,
            agent=f"limits = {{ u = [-{limit}, {limit}] }}",
            design="starts = 1\n[simulation]\ninitial = [[-1.0], [1.0]]",
        )
        made = led_to((9.0, 9.0), *then, posed=posed)
        assert (made.certificate.rho, made.problem.order) == (9.0, 0)


def test_static_gains_that_keep_inputs_within_their_limits_are_near_within_two_floors(
    led_to: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three floors, or of inputs that meet a limit from the file's start, states are tried as well."""
    posed = replace(
        WITHIN,
        file=UNNAMED.file.model_copy(
            update={"agent": WITHIN.file.agent, "simulation": WITHIN.file.simulation}
        ),
    )
    for within in (True, False):
        monkeypatch.setattr(attempts, "within_limits", lambda *_, within=within: within)
        then = [] if within else [(1.3, 1.3)]
        assert (led_to((1.9, 1.9), *then, posed=posed).problem.order == 0) is within
        assert led_to((3.0, 3.0), (1.3, 1.3), posed=posed).problem.order > 0


def test_a_decay_that_static_gains_have_is_not_looked_for_with_states(led_to: Any) -> None:
    """Within two floors, whether or not inputs meet a limit: larger gains are what a decay asks for."""
    agent, start = "limits = { u = [-1.0, 1.0] }", "[simulation]\ninitial = [[-1.0], [1.0]]"
    posed = problem(
        dynamics={"x": "sin(x) + u"},
        outputs={"y": "x"},
        network=PATH_2,
        agent=agent,
        design=f"starts = 1\ndecay = 0.1\n{start}",
    )
    made = led_to(None, None, (1.9, 1.9), posed=posed)
    assert made.problem.order == 0
    assert made.figures["defaults"]["given_up"].count("order 0, ") == 2, (
        "half of the limits, and 1.5 times these"
    )


@pytest.mark.parametrize(("apart", "within"), [(0.49, True), (0.51, False)])
def test_inputs_are_within_their_limits_from_the_start_of_the_file(
    found: Proposal, apart: float, within: bool
) -> None:
    """u = D (x_1 - x_2) of each of two agents, largest at first: D times the limit 1 apart it is met."""
    D = abs(float(found.gains.D[0][0, 0]))
    limits = f"limits = {{ u = [-{D}, {D}] }}"
    start = f"[simulation]\ninitial = [[-{apart}], [{apart}]]"
    posed = problem(
        dynamics={"x": "sin(x) + u"}, outputs={"y": "x"}, network=PATH_2, agent=limits, design=start
    )
    assert np.allclose(np.abs(found.gains.D), D)
    assert within_limits(posed, found.network, found.gains) is within
    assert not within_limits(UNNAMED, found.network, found.gains), "no limits, no start"


def test_states_are_taken_where_they_lower_rho_by_a_tenth(led_to: Any) -> None:
    made = led_to((1.3, 1.3), (1.2, 1.2), posed=UNNAMED)
    assert (made.certificate.rho, made.problem.order) == (1.3, 0)
    assert "rho was 1.2 times its lower bound" in made.figures["defaults"]["not_taken"]
    made = led_to((1.3, 1.3), (1.1, 1.1), posed=UNNAMED)
    assert (made.certificate.rho, made.problem.order) == (1.1, UNNAMED.order)
    assert made.figures["defaults"]["given_up"].startswith("order 0, gain_limit ")
    assert "order" not in made.figures["defaults"]


def test_where_no_static_gains_are_found_states_are_as_before(led_to: Any) -> None:
    made = led_to(None, (3.9, 4.0), posed=UNNAMED)
    assert (made.certificate.rho, made.problem.order) == (3.9, UNNAMED.order)
    # Two or more limits are compared as those of controllers with states are: by half.
    made = led_to((34.0, 34.0), (33.0, 33.0), (20.0, 20.0), (3.0, 3.0), posed=UNNAMED)
    assert (made.certificate.rho, made.problem.order) == (3.0, UNNAMED.order)


def test_what_ships_is_compared_and_not_the_continuous_loop_alone(led_to: Any) -> None:
    """With rho 6 against 9 none is half as large; of the sampled loops it is 6.1 against 20, and then 6.1 against 13."""
    assert led_to((9.0, 20.0), (6.0, 6.1), (5.5, 5.5)).certificate.rho == 6.0
    assert led_to((9.0, float("inf")), (6.0, 6.1), (5.5, 5.5)).certificate.rho == 6.0
    assert led_to((9.0, 9.0), (4.1, 13.0)).certificate.rho == 9.0


def test_very_far_from_the_floor_the_largest_limit_is_tried_too(led_to: Any) -> None:
    """More than ten floors away a second attempt that comes to nothing, or to little more, is not the last."""
    for second in ((33.0, 33.0), None):
        made = led_to((34.0, 34.0), second, (3.0, 3.1))
        assert made.certificate.rho == 3.0
        said = made.figures["defaults"]["given_up"]
        assert said.count("gain_limit") == 2
        assert "not_taken" not in made.figures["defaults"]
    assert led_to((34.0, 34.0), (33.0, 33.0), (32.0, 32.0), (31.0, 31.0)).certificate.rho == 34.0


def test_gains_that_are_found_are_not_lost_by_later_ones_that_are_not(led_to: Any) -> None:
    made = led_to((9.0, 9.0), None)
    assert made.certificate.rho == 9.0
    assert "0.5 of what is asked was carried" in made.figures["defaults"]["not_taken"]


def test_gains_a_little_beyond_the_actuators_limits_are_taken_before_far_larger_ones(led_to: Any) -> None:
    """Sixteen floors within half of the limits, nine within 1.5 times: ten are enough where actuators are the reason."""
    made = led_to((16.0, 17.0), (9.0, 12.0), posed=WITHIN)
    assert made.certificate.rho == 9.0
    assert made.figures["defaults"]["gain_limit"] == 0.6, "half of 1 over |r| = 2, to one digit, times three"
    assert "sized for half of [agent.limits]: rho was 16" in made.figures["defaults"]["given_up"]
    assert led_to((9.9, 12.0), posed=WITHIN).certificate.rho == 9.9
    # Neither is enough: the limits that know no actuators follow, and ten floors are enough of them, too.
    assert led_to((90.0, 90.0), (80.0, 80.0), (9.0, 9.0), posed=WITHIN).certificate.rho == 9.0
    # What is enough by its continuous rho and ships worse than what there is, is not taken.
    assert led_to((11.0, 11.0), (9.0, 30.0), (8.0, 8.0), posed=WITHIN).certificate.rho == 8.0
