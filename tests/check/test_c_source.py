"""Reading the numbers back from the C: all that is printed is read, and nothing else is taken for ours."""

from fractions import Fraction

import numpy as np
import pytest

from lockstep.check.c_source.reader import read_controller
from lockstep.check.c_source.tokens import CText, nearest
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.manifest import Manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour

NAMES = ["a1", "a2", "a3"]


def spec(optimize="speed", real="float32", weights=(1.0, 1.0)):
    rng = np.random.default_rng(4)
    agents = []
    for i, name in enumerate(NAMES):
        others = [other for other in NAMES if other != name][: 1 + (i == 0)]
        C = np.array([[1.0, 0.0]])
        A, B = rng.standard_normal((2, 2)) - 2 * np.eye(2), rng.standard_normal((2, 2))
        heard = tuple(Neighbour(o, w) for o, w in zip(others, weights, strict=False))
        agents.append(Controller(name, A, B, C, np.array([[-1.0, 2.0]]), heard))
    return CodegenSpec(tuple(agents), 0.01, "euler", real, optimize)


def read(files, name="a1", **changed):
    header, source = (
        changed.get(k, files[p]) for k, p in (("h", f"include/{name}.h"), ("c", f"src/{name}.c"))
    )
    return read_controller(name, header, source, NAMES)


@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.3, 1.7)])
def test_what_is_printed_is_read(optimize, real, weights):
    files = emit(spec(optimize, real, weights))
    manifest = Manifest.model_validate_json(files["manifest.json"])
    for agent in manifest.agents:
        one = read(files, agent.name)
        np.testing.assert_array_equal(one.controller.table, agent.table(manifest.real_type).astype(float))
        np.testing.assert_array_equal(one.controller.weights, agent.weights(manifest.real_type).astype(float))
        assert [NAMES[j] for j in one.controller.sources] == [s.source for s in agent.neighbours]
        assert one.period == np.dtype(real).type(0.01)
        assert one.real == real


def test_unrolled_statements_round_no_more_than_full_rows():
    """1 z, -1 z and 2 z are exact, zeros are left out: the counts are those of what is written."""
    speed, size = read(emit(spec())).controller, read(emit(spec("size"))).controller
    assert (speed.roundings <= size.roundings).all()
    # u = x0 - r0 + 2 r1: two sums, no product that rounds; x1 is not there.
    assert speed.table[2].tolist() == [1.0, 0.0, -1.0, 2.0]
    assert speed.roundings[2].tolist() == [2, 0, 2, 1]
    assert size.roundings[2].tolist() == [4, 4, 3, 2]


def test_another_coefficient_is_read_as_such():
    files = emit(spec())
    entry = read(files).controller.table[0, 1]
    text = next(line for line in files["src/a1.c"].splitlines() if "* x1" in line)
    literal = text.split("= ")[1].split(" *")[0]
    changed = read(files, c=files["src/a1.c"].replace(literal, "0.25f")).controller
    assert entry != 0.25 == changed.table[0, 1]
    assert (changed.table != read(files).controller.table).sum() == 1


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x_next[0] = ", "x_next[0] = 2.0f * "),
        ("r[k] = r[k] + ", "r[k] = r[k] - "),
        ("const float difference = y[k] - source[k];", "const float difference = source[k] - y[k];"),
        ("state->x[0] = x_next[0];", "state->x[0] = x_next[1];"),
        ("const float x0 = x[0];", "const float x0 = x[7];"),
        ("const float x0 = x[0];", "const float x0 = x[0];\n    x_next[0] = x0;"),
        ("#include <float.h>", "#include <float.h>\n#define x1 x0"),
        ("/* (x, r)", "/* \\\n (x, r)"),
        ("const float t1 = ", "const float t1 = 1.0 * "),
        # An operator that is missing, doubled or another one.
        ("= t1 + t3;", "= t1  t3;"),
        ("= t1 + t3;", "= t1 t3;"),
        ("= t1 + t3;", "= t1 +- t3;"),
        ("= t1 + t3;", "= t1 ++ t3;"),
        ("= t1 + t3;", "= t1 * t3;"),
        ("= t1 + t3;", "= t1 + t1;"),
        ("const float t1 = ", "const float i386 = 0.5f * x0;\n    const float t1 = "),
        ("const float t1 = ", "const double t1 = "),
        ("check = check + (values[k] - values[k]);", "check = check + (values[k] - values[k]), k++;"),
        ("#include <float.h>", "#include < float.h>"),
        ("#include <float.h>", "// \n#include <float.h>"),
        ("const float x0 = x[0];", "const float x0 = '/*' + x[0]; /*'*/"),
        ("    return status;", "    return status;;"),
        # A self-check that asks for less.
        ("    differs |= (a1_step_relative(&state, bad, u) == A1_NOT_FINITE) ? 0u : 1u;\n", ""),
        ("bits[k] = (uint8_t)~first;", "bits[k] = (uint8_t)first;"),
        ("    differs |= (state.age[0] == 1u) ? 0u : 1u;\n", ""),
        ("bad, 1u, u) == A1_OK", "bad, 0u, u) == A1_OK"),
        # A row that is not finite.
        ("neighbour_y, usable, r);", "neighbour_y, received, r);"),
        ("neighbour_y, usable, status);", "neighbour_y, received, status);"),
        ("            usable |= bit;", "            usable |= received;"),
    ],
)
def test_c_of_another_form_is_refused(old, new):
    files = emit(spec())
    assert old in files["src/a1.c"], "the test is about what is printed"
    with pytest.raises(NotCertified):
        read(files, c=files["src/a1.c"].replace(old, new, 1))


