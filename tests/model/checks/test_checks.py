"""The checks: the arms pass, and each thing that can be wrong is named with its figure."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lockstep.lmi.proposal import proved_bound
from lockstep.model import Agent, BoundNotProved, Graph, Problem, ProblemError, load_problem, parse_problem
from lockstep.model.checks import CheckReport, CheckRow, check_problem, linear_part, nonlinearity
from lockstep.model.checks.check import seldom_meant
from lockstep.model.checks.nonlinearity import holds_everywhere

EXAMPLES = Path(__file__).parents[3] / "examples"
ARMS = (EXAMPLES / "flexible_joint_arms.toml").read_text(encoding="utf-8")


CYCLE = '[network]\nagents = 3\ntopology = "cycle"\n'


def cart(force: str = "f - 2*sin(p)", *, agent: str = "", network: str = CYCLE) -> Problem:
    return parse_problem(f"""
    [agent]
    name = "cart"
    states = ["p", "v"]
    inputs = ["f"]
    parameters = {{ b = 1.0 }}
    outputs = {{ y1 = "p" }}
    {agent}
    [agent.dynamics]
    p = "v"
    v = "{force}"
    {network}
    """)


def row(report: CheckReport, name: str) -> CheckRow:
    return next(row for row in report.rows if name in row.name)


def test_the_arms_pass_every_check() -> None:
    report = check_problem(load_problem(EXAMPLES / "flexible_joint_arms.toml"))
    assert report.ok
    assert report.problems == []
    assert [note.partition(" (gravity)")[0] for note in report.notes] == ["units of parameters: 1 has none"]
    document = report.document()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["bound"]["alpha"] == 3.33
    assert document["bound"]["proved"] is True
    assert document["bound"]["domain"] == "everywhere"
    assert document["bound"]["H"] == [[0, 0, 1, 0]]
    assert document["bound"]["G"] == [[0], [0], [0], [1]]
    assert document["controllable"] is document["observable"] is True
    assert document["graph"] == {"spanning_tree": True, "roots": [1, 2, 3]}
    assert document["problems"] == []
    assert {"name", "verdict", "figure", "reason"} == set(document["checks"][0])
    assert all(r.reason and r.figure for r in report.rows)


def test_an_alpha_that_is_too_small_is_refuted_with_a_witness() -> None:
    with pytest.raises(BoundNotProved) as raised:
        check_problem(parse_problem(ARMS.replace("[design]", "[design]\nalpha = 3.32")))
    figures = raised.value.figures
    slope = abs(-3.33 * np.cos(figures["witness"][0]))
    assert figures["alpha"] == 3.32 < figures["lower"] <= slope * (1 + 1e-15)


def test_an_alpha_that_is_larger_is_taken() -> None:
    report = check_problem(parse_problem(ARMS.replace("[design]", "[design]\nalpha = 4.5")))
    assert report.document()["bound"]["alpha"] == 4.5
    assert "as asked" in row(report, "bound").figure


def test_an_unbounded_nonlinearity_is_an_input_error_that_names_the_remedy() -> None:
    with pytest.raises(ProblemError) as raised:
        check_problem(cart("f - p**3"))
    assert "[agent.domain]" in raised.value.remedy
    assert "where p ->" in raised.value.found


def test_on_a_box_it_is_bounded_and_the_certificate_is_called_local() -> None:
    report = check_problem(cart("f - p**3", agent="domain = { p = [-1.0, 2.0] }"))
    assert report.ok
    assert report.document()["bound"]["domain"] == "box"
    assert report.bound.alpha == pytest.approx(6.0, rel=2e-3)  # slopes [-12, 0], centred
    assert row(report, "where").verdict == "note"
    assert "local" in row(report, "where").figure
    assert row(report, "where").figure.startswith("with p from -1 to 2 only: the certificate is local")


def test_a_box_of_sums_of_states_is_told_by_their_numbers() -> None:
    report = check_problem(cart("f - (p + v)**3", agent="domain = { p = [-1.0, 2.0], v = [-1.0, 1.0] }"))
    assert row(report, "where").figure.startswith("on -2 <= v1 <= 3 only (v1 = p + v): ")


def test_a_box_that_constrains_nothing_leaves_the_certificate_global() -> None:
    """sin needs no box, nor does a box on a state that phi does not see."""
    for domain in ("p = [-4.0, 4.0]", "v = [-1.0, 1.0]"):
        report = check_problem(cart(agent=f"domain = {{ {domain} }}"))
        assert report.everywhere
        assert "not needed" in row(report, "where").figure


def test_a_budget_that_is_too_short_is_no_proof() -> None:
    force = "f + sin(p*v)*exp(-p**2)*v/(1 + v**2) + cos(p + v)/(1 + (p*v)**2)"
    with pytest.raises(BoundNotProved) as raised:
        check_problem(cart(force), boxes=1)
    assert raised.value.figures["boxes"] >= 0


def test_no_slope_is_moved_where_alpha_is_asked_for_as_it_is_written() -> None:
    """tanh has slopes from 0 to 1: 0.5 is enough of what is left of its middle, and says nothing of phi = v."""
    asked = check_problem(cart("f - tanh(v)", network=CYCLE + "[design]\nalpha = 1.0"))
    assert asked.bound.proved
    assert "as written" in row(asked, "loop transformation").figure
    with pytest.raises(BoundNotProved, match="as they are written"):
        proved_bound(cart("f - tanh(v)", network=CYCLE + "[design]\nalpha = 0.6"))
    assert proved_bound(cart("f - tanh(v)")).alpha < 0.6


def test_a_case_without_a_value_is_no_error() -> None:
    """A branch that its condition rules out may divide by 0: on p < 4 it never does."""
    domain = "domain = { p = [-2.0, 2.5], v = [-0.5, 0.5] }"
    report = check_problem(cart("f - 0.1*p*v/if_else(p < 4, 2 + v, 0)", agent=domain))
    assert report.bound.proved


def test_the_scales_of_alpha_are_said_where_there_are_some() -> None:
    """phi = (sin, 1000 sin): slopes of 1 and 1000 are one alpha in units of phi that are 1000 apart."""
    text = cart_text('y1 = "p"').replace('p = "v"', 'p = "v - sin(v)"').replace("sin(p)", "500*sin(p)")
    apart = check_problem(parse_problem(text))
    said = row(apart, "bound of the nonlinearity").figure
    assert "phi in units of" in said
    scales = apart.document()["bound"]["scales"]
    assert all(f"{one:.3g}" in said for one in scales["G"])
    assert "in units of" not in row(check_problem(cart("f - sin(p)")), "bound of the nonlinearity").figure


def test_an_offset_is_a_note_and_no_problem() -> None:
    report = check_problem(cart("f - 2*sin(p) + cos(p) + 0.5"))
    assert report.ok
    assert row(report, "h(t, 0)").verdict == "note"
    assert "1.5" in row(report, "h(t, 0)").figure
    assert "incremental" in row(report, "h(t, 0)").figure


def test_an_offset_that_depends_on_time_is_seen() -> None:
    report = check_problem(cart("f - 2*sin(p) + 0.25*sin(t)"))
    assert "reaches 0.25" in row(report, "h(t, 0)").figure


def test_moving_the_middle_of_the_slopes_is_said() -> None:
    report = check_problem(cart("f - tanh(v) - sin(p)"))
    figure = row(report, "loop transformation").figure
    assert row(report, "loop transformation").verdict == "note"
    assert "-0.5 v2" in figure
    assert "centre = false" in row(report, "loop transformation").reason
    plain = check_problem(cart("f - tanh(v) - sin(p)", agent="centre = false"))
    assert row(plain, "loop transformation").verdict == "ok"
    assert plain.bound.alpha > report.bound.alpha


def test_a_zero_in_the_right_half_plane_is_a_note() -> None:
    """y = p - v: (1 - s)/(s^2 + ...) has its zero at 1."""
    report = check_problem(parse_problem(cart_text('y1 = "p - v"')))
    assert row(report, "zeros").verdict == "note"
    assert "1 in the right half-plane" in row(report, "zeros").figure
    np.testing.assert_allclose(report.document()["zeros"], [[[1.0, 0.0]]] * 3, atol=1e-9)
    other = check_problem(parse_problem(cart_text('y1 = "p + v"')))
    assert row(other, "zeros").verdict == "ok"


def cart_text(output: str) -> str:
    return f"""
    [agent]
    states = ["p", "v"]
    inputs = ["f"]
    dynamics = {{ p = "v", v = "f - 2*sin(p)" }}
    outputs = {{ {output} }}
    [network]
    agents = 3
    topology = "cycle"
    """


def test_roots_are_named() -> None:
    led = cart(network="[network]\nagents = 4\nedges = [[2, 1], [3, 2], [4, 1]]")
    report = check_problem(led)
    assert report.document()["graph"] == {"spanning_tree": True, "roots": [1]}
    assert "agent 1 hears none of the others and leads" in row(report, "spanning tree").figure
    assert row(report, "spanning tree").verdict == "note"
    assert any("Are `edges` [listener, source]" in one.figure for one in seldom_meant(led))
    named = row(
        check_problem(cart(network='[network]\nagents = 4\ntopology = "leader_path"')), "spanning tree"
    )
    assert (named.verdict, "edges" in named.figure) == ("ok", False)
    path = check_problem(cart(network="[network]\nagents = 2\nedges = [[2, 1], [1, 2]]"))
    assert "each of the agents 1, 2 can be its root" in row(path, "spanning tree").figure


@pytest.mark.parametrize(
    ("problem", "says"),
    [
        (lambda: cart(network="[network]\nagents = 4\nedges = [[2, 1], [4, 3]]"), "spanning tree"),
        (lambda: parse_problem(cart_text('y1 = "v"').replace("2*sin(p)", "v - 2*sin(v)")), "not detectable"),
        (
            lambda: cart("-p - 2*sin(p) + b*f", network=CYCLE + "parameters = [{b = 1.0}, {b = 0.0}, {}]"),
            r"\(A, B_2\) is not stabilisable",
        ),
    ],
)
def test_what_cannot_agree_is_an_input_error(problem: object, says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        check_problem(problem())


def test_rows_fail_where_validate_would_refuse() -> None:
    split = linear_part.spanning_tree(Graph.from_edges(4, [[2, 1], [4, 3]]))
    assert split.verdict == "fails"
    assert "[1]" in split.figure
    assert "[3]" in split.figure
    blind = Agent.from_expressions(
        "cart", states=["p", "v"], inputs=["f"], outputs={"y": "v"}, dynamics={"p": "v", "v": "f"}
    )
    seen, observed = linear_part.observable(blind)
    assert (seen.verdict, observed.observable, observed.detectable) == ("fails", False, False)
    assert "not detectable" in seen.figure
    decaying = Agent.from_expressions(
        "cart", states=["p", "v"], inputs=["f"], outputs={"y": "v"}, dynamics={"p": "v - p", "v": "f"}
    )
    seen, observed = linear_part.observable(decaying)
    assert (seen.verdict, observed.observable, observed.detectable) == ("note", False, True)
    assert ": detectable" in seen.figure
    assert "s = -1" in seen.figure
    lost, controlled = linear_part.controllable(decaying, [decaying.lure.B, 0 * decaying.lure.B])
    assert (lost.verdict, controlled.controllable, controlled.stabilisable) == ("fails", False, False)
    assert linear_part.controllable(decaying, [decaying.lure.B])[0].verdict == "ok"


def test_modes_that_are_lost_and_decay_are_reported_and_no_failure() -> None:
    """w' = -w, which no input moves, and z' = p - 2 z, which no output shows."""
    text = cart_text('y = "p"').replace('["p", "v"]', '["p", "v", "w", "z"]')
    report = check_problem(parse_problem(text.replace('v = "f', 'w = "-w", z = "p - 2*z", v = "w + f')))
    answer = report.document()
    assert (answer["ok"], answer["problems"]) == (True, [])
    assert (answer["controllable"], answer["stabilisable"]) == (False, True)
    assert (answer["observable"], answer["detectable"]) == (False, True)
    assert "s = -1: stabilisable" in row(report, "controllable").figure
    assert "s = -2: detectable" in row(report, "observable").figure


def test_a_failing_row_makes_the_report_not_ok() -> None:
    report = check_problem(cart())
    bad = CheckReport(
        **{**vars(report), "rows": (*report.rows, linear_part.spanning_tree(Graph.from_edges(2, [])))}
    )
    assert report.ok
    assert not bad.ok
    assert bad.problems == ["spanning tree: none: the groups [1], [2] hear nothing from each other"]


def test_a_verdict_is_one_of_three() -> None:
    with pytest.raises((ValueError, TypeError), match="maybe"):
        CheckRow("x", "maybe", "1", "because")


def test_the_distance_to_losing_control_is_that_of_the_pair() -> None:
    """(diag(1, 2), (1, eps)): dropping eps loses the mode at 2."""
    agent = Agent.from_expressions(
        "pair",
        states=["a", "b"],
        inputs=["f"],
        outputs={"y": "a + b"},
        dynamics={"a": "a + f", "b": "2*b + 0.001*f"},
    )
    check = linear_part.controllable(agent, [agent.lure.B])[0]
    assert check.verdict == "ok"
    margin = float(check.figure.removeprefix("the nearest that is not is ").split(" away")[0])
    assert 0 < margin <= 0.001
    assert "s = 2" in check.figure


def test_a_pair_that_a_small_part_of_itself_would_lose_is_a_note() -> None:
    """Hydraulics whose piston's area is in m^2 where N/bar are meant."""
    for area, verdict in ((100.0, "ok"), (1e-3, "note")):
        agent = Agent.from_expressions(
            "jack",
            states=["x", "v", "q"],
            inputs=["u"],
            outputs={"y": "x"},
            dynamics={"x": "v", "v": f"0.5*({area}*q - 38*v)", "q": "0.012*(66700*u - 1963*v - 100*q)"},
        )
        told = linear_part.controllable(agent, [agent.lure.B])[0]
        assert told.verdict == verdict
        assert ("a slip in a unit?" in told.figure) == (verdict == "note")


