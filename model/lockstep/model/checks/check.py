"""All symbolic checks of a problem, in the order in which they are worth reading."""

import time

from lockstep.model.assembly import BUDGET, Report, bound_of, network_of
from lockstep.model.checks import nonlinearity, structure
from lockstep.model.checks.report import CheckReport
from lockstep.model.problem import Problem


def check_problem(problem: Problem, *, budget: float = BUDGET, progress: Report | None = None) -> CheckReport:
    """Check what the certificate will rest on, and report it row by row.

    Args:
        problem: the problem.
        budget: seconds for the proof of the bound.
        progress: called with the state of that proof now and then.

    Raises:
        ProblemError: no spanning tree, a pair that is not controllable or observable, or no finite bound: the
            input is bad, and the message says what to change.
        BoundNotProved: [design] alpha is given and does not bound the nonlinearity (with a witness), or could
            not be proved within the budget.

    >>> from lockstep.model.problem import parse_problem
    >>> report = check_problem(parse_problem('''
    ... [agent]
    ... states = ["x"]
    ... inputs = ["u"]
    ... dynamics = { x = "u - 2*sin(x)" }
    ... outputs = { y = "x" }
    ... [network]
    ... agents = 3
    ... topology = "cycle"
    ... '''))
    >>> report.ok, report.document()["bound"]["alpha"], report.roots
    (True, 2.0, (1, 2, 3))
    """
    problem.validate()
    agent, graph, agents_B = problem.agent(), problem.graph(), problem.agents_B()
    start = time.monotonic()
    bound = bound_of(agent, budget=budget, alpha=problem.design.alpha, progress=progress)
    left = max(0.0, budget - (time.monotonic() - start))
    everywhere = nonlinearity.holds_everywhere(agent, bound, seconds=min(left, 2.0))
    controllable, is_controllable = structure.controllable(agent, agents_B)
    observable, is_observable = structure.observable(agent)
    zeros, right = structure.zeros(agent, agents_B)
    rows = (
        nonlinearity.bound(agent, bound),
        nonlinearity.reach(agent, graph, everywhere=everywhere),
        nonlinearity.centring(agent),
        nonlinearity.origin(agent),
        nonlinearity.numbers(agent),
        structure.spanning_tree(graph),
        structure.row_sums(graph),
        controllable,
        observable,
        zeros,
    )
    return CheckReport(
        rows=rows,
        bound=bound,
        plant=network_of(problem, bound).plant,
        roots=graph.roots,
        controllable=is_controllable,
        observable=is_observable,
        everywhere=everywhere,
        zeros=right,
    )
