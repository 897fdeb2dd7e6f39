"""Defaults, the decay held in parts and as an objective, and what rho costs: on loops small enough to know the answer."""

import numpy as np
import pytest
from lmi_cases import PATH_2, first_wishes, problem, stored

import lockstep
from lockstep.check.errors import Infeasible, NotCertified, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.guarantees import fastest_decay
from lockstep.lmi.methods.certified import decays_held
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.specification.defaults import GAIN_LIMIT, specifications
from lockstep.lmi.trade_off.pareto import Figures, ParetoPoint, pareto, pareto_csv, pareto_front
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem, parse_problem


def scalar(table: str, gain: float = 1.0) -> Problem:
    """x' = sin x + gain u, y = x, two agents: x_d' = -gain (d_1 + d_2) x_d + phi_d + xi_d."""
    return problem(
        dynamics={"x": f"sin(x) + {gain!r}*u"},
        outputs={"y": "x"},
        network=PATH_2,
        design=table,
        agent="centre = false",
    )


def test_what_is_left_out_is_asked_for_and_written_down() -> None:
    found = stored(scalar("order = 0\nstarts = 1"))
    table = found.document()["problem"]["design"]
    assert table["gain_limit"] == GAIN_LIMIT
    assert table["weights"]["input"][0] > 0
    assert table["disturbances"]["outputs"]["y"] > 0
    assert table["stable_controllers"] is True
    assert table["search_decay"] > 0
    assert certify(found).certified
    assert max(found.problem.gain_norms(found.gains.blocks)) <= GAIN_LIMIT
    assert not found.problem.has_defaults, "a design file is never filled in"
    assert found.info["figures"]["defaults"]["gain_limit"] == GAIN_LIMIT


@pytest.mark.parametrize(
    "named", ["gain_limit = 50.0", "weights = {}", "weights = { controller = 1.0 }", "method = 'theorem1'"]
)
def test_a_file_that_names_a_weight_or_a_limit_is_asked_for_what_it_says(named: str) -> None:
    posed = scalar(f"order = 0\n{named}")
    bound = proved_bound(posed)
    (only,) = specifications(posed, network_of(posed, bound), claim_of(posed, bound))
    assert only.problem is posed
    table = posed.document()["design"]
    assert "stable_controllers" not in table
    assert "disturbances" not in table
    assert "input" not in table["weights"]


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("stable_controllers = false", {"stable_controllers": False}),
        ("disturbances = { outputs = { y = 0.5 } }", {"disturbances": {"outputs": {"y": 0.5}}}),
        ("search_decay = 0.25", {"search_decay": 0.25}),
        ("decay = 0.5", {"decay": 0.5}),
    ],
)
def test_what_the_file_speaks_of_stays(said: str, kept: dict) -> None:
    table = first_wishes(scalar(f"order = 0\n{said}"))
    assert table.items() >= kept.items()
    assert table["gain_limit"] == GAIN_LIMIT
    assert ("search_decay" in table) == (not said.startswith("decay"))


def test_the_text_and_the_tables_of_a_problem_keep_what_it_asks_for() -> None:
    """A limit that happens to be the schema's default is still a limit that is named."""
    for table in ("order = 0", "order = 0\ngain_limit = 50.0", "order = 0\nweights = {}"):
        posed = scalar(table)
        for again in (parse_problem(posed.toml()), Problem.from_document(posed.document())):
            assert again.has_defaults == posed.has_defaults == (table == "order = 0")
            assert again.document() == posed.document()


def test_the_same_plant_in_other_units_of_its_input_is_asked_for_the_same() -> None:
    """u in thousandths: W in millionths, the limit in thousands, noise and decay as before, to one decimal."""
    one, other = (first_wishes(scalar("order = 0", gain)) for gain in (1.0, 1e-3))
    W, W_other = (table["weights"]["input"][0] for table in (one, other))
    assert W / W_other == pytest.approx(1e6, rel=0.5)
    assert other["gain_limit"] > one["gain_limit"]
    assert one["search_decay"] == pytest.approx(other["search_decay"], rel=0.05)
    assert one["disturbances"] == other["disturbances"]


def test_a_weight_of_the_inputs_alone_leaves_the_rest_to_the_defaults() -> None:
    posed = scalar("order = 0\nweights = { input = 0.5 }")
    plain, named = first_wishes(scalar("order = 0")), first_wishes(posed)
    assert named["weights"].pop("input") == 0.5
    plain["weights"].pop("input")
    assert named == plain
    for again in (parse_problem(posed.toml()), Problem.from_document(posed.document())):
        assert again.document() == posed.document()
        assert first_wishes(again)["weights"]["input"] == 0.5


