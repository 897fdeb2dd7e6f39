"""Theorem 1 and Corollary 1 as printed: the reference's figures, and what their recovery (22) loses."""

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, table_1_problem

from lockstep.check.errors import Infeasible, NotCertified
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.design import design
from lockstep.lmi.methods.paper import Audit, solve_as_printed
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem

PAPER_DELTA = np.array([0.5, 0.2, 0.2, 0.2])


def corollary_1(order: int = 2) -> Audit:
    return solve_as_printed(arms(), order, np.eye(4), 2 * np.eye(order), None)


def test_corollary_1_on_the_paper_s_example() -> None:
    """Reference, measured.as_printed: objective 21.30, alpha 0.554, the recovered loop within 1e-4 of the axis."""
    audit = corollary_1()
    assert audit.objective == pytest.approx(21.30, abs=0.005)
    assert audit.alpha == pytest.approx((0.554, 0.554), abs=0.001)
    assert audit.objective == pytest.approx(
        audit.rho**2 + sum(a**-2 for a in audit.alpha) * _tau(audit), rel=1e-3
    )
    assert audit.abscissa > -1e-3  # "stable" by the theorem; its slowest mode takes an hour
    assert audit.residual > 100  # nothing of k_i, f_i survives (22)


def _tau(audit: Audit) -> float:
    """gamma_hat = tau_5 gamma: what the printed alpha leaves of the objective."""
    return (audit.objective - audit.rho**2) / sum(a**-2 for a in audit.alpha)


def test_the_recovered_gains_are_not_certified() -> None:
    audit, network = corollary_1(), arms()
    with pytest.raises(NotCertified):
        prove(network, audit.gains, claim(network, 2, ALPHA))
    # Not even for the 0.554 that (34) is proud of, although the nonlinearity is structured here.
    with pytest.raises(NotCertified):
        prove(network, audit.gains, claim(network, 2, 0.554))


def test_theorem_1_on_the_paper_s_example_recovers_an_unstable_loop() -> None:
    """Reference: the abscissa of the recovered loop is about +0.06 (a solver's figure: the optimum is not unique)."""
    audit = solve_as_printed(arms(), 2, np.eye(4), 2 * np.eye(2), PAPER_DELTA)
    assert 0.02 < audit.abscissa < 0.1
    assert audit.residual > 100
    assert audit.objective > corollary_1().objective  # (19) asks for more than (34)


def first_order(**options: object) -> Network:
    """x' = -x + sin x + u, y = x: B = 1 has the whole range, so that (22) loses nothing."""
    agent = Agent.from_expressions(
        "a", states=["x"], inputs=["u"], outputs={"y": "x"}, dynamics={"x": "sin(x) - x + u"}
    )
    return Network(agent, Graph.topology("cycle", 3), **options)


@pytest.mark.parametrize(
    ("order", "delta"),
    [
        (0, None),
        (1, None),
        (0, np.full(4, 0.1)),
        (1, np.full(4, 0.1)),
    ],
)
def test_with_an_invertible_B_the_recovery_loses_nothing(order: int, delta: np.ndarray | None) -> None:
    """The must-pass beside the arms: the residual vanishes and the recovered loop is as stable as (19) says."""
    network = first_order()
    audit = solve_as_printed(network, order, np.eye(1), 2 * np.eye(order), delta)
    assert audit.residual < 1e-9
    assert audit.abscissa < -0.1


def test_the_abscissa_is_that_of_the_gains_returned() -> None:
    """Recomputed on the full loop (12): its poles are those of the reduced one and of one agent without input."""
    network = first_order()
    audit = solve_as_printed(network, 0, np.eye(1), np.zeros((0, 0)), None)
    D = np.diag([float(block[0, 0]) for block in audit.gains.D])
    poles = np.linalg.eigvals(-np.eye(3) + D @ network.graph.laplacian)  # A = -1, agreement moves with A
    moving = np.sort(poles[np.abs(poles + 1) > 1e-9].real)
    assert moving[-1] == pytest.approx(audit.abscissa, abs=1e-9)


def test_order_0_on_the_arms_gives_D_alone() -> None:
    """Remark 1. The dynamics were idle anyway: the objective stays where it was (P = diag(P_S, P_C))."""
    audit = corollary_1(order=0)
    assert audit.gains.order == 0
    assert audit.gains.D[0].shape == (1, 2)
    assert audit.objective == pytest.approx(corollary_1().objective, rel=1e-3)


def test_what_no_output_shows_makes_it_infeasible() -> None:
    agent = Agent.from_expressions(
        "a", states=["x", "y"], inputs=["u"], outputs={"seen": "x"}, dynamics={"x": "u - x", "y": "y + u"}
    )
    with pytest.raises(Infeasible, match=r"\(34\) as printed"):
        solve_as_printed(Network(agent, Graph.topology("cycle", 3)), 0, np.eye(2), np.zeros((0, 0)), None)


@pytest.mark.parametrize("method", ["corollary1", "theorem1"])
def test_the_method_exits_with_the_audit_s_figures(method: str) -> None:
    document = table_1_problem().document()
    document["design"] |= {
        "method": method,
        "order": 2,
        "fragility": dict(zip("ABCD", PAPER_DELTA.tolist(), strict=True)),
    }
    del document["design"]["gains"]
    if method == "corollary1":
        del document["design"]["fragility"]
    with pytest.raises(NotCertified, match="as printed, the recovered loop is not certified") as error:
        design(Problem.from_document(document))
    assert error.value.figures["residual"] > 100
    assert error.value.figures["abscissa"] > -1e-3
    assert not error.value.figures["design"].certified
