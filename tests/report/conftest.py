"""The committed example as a folder that is about to be written, with what `check` and `verify` would say of it."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from lockstep.lmi.document import parse
from lockstep.model.checks import check_problem
from lockstep.report.drawings import draw
from lockstep.report.page import html
from lockstep.report.poles import spectrum_of
from lockstep.report.report import make_report
from lockstep.report.report_data import gather
from lockstep.verification.verify import TargetResult, VerifyReport

sys.path.insert(0, str(Path(__file__).parent))

SKIPPED = "they do not work with this compiler (linking failed: /usr/bin/ld: cannot find /usr/lib/x.a\nmore)"


@pytest.fixture(scope="session")
def files(root) -> dict[str, str]:
    folder = root / "generated" / "flexible_joint_arms"
    return {
        path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()
    }


@pytest.fixture(scope="session")
def stored(files):
    """The design, with a shorter run: what is drawn of it takes as long as it does."""
    content = json.loads(files["design.json"])
    content["problem"]["simulation"]["horizon"] = 1.0
    return parse(content, "design.json")


@pytest.fixture(scope="session")
def checks(stored):
    return check_problem(stored.problem, every=True)


@pytest.fixture(scope="session")
def verified() -> VerifyReport:
    targets = (
        TargetResult("host gcc -O2", True, 100, 100, 0.0, text_bytes=722, ram_bytes=32),
        TargetResult("host clang sanitizers", None, skipped=SKIPPED),
        TargetResult("Cortex-M4F gcc -O2, emulated", True, 100, 100, 0.0, 84, 640, 32, 24, core="cortex-m4f"),
    )
    return VerifyReport(True, targets, (), ())


@pytest.fixture(scope="session")
def facts(files, stored, checks, verified):
    return gather(files, stored, checks, verified)


@pytest.fixture(scope="session")
def report(files, stored, checks, verified):
    return make_report(files, stored, checks, verified)


@pytest.fixture(scope="session")
def spectrum(facts):
    return spectrum_of(facts.network, facts.stored.gains, facts.stored.claim)


@pytest.fixture(scope="session")
def page_of(facts, spectrum):
    """The page of the facts with something changed; the figures are those of the facts as they are."""
    drawings = draw(facts, spectrum)
    return lambda **changes: html(replace(facts, **changes), spectrum, drawings, [])


@pytest.fixture
def failing(verified) -> VerifyReport:
    """The same with one target whose bits differ."""
    first, *rest = verified.targets
    return VerifyReport(False, (replace(first, bitwise=False), *rest), (), ("host gcc -O2: 3 calls differ",))
