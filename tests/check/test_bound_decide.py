"""The decision of a bound: against slopes known in closed form, from above and from just below, and by its count of boxes."""

import json
import math
import os
import subprocess
import sys
from fractions import Fraction

import flint
import numpy as np
import pytest

from lockstep.check.bound.box import Box
from lockstep.check.bound.decide import decide_bound
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.regularity import Condition
from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import (
    ONE,
    Node,
    add,
    constant,
    function,
    multiply,
    power,
    scale,
    variable,
)
from lockstep.check.expression.switches import positive
from lockstep.check.system.domain import argument_box, claimed_box

INF = math.inf
x, y = variable(0), variable(1)
ENOUGH = 20_000


def phi(*outputs: Node, inputs: int = 1, needs: tuple[Condition, ...] = ()) -> ExactPhi:
    return ExactPhi(outputs, needs, inputs)


def fn(name: str, *args: Node) -> Node:
    return function(name, *args)


def root(number: int) -> flint.arb:
    return flint.arb(number).sqrt()


def decide(
    graph: ExactPhi,
    box: Box,
    alpha: float,
    entries: tuple[Entry, ...] = (),
    boxes: int = ENOUGH,
    **scales,
):
    given = {"output_scale": None, "input_scale": None, **scales}
    return decide_bound(graph, box, alpha, given["output_scale"], given["input_scale"], entries, boxes=boxes)


ANGLE = phi(fn("atan2", y, x), inputs=2, needs=(Condition("off the cut", (y, x), "`atan2`"),))
LOG = phi(fn("log", x), needs=(Condition("positive", (x,), "`log`"),))
CONSTANTS = {
    # name: phi, box, the supremum of its slope by hand as a ball of 200 bits
    "sin": (phi(fn("sin", x)), Box.everywhere(1), 1),  # cos(0)
    "arms": (phi(scale(-Fraction(3.33), fn("sin", x))), Box.everywhere(1), 3.33),
    "two waves": (phi(add(fn("sin", x), scale(Fraction(1, 2), fn("sin", scale(2, x))))), Box.everywhere(1), 2),
    "tanh": (phi(fn("tanh", x)), Box.everywhere(1), 1),  # sech^2(0)
    "tanh on one side": (phi(fn("tanh", x)), Box((1.0,), (INF,)), lambda: flint.arb(1).sech() ** 2),
    "bell": (phi(fn("exp", scale(-1, power(x, 2)))), Box.everywhere(1), lambda: root(2) / (flint.arb(1) / 2).exp()),
    "rational": (phi(x / (1 + x**2)), Box.everywhere(1), 1),  # at 0
    "logistic": (phi(power(add(ONE, fn("exp", scale(-1, x))), -1)), Box.everywhere(1), 0.25),  # at 0
    "softplus": (phi(fn("log", add(ONE, fn("exp", x)))), Box.everywhere(1), 1),  # towards infinity
    "length": (phi(fn("sqrt", add(ONE, power(x, 2)))), Box.everywhere(1), 1),  # towards infinity
    "cube on a box": (phi(power(x, 3)), Box((-2.0,), (1.0,)), 12),
    "modulus": (phi(fn("fabs", x)), Box.everywhere(1), 1),
    "log on a box": (LOG, Box((0.5,), (3.0,)), 2),
    "product": (phi(multiply(x, y), inputs=2), Box((-2.0, -1.0), (3.0, 4.0)), 5),  # |(4, 3)|
    "van der Pol": (phi((1 - x**2) * y, inputs=2), Box((-2.0, -3.0), (2.0, 3.0)), lambda: root(153)),
    "angle": (ANGLE, Box((1.0, -1.0), (2.0, 1.0)), 1),  # 1/r at (1, 0)
    "norm": (phi(fn("hypot", x, y), inputs=2), Box.everywhere(2), 1),
    "larger": (phi(fn("fmax", x, scale(2, y)), inputs=2), Box.everywhere(2), 2),
    "sum of independent waves": (phi(add(fn("sin", x), fn("sin", y)), inputs=2), Box.everywhere(2), lambda: root(2)),
    # J = [[y, x], [1, 0]] at (1, 1): the golden ratio
    "coupled": (phi(multiply(x, y), x, inputs=2), Box((0.0, 0.0), (1.0, 1.0)), lambda: (1 + root(5)) / 2),
}  # fmt: skip


def supremum(name: str) -> flint.arb:
    with flint.ctx.workprec(200):
        value = CONSTANTS[name][2]
        return value() if callable(value) else flint.arb(value)


