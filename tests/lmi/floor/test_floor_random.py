"""No certificate that is found for small random problems has a rho below their floor."""

import numpy as np
import pytest
from floor_cases import best_found, floor, random_problem

from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.rounding import prove


def holds_against_what_is_found(seed: int) -> tuple[float | None, float]:
    """Return the least rho that was met and the floor, the floor not above it; decided exactly where they are close."""
    rng = np.random.default_rng(seed)
    posed, asked, order = random_problem(rng)
    found = floor(posed, asked)
    K = best_found(posed, asked, order, rng)
    if K is None:
        return None, found
    least = least_rho(posed.loop(order), K, asked)
    assert least is not None
    if found <= 0.998 * least.rho:
        return least.rho, found
    try:
        certified = prove(posed, Gains.from_blocks(K, order), asked).rho
    except NotCertified:
        return None, found
    assert found <= certified
    return certified, found


@pytest.mark.parametrize("seed", range(6))
def test_no_certificate_is_below_the_floor(seed: int) -> None:
    holds_against_what_is_found(seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    "part", [part if part < 4 else pytest.param(part, marks=pytest.mark.by_hand) for part in range(20)]
)
def test_no_certificate_is_below_the_floor_of_1000_problems(part: int) -> None:
    held = [holds_against_what_is_found(seed) for seed in range(50 * part, 50 * (part + 1))]
    known = [(rho, found) for rho, found in held if rho is not None and found > 0]
    assert len(known) >= 10  # of the others, none has a floor or none was certified
    assert min(rho / found for rho, found in known) < 1.01  # the floor is not only true, it is reached
