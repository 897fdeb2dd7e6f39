"""The text of the folder: deterministic, clean C, honest claims, bad specifications refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import TABLE_1, arms, shapes

from lockstep.check.errors import ProblemError
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.emission.kernel import kernel_function
from lockstep.codegen.manifest import Manifest, manifest_is_intact
from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant, Neighbour, Signal


def code(text):
    """C text without comments and without the guards, which name types and functions of the preprocessor."""
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    return "\n".join(line for line in bare.splitlines() if not line.startswith("#"))


def test_is_deterministic_and_holds_no_date_or_path():
    first, second = emit(arms()), emit(arms())
    assert first == second
    assert set(first) == {
        *(f"{place}/arm{i}.{end}" for i in (1, 2, 3) for place, end in (("include", "h"), ("src", "c"))),
        *(f"proof/arm{i}_eva.c" for i in (1, 2, 3)),
        *(
            "CMakeLists.txt",
            "README.md",
            "manifest.json",
            "include/arms.h",
            "src/arms.c",
            "cmake/arms-config.cmake",
        ),
    }
    for text in first.values():
        assert not re.search(r"/(home|tmp|work|usr)/|\b20[2-9]\d-\d\d-\d\d", text)


@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_float32_code_holds_no_double_no_heap_no_stdio(optimize):
    for path, text in emit(shapes([0, 1, 3], [1, 2], [1, 2], optimize=optimize)).items():
        if path.startswith(("src", "include")):
            bare = code(text)
            assert "double" not in bare
            assert not re.findall(r"\b\d+\.\d*(?:e[+-]?\d+)?(?![\d.ef])", bare), "a literal without suffix f"
            assert not re.search(r"malloc|stdio|\bmath\.h|memcpy", bare)
            assert not re.search(r"^(?!static const|const )\w[\w ]*\w+(\[\d+\])* = ", bare, re.M), (
                "a variable global"
            )
            assert not re.search(r"(float|uint32_t) \w+\[0\]", bare), "a zero-length array"


def test_float64_code_has_no_float():
    text = code(emit(arms(real="float64"))["src/arm1.c"])
    assert "double" in text and not re.search(r"\bfloat\b|\df\b", text)


def test_the_kernel_function_is_the_matrix_product():
    """CasADi's expression evaluated by CasADi against M z: what is printed is what was meant."""
    M = np.random.default_rng(1).normal(size=(5, 5))
    M[M > 1] = 0
    x, r = np.array([1.0, -2.0, 0.5]), np.array([3.0, 0.25])
    x_next, u = kernel_function(M, 3)(x, r)
    found = np.concatenate([x_next.full(), u.full()]).ravel()
    np.testing.assert_allclose(found, M @ np.concatenate([x, r]), rtol=1e-14)


@pytest.mark.parametrize("name", ["float32", "float64"])
def test_literals_read_back_to_the_same_bits(name):
    real = RealType(name)
    random = np.random.default_rng(0)
    size = real.bytes
    patterns = np.frombuffer(random.bytes(size * 2000), real.dtype)
    limits = np.finfo(real.dtype)
    for value in [
        *patterns[np.isfinite(patterns)],
        limits.max,
        limits.tiny,
        limits.smallest_subnormal,
        0.1,
        1.0,
    ]:
        text = real.literal(value)
        assert text.endswith("f") == (name == "float32")
        assert real.dtype.type(text.rstrip("f")) == value
        assert re.fullmatch(r"-?(\d+\.\d*|\d+(\.\d+)?e[+-]\d+)f?", text)


def test_the_manifest_holds_the_rounded_gains_exactly():
    manifest = Manifest.model_validate_json(emit(arms())["manifest.json"])
    assert manifest_is_intact(manifest)
    table = manifest.agents[0].table(manifest.real_type)
    assert table.dtype == np.float32
    A, B, C, D = (np.array(M) for M in TABLE_1[0])
    E = np.eye(2) - A * 0.005 / 2
    expected = np.block(
        [
            [np.linalg.solve(E, np.eye(2) + A * 0.005 / 2), np.linalg.solve(E, B) * 0.005],
            [C @ np.linalg.inv(E), D + C @ np.linalg.solve(E, B) * 0.0025],
        ]
    )
    np.testing.assert_allclose(table, expected, rtol=2**-24)  # half a unit in the last place
    changed = json.loads(emit(arms())["manifest.json"])
    changed["agents"][0]["sampled"]["D"]["decimal"][0][0] = -0.74
    with pytest.raises(ProblemError, match="disagree"):
        Manifest.model_validate_json(json.dumps(changed)).agents[0].table(RealType("float32"))


