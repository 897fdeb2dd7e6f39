"""What CI runs, piece by piece: `nox -s tests`."""

import nox

nox.options.sessions = ["lint", "tests"]
DESIGNS = ("tests/lmi", "tests/cli", "tests/test_generated.py")


@nox.session
def tests(session: nox.Session) -> None:
    """Run the fast tests."""
    session.install("-e", ".[dev]")
    session.run("pytest", "-q", *session.posargs)


@nox.session
def long(session: nox.Session) -> None:
    """Run the tests marked slow."""
    session.install("-e", ".[dev]")
    session.run("pytest", "-q", "-m", "slow and not by_hand", "--dist", "worksteal", "tests")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the site, warnings as errors."""
    session.install("-e", ".[docs]")
    session.run("sphinx-build", "-W", "--keep-going", "docs", "build/site")


@nox.session
def lint(session: nox.Session) -> None:
    """Check style, types, import contracts and the limits on lines."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")
    session.run("python", ".ci/imports.py")
    session.run("python", ".ci/lines.py")


@nox.session
@nox.parametrize("kernel", ["Haswell", "SkylakeX", "Zen", "Nehalem"])
def kernels(session: nox.Session, kernel: str) -> None:
    """Run the tests of designs with another processor's linear algebra kernel."""
    session.install("-e", ".[dev]")
    session.run("pytest", "-q", *DESIGNS, env={"OPENBLAS_CORETYPE": kernel})


@nox.session
def lowest(session: nox.Session) -> None:
    """Run all fast tests with the lowest versions that are allowed."""
    extras = ("campaign", "docs", "fmu", "notebook", "toolchain", "test")
    wanted = session.run("python", ".ci/lowest.py", *extras, silent=True)
    session.install(*wanted.split(), "-e", ".[dev]")
    session.run("pytest", "-q")


@nox.session
def benchmarks(session: nox.Session) -> None:
    """Measure the ratios of the benchmarks, and say what moved by more than its noise: by hand, on an idle machine."""
    session.install("-e", ".[dev]")
    session.run("python", "benchmarks/moved.py", *session.posargs)
