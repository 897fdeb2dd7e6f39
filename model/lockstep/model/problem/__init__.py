"""Problem files: the schema, its messages, and the checked problem."""

from lockstep.model.problem.problem import Problem, load_problem, parse_problem

__all__ = ["Problem", "load_problem", "parse_problem"]
