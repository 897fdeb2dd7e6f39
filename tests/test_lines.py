"""The count of code lines that CI holds to its limits."""

import runpy

import pytest


@pytest.fixture(scope="module")
def lines(root) -> dict:
    return runpy.run_path(str(root / ".ci" / "lines.py"))


MODULE = '''"""A module."""

import a  # and why

LIMIT = 3
"""What it is.

In three lines."""

# A comment.
TEXT = """
two lines more"""


def f(x):
    """Do nothing."""
    return g(
        x
    )
'''


@pytest.mark.parametrize(
    ("source", "count"),
    [(MODULE, 1 + 1 + 2 + 1 + 3), ("", 0), ("# x\n\n", 0), ('f("""one\ntwo""")\n', 2), ("x = 'text'\n", 1)],
)
def test_blanks_comments_and_docstrings_do_not_count(lines, source, count):
    assert lines["code_lines"](source) == count


def test_the_limits_hold(lines, capsys):
    assert lines["main"]() == 0
    printed = capsys.readouterr().out
    assert all(name in printed and str(limit) in printed for name, (_, _, limit) in lines["LIMITS"].items())


@pytest.mark.slow
def test_more_than_a_limit_fails_and_so_does_a_folder_that_is_gone(lines, monkeypatch, capsys):
    folders, without, _ = lines["LIMITS"]["cli"]
    monkeypatch.setitem(lines["LIMITS"], "cli", (folders, without, 10))
    assert lines["main"]() == 1
    assert "at most 10" in capsys.readouterr().out
    monkeypatch.setitem(lines["LIMITS"], "cli", (["nowhere"], without, 10))
    assert lines["main"]() == 1
