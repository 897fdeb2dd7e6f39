"""Symbolic checks of a problem, each with a figure and the reason why it matters."""

from lockstep.model.checks.check import check_problem
from lockstep.model.checks.report import CheckReport, CheckRow

__all__ = ["CheckReport", "CheckRow", "check_problem"]