@pytest.mark.slow
def test_no_committed_problem_that_is_well_is_near_losing_a_mode() -> None:
    root = EXAMPLES.parent
    fields = (root / "codegen" / "lockstep" / "workflow" / "fields").glob("*.toml")
    seen = 0
    for path in (*EXAMPLES.glob("*.toml"), *fields, *(root / "benchmarks" / "designs").glob("*.toml")):
        posed = load_problem(path)
        inputs, outputs = (
            linear_part.controllable(posed.agent(), posed.agents_B())[0],
            linear_part.observable(posed.agent())[0],
        )
        assert "a slip in a unit?" not in inputs.figure + outputs.figure, path.stem
        seen += 1
    assert seen > 50


def test_a_fast_plant_in_si_units_is_far_from_losing_a_mode() -> None:
    """x' = v, v' = -1.2e5 v + u: in units of 8 us the numbers are 1 and 1."""
    fast = Agent.from_expressions(
        "loop",
        states=["x", "v"],
        inputs=["u"],
        outputs={"x": "x"},
        dynamics={"x": "v", "v": "-1.2e5*v + u"},
    )
    assert linear_part.controllable(fast, [fast.lure.B])[0].verdict == "ok"
    assert linear_part.observable(fast)[0].verdict == "ok"


def test_row_sums_are_reported_as_they_are() -> None:
    assert linear_part.row_sums(Graph.topology("cycle", 3)).figure == "exactly"
    decimal = Graph.from_edges(4, [[1, 2, 0.1], [1, 3, 0.2], [1, 4, 0.3], [2, 1], [3, 1], [4, 1]])
    assert "in doubles" in linear_part.row_sums(decimal).figure


