"""Agents: the paper's (38) comes out exactly, and what (2) does not cover is refused with its place."""

import casadi as ca
import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.model.agents.agent import Agent
from lockstep.model.control.pbh import controllability, observability

ARM = {
    "name": "arm",
    "states": ["theta_m", "omega_m", "theta_l", "omega_l"],
    "inputs": ["u"],
    "parameters": {"gravity": 3.33},
    "dynamics": {
        "theta_m": "omega_m",
        "omega_m": "-48.6*theta_m - 1.25*omega_m + 48.6*theta_l + 21.6*u",
        "theta_l": "omega_l",
        "omega_l": "19.5*theta_m - 19.5*theta_l - gravity*sin(theta_l)",
    },
    "outputs": {"y1": "theta_m", "y2": "omega_m"},
}


def arm(**changes: object) -> Agent:
    return Agent.from_expressions(**{**ARM, **changes})


def dynamics(**changes: str) -> dict:
    return {"dynamics": {**ARM["dynamics"], **changes}}


def test_the_paper_s_matrices_come_out_exactly() -> None:
    """(38)."""
    lure = arm().lure
    np.testing.assert_array_equal(
        lure.A, [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]
    )
    np.testing.assert_array_equal(lure.B, [[0], [21.6], [0], [0]])
    np.testing.assert_array_equal(lure.C, [[1, 0, 0, 0], [0, 1, 0, 0]])
    np.testing.assert_array_equal(lure.G, [[0], [0], [0], [1]])
    np.testing.assert_array_equal(lure.H, [[0, 0, 1, 0]])
    assert float(lure.phi(0.5, 0.0)) == -3.33 * np.sin(0.5)
    assert lure.phi.name_in() == ["v", "t"]
    assert lure.phi.name_out() == ["w"]
    assert not np.asarray(lure.at_origin(0.0)).any()


def test_casadi_expressions_give_the_same_agent() -> None:
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rhs = ca.vertcat(
        x[1],
        -48.6 * x[0] - 1.25 * x[1] + 48.6 * x[2] + 21.6 * u,
        x[3],
        19.5 * (x[0] - x[2]) - 3.33 * ca.sin(x[2]),
    )
    mine = Agent(name="arm", x=x, u=u, rhs=rhs, y=x[:2])
    for letter in "ABCGH":
        np.testing.assert_array_equal(getattr(mine.lure, letter), getattr(arm().lure, letter))
    assert mine.states == ("x_0", "x_1", "x_2", "x_3")
    assert mine.outputs == ("y1", "y2")


def test_an_offset_is_kept_apart() -> None:
    lure = arm(**dynamics(omega_m="u - theta_m + 2 + sin(t)", omega_l="theta_m - cos(theta_l)")).lure
    np.testing.assert_allclose(np.asarray(lure.offset(0.5)).ravel(), [0, 2 + np.sin(0.5), 0, 0])
    np.testing.assert_allclose(np.asarray(lure.at_origin(0.5)).ravel(), [0, 2 + np.sin(0.5), 0, -1])