def test_claims_are_as_strong_as_the_certificate_and_no_stronger():
    header = "include/arm1.h"
    proved = emit(arms(certificate={"certified": True, "proof": "exact", "rho": 6.5}))[header]
    assert "certified (proof: exact)" in proved and "rho: 6.5\n" in proved and "NOT CERTIFIED" not in proved
    for weak in ({}, {"certified": False, "rho": 6.5}, {"certified": "yes"}, {"proof": "exact"}):
        text = emit(arms(certificate=weak))[header]
        assert "NOT CERTIFIED" in text and "certified (proof" not in text


def test_text_from_the_problem_file_cannot_leave_its_comment():
    evil = "*/ int owned; /* \\\n#error ??/ \u202e"
    agent = replace(
        arms().agents[0], outputs=(Signal(evil, evil), Signal("b")), neighbours=(Neighbour(evil),)
    )
    files = emit(CodegenSpec((agent,), 0.01, title=evil, design_hash=evil, certificate={evil: evil}))
    for path in ("include/arm1.h", "src/arm1.c"):
        assert "owned" not in code(files[path]) and "\u202e" not in files[path]
    assert all(line.startswith("#") for line in files["CMakeLists.txt"].splitlines() if "owned" in line)


ONE = np.ones((1, 1))


def controller(**change):
    return Controller(**{"name": "a", "A": -ONE, "B": ONE, "C": ONE, "D": ONE, **change})


def test_the_base_case_of_the_bad_ones_is_good():
    assert controller().order == 1
    assert emit(CodegenSpec((controller(),), 0.1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "1a"}, "no C identifier"),
        ({"name": "double"}, "no C identifier"),
        ({"name": "a;b"}, "no C identifier"),
        ({"A": np.ones((1, 2))}, "expected 1 x 1"),
        ({"B": np.ones((2, 1))}, "expected 1 x 1"),
        ({"A": ONE * np.nan}, "NaN or infinite"),
        ({"D": ONE * np.inf}, "NaN or infinite"),
        ({"D": np.ones((0, 1))}, "one or more"),
        ({"C": [["x"]]}, "not a matrix"),
        ({"outputs": (Signal("a"), Signal("b"))}, "2 signals"),
        ({"neighbours": (Neighbour("b"), Neighbour("b"))}, "twice"),
        ({"neighbours": tuple(Neighbour(f"b{k}") for k in range(65))}, "at most 64"),
    ],
)
def test_a_bad_controller_is_refused(change, message):
    with pytest.raises(ProblemError, match=message):
        controller(**change)


@pytest.mark.parametrize("weight", [0.0, -1.0, float("nan"), float("inf")])
def test_a_bad_weight_is_refused(weight):
    with pytest.raises(ProblemError, match="weight"):
        Neighbour("b", weight)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0}, "period"),
        ({"period": -0.1}, "the period is"),
        ({"period": float("nan")}, "period"),
        ({"period": float("inf")}, "period"),
        ({"real": "float16"}, "float32 or float64"),
        ({"optimize": "fun"}, "speed or size"),
        ({"discretization": "heun"}, "tustin or zoh or euler"),
        ({"name": "a b"}, "no C identifier"),
        ({"name": "stdint"}, "no name of a C header"),
        ({"agents": ()}, "no agent"),
        ({"agents": (controller(), controller(name="A"))}, "one name"),
        ({"plants": (LinearPlant(ONE, ONE, ONE, [1.0]),) * 2}, "2 plants"),
        ({"plants": (LinearPlant(ONE, ONE, np.ones((2, 1)), [1.0]),)}, "differ"),
        (
            {
                "agents": (
                    controller(neighbours=(Neighbour("b"),)),
                    controller(name="b", B=np.ones((1, 2)), D=np.ones((1, 2))),
                )
            },
            "outputs",
        ),
    ],
)
def test_a_bad_specification_is_refused(change, message):
    with pytest.raises(ProblemError, match=message):
        CodegenSpec(**{"agents": (controller(),), "period": 0.1, **change})


def test_a_gain_that_float32_cannot_hold_is_refused_and_float64_takes_it():
    big = (controller(D=1e39 * ONE),)
    with pytest.raises(ProblemError, match="float32"):
        emit(CodegenSpec(big, 0.1))
    assert emit(CodegenSpec(big, 0.1, real="float64"))


def test_the_caller_is_told_when_u_acts():
    """The certificate of a delayed loop is about u applied a period late, that of an undelayed one about u at once."""
    late, prompt = (emit(arms(delay=delay))["include/arm1.h"] for delay in (1, 0))
    assert "apply u one period later" in late
    assert "apply u at once" in prompt
    with pytest.raises(ProblemError, match="0 or 1"):
        arms(delay=2)