RESONATORS = """
[agent]
name = "resonator"
states = ["q", "v"]
inputs = ["u"]
dynamics = {{ q = "v", v = "-{w}**2*q - {w}/800*v - 0.03*({w}/{q})**2*q**3 + {w}**2*{q}*u" }}
outputs = {{ y = "q/{q}", z = "v/({w}*{q})" }}
domain = {{ q = [-{q}, {q}] }}
[network]
agents = 2
topology = "path"
[design]
order = 0
starts = 1
[controller]
period = {period}
"""


@pytest.mark.slow
def test_a_resonator_in_si_units_is_asked_for_what_it_is_asked_for_in_its_own() -> None:
    """The same agents in metres and seconds, and in their own units: the same gains serve, and rho counts time and length."""
    si, own = (
        parse_problem(RESONATORS.format(w=w, q=q, period=0.2 / w)) for w, q in ((2e5, 2e-6), (1.0, 1.0))
    )
    sizes = first_wishes(si)["weights"]["state"], first_wishes(si)["disturbances"]["states"]
    assert sizes[0][0] == 1.0
    assert sizes[0][1] == pytest.approx(1 / 2e5**2, rel=0.5)  # one significant decimal
    assert sizes[1]["q"] == 1.0
    assert sizes[1]["v"] == pytest.approx(2e5, rel=0.3)
    assert first_wishes(own)["weights"]["state"] == 1.0
    in_si, in_own = stored(si), stored(own)
    assert certify(in_si).certified
    # Weights and disturbances of one decimal are up to a fifth off here (2e5 for 1.7e5), and rho with them.
    assert in_si.claims.rho * 2e5 == pytest.approx(in_own.claims.rho, rel=0.2)


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::scipy.linalg.LinAlgWarning"
)  # the basis of a program; what is proved is in balls
def test_a_resonator_in_si_units_is_certified_as_it_ships() -> None:
    """Its position alone is measured, in metres: conjugate points, P's decimals and the sampled rho know no units."""
    text = RESONATORS.format(w=2e5, q=2e-6, period=1e-6)
    text = (
        text.replace("200000.0**2*2e-06*u", "1e4*u")
        .replace(', z = "v/(200000.0*2e-06)"', "")
        .replace("order = 0\nstarts = 1", "order = 1")
    )
    assert "z =" not in text
    assert "1e4*u" in text
    found = lockstep.design(parse_problem(text), jobs=2, reuse=False)
    assert found.sampled["certified"]
    assert found.rho < found.sampled["rho"] < 1.5 * found.rho


@pytest.mark.slow
def test_where_the_small_limit_is_too_small_the_next_is_taken_and_said() -> None:
    """x' = 20 x + sin x + u: 2 d > 21 is needed, and 6.4 twice is not."""
    unstable = problem(
        dynamics={"x": "20*x + sin(x) + u"},
        outputs={"y": "x"},
        network=PATH_2,
        design="order = 0\nstarts = 1",
    )
    found = stored(unstable)
    assert certify(found).certified
    said = found.info["figures"]["defaults"]
    assert said["gain_limit"] > 10.5
    assert "6.4" in said["given_up"]


def test_where_none_is_found_at_all_the_refusal_is_that_of_the_last_try() -> None:
    """x'' = u - 0.1 sin x, x alone measured: a gain of it leaves the trace 0, so that no static gains are stable."""
    undamped = problem(
        dynamics={"x": "v", "v": "u - 0.1*sin(x)"},
        outputs={"y": "x"},
        network=PATH_2,
        design="order = 0\nstarts = 1",
    )
    with pytest.raises(Infeasible, match=r"raise \[design\] order to 1") as refused:
        design(undamped, jobs=1)
    assert "by default" not in str(refused.value), "nothing that was given up is to blame"


def test_what_was_given_up_is_said_where_it_did_not_help(monkeypatch) -> None:
    """Stability and a decay go last: whoever reads of a gain_limit of 50 did not ask for it, and knows of no other."""
    posed, asked = scalar("order = 1"), []

    def none(one: Problem, *_: object) -> None:
        asked.append(one.document()["design"])
        raise Infeasible(f"no gains were found (gain_limit {one.design.gain_limit:g})", fraction=0.9)

    monkeypatch.setattr("lockstep.lmi.design._proposed", none)
    with pytest.raises(
        Infeasible,
        match=r"50\); before that, by default, gain_limit 6.4: 0.9 of what is asked was carried; .*; not asked for",
    ) as refused:
        design(posed)
    assert refused.value.figures == {"fraction": 0.9}
    said = [(one["gain_limit"], one.get("stable_controllers"), "search_decay" in one) for one in asked]
    assert said == [*((limit, True, True) for limit in (6.4, 50, 500)), (50, None, False)]


