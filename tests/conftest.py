"""Shared by all tests: where the repository's files are, `--update` for files that are kept in the repository, and chance.

Property tests draw the same examples on every machine and in every run. `--hypothesis-profile=random` draws others; a failure
then prints how to repeat it (`@reproduce_failure`), as does `--hypothesis-seed`.
"""

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(Path(__file__).parent))  # these tests are no package

# What is slow on one machine is not wrong.
ANYWHERE = settings(deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("fixed", ANYWHERE, derandomize=True)
settings.register_profile("random", ANYWHERE, derandomize=False, print_blob=True)
settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="accept what is generated as the files to keep")


@pytest.fixture(scope="session", autouse=True)
def own_cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep designs that the command makes in a folder of these tests, not in the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session", autouse=True)
def no_signs_of_life() -> Iterator[None]:
    """Leave out the lines that a command writes after some seconds: what it says is not to depend on a clock."""
    from lockstep.workflow.waiting.progress_lines import ProgressLines

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ProgressLines.__init__.__kwdefaults__, "patience", math.inf)
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def examples(root: Path) -> Path:
    return root / "examples"


@pytest.fixture
def update(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update"))
