"""Agents without controllers, beside the design for them."""

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, problem

from lockstep.check.system.loop import Gains
from lockstep.lmi.diagnosis.open_loop import part_of_states, rho_alone
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.model.assembly import network_of


def alone(dynamics: str, order: int) -> float | None:
    posed = problem(
        dynamics={"x": dynamics}, outputs={"y": "x"}, network='agents = 2\ntopology = "path"',
        design=f"order = {order}\nfragility = {{ D = 0.1 }}", agent="centre = false",
    )  # fmt: skip
    bound = proved_bound(posed)
    return rho_alone(network_of(posed, bound), claim_of(posed, bound))


@pytest.mark.parametrize("order", [0, 1])
def test_the_gain_of_agents_left_alone(order: int) -> None:
    """x_d' = -2 x_d + phi_d + xi_d with |phi_d| <= 0.5 |x_d|: rho = 1 / (2 - 0.5), whatever the controllers would be."""
    assert alone("-2*x + 0.5*sin(x) + u", order) == pytest.approx(1 / 1.5, rel=1e-4)


def test_agents_that_do_not_agree_by_themselves_have_none() -> None:
    assert alone("0.5*sin(x) + u", 0) is None
    assert alone("-0.4*x + 0.5*sin(x) + u", 0) is None, "the slope 0.5 takes it to the right"


def test_a_gain_of_agents_near_the_edge_does_not_depend_on_units() -> None:
    """x_d' = -1000.5 x_d + phi_d + xi_d with |phi_d| <= 1000 |x_d|: rho = 2, and 2e6 where the same is told in 1e6 s."""
    assert alone("-1000.5*x + 1000*sin(x) + u", 0) == pytest.approx(2.0, rel=1e-3)
    assert alone("-1000.5e-6*x + 1000e-6*sin(x) + 1e-6*u", 0) == pytest.approx(2e6, rel=1e-3)


def test_what_stays_where_it_is_has_none() -> None:
    """The joint of an arm turns freely: a pole at 0, which doubles may see to the left of it, and a singular matrix."""
    network = arms()
    assert rho_alone(network, claim(network, 0, ALPHA)) is None


PLANT = np.array([[0, 1, 0, 0], [-7.6, -68, 8, 0], [0, -175, -7.4, 330], [0, 0, 0, -50.0]])
"""A steered axle with an angle of 30 s, a cylinder of 40 1/s and a valve of 50 1/s."""


@pytest.mark.parametrize("slopes", [(1, 1), (10, 10), (66, 100)])
@pytest.mark.parametrize("sizes", [(1.0, 1.0, 1.0, 1.0), (4.0, 10.0, 50.0, 1.0)])
def test_a_gain_of_a_stiff_plant_is_above_that_of_its_linear_part(
    sizes: tuple[float, ...], slopes: tuple[int, int]
) -> None:
    """The linear part has 41 or more, from its frequency response: 0.96 was told of the whole, or nothing."""
    a, w, p, s = sizes
    posed = problem(
        dynamics={
            "a": "w", "w": f"-7.6*a - 68*w + 8*p + {slopes[0]}*sin(w)",
            "p": f"-175*w - 7.4*p + 330*s + {slopes[1]}*sin(s)", "s": "-50*s + 50*u",
        },
        outputs={"y": "a"}, network='agents = 2\ntopology = "path"', agent="centre = false",
        design=f"order = 0\ndisturbances = {{ states = {{ a = {a}, w = {w}, p = {p}, s = {s} }} }}",
    )  # fmt: skip
    linear = max(
        np.linalg.norm(np.linalg.solve(1j * omega * np.eye(4) - PLANT, np.diag(sizes)), 2)
        for omega in (0.0, *np.logspace(-4, 4, 400))
    )
    bound = proved_bound(posed)
    found = rho_alone(network_of(posed, bound), claim_of(posed, bound))
    assert found is not None
    assert linear <= found <= 1.5 * linear


@pytest.mark.parametrize(("C", "part"), [(0.0, 0.0), (0.01, 0.01 / 2.01), (2.0, 0.5)])
def test_the_part_of_u_that_is_made_of_the_states_of_the_controllers(C: float, part: float) -> None:
    """C (j w + 1)^-1 beside D = -2: |C| at most, at w = 0."""
    one = [np.array([[value]]) for value in (-1.0, 1.0, C, -2.0)]
    gains = Gains(*((block,) * 2 for block in one))
    assert part_of_states(gains) == pytest.approx(part, rel=1e-8)  # poles are moved by 1e-9


def test_a_controller_that_integrates_makes_all_of_u_in_the_end() -> None:
    """A_C = 0: lstsq answers the singular equation at w = 0 with 0, and the integrator was said to do nothing."""
    one = [np.array([[value]]) for value in (0.0, 1.0, 1.0, -2.0)]
    assert part_of_states(Gains(*((block,) * 2 for block in one))) > 0.999


@pytest.mark.parametrize("entry", [1e300, 1e-9 / (1 - 1e-9), 5e-324])
def test_the_part_is_a_number_of_any_controller_that_a_file_may_hold(entry: float) -> None:
    """The answer of every command has it: overflow, or a pole where poles are moved to, is no error there, and no NaN."""
    one = [np.array([[value]]) for value in (entry, entry, 1.0, -2.0)]
    part = part_of_states(Gains(*((block,) * 2 for block in one)))
    assert 0.0 <= part <= 1.0


def test_static_gains_have_no_such_part() -> None:
    assert part_of_states(Gains(*((np.zeros(s),) * 2 for s in ((0, 0), (0, 1), (1, 0), (1, 1))))) is None