def below(value: flint.arb) -> float:
    """The largest double that is below the number."""
    double = float(value.mid())
    return double if flint.arb(double) < value else math.nextafter(double, 0.0)


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_bound_a_little_above_the_supremum_is_proved(name: str) -> None:
    """A little: a few units in the last place, which enclosures cost; a part in 10^4 with two variables or more."""
    graph, box, _ = CONSTANTS[name]
    room = (
        1e-14
        if graph.inputs == 1 and name not in ("two waves", "bell")
        else 1e-7
        if graph.inputs == 1
        else 1e-4
    )
    assert decide(graph, box, float(supremum(name).mid()) * (1 + room)).proved


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_bound_below_the_supremum_is_never_proved(name: str) -> None:
    """Not one double below, where nothing may be found, and refuted by a point of the box one part in a hundred below."""
    graph, box, _ = CONSTANTS[name]
    least = supremum(name)
    assert not decide(graph, box, below(least)).proved
    assert not decide(graph, box, below(least), boxes=17).proved
    answer = decide(graph, box, 0.99 * float(least.mid()))
    assert answer.status == "refuted"
    assert answer.figures["slope"] > 0.99 * float(least.mid())
    assert answer.figures["slope"] <= float(least.mid()) * (1 + 1e-15)
    assert all(
        low <= v <= high for v, low, high in zip(answer.figures["v"], box.lower, box.upper, strict=True)
    )
    assert json.dumps(dict(answer.figures), allow_nan=False)


def test_a_witness_has_the_slope_it_says() -> None:
    answer = decide(CONSTANTS["van der Pol"][0], CONSTANTS["van der Pol"][1], 12.0)
    a, b = answer.figures["v"]
    assert math.hypot(2 * a * b, 1 - a * a) == pytest.approx(answer.figures["slope"], rel=1e-12)
    assert answer.figures["slope"] > 12.0


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_proof_needs_the_boxes_it_used_and_one_less_leaves_it_undecided(name: str) -> None:
    graph, box, _ = CONSTANTS[name]
    alpha = 1.01 * float(supremum(name).mid())
    used = decide(graph, box, alpha).figures["boxes"]
    assert decide(graph, box, alpha, boxes=used).proved
    fewer = decide(graph, box, alpha, boxes=used - 1)
    assert fewer.status == "undecided"
    assert f"{used - 1} boxes do not suffice" in fewer.reason
    assert decide(graph, box, alpha, boxes=0).status == "undecided"


def test_what_is_not_defined_or_jumps_is_undecided_however_large_alpha_is() -> None:
    jump = positive(x)
    cases = [
        (LOG, "`log`"),
        (phi(power(x, -1), needs=(Condition("nonzero", (x,), "a division"),)), "a division"),
        (phi(jump, needs=(Condition("decided", (jump,), "a comparison"),)), "a comparison"),
        (phi(fn("sqrt", x), needs=(Condition("not negative", (x,), "`sqrt`"),)), "`sqrt`"),
        (ANGLE, "`atan2`"),
    ]
    for graph, name in cases:
        answer = decide(graph, Box((-1.0,) * graph.inputs, (2.0,) * graph.inputs), 1e300, boxes=100_000)
        assert answer.status == "undecided"
        assert name in answer.reason
    assert not decide(phi(fn("sqrt", x)), Box((0.0,), (1.0,)), 1e300).proved
    assert not decide(phi(power(x, 3)), Box.everywhere(1), 1e300).proved


def test_scales_belong_to_the_question() -> None:
    """|D_w^-1 J D_v| with J = diag(3 cos v1, sech^2(v2) / 2): 3 D_v1 / D_w1 and D_v2 / (2 D_w2)."""
    graph = phi(scale(3, fn("sin", x)), scale(Fraction(1, 2), fn("tanh", y)), inputs=2)
    box = Box.everywhere(2)
    assert decide(graph, box, 3.0).proved
    assert decide(graph, box, 3.0, output_scale=[1.0, 0.25]).proved
    assert decide(graph, box, 3.0, output_scale=[1.0, 0.125]).status == "refuted"
    assert decide(graph, box, 3.0, input_scale=[1.0, 6.0]).proved
    assert decide(graph, box, 3.0, input_scale=[1.001, 1.0]).status == "refuted"
    for wrong in ([1.0], [1.0, 0.0], [1.0, -1.0], [1.0, INF], [1.0, math.nan]):
        with pytest.raises(ProblemError, match="output_scale"):
            decide(graph, box, 3.0, output_scale=wrong)


THRUST = phi(multiply(y, fn("cos", x)), inputs=2)
"""T cos(theta): slopes -T sin(theta) and cos(theta)."""
THRUST_BOX = Box((-0.5, 8.0), (0.5, 16.0))
SLOPES = (Entry(0, 0, 16 * math.sin(0.5) * (1 + 1e-12)), Entry(0, 1, 1.0))


def test_entries_are_decided_too_and_none_may_be_missing() -> None:
    alpha = 1.001 * math.hypot(16 * math.sin(0.5), math.cos(0.5))
    proved = decide(THRUST, THRUST_BOX, alpha, SLOPES)
    assert proved.proved
    assert decide(THRUST, THRUST_BOX, alpha, SLOPES, boxes=proved.figures["boxes"]).proved
    assert decide(THRUST, THRUST_BOX, alpha, SLOPES, boxes=proved.figures["boxes"] - 1).status == "undecided"
    for k, least in enumerate((16 * math.sin(0.5), 1.0)):
        smaller = tuple(Entry(0, l, 0.999 * least) if l == k else one for l, one in enumerate(SLOPES))
        answer = decide(THRUST, THRUST_BOX, alpha, smaller)
        assert answer.status == "refuted"
        assert f"slope (1, {k + 1})" in answer.reason
        missing = decide(THRUST, THRUST_BOX, alpha, SLOPES[:k] + SLOPES[k + 1 :])
        assert missing.status == "refuted"
        assert f"slope (1, {k + 1}), whose entry is missing" in missing.reason
    assert decide(THRUST, THRUST_BOX, 0.9 * alpha, SLOPES).status == "refuted"