def test_a_decay_that_is_asked_for_is_held_in_parts() -> None:
    assert decays_held(scalar("order = 0\ngain_limit = 9.0")) == (0.0,)
    held = decays_held(scalar("order = 0\ngain_limit = 9.0\ndecay = 2.0"))
    assert held == pytest.approx((0.8, 1.4, 2.0))
    assert decays_held(scalar("order = 0\ndecay = 2.0\nsearch_decay = 3.0")) == (3.0,)


@pytest.mark.slow
def test_the_largest_decay_of_the_scalar_loop_is_its_limit_s() -> None:
    """sigma = 2 d - alpha at d = 4, alpha = 1: 7. With rho = 1 / (2 d - alpha) at most 0.2 it is no less than 5."""
    free = design(scalar('order = 0\nstarts = 1\ngain_limit = 4.0\nobjective = "decay"'), jobs=1)
    kept = design(scalar('order = 0\nstarts = 1\ngain_limit = 4.0\nobjective = "decay"\nrho = 0.2'), jobs=1)
    for found in (free, kept):
        assert found.guarantees.decay is not None
        assert 6.5 <= found.guarantees.decay[0] <= 7.0
    assert kept.certificate is not None
    assert kept.certificate.rho <= 0.2
    with pytest.raises(NotCertified, match="rho"):
        design(scalar('order = 0\nstarts = 1\ngain_limit = 4.0\nobjective = "decay"\nrho = 0.14'), jobs=1)


@pytest.mark.slow
def test_a_decay_is_proved_where_the_solver_s_units_let_none_hold(monkeypatch) -> None:
    """x_d' = -8 x_d + phi_d decays at 7: of the parts of 8 that are put to the proof 0.8 is the first below."""
    found = design(scalar("order = 0\nstarts = 1\ngain_limit = 4.0"), jobs=1)
    monkeypatch.setattr("lockstep.lmi.guarantees.may_be_proved", lambda *_, **__: False)
    proved = fastest_decay(found.network, found.gains, found.claim, modal=False)
    assert proved is not None
    assert proved[0] == pytest.approx(6.4, rel=0.01)


def test_decay_is_an_objective_of_one_method() -> None:
    with pytest.raises(ProblemError, match="certified"):
        scalar('order = 0\nmethod = "modal"\nobjective = "decay"')


@pytest.mark.slow
def test_the_figures_of_a_scalar_loop_are_those_of_its_formulas() -> None:
    """With u_i = -d r_i: x_d' = -2 d x_d + phi_d + xi_d, |phi_d| <= |x_d|, so rho = 1 / (2 d - 1), the decay is 2 d - 1,
    |u| = 2 d |x_d|, and noise nu on the outputs comes in as 2 d nu_d."""
    posed, d = scalar("order = 0\nstarts = 1\ngain_limit = 3.0"), 2.0
    other = Gains(*((np.zeros(shape),) * 2 for shape in ((0, 0), (0, 1), (1, 0))), (np.array([[-d]]),) * 2)
    points = pareto(stored(posed), {"by hand": other})
    by_hand = next(one for one in points if one.family == "given")
    rho, effort, noise, decay = by_hand.figures
    assert 1 / 3 <= rho <= 1.003 / 3
    assert 4 / 3 <= effort <= 1.01 * 4 / 3
    assert 4 / 3 <= noise <= 1.003 * 4 / 3
    assert 0.96 * 3 <= decay <= 3
    assert {one.family for one in points} >= {"design", "given", "gain limit"}
    assert pareto_csv(points).count("\n") == len(points) + 1
    most = max(points, key=lambda one: np.linalg.norm(one.gains.blocks, 2, axis=(1, 2)).max())
    assert most.figures.rho < points[0].figures.rho, "a larger limit buys rho"


def test_the_front_leaves_out_what_is_worse_in_both() -> None:
    none = Gains((np.zeros((0, 0)),), (np.zeros((0, 1)),), (np.zeros((1, 0)),), (np.zeros((1, 1)),))
    points = tuple(
        ParetoPoint("design", str(k), none, Figures(rho, effort, 1.0, decay), True)
        for k, (rho, effort, decay) in enumerate(
            [(1.0, 9.0, 0.1), (2.0, 5.0, 0.3), (3.0, 6.0, 0.2), (4.0, 1.0, 0.2)]
        )
    )
    assert [one.name for one in pareto_front(points, "effort")] == ["3", "1", "0"]
    assert [one.name for one in pareto_front(points, "decay")] == ["1", "0"]