def test_a_linear_agent_has_alpha_zero() -> None:
    report = check_problem(cart("f - 2*p"))
    assert report.bound.alpha == 0.0
    assert report.everywhere
    assert "linear" in row(report, "bound").figure
    json.dumps(report.document(), allow_nan=False)


def test_holds_everywhere_is_not_said_of_a_box_only_bound() -> None:
    agent = Agent.from_expressions(
        "cart",
        states=["p", "v"],
        inputs=["f"],
        outputs={"y": "p"},
        domain={"p": (-1.0, 1.0)},
        dynamics={"p": "v", "v": "f - p**3"},
    )
    from lockstep.model.assembly import bound_of

    assert not nonlinearity.holds_everywhere(agent, bound_of(agent))


def test_a_leader_is_named_where_the_bound_is_local() -> None:
    on_a_box = "domain = { p = [-1.0, 2.0] }"
    leader = '[network]\nagents = 3\ntopology = "leader_path"\n'
    led = row(check_problem(cart("f - p**3", agent=on_a_box, network=leader)), "where").figure
    assert "with agent 1 leading" in led
    assert "drift out" not in led
    assert "drift out" in row(check_problem(cart("f - p**3", agent=on_a_box)), "where").figure


def test_a_budget_ends_in_the_best_enclosure_labelled_as_such() -> None:
    hard = "f + sin(3*p*v)*exp(w) + z*cos(p*w)"
    text = f"""
    [agent]
    states = ["p", "v", "w", "z"]
    inputs = ["f", "g", "h", "k"]
    outputs = {{ a = "p", b = "v", c = "w", d = "z" }}
    centre = false
    domain = {{ p = [-2.0, 2.0], v = [-2.0, 2.0], w = [-2.0, 2.0], z = [-2.0, 2.0] }}
    dynamics = {{ p = "{hard}", v = "g", w = "h", z = "k" }}
    {CYCLE}
    """
    seen = []
    report = check_problem(parse_problem(text), boxes=1000, progress=seen.append)
    bound = row(report, "bound")
    assert bound.verdict == "note"
    assert "not shown to be the smallest" in bound.figure
    assert report.bound.lower < report.bound.alpha
    assert seen
    assert seen[-1].lower <= seen[-1].upper
    assert seen[-1].part == 1.0
    assert report.ok