@pytest.mark.parametrize("wrong", [(Entry(1, 0, 1.0),), (Entry(0, 2, 1.0),), SLOPES[:1] * 2])
def test_entries_that_phi_does_not_have_are_refused(wrong: tuple[Entry, ...]) -> None:
    with pytest.raises(ProblemError, match="entries for the slopes"):
        decide(THRUST, THRUST_BOX, 100.0, wrong)


def test_a_box_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ProblemError, match="2 components"):
        decide(CONSTANTS["sin"][0], Box.everywhere(2), 1.0)


def test_without_a_slope_there_is_nothing_to_prove_but_what_phi_needs() -> None:
    assert decide(phi(), Box.everywhere(1), 0.0, boxes=0).proved
    assert decide(phi(fn("sin", x), inputs=0), Box.everywhere(0), 0.0, boxes=0).proved  # of t alone
    needs = (Condition("positive", (x,), "`log`"),)
    assert decide(phi(constant(1), needs=needs), Box((1.0,), (2.0,)), 0.0).proved
    assert not decide(phi(constant(1), needs=needs), Box((-1.0,), (2.0,)), 0.0).proved


def test_every_time_counts() -> None:
    """(1 + 0.3 cos t) sin v: 1.3 over all t."""
    t = variable(1)
    graph = phi(multiply(add(ONE, scale(Fraction(3, 10), fn("cos", t))), fn("sin", x)))
    assert decide(graph, Box.everywhere(1), 1.3 * (1 + 1e-12)).proved
    assert decide(graph, Box.everywhere(1), 1.29).status == "refuted"


def test_no_linear_algebra_library_and_no_random_number_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a decision has asked for it")

    for name in ("svd", "norm", "eigh", "eigvalsh", "solve", "inv", "cholesky", "qr", "lstsq"):
        monkeypatch.setattr(np.linalg, name, forbidden)
    for name in ("dot", "matmul", "einsum", "tensordot", "inner", "vdot"):
        monkeypatch.setattr(np, name, forbidden)
    monkeypatch.setattr(np.random, "default_rng", forbidden)
    for name, (graph, box, _) in CONSTANTS.items():
        assert decide(graph, box, 1.01 * float(supremum(name).mid())).proved
        assert decide(graph, box, 0.99 * float(supremum(name).mid())).status == "refuted"


PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import test_bound_decide as cases
np.linalg.svd(np.random.default_rng(0).normal(size=(60, 60)))
for name, (graph, box, _) in cases.CONSTANTS.items():
    for share in (0.99, 1.01):
        answer = cases.decide(graph, box, share * float(cases.supremum(name).mid()))
        print(name, answer.status, dict(answer.figures))
"""


@pytest.mark.slow
def test_threads_and_kernels_change_nothing() -> None:
    """The same verdicts, counts and witnesses, to the last bit, whatever the linear algebra library is set to."""
    settings = [("1", "Prescott"), ("2", "Haswell"), ("4", "")]
    printed = {_run(threads, kernel) for threads, kernel in settings}
    assert len(printed) == 1
    assert len(printed.pop().splitlines()) == 2 * len(CONSTANTS)


def _run(threads: str, kernel: str) -> str:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OPENBLAS_CORETYPE": kernel}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, "-c", PROGRAM, os.path.dirname(__file__)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout


def test_a_global_bound_is_decided_without_the_domain() -> None:
    box = Box((-1.0,), (1.0,))
    cube, wave = phi(power(x, 3)), phi(fn("sin", x))
    assert decide(cube, claimed_box("local", box), 3.0 * (1 + 1e-12)).proved
    assert not decide(cube, claimed_box("global", box), 3.0 * (1 + 1e-12)).proved
    assert decide(wave, claimed_box("global", box), 1.0).proved


def test_the_domain_of_the_arguments_is_rounded_outwards() -> None:
    """v = x1/3 - x2/10 on [0, 1] x [0, 1] is [-1/10, 1/3]: no double is either of them."""
    third, tenth = flint.fmpq(1, 3), flint.fmpq(1, 10)
    box = argument_box([[third, -tenth]], [(0.0, 1.0), (0.0, 1.0)])
    assert Fraction(box.lower[0]) <= Fraction(-1, 10)
    assert Fraction(math.nextafter(box.lower[0], INF)) > Fraction(-1, 10)
    assert Fraction(box.upper[0]) >= Fraction(1, 3)
    assert Fraction(math.nextafter(box.upper[0], -INF)) < Fraction(1, 3)
    assert argument_box([[1.0, 1.0]], [(-INF, 0.0), (0.0, 1.0)]) == Box((-INF,), (1.0,))