def test_the_box_is_open_where_nothing_is_given() -> None:
    box = arm(domain={"theta_l": (1.0, 2.0), "omega_l": (-np.inf, 0.0)}).box
    np.testing.assert_array_equal(box[2], [1, 2])
    np.testing.assert_array_equal(box[3], [-np.inf, 0])
    np.testing.assert_array_equal(box[0], [-np.inf, np.inf])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (dynamics(omega_m="u**2"), ("[agent.dynamics] omega_m", "`u`", "`u**2`", "linearly")),
        (dynamics(omega_m="theta_m*u"), ("[agent.dynamics] omega_m", "`(theta_m*u)`")),
        (dynamics(omega_m="sin(t)*u"), ("[agent.dynamics] omega_m", "constant coefficients")),
        (dynamics(omega_m="abs(u)"), ("`abs(u)`",)),
        (dynamics(omega_m="sin(theta_m + u)"), ("through `sin((theta_m+u))`",)),
        (dynamics(omega_m="bogus"), ("[agent.dynamics] omega_m", "unknown symbol `bogus`")),
        (dynamics(omega_m=3), ("[agent.dynamics] omega_m", "3 is no text")),
        (dynamics(omega_x="u"), ("[agent.dynamics]", "`omega_x` is unknown", "did you mean `omega_")),
        (
            {"dynamics": {k: v for k, v in ARM["dynamics"].items() if k != "omega_l"}},
            ("no equation", "`omega_l`"),
        ),
        ({"outputs": {"y1": "theta_m**2"}}, ("[agent.outputs] y1", "not linear")),
        ({"outputs": {"y1": "theta_m*t"}}, ("[agent.outputs] y1", "not linear")),
        ({"outputs": {"y1": "theta_m + 1"}}, ("[agent.outputs] y1", "constant 1")),
        ({"outputs": {"y1": "theta_m + u"}}, ("[agent.outputs] y1", "input `u`", "feedthrough")),
        ({"outputs": {"y1": "0"}}, ("[agent.outputs] y1", "no state")),
        ({"outputs": {}}, ("[agent] outputs", "no outputs")),
        ({"inputs": []}, ("[agent] inputs", "no inputs")),
        ({"states": []}, ("[agent] states", "no states")),
        ({"states": ["x", "x"]}, ("[agent] states", "`x` is twice")),
        ({"inputs": ["theta_m"]}, ("[agent] inputs", "`theta_m` is in states too")),
        ({"parameters": {"u": 1.0}}, ("[agent] parameters", "`u` is in inputs too")),
        ({"parameters": {"t": 1.0}}, ("[agent] parameters", "already the time")),
        ({"parameters": {"pi": 3.0}}, ("already a constant",)),
        ({"parameters": {"sin": 3.0}}, ("already a function",)),
        ({"parameters": {"lambda": 3.0}}, ("a word of Python",)),
        ({"parameters": {"gravity": float("nan")}}, ("[agent.parameters]", "`gravity` is nan")),
        ({"parameters": {"gravity": True}}, ("`gravity` is True",)),
        ({"parameters": {"gravity": "3"}}, ("`gravity` is '3'",)),
        ({"states": ["theta m"]}, ("`theta m` is not a name",)),
        ({"states": ["θ"]}, ("is not a name",)),
        ({"states": ["s" * 100]}, ("100 characters",)),
        ({"name": "1arm"}, ("[agent] name", "not a C identifier")),
        ({"name": "my arm"}, ("not a C identifier",)),
        ({"name": "_arm"}, ("not a C identifier",)),
        ({"name": "arm\n"}, ("not a C identifier",)),
        ({"name": ""}, ("not a C identifier",)),
        ({"name": "float"}, ("a word of C",)),
        ({"name": "a" * 40}, ("at most 20",)),
        ({"split": "taylor"}, ("[agent] split", '"terms" or "jacobian"')),
        ({"domain": {"theta": (0, 1)}}, ("[agent.domain]", "`theta` is unknown", "did you mean `theta_")),
        ({"domain": {"theta_m": (1, 1)}}, ("[agent.domain] theta_m", "lower bound below")),
        ({"domain": {"theta_m": (2, 1)}}, ("from 2 to 1",)),
        ({"domain": {"theta_m": (float("nan"), 1)}}, ("from nan to 1",)),
        ({"units": {"thetam": "rad"}}, ("[agent.units]", "`thetam` is unknown")),
    ],
)
def test_bad_agents_are_refused(changes: dict, says: tuple) -> None:
    with pytest.raises(ProblemError) as caught:
        arm(**changes)
    for part in says:
        assert part in str(caught.value)


X, U = ca.SX.sym("x", 2), ca.SX.sym("u")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"rhs": X[0]}, "`rhs` has 1 rows, but there are 2 states"),
        ({"rhs": ca.horzcat(X, X)}, "shape 2 x 2"),
        ({"rhs": ca.vertcat(X[0], ca.SX.sym("z"))}, "`z` is neither"),
        ({"rhs": ca.vertcat(X[0], X[1] * float("inf"))}, "finite"),
        ({"rhs": "x"}, "casadi.SX"),
        ({"x": X * 2}, "symbols only"),
        ({"u": ca.SX(0, 1)}, "at least one input"),
        ({"states": ("a",)}, "1 names for 2 states"),
    ],
)
def test_bad_casadi_agents_are_refused(changes: dict, says: str) -> None:
    good = {"name": "a", "x": X, "u": U, "rhs": ca.vertcat(X[1], U), "y": X[0]}
    Agent(**good)
    with pytest.raises(ProblemError, match=says):
        Agent(**{**good, **changes})


