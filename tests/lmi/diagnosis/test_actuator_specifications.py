"""Defaults that actuators size: gains that take about half of [agent.limits] in the initial states, whatever the units."""

import re

import numpy as np
import pytest
from lmi_cases import PATH_2, first_wishes, problem, stored

from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.specification.defaults import GAIN_LIMIT, HIGH_GAIN_LIMIT, VERY_HIGH, specifications
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem


def slider(most: float, order: int = 0, said: str = "") -> Problem:
    """p'' = u - p' - sin p, |u| <= most, from p = 1 and -1."""
    return problem(
        dynamics={"p": "v", "v": "u - v - sin(p)"},
        outputs={"y": "p"},
        network=PATH_2,
        agent=f"limits = {{ u = [-{most}, {most}] }}",
        design=f"order = {order}\nstarts = 1\n{said}\n[simulation]\ninitial = [[1.0, 0.0], [-1.0, 0.0]]",
    )


def limits_asked(posed: Problem) -> list[float]:
    bound = proved_bound(posed)
    found = specifications(posed, network_of(posed, bound), claim_of(posed, bound))
    return [one.problem.document()["design"]["gain_limit"] for one in found]


def test_static_gains_are_first_asked_to_take_half_of_what_the_actuators_can() -> None:
    """From p = 1 and -1 |r| is 2 for both: gains up to 0.5 * 4 / 2 = 1 take half of 4 at the start, of 80 those up to 20."""
    assert limits_asked(slider(4.0))[:3] == [1.0, 3.0, GAIN_LIMIT], (
        "1.5 times as much before what knows no actuators"
    )
    assert limits_asked(slider(80.0))[:3] == [20.0, 60.0, VERY_HIGH * HIGH_GAIN_LIMIT], (
        "6.4 and 50 were within 60"
    )
    assert 1.0 < limits_asked(slider(4.0, order=1))[0] < GAIN_LIMIT, "the direct gain alone has 1"
    assert limits_asked(slider(80.0, order=1))[0] == GAIN_LIMIT, "what is asked for anyway is less"
    assert limits_asked(slider(4.0, said="gain_limit = 3.0")) == [3.0]
    assert limits_asked(slider(4.0, said="decay = 0.2"))[:4] == [1.0, 3.0, 10.0, HIGH_GAIN_LIMIT], (
        "a decay asks for more"
    )


@pytest.mark.parametrize(("said", "static"), [("", [1.0]), ("decay = 0.2\n", [1.0, 3.0, 10.0])])
def test_a_decay_is_asked_of_larger_static_gains_before_controllers_have_states(
    said: str, static: list
) -> None:
    """Steered axles carried 0.3 of a decay with half of their actuators, all of it with more, and were given states."""
    posed = problem(
        dynamics={"p": "v", "v": "u - v - sin(p)"},
        outputs={"y": "p"},
        network=PATH_2,
        agent="limits = { u = [-4.0, 4.0] }",
        design=f"{said}starts = 1\n\n[simulation]\ninitial = [[1.0, 0.0], [-1.0, 0.0]]",
    )
    bound = proved_bound(posed)
    specs = list(specifications(posed, network_of(posed, bound), claim_of(posed, bound)))
    orders = [one.problem.order for one in specs]
    assert orders[: len(static) + 1] == [0] * len(static) + [2], "then the usual order"
    assert [one.problem.document()["design"]["gain_limit"] for one in specs[: len(static)]] == static
    assert all(bool(one.static) == (one.problem.order == 0) for one in specs)


@pytest.mark.parametrize("order", [0, 1])
def test_in_metres_or_millimetres_the_actuators_are_asked_for_the_same(order) -> None:
    """q' = u - q, p' = q: weights and noise of one decimal stand to each other as the units do."""

    def asked(mm: float) -> dict:
        posed = problem(
            dynamics={"p": f"{mm}*q", "q": f"u - q - sin(p/{mm})"},
            outputs={"y": "p"},
            network=PATH_2,
            agent="limits = { u = [-2.0, 2.0] }",
            design=f"order = {order}\n[simulation]\ninitial = [[{mm}, 0.0], [{-mm}, 0.0]]",
        )
        return first_wishes(posed)

    one, other = asked(1.0), asked(1000.0)
    ratio = [np.divide(table["weights"]["state"][0], table["weights"]["state"][1]) for table in (one, other)]
    assert ratio[0] == pytest.approx(1e6 * ratio[1], rel=0.5)
    noise = [
        table["disturbances"]["outputs"]["y"] / table["disturbances"]["states"]["p"] for table in (one, other)
    ]
    assert noise[0] == pytest.approx(noise[1], rel=0.5)
    if not order:
        assert one["gain_limit"] == pytest.approx(1000 * other["gain_limit"], rel=0.01)


