"""What a file asks for against what it claims, and what lies beside the C that is read: seams that an audit went through."""

import json
import math
import shutil
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import fmpq

from lockstep.check.bound.box import Box
from lockstep.check.bound.decide import decide_offset
from lockstep.check.certify import certified, certify
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.initial_set import Domain, largest_level
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import exact, exactly
from lockstep.check.sampled.controller import spectral_bound
from lockstep.check.system.agent import ExactAgent
from lockstep.check.system.graph import Digraph
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "generated" / "flexible_joint_arms"
ARMS = json.loads((FOLDER / "design.json").read_text())
CARTS = json.loads((ROOT / "docs" / "gallery" / "designs" / "carts.json").read_text())


def verdicts(content: dict[str, Any]) -> dict[str, Verdict]:
    return dict(certified(parse(content, "design", ProblemTables.from_document)).verdicts)


def changed(content: dict[str, Any], change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    made = deepcopy(content)
    change(made)
    return made


@pytest.mark.parametrize("path", ["include/stdint.h", "src/more.c", "src/arm1.h.gch", "include/zz_arm1.h"])
def test_code_that_nothing_reads_is_no_part_of_a_proof(path: str, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    assert certify(folder).verdicts["code"].proved
    (folder / path).write_text("#define float double\n")
    found = certify(folder).verdicts["code"]
    assert not found.proved and path in found.reason


TABLE = "arm_controllers"
CODE = "static void run(void) { arm1_init(0); }"


@pytest.mark.parametrize(
    ("end", "more"),
    [
        ("h", CODE),
        ("h", '#include "evil.h"'),
        ("h", "#include <math.h>"),
        ("h", "#define float double"),
        ("h", "#define ARM_CONTROLLERS_BODY {"),
        ("c", CODE),
        ("c", "int run(a) int a; { return a; }"),
        ("c", '__asm__("nop");'),
        ("c", 'asm("nop");'),
        ("c", "static __attribute__((constructor)) void run(void);"),
        ("c", "int run(void) <% return 1; %>"),
        ("c", "/* open"),
    ],
)
@pytest.mark.parametrize("name", [TABLE, "of_mine_controllers"])
def test_the_table_of_the_controllers_is_no_code_whatever_it_is_called(end, more, name, tmp_path) -> None:
    """Its header is found before others, its source is compiled with the rest."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    for path in (f"include/{TABLE}.h", f"src/{TABLE}.c"):
        text = (folder / path).read_text().replace(TABLE, name).replace(TABLE.upper(), name.upper())
        (folder / path).unlink()
        (folder / path.replace(TABLE, name)).write_text(text)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "name": name}))
    assert certify(folder).verdicts["code"].proved, "declarations and a list"
    path = folder / {"h": f"include/{name}.h", "c": f"src/{name}.c"}[end]
    path.write_text(path.read_text() + more.replace("ARM_CONTROLLERS", name.upper()) + "\n")
    found = certify(folder).verdicts["code"]
    assert not found.proved and path.name in found.reason


def test_a_rho_that_overflows_is_a_claim_that_does_not_hold() -> None:
    found = verdicts(changed(ARMS, lambda content: content["claims"]["sampled"].update(rho=1e-300)))
    assert found["sampled"].proved
    assert found["sampled_rho"].status == "undecided"


def test_copies_that_the_manifest_names_do_not_stand_for_the_files_beside_them(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    for path in [*folder.glob("include/arm?.h"), *folder.glob("src/arm?.c")]:
        text = path.read_text().replace("arm", "zz_arm").replace("ARM", "ZZ_ARM")
        path.with_name(f"zz_{path.name}").write_text(text)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "prefix": "zz_"}))
    assert not certify(folder).verdicts["code"].proved


def test_messages_that_are_asked_for_are_asked_of_controllers_that_are_not_certified() -> None:
    def silent(content: dict[str, Any]) -> None:
        content["problem"]["network"]["messages"] = {"loss": 0.99, "burst": 1000}
        sampled = content["claims"]["sampled"]
        content["claims"]["sampled"] = dict.fromkeys(sampled) | {"certified": False, "proof": "none"}

    found = verdicts(changed(ARMS, silent))
    assert not found["messages"].proved and "asks for more than is claimed" in found["messages"].reason


def test_alpha_is_asked_for_in_the_units_of_the_equation() -> None:
    """phi' = 8 phi has the slope 26.64 where phi has 3.33: what is proved of it leaves no room for a steeper phi."""

    def scaled(content: dict[str, Any], asked: float) -> None:
        content["problem"]["design"]["alpha"] = asked
        content["claims"] |= {"alpha": 8 * 3.33, "scales": {"G": [1 / 8], "H": [1.0]}, "floor": None}
        proof = content["proofs"]["certificate"]
        proof["m"] = [one / 64 for one in proof["m"]]

    found = verdicts(changed(ARMS, lambda content: scaled(content, 26.64)))
    assert found["certificate"].proved
    assert not found["asked"].proved and "scales" in found["asked"].reason


def test_the_leader_stays_where_the_problem_says() -> None:
    inner = CARTS["claims"]["initial_set"]["inner"][0]
    assert inner[0] < -0.2 and inner[1] > 0.2

    def within(content: dict[str, Any], side: float) -> None:
        content["problem"]["network"]["leader"] = {"theta": [-side, side]}

    assert verdicts(changed(CARTS, lambda content: within(content, 0.2)))["initial_set"].proved
    found = verdicts(changed(CARTS, lambda content: within(content, 0.45)))["initial_set"]
    assert found.status == "refuted" and "[network] leader" in found.reason


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["problem"]["design"].update(method="foo"),
        lambda content: content["problem"]["controller"].update(delay=False),
        lambda content: content["problem"]["network"].update(parameters=[0, {}, {}]),
        lambda content: content["problem"]["network"].update(
            agents=7, laplacian=[[1, -1, 0], [0, 1, -1], [-1, 0, 1]], edges=None, topology=None
        ),
    ],
)
def test_a_value_of_another_kind_is_refused(change: Callable[[dict[str, Any]], Any]) -> None:
    with pytest.raises(ProblemError):
        verdicts(changed(ARMS, change))


