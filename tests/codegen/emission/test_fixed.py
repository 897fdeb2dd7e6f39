"""`generate --fixed`: controllers in integers, to the bit, within their error bound, certified, and in few instructions."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from codegen_cases import arms, random_controller
from export_cases import folder_of, needs_compiler
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lockstep.check.c_source.fixed_point import read_fixed
from lockstep.check.certify import certified
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.sampled.fixed_point import LARGEST_R, LARGEST_X, MOST_A, MOST_D, SPLIT, FixedController
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.exports.fixed_point import controller_of
from lockstep.codegen.manifest import FixedEntry, load_manifest
from lockstep.codegen.spec import CodegenSpec, Neighbour
from lockstep.verification.fixed_point import step_of
from lockstep.verification.verify import verify_folder


def formats(order, outputs, inputs, agents=1):
    states = ((22,) * order,) * agents
    return FixedEntry(outputs=(11,) * outputs, inputs=(10,) * inputs, states=states, claims=("nothing",))


def one_agent(order, outputs, inputs, neighbours):
    one = random_controller("c1", order, outputs, inputs, neighbours=0)
    sources = tuple(Neighbour(f"peer{j}") for j in range(neighbours))
    limits = np.tile([-9.0, 7.0], (inputs, 1))
    agent = type(one)("c1", one.A, one.B, one.C, one.D, sources, limits=limits)
    return CodegenSpec((agent,), period=0.01, name="whole", fixed=formats(order, outputs, inputs))


def of_arms(**options):
    agents = tuple(replace(one, limits=np.array([[-10.0, 10.0]])) for one in arms().agents)
    return arms(fixed=formats(2, 2, 1, 3), agents=agents, **options)


def integers(draw, count, most):
    """So many integers whose sizes add up to at most so much, often to exactly that."""
    parts = [draw(st.integers(0, most)) for _ in range(count)]
    total = sum(parts)
    sizes = [
        p * most // max(total, most) if draw(st.booleans()) else p * most // max(total, 1) for p in parts
    ]
    return tuple(size * draw(st.sampled_from([-1, 1])) for size in sizes)


@st.composite
def controllers(draw):
    n, q, m = draw(st.integers(0, 3)), draw(st.integers(1, 3)), draw(st.integers(1, 2))
    shifts = st.integers(1, 30)
    return FixedController(
        tuple(integers(draw, n, MOST_A) for _ in range(n + m)),
        tuple(draw(shifts) for _ in range(n + m)),
        tuple(integers(draw, q, MOST_D) for _ in range(n + m)),
        tuple(draw(shifts) for _ in range(n + m)),
        *(tuple(draw(st.integers(-5, 30)) for _ in range(k)) for k in (n, q, m)),
        ((-LARGEST_R, LARGEST_R),) * m,
    )


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(controllers(), st.data())
def test_a_step_is_within_its_error_bound_and_no_sum_leaves_32_bits(one, data):
    """Against the table that the certificate is of, in rationals; extremes are drawn often."""
    x = [
        data.draw(st.sampled_from([-LARGEST_X, LARGEST_X]) | st.integers(-LARGEST_X, LARGEST_X))
        for _ in one.x
    ]
    r = [
        data.draw(st.sampled_from([-LARGEST_R, LARGEST_R]) | st.integers(-LARGEST_R, LARGEST_R))
        for _ in one.r
    ]
    table, n = one.held(()).table, len(x)
    signals = [Fraction(v) / Fraction(2) ** e for v, e in zip(x + r, (*one.x, *one.r), strict=True)]
    x_next, u, saturated = step_of(one, x, r)
    for row, found, e in zip(table, x_next + u, (*one.x, *one.u), strict=True):
        exact = sum((Fraction(a) * v for a, v in zip(row.tolist(), signals, strict=True)), Fraction(0))
        if not saturated:
            assert abs(Fraction(found) / Fraction(2) ** e - exact) <= Fraction(5, 4) / Fraction(2) ** e
    high, low = [v >> SPLIT for v in x], [v % (1 << SPLIT) for v in x]
    for i, (a, h, d, g) in enumerate(zip(one.a, one.h, one.d, one.g, strict=True)):
        inner = sum(abs(p * q) for p, q in zip(a, low, strict=True)) + (1 << SPLIT - 1)
        outer = sum(abs(p * q) for p, q in zip(a, high, strict=True)) + (inner >> SPLIT) + 1 + (1 << h - 1)
        seen = sum(abs(p * q) for p, q in zip(d, r, strict=True)) + (1 << g - 1)
        whole = (abs(x[i]) if i < n else 0) + (outer >> h) + (seen >> g) + 2
        assert max(inner, outer, seen, whole) < 2**31


def test_integers_that_may_overflow_are_refused():
    fits = FixedController(((MOST_A,),) * 2, (1, 1), ((MOST_D,),) * 2, (30, 1), (0,), (0,), (0,), ((-1, 1),))
    broken = {"a": ((MOST_A + 1,),) * 2, "d": ((0,), (-MOST_D - 1,)), "h": (0, 1), "g": (1, 31)}
    for key, value in {**broken, "sides": ((-(2**15), 1),), "x": (61,)}.items():
        with pytest.raises(ProblemError, match="may overflow"):
            replace(fits, **{key: value})


SHAPES = [(0, 1, 1, 1), (1, 2, 1, 0), (2, 2, 1, 1), (3, 1, 2, 3), (4, 3, 2, 2), (0, 2, 2, 0), (1, 1, 1, 40)]


@needs_compiler
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_c_has_the_bits_of_the_reference(tmp_path, shape):
    """With the sanitizers: no overflow, no shift that C leaves open. The reader takes out of the C what was put in."""
    folder = folder_of(tmp_path, one_agent(*shape), "fixed")
    report = verify_folder(folder, steps=30, adversarial_steps=400, targets=["sanitizers"])
    assert report.ok, report.problems
    ran = [one for target in report.targets for one in target.fixed]
    assert ran
    assert all(one.bitwise and one.calls == 430 for one in ran)
    manifest = load_manifest(folder)
    (agent,) = manifest.agents
    texts = [(folder / "fixed" / f"c1_fixed.{end}").read_text() for end in "hc"]
    read = read_fixed("c1", *texts, [f"peer{j}" for j in range(40)])
    assert read == (controller_of(agent, manifest), tuple(range(shape[3])), 0.01)


CHANGES = [
    ("c", " && defined(__OPTIMIZE__)", ""),
    ("c", "14u), ", "13u), "),
    ("c", "0x3fffu", "0x1fffu"),
    ("c", "- 131072", "- 131071"),
    ("c", "-268435456, 268435456", "-268435456, 268435457"),
    ("c", "-32767, 32767", "-32768, 32767"),
    ("c", "bits - 1u", "bits - 2u"),
    ("c", "y[k] - (int32_t)state->held", "y[k] + (int32_t)state->held"),
    ("c", "* h0", "* l0"),
    ("c", "= 1u;\n    } else if", "= 0u;\n    } else if"),
    ("h", "EXPONENT (22)", "EXPONENT (0x22)"),
    ("h", "SATURATED = 16", "SATURATED = 0"),
    ("h", "CLIPPED = 8", "CLIPPED = 16"),
    ("c", ", &clipped);", ", &saturated);"),
    ("c", "status = ARM1_FIXED_SATURATED;", "status = ARM1_FIXED_CLIPPED;"),
    ("h", "int32_t x[", "int16_t x["),
    ("h", "neighbour 0 arm2", "neighbour 0 arm9"),
    ("h", "FIXED_PERIOD_S 0.005", "FIXED_PERIOD_S 5e999"),
    ("h", "FIXED_PERIOD_S 0.005", "FIXED_PERIOD_S 0.0.5"),
    ("h", "FIXED_PERIOD_US 5000u", "FIXED_PERIOD_US 500u"),
]


@pytest.mark.parametrize(("end", "old", "new"), CHANGES)
def test_c_of_another_form_is_not_read(tmp_path, end, old, new):
    folder = folder_of(tmp_path, of_arms(), "fixed")
    texts = {one: (folder / "fixed" / f"arm1_fixed.{one}").read_text() for one in "hc"}
    names = ["arm1", "arm2", "arm3"]
    assert read_fixed("arm1", texts["h"], texts["c"], names).sources == (1,)
    assert old in texts[end]
    texts[end] = texts[end].replace(old, new, 1)
    with pytest.raises((NotCertified, ProblemError)):
        read_fixed("arm1", texts["h"], texts["c"], names)


@pytest.mark.slow
def test_c_that_computes_otherwise_is_found(tmp_path):
    folder = folder_of(tmp_path, of_arms(), "fixed")
    path = folder / "fixed" / "arm1_fixed.c"
    text = path.read_text()
    assert "(bits - 1u)" in text
    path.write_text(text.replace("((uint32_t)1u << (bits - 1u))", "0u"))
    report = verify_folder(folder, steps=30, adversarial_steps=50, targets=["host"], run_changed=True)
    assert {one.agent for target in report.targets for one in target.fixed if not one.bitwise} == {"arm1"}
    assert not report.ok


def test_weights_other_than_one_and_a_design_without_integers_are_refused():
    agent = random_controller("c1", 1, 1, 1, neighbours=1)
    with pytest.raises(ProblemError, match="1 for each neighbour"):
        with_exports(emit(CodegenSpec((agent,), period=0.01, name="w", fixed=formats(1, 1, 1))), ["fixed"])
    with pytest.raises(ProblemError, match="claims nothing of integers"):
        with_exports(emit(arms()), ["fixed"])


@pytest.fixture(scope="module")
def shipped(root, tmp_path_factory):
    """The worked example with ranges of its outputs, generated once."""
    from lockstep.workflow.generate import generate

    document = json.loads((root / "generated" / "flexible_joint_arms" / "design.json").read_text())
    document["problem"]["agent"]["output_range"] = {"y1": [-3.2, 3.2], "y2": [-15.0, 15.0]}
    place = tmp_path_factory.mktemp("fixed")
    (place / "design.json").write_text(json.dumps(document))
    generate(place / "design.json", place / "folder", exports=["fixed"])
    return place / "folder"


def decided(document, folder=None):
    return certified(parse(document, "here", ProblemTables.from_document), folder).verdicts


@pytest.mark.slow
def test_the_arms_in_integers_are_certified_and_no_better_claim_is(shipped):
    document = json.loads((shipped / "design.json").read_text())
    claims = document["claims"]["fixed"]
    assert claims["rho"] <= 1.02 * document["claims"]["sampled"]["rho"]
    assert all(one.proved for one in decided(document, shipped).values())
    assert all(one.proved for one in decided(document).values()), "without the C too: the integers follow"
    for key, factor in (
        ("decay", 0.999), ("residual_per_message_error", 0.99), ("residual_from_rounding", 0.99), ("rho", 0.99),
        ("rho_rounding", 0.99), ("radius", 1.1),
    ):  # fmt: skip
        better = json.loads(json.dumps(document))
        better["claims"]["fixed"][key] *= factor
        name, last = list(decided(better, shipped).items())[-1]
        assert (name.startswith("fixed"), last.proved) == (True, False), key
    other = json.loads(json.dumps(document))
    other["claims"]["fixed"]["states"][0][0] -= 1
    assert list(decided(other, shipped).items())[-1][1].status == "refuted", "the C has other formats"
    formation = json.loads(json.dumps(document))
    formation["problem"]["network"]["offsets"] = [[0.0] * 4] * 3
    name, last = list(decided(formation).items())[-1]
    assert (name, last.proved) == ("fixed", False), "the C in integers takes no offset from what it reads"


@pytest.mark.slow
def test_one_integer_more_in_the_c_is_refused(shipped):
    path = shipped / "fixed" / "arm2_fixed.c"
    text = path.read_text()
    document = json.loads((shipped / "design.json").read_text())
    a = controller_of(load_manifest(shipped).agents[1], load_manifest(shipped)).a[0][0]
    assert f"({a} *" in text
    path.write_text(text.replace(f"({a} *", f"({a + 1} *"))
    try:
        name, last = list(decided(document, shipped).items())[-1]
        assert (name, last.status) == ("fixed", "refuted")
    finally:
        path.write_text(text)
    (shipped / "fixed" / "stdint.h").write_text("#define int32_t float\n")
    try:
        name, last = list(decided(document, shipped).items())[-1]
        assert (name, last.status) == ("fixed", "refuted") and "fixed/stdint.h" in last.reason
    finally:
        (shipped / "fixed" / "stdint.h").unlink()


@pytest.mark.slow
def test_runs_of_the_nonlinear_arms_keep_what_is_proved(shipped):
    """From the edge of the radius: nothing saturates, and what remains is below the residuals; readings are rounded."""
    manifest = load_manifest(shipped)
    claims = json.loads((shipped / "design.json").read_text())["claims"]["fixed"]
    ones = [controller_of(agent, manifest) for agent in manifest.agents]
    unit = 2.0 ** np.array(ones[0].r)

    # (38), its sine apart.
    arm = np.array([[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]], float)
    into = np.array([0, 21.6, 0, 0])

    def slope(_, flat, u):
        x = flat.reshape(3, 4)
        rest = np.zeros((3, 4))
        rest[:, 3] = -3.33 * np.sin(x[:, 2])
        return (x @ arm.T + u[:, None] * into + rest).ravel()

    for seed in range(3):
        random = np.random.default_rng(seed)
        x = random.normal(size=(3, 4))
        x -= x.mean(axis=0)
        x *= 0.99 * claims["radius"] / np.linalg.norm(x)
        states, met = [[0, 0] for _ in range(3)], False
        for _ in range(6000):
            y = np.rint(x[:, :2] * unit).astype(int)
            u = np.zeros(3)
            for i, one in enumerate(ones):
                states[i], counts, saturated = step_of(one, states[i], (y[i] - y[(i + 1) % 3]).tolist())
                u[i], met = counts[0] * 2.0 ** -one.u[0], met or saturated
            x = (
                solve_ivp(slope, (0, 0.005), x.ravel(), args=(u,), rtol=1e-7, atol=1e-9)
                .y[:, -1]
                .reshape(3, 4)
            )
        assert not met
        left = np.linalg.norm(x - x.mean(axis=0))
        bound = claims["residual_from_rounding"] + claims["residual_per_message_error"] * 0.5 / unit.min()
        assert left <= bound


@pytest.mark.slow
def test_a_step_takes_at_most_300_instructions_on_a_cortex_m0(shipped):
    report = verify_folder(shipped, steps=100, adversarial_steps=100, targets=["cortex-m0"])
    assert report.ok, report.problems
    counts = [one.instructions_per_step for target in report.targets for one in target.fixed]
    if not counts:
        pytest.skip("no emulator or no compiler for it")
    assert max(counts) <= 300
    soft = [target.instructions_per_step for target in report.targets if not target.skipped]
    assert min(soft) > 5 * max(counts)