@pytest.mark.parametrize(("slowness", "sized"), [(20.0, True), (1.0, False)])
def test_static_gains_in_units_far_apart_are_sized_entry_by_entry(slowness, sized) -> None:
    """A tug's heading in deg and its rate in deg/s: a norm that gives the rate its size would give the heading as much.

    |r| is 20 deg at most at first: |D| <= 35 / 20 of the heading asks for all of the limit, five times as much are too many.
    """
    asked = first_wishes(
        problem(
            dynamics={"p": "v", "v": f"(0.11*u - v - 0.01*sin(v))/{slowness}"},
            outputs={"y": "p", "z": "v"},
            network=PATH_2,
            agent="limits = { u = [-35.0, 35.0] }",
            design="order = 0\n[simulation]\ninitial = [[10.0, 0.0], [-10.0, 0.0]]",
        )
    )
    assert ("gain_units" in asked) is sized
    if sized:
        D = asked["gain_limit"] * asked["gain_units"]["inputs"]["u"] / asked["gain_units"]["outputs"]["y"]
        assert 0.25 < D * 20 / 35 < 1.0
    else:
        assert asked["gain_limit"] * 20 / 35 < 5.0


def test_a_faster_actuator_is_not_asked_to_do_less() -> None:
    """p'' = f - sin(p)/100, f' = (u - f) / lag: how small the lag is beside the move says nothing of what u costs."""

    def cost(lag: float) -> float:
        posed = problem(
            dynamics={"p": "v", "v": "f - 0.01*sin(p)", "f": f"(u - f)/{lag}"},
            outputs={"y": "p", "z": "v"},
            network=PATH_2,
            agent="limits = { u = [-0.1, 0.1] }",
            design="order = 0\n[simulation]\ninitial = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]",
        )
        return first_wishes(posed)["weights"]["input"]

    slow, faster, fastest = (cost(lag) for lag in (0.1, 0.01, 0.001))  # beside moves of some 6 s
    assert faster == pytest.approx(slow, rel=0.5)  # one decimal
    assert fastest == pytest.approx(faster, rel=0.5)


def test_inputs_that_move_nothing_keep_their_usual_unit() -> None:
    """A second input that nobody has, and an agent whose own input does nothing: the others say what u is worth."""
    start = "order = 0\n[simulation]\ninitial = [[1.0, 0.0], [-1.0, 0.0]]"
    given = {"outputs": {"y": "p", "z": "v"}, "network": PATH_2, "design": start}
    dynamics = {"p": "v", "v": "b*u - v - 0.1*sin(p)"}
    one = first_wishes(
        problem(dynamics=dynamics, agent="limits = { u = [-2.0, 2.0] }\nparameters = { b = 1.0 }", **given)
    )
    both = first_wishes(
        problem(
            dynamics=dynamics,
            agent="limits = { u = [-2.0, 2.0] }\nparameters = { b = 1.0 }",
            **given | {"network": PATH_2 + "\nparameters = [{ b = 0.0 }, {}]"},
        )
    )
    assert one["weights"]["input"] == both["weights"]["input"]
    idle = first_wishes(
        problem(
            dynamics=dynamics,
            inputs=("u", "w"),
            agent="limits = { u = [-2.0, 2.0] }\nparameters = { b = 1.0 }",
            **given,
        )
    )
    assert idle["weights"]["input"][0] == one["weights"]["input"][0]
    assert np.isfinite(idle["weights"]["input"]).all()