SMUGGLED = """#error "Floating-point/*
#endif
#define OK EVIL
#if 0
*/shortcuts"""
"""Within a string there is no comment: compilers skip the line and take what follows for code."""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('#error "Floating-point shortcuts', SMUGGLED),
        ('#error "Floating-point shortcuts', '#error "Floating-point/* */shortcuts'),
        ("#endif\n", "#endif\r"),
        ("#endif\n", "#endif\f"),
        ("#endif\n", "#endif\x85"),
        ("#endif\n", "#endif\u2028"),
    ],
)
def test_what_hides_code_from_either_reader_is_refused(old, new):
    files = emit(spec())
    assert old in files["src/a1.c"]
    with pytest.raises(NotCertified):
        read(files, c=files["src/a1.c"].replace(old, new, 1))


@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("literal", ["010", "0x1p3", "10", "0x8", "1e5000"])
def test_a_literal_that_is_no_decimal_fraction_is_refused(optimize, literal):
    """`010 * x0` is 8 x0 in C."""
    files = emit(spec(optimize, "float64"))
    lines = files["src/a1.c"].splitlines()
    mark = "* x0;" if optimize == "speed" else "    {"
    line = next(line for line in lines if mark in line)
    old = line.split("= ")[1].split(" *")[0] if optimize == "speed" else line.strip(" {},").split(", ")[0]
    assert read(files, c=files["src/a1.c"].replace(old, "0.010", 1)).controller.table[0, 0] == 0.01
    with pytest.raises(NotCertified):
        read(files, c=files["src/a1.c"].replace(old, literal, 1))


def test_an_octal_index_is_refused():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((12, 12)) - 5 * np.eye(12)
    agents = tuple(Controller(name, A, np.ones((12, 1)), np.ones((1, 12)), np.ones((1, 1))) for name in NAMES)
    files = emit(CodegenSpec(agents, 0.01, "euler"))
    source = files["src/a1.c"]
    assert read(files).controller.order == 12
    with pytest.raises(NotCertified):
        read(files, c=source.replace("= x[10];", "= x[010];"))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("#define A1_PERIOD_S 0.01f", "#define A1_PERIOD_S -0.01f"),
        ("#define A1_ORDER 2", "#define A1_ORDER 3"),
        ("#define A1_ORDER 2u", "#define A1_ORDER 2"),
        ("#define A1_PERIOD_US 10000u", "#define A1_PERIOD_US 1000u"),
        ("#define A1_PERIOD_US 10000u\n", ""),
        ("a2, weight", "stranger, weight"),
        ("weight a = 1.0", "weight a = 2.0"),
        ("#include <stdint.h>", "#include <stdint.h>\n#define float double"),
    ],
)
def test_a_header_of_another_form_is_refused(old, new):
    files = emit(spec())
    assert old in files["include/a1.h"]
    with pytest.raises(NotCertified):
        read(files, h=files["include/a1.h"].replace(old, new, 1))