@pytest.mark.parametrize(
    ("force", "said"),
    [
        ("f - 2*sin(p)", "at first f raises y1"),
        ("-f - 2*sin(p)", "at first f lowers y1"),
        ("-2*sin(p)", "no input moves an output"),
    ],
)
def test_which_way_inputs_move_outputs_is_told(force: str, said: str) -> None:
    """No figure knows which way a machine moves: who writes -f for f gets a certificate of another machine."""
    assert linear_part.directions(cart(force).agent()).figure == said


def test_slopes_with_bounds_of_their_own_are_reported() -> None:
    """-tanh(v) is centred to slopes within 1/2; alpha = sqrt(4 + 1/4) is that of both arguments together."""
    report = check_problem(cart("f - tanh(v) - 2*sin(p)"))
    found = report.document()["bound"]["entries"]
    assert [(one["component"], one["argument"]) for one in found] == [(1, 1), (1, 2)]
    assert [one["bound"] for one in found] == pytest.approx([2.0, 0.5])
    assert report.bound.alpha == pytest.approx(4.25**0.5)
    figure = row(report, "slope bounds").figure
    assert "|d phi1 / d v1| <= 2," in figure
    assert check_problem(cart("f - 2*sin(p)")).document()["bound"]["entries"] == []


def test_a_box_that_only_an_entry_needs_makes_the_certificate_local() -> None:
    """The slope of sqrt(1 + p^2 + v^2) has a length below 1 everywhere; p / sqrt(...) is below 0.41 for |p| <= 1, v >= 2."""
    box = "centre = false\n    domain = { p = [-1.0, 1.0], v = [2.0, inf] }"
    posed = cart("f + sqrt(1 + p**2 + v**2)", agent=box)
    agent, bound = posed.agent(), check_problem(posed).bound
    assert [one.bound for one in bound.entries] == pytest.approx([6**-0.5, 1.0], rel=1e-3)
    assert holds_everywhere(agent, replace(bound, entries=(), alpha=10.0))
    assert not holds_everywhere(agent, replace(bound, alpha=10.0))