@pytest.mark.slow
def test_gains_that_are_far_from_the_floor_within_the_limits_are_not_taken(monkeypatch) -> None:
    """Where actuators that take half lead to more than ten floors, what is asked for elsewhere is tried, taken if better."""
    said = []
    monkeypatch.setattr("lockstep.lmi.specification.attempts.MUCH", 1e9)
    monkeypatch.setattr("lockstep.lmi.specification.attempts.FAR", 1e9)
    for far in (1e9, 1e-9):
        monkeypatch.setattr("lockstep.lmi.specification.attempts.VERY_FAR", far)
        said.append(stored(slider(4.0)).info["figures"]["defaults"])
    assert said[0]["gain_limit"] == 1.0
    assert "given_up" not in said[0]
    assert said[1]["gain_limit"] > GAIN_LIMIT, "with MUCH so large the last that is tried is taken"
    assert "half of [agent.limits]" in said[1]["given_up"]
    assert "1.5 times [agent.limits]" in said[1]["given_up"]


def test_what_is_zero_at_the_start_takes_nothing_of_the_actuators() -> None:
    """x'' = u, |u| <= 1, 8 m apart at rest: t^2 / 2 = 8 after 4 s, position and speed weigh as 1 : 4, and from 8 (1, 0)
    gains of 0.5 sqrt(17) / 8 = 0.26 take half. 8 m/s take 8 s; from 8 (1, 1), as 1 : 8, it is 0.5 sqrt(65) / 72 = 0.056.
    """

    def cart(speed: float) -> Problem:
        return problem(
            dynamics={"p": "v", "v": "u"},
            outputs={"y": "p", "w": "v"},
            network=PATH_2,
            agent="limits = { u = [-1.0, 1.0] }",
            design="order = 0\n[controller]\nperiod = 0.25\n"
            f"[simulation]\ninitial = [[0.0, 0.0], [8.0, {speed}]]",
        )

    assert limits_asked(cart(0.0))[0] == 0.3
    assert limits_asked(cart(8.0))[0] == 0.06


@pytest.mark.parametrize(("order", "natural"), [(0, False), (2, True)])
def test_a_norm_that_lets_the_first_step_ask_too_much_counts_in_natural_units(
    order: int, natural: bool
) -> None:
    """x'' = u, |u| <= 1, 8 m apart at rest: sizes are (1/4, 1/4, 1/16)' (1, 1, 1, 4), a norm of 1.6, which from 8 m lets D
    alone ask for 12.5; twelve entries in their units let it ask for sqrt(12) / 2. Without states the norm is D's own."""
    said = first_wishes(
        problem(
            dynamics={"p": "v", "v": "u"},
            outputs={"y": "p", "w": "v"},
            network=PATH_2,
            agent="limits = { u = [-1.0, 1.0] }",
            design=f"order = {order}\n[controller]\nperiod = 0.25\n"
            "[simulation]\ninitial = [[0.0, 0.0], [8.0, 0.0]]",
        )
    )
    assert (said.get("gain_units") is not None) is natural
    if natural:
        units = said["gain_units"]
        first = said["gain_limit"] * units["inputs"]["u"] / units["outputs"]["y"] * 8.0
        assert first < 2.0  # of 1.73 to one significant digit each


@pytest.mark.parametrize("inputs", ["u", "u, w"])
def test_actuators_that_never_reach_so_far_and_inputs_without_a_limit(inputs: str) -> None:
    """x' = u - x, |u| <= 0.08, is moved by 0.08 at most, the agents are 2 apart: 0.5 * 0.08 / 2. Of w nothing is known."""
    posed = problem(
        dynamics={"x": " + ".join(inputs.split(", ")) + " - x"},
        inputs=inputs.split(", "),
        outputs={"y": "x"},
        network=PATH_2,
        agent="limits = { u = [-0.08, 0.08] }",
        design="order = 0\n[simulation]\ninitial = [[1.0], [-1.0]]",
    )
    assert limits_asked(posed)[:3] == [0.02, 0.06, GAIN_LIMIT]