@pytest.mark.slow
@pytest.mark.parametrize(("optimize", "weights"), [("speed", (1.0, 1.0)), ("size", (0.3, 1.7))])
@pytest.mark.parametrize(("kind", "path"), [("h", "include/a1.h"), ("c", "src/a1.c")])
def test_every_token_counts(optimize, weights, kind, path):
    """Without any one of them, or with one twice, the C is refused or has other numbers (a sign, or x0 of x0 - r0)."""
    files = emit(spec(optimize, "float32", weights))
    tokens = CText(path, files[path]).tokens[:-1]
    comment, table = files[path].split("*/")[0] + "*/", read(files).controller.table

    def refused(these):
        text = "\n".join(these)
        try:
            return (read(files, **{kind: f"{comment}\n{text}\n"}).controller.table != table).any()
        except NotCertified:
            return True

    assert not refused(tokens), "layout and comments do not count"
    for k, token in enumerate(tokens):
        if token == "-" and "given" in tokens[:k] and "volatile" not in tokens[:k]:
            continue  # a sign in the self-check's numbers, which are not judged
        assert k % 4 or refused([*tokens[:k], token, *tokens[k:]]), (k, token)
        assert refused([*tokens[:k], *tokens[k + 1 :]]), (k, token)


@pytest.mark.parametrize(
    "text", ["", "#", '"', "/*", "#ifndef A1_H", "\ud800", "1" * 5000, "{" * 5000, "const float t0 = " * 2000]
)
def test_text_of_any_kind_is_refused_in_words(text):
    files = emit(spec())
    header, source = files["include/a1.h"], files["src/a1.c"]
    for changed in ({"h": text}, {"c": text}, {"h": header + text + "x"}, {"c": source + text + "x"}):
        with pytest.raises(NotCertified):
            read(files, **changed)
    for macro in ("ORDER 2", "OUTPUTS 2", "INPUTS 1", "NEIGHBOURS 2"):
        for number in ("9" * 5000, "999", "65", "0", "02", "-1", "2 + 0"):
            with pytest.raises(NotCertified):
                read(files, h=header.replace(f"A1_{macro}", f"A1_{macro[:-1]}{number} "))
    first = source.index("{", source.index("a1_kernel")) + 1
    with pytest.raises(NotCertified):
        read(files, c=source[:first] + text + source[first:] + "x")


def test_coefficients_that_no_double_holds_are_refused():
    files = emit(spec(real="float64"))
    line = "const double x0 = x[0];"
    doubled = f"{line} const double t0 = x0 + x0; const double t999 = 1.7e308 * t0;"
    with pytest.raises(NotCertified, match=r"1\.7e308"):
        read(files, c=files["src/a1.c"].replace(line, doubled))


@pytest.mark.parametrize(("comment", "refused"), [("/* " * 100_000, True), ("/*/", True), ("/**/", False)])
def test_a_comment_that_does_not_end_is_refused_at_once(comment, refused):
    """Each start of one was searched for its end: of 300 kB, for minutes."""
    files = emit(spec())
    header = files["include/a1.h"] + comment
    if refused:
        with pytest.raises(NotCertified, match="does not end"):
            read(files, h=header)
    else:
        read(files, h=header)


def test_a_name_that_is_no_identifier_is_refused():
    files = emit(spec())
    with pytest.raises(ProblemError, match="identifier"):
        read_controller("../a1", files["include/a1.h"], files["src/a1.c"], NAMES)


def test_literals_are_rounded_once():
    # Just above the middle of 1 and 1 + 2^-23, by less than half a unit of float64: rounding twice would give 1.
    tie = Fraction(1) + Fraction(1, 2**24)
    above = tie + Fraction(1, 2**60)
    text = f"{int(above * 10**70)}"
    assert nearest(f"{text[0]}.{text[1:]}f", "float32") == 1 + 2.0**-23
    assert nearest("1.0f", "float32") == 1.0
    exact = f"{int(tie * 10**24)}"
    assert nearest(f"{exact[0]}.{exact[1:]}f", "float32") == 1.0, "ties to even"