def test_the_arm_is_controllable_and_observable() -> None:
    assert arm().controllability().controllable
    assert arm().observability().observable
    assert arm().controllability().margin > 0.1


def test_the_link_alone_does_not_show_in_a_cut_arm() -> None:
    cut = arm(**dynamics(omega_l="-19.5*theta_l - omega_l", omega_m="u - theta_m")).controllability()
    assert not cut.controllable
    assert cut.stabilisable
    assert cut.unstable_eigenvalue is None
    assert abs(cut.eigenvalue.real + 0.5) < 1e-9


@pytest.mark.parametrize(
    ("A", "B", "controllable", "stable"),
    [
        ([[0, 1], [0, 0]], [[0], [1]], True, True),
        ([[0, 1], [0, 0]], [[1], [0]], False, False),
        ([[-1, 0], [0, 2]], [[0], [1]], False, True),
        ([[-1, 0], [0, 2]], [[1], [0]], False, False),
        ([[1, 0], [0, 1]], [[1], [1]], False, False),
        ([[0, 1], [-1, 0]], [[0], [0]], False, False),
        # Badly scaled but controllable: metres beside pascals.
        ([[0, 1e-6], [-1e6, -1]], [[0], [1e6]], True, True),
        # Stiff, with a slow mode that no input moves but that decays.
        ([[-1e6, 0], [0, -0.5]], [[1], [0]], False, True),
        ([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], [[0], [0], [0], [1]], True, True),
        ([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], [[0], [0], [1], [0]], False, False),
    ],
)
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_controllability_in_any_coordinates(
    A: list, B: list, controllable: bool, stable: bool, seed: int
) -> None:
    """Known by inspection; an orthogonal change of the states changes nothing but rounding."""
    a, b = np.array(A, dtype=float), np.array(B, dtype=float)
    if seed is not None:
        V, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal(a.shape))
        a, b = V.T @ a @ V, V.T @ b
    check = controllability(a, b)
    assert (check.controllable, check.stabilisable) == (controllable, stable)
    dual = observability(a.T, b.T)
    assert (dual.observable, dual.detectable) == (controllable, stable)


def test_the_margin_is_the_distance_to_an_uncontrollable_pair() -> None:
    """[-1 - s, 0, e; 0, -2 - s, 1]: at s = -1 the least singular value is about e for small e."""
    e = 1e-5
    check = controllability(np.diag([-1.0, -2.0]), np.array([[e], [1.0]]))
    assert check.controllable
    assert check.margin == pytest.approx(e / np.sqrt(2), rel=0.5)


def test_the_margin_is_no_larger_than_a_fine_grid_finds() -> None:
    """The least singular value over s, which need not be near an eigenvalue: random pairs against a grid of 0.1."""
    generator = np.random.default_rng(1)
    grid = (np.linspace(-3, 3, 61)[:, None] + 1j * np.linspace(0, 3, 31)).ravel()
    for _ in range(6):
        n, m = generator.integers(1, 6), generator.integers(1, 3)
        a, b = generator.standard_normal((n, n)), generator.standard_normal((n, m))
        pencils = np.concatenate(
            [a - grid[:, None, None] * np.eye(n), np.broadcast_to(b, (len(grid), n, m))], axis=2
        )
        seen = np.linalg.svd(pencils, compute_uv=False)[:, -1].min()
        check = controllability(a, b)
        assert check.margin <= seen
        s = check.eigenvalue
        here = np.linalg.svd(np.hstack([a - s * np.eye(n), b]), compute_uv=False)[-1]
        assert here == pytest.approx(check.margin, rel=1e-6)