@pytest.mark.slow
def test_gains_within_the_actuators_limits_are_taken_though_larger_ones_have_a_smaller_rho() -> None:
    found = stored(slider(4.0))
    assert certify(found).certified
    said = found.info["figures"]["defaults"]
    assert said["gain_limit"] == 1.0
    assert "given_up" not in said
    assert found.claims.decay is not None
    assert said["search_decay"] == pytest.approx(0.5 * found.claims.decay, rel=0.01), (
        "what it keeps to at its period"
    )
    assert found.problem.design.search_decay == said["search_decay"]
    assert max(np.linalg.norm(K, 2) for K in found.gains.blocks) <= 1.0


@pytest.mark.slow
def test_a_period_short_against_what_the_actuators_can_leaves_states_room() -> None:
    """At 0.2 ms an A of 50 1/s forgets within 100 periods; within the actuators' limits none has a tenth of that."""
    document = slider(4.0, order=1).document()
    document["controller"]["period"] = 0.0002
    found = stored(Problem.from_document(document))
    assert certify(found).certified
    assert "given_up" not in found.info["figures"]["defaults"]
    assert max(np.linalg.norm(K[:1, :1], 2) for K in found.gains.blocks) < 5.0


def test_agents_that_start_alike_say_nothing_of_the_size_of_gains() -> None:
    posed = slider(4.0, order=1)
    document = posed.document()
    document["simulation"]["initial"] = [[1.0, 0.0], [1.0, 0.0]]
    assert limits_asked(Problem.from_document(document))[0] == GAIN_LIMIT


def test_gains_within_the_actuators_limits_are_not_asked_for_where_these_allow_more_of_every_entry() -> None:
    """A stage of 1 kg, 100 N and 10 um: half of that is 5e6 N/m, and in a time of 0.4 ms."""
    posed = problem(
        dynamics={"p": "v", "v": "u - v - sin(p)"},
        outputs={"y": "p"},
        network=PATH_2,
        agent="limits = { u = [-100.0, 100.0] }",
        design="order = 1\n[simulation]\ninitial = [[1e-5, 0.0], [0.0, 0.0]]",
    )
    assert limits_asked(posed)[0] == GAIN_LIMIT


def test_an_input_without_a_limit_has_its_own_unit() -> None:
    """p'' = f / 2000, q'' = g: 4000 N at 30 mm are 67 kN/m; of g nothing is said, and its unit is that of the plant."""
    posed = problem(
        dynamics={"p": "v", "v": "f/2000 - v", "q": "w", "w": "g - w - q"},
        inputs=["f", "g"],
        outputs={"y": "p", "z": "q"},
        network=PATH_2,
        agent="limits = { f = [-4000.0, 4000.0] }",
        design="order = 1\n[simulation]\ninitial = [[0.0, 0.0, 0.0, 0.0], [0.03, 0.0, 0.0, 0.0]]",
    )
    units = first_wishes(posed)["gain_units"]["inputs"]
    assert units["f"] > 300 * units["g"]


@pytest.mark.slow
def test_how_fast_loops_came_is_said_of_gains_that_are_too_slow() -> None:
    """p'' = u - 4 p' + phi from |r| = 2 with |u| <= 0.2: gains of 0.05 leave s^2 + 4 s + 2 * 0.05 = 0, s = -0.0252."""
    posed = problem(
        dynamics={"p": "v", "v": "u - 4*v - 0.01*sin(p)"},
        outputs={"y": "p"},
        network=PATH_2,
        agent="limits = { u = [-0.2, 0.2] }",
        design="order = 0\nstarts = 1\ndecay = 0.2\n[simulation]\ninitial = [[1.0, 0.0], [-1.0, 0.0]]",
    )
    told = list[tuple[str, float]]()
    found = design(posed, jobs=1, progress=lambda what, part: told.append((what, part)))
    searched = [(what, part) for what, part in told if "searching for gains up to 0.05" in what]
    assert {"this search likely" in what for what, part in searched if part == 0} == {True}
    assert {"this search likely" in what for what, part in searched if part > 0} == {False}
    given_up = found.figures["defaults"]["given_up"]
    came = re.match(
        r"gain_limit 0\.05, sized for half of \[agent\.limits\]: no loop decayed at 0\.2 1/s \(([\d.]+) 1/s at most\)",
        given_up,
    )
    assert came is not None
    assert 0.015 < float(came[1]) < 0.0252