@pytest.mark.slow
def test_a_trade_off_of_given_gains_is_refused() -> None:
    posed = scalar('order = 0\nmethod = "given"\ngains = [{ D = [[-2.0]] }, { D = [[-2.0]] }]')
    with pytest.raises(ProblemError, match="certified"):
        pareto(stored(posed), {})
    other = Gains((np.zeros((0, 0)),), (np.zeros((0, 1)),), (np.zeros((1, 0)),), (np.zeros((1, 1)),))
    with pytest.raises(ProblemError, match="1 controllers"):
        pareto(stored(scalar("order = 0\nstarts = 1\ngain_limit = 3.0")), {"of one agent": other})


def test_the_decay_that_the_search_keeps_to_is_slow_for_the_period() -> None:
    """A slope that a small part of the domain has makes the natural unit of time short: here 1e-4 s, sampled at 1 ms."""
    stiff = problem(
        dynamics={"x": "-10*x - 5e3*tanh(x) + u"},
        outputs={"y": "x"},
        network=PATH_2,
        design="order = 0\n[controller]\nperiod = 0.001",
    )
    assert first_wishes(stiff)["search_decay"] * 0.001 == pytest.approx(0.01)


def test_given_gains_without_a_certificate_say_how_much_they_carry() -> None:
    """x_d' = phi_d + 2 d x_d with |phi_d| <= |x_d|: D = d = -0.25 is stable for slopes up to 0.5, d = 1 for none."""
    weak, wrong = (
        scalar(f'method = "given"\norder = 0\n[[design.gains]]\nD = [[{d}]]\n[[design.gains]]\nD = [[{d}]]')
        for d in (-0.25, 1.0)
    )
    with pytest.raises(NotCertified, match="one is computed for slopes up to") as found:
        design(weak)
    assert found.value.figures["fraction"] == pytest.approx(0.5, abs=0.02)
    with pytest.raises(NotCertified, match="the linear loop of the given gains is unstable, Re s = 2"):
        design(wrong)


def cushions(h: float, p: float, weighed: str) -> Problem:
    """Two air cushions of 500 kg on 1.5 m^2, p around 3270 Pa, counted in units of h metres and p pascals."""
    flow = f"3*(0.008 + {h}*h)*sqrt(2*(3270 + {p}*p)/1.2)"
    gains = f"A = [[-100.0]]\nB = [[100.0, 0.0]]\nC = [[{75 * h}]]\nD = [[{-75 * h}, 0.0]]"
    return problem(
        dynamics={
            "h": "v",
            "v": f"(1.5*{p / h}*p - 200*v)/500",
            "p": f"{472850 / p}*(1.7718 - 2e-4*{p}*p + q - {flow} - 1.5*{h}*v)",
        },
        outputs={"gap": "h", "pressure": "p"},
        inputs=("q",),
        network=PATH_2,
        design=f'method = "given"\norder = 1\n{weighed}\n' + f"[[design.gains]]\n{gains}\n" * 2,
        agent=f"domain = {{ h = [{-0.003 / h}, {0.003 / h}], p = [{-1000 / p}, {1000 / p}] }}",
    )


def test_how_much_is_carried_is_the_same_in_metres_and_pascals() -> None:
    """With the weights that the defaults have in these units 0 was said to be, of gains that carry more than half."""
    states = "states = { h = 1.0, v = 20.0, p = 1e5 }, outputs = { gap = 4e-4, pressure = 50.0 }"
    weighed = f"weights = {{ state = [1.0, 0.003, 5e-11], input = 2e-6 }}\ndisturbances = {{ {states} }}"
    with pytest.raises(NotCertified, match="one is computed for slopes up to") as millimetres:
        design(cushions(1e-3, 1e3, ""))
    with pytest.raises(NotCertified, match="one is computed for slopes up to") as metres:
        design(cushions(1.0, 1.0, weighed))
    part = millimetres.value.figures["fraction"]
    assert 0.5 < part < 0.9
    assert metres.value.figures["fraction"] == pytest.approx(part, abs=2**-6), (
        "a bisection of 0 to 1 in six steps"
    )


def test_an_agent_that_hears_nobody_needs_a_controller_that_is_stable_alone() -> None:
    """A leader's controller is no part of any feedback: with A = 1 its state grows, whatever sign the others' u has."""
    leader = "[[design.gains]]\nA = [[1.0]]\nB = [[0.0]]\nC = [[0.0]]\nD = [[0.0]]\n"
    follower = "[[design.gains]]\nA = [[-1.0]]\nB = [[0.0]]\nC = [[0.0]]\nD = [[-3.0]]\n"
    posed = problem(
        dynamics={"x": "sin(x) + u"},
        outputs={"y": "x"},
        network='agents = 2\ntopology = "leader_path"',
        design=f'method = "given"\norder = 1\n{leader}{follower}',
    )
    with pytest.raises(
        NotCertified, match="agent 1 hears nobody, and its own controller is unstable by itself"
    ):
        design(posed)
