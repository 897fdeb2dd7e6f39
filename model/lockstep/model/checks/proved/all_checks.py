"""All checks that prove, in order, with one work limit: a number of boxes for each."""

from collections.abc import Callable

from lockstep.model.checks.proved import equilibria as zeros
from lockstep.model.checks.proved.dimensions import check_units
from lockstep.model.checks.proved.dissipation import contraction, incremental_gain, passivity
from lockstep.model.checks.proved.finding import CheckFinding
from lockstep.model.checks.proved.geometry.lie import Point
from lockstep.model.checks.proved.geometry.rank import controllability_rank, observability_rank
from lockstep.model.checks.proved.geometry.relative_degree import relative_degree, zero_dynamics
from lockstep.model.checks.proved.interval_algebra.definite import BOXES
from lockstep.model.checks.proved.one_sided_lipschitz import one_sided_lipschitz, quadratic_inner_boundedness
from lockstep.model.checks.proved.sector import sectors
from lockstep.model.checks.proved.stiffness import stiffness
from lockstep.model.checks.proved.vector_field import Field
from lockstep.model.problem import Problem


def prove(
    problem: Problem, *, boxes: int = BOXES, progress: Callable[[str], None] = lambda _: None
) -> tuple[CheckFinding, ...]:
    """Run every check of this folder on the agent of a problem.

    Args:
        problem: its agent is taken with u = 0 on [agent.domain].
        boxes: the work limit of each question, a count.
        progress: called with the name of what comes next.

    Raises:
        ProblemError: units that contradict each other.

    >>> problem = Problem.parse('''
    ... [agent]
    ... states = ["x"]
    ... inputs = ["u"]
    ... dynamics = { x = "u - x - x**3" }
    ... outputs = { y = "x" }
    ... domain = { x = [-1.0, 1.0] }
    ... [network]
    ... agents = 2
    ... topology = "path"
    ... ''')
    >>> [finding.status for finding in prove(problem)[:2]]
    ['proved', 'proved']
    """
    progress("units")
    units = check_units(problem.file.agent)
    agent = problem.agent()
    field = Field.of(agent)
    progress("equilibria")
    equilibria, found = zeros.equilibria(field, boxes=boxes)
    points = Point.all(field, found)
    point = points[0]
    findings = [equilibria]
    progress("sectors")
    findings += sectors(agent, boxes=boxes)
    for check in (one_sided_lipschitz, quadratic_inner_boundedness, passivity, incremental_gain, contraction):
        progress(check.__name__.replace("_", " "))
        findings.append(check(field, boxes=boxes))
    progress("Lie derivatives")
    degree = relative_degree(field, boxes=boxes)
    findings += [degree, zero_dynamics(field, point, degree)]
    for rank in (controllability_rank, observability_rank):
        tried = [rank(field, points[0])]
        tried += [rank(field, p) for p in points[1:] if tried[0].status == "undecided"]
        findings.append(next((finding for finding in tried if finding.status != "undecided"), tried[0]))
    findings.append(units)
    progress("stiffness")
    return (*findings, stiffness(field, point, boxes=boxes))