@pytest.mark.parametrize("count", [2, 4])
def test_there_is_a_table_of_given_gains_for_each_agent(count: int) -> None:
    given = [*ARMS["gains"], ARMS["gains"][0]][:count]

    def give(content: dict[str, Any]) -> None:
        content["problem"]["design"] |= {"method": "given", "gains": given}

    found = verdicts(changed(ARMS, give))["asked"]
    assert not found.proved and f"{count} tables" in found.reason


@pytest.mark.parametrize(
    ("text", "defined"),
    [
        ("sin(t)", True), ("sqrt(t)", True), ("log(1 + t)", True), ("1/(2 + sin(t))", True), ("sign(t - 3)", True),
        ("if_else(t > 1, 1/t, 0)", True),
        ("tan(t)", False), ("log(t - 3)", False), ("sqrt(2 - t)", False), ("1/(t - 5)", False), ("1/sin(t)", False),
    ],
)  # fmt: skip
def test_terms_in_t_alone_have_a_value(text: str, defined: bool) -> None:
    """Of x' = f(t) with f nowhere defined everything holds: nothing solves it."""
    agent = ExactAgent.from_texts(
        "a", states=["x"], inputs=["u"], outputs={"y": "x"}, dynamics={"x": f"u - x + sin(x)/9 + {text}"}
    )
    assert decide_offset(agent.offset_needs).proved is defined

    def driven(content: dict[str, Any]) -> None:
        content["problem"]["agent"]["dynamics"]["omega_m"] += f" + {text}"

    found = verdicts(changed(ARMS, driven))
    assert found.get("offset", Verdict("proved", "")).proved is defined
    assert ("certificate" in found) is defined


def test_a_level_is_decided_with_h_as_it_is() -> None:
    """x/3 - y/7 is no row of doubles: a level of the rounded one may lie above that of the row itself."""
    a = ExactAgent.from_texts(
        "a", states=["x", "y"], inputs=["u"], outputs={"o": "x"},
        dynamics={"x": "y", "y": "u - x - y + 0.001*sin(x/3 - y/7)"},
    )  # fmt: skip
    network = ExactNetwork(Plant(a.A, (a.B, a.B), a.C, a.G, a.H), Digraph.from_edges(2, [[2, 1]]))
    c = Certificate(1.0, np.diag([2.0, 3.0]), np.zeros(1))
    level, _, _ = largest_level(network, c, Domain(a.H, Box((-1.0,), (1.0,))), Box((-0.5,), (0.5,)))
    # (1/2)^2 / (1/9/2 + 1/49/3)
    assert level == Fraction(1, 4) / (Fraction(1, 18) + Fraction(1, 147))


@pytest.mark.parametrize("size", [1e-170, 5e-324, 3e-160, 0.1, 1e150])
def test_a_spectral_bound_is_none_below_the_norm(size: float) -> None:
    """Of [a, a] the norm is sqrt(2) a: its square underflows in doubles, and the bound must not."""
    found = spectral_bound(exactly(np.array([[size, size]])))
    assert exact(found) ** 2 >= 2 * exact(size) ** 2
    assert size < 1e-300 or exact(found) ** 2 <= 2 * exact(size) ** 2 * (1 + fmpq(1, 10**15))


def test_a_negative_multiplier_is_named_and_no_vector_with_it() -> None:
    content = parse(ARMS, "design", ProblemTables.from_document)
    certificate = content.proofs.certificate
    assert isinstance(certificate, Certificate)
    wrong = replace(certificate, m=-np.ones(len(certificate.m)))
    found = certified(replace(content, proofs=replace(content.proofs, certificate=wrong))).verdicts[
        "certificate"
    ]
    assert "sign of a multiplier" in found.reason and "vector" not in found.reason
    assert math.isfinite(found.figures["value"])


@pytest.mark.parametrize(
    ("line", "passes"),
    [
        ("#define ARM_CONTROLLERS_MORE 1", True), ("#define float double", False), ("#include_next <a>", False),
        ("/* */ #define float double", False), ("%:define float double", False), ("#def\\\nine float double", False),
        ("??=define float double", False), ('_Pragma("GCC poison x")', False), ("int f(void) __attribute__((cold));", False),
    ],
)  # fmt: skip
def test_the_table_of_the_controllers_defines_names_of_its_own(
    line: str, passes: bool, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(FOLDER, tmp_path / "c"))
    header = folder / "include" / "arm_controllers.h"
    header.write_text(header.read_text() + line + "\n")
    assert certify(folder).verdicts["code"].proved is passes


@pytest.mark.parametrize("size", [1e-200, 1e200, 1e300])
def test_a_norm_whose_square_is_no_double_has_a_bound(size: float) -> None:
    found = spectral_bound(exactly(np.array([[3.0 * size, 4.0 * size]])))
    assert 5 * size <= found <= 5 * size * (1 + 1e-15)
