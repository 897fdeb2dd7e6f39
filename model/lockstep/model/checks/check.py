"""All symbolic checks of a problem, in the order in which they are worth reading."""

from collections.abc import Callable

from lockstep.model.assembly import Report, bound_of, network_of
from lockstep.model.bound_search import BOXES
from lockstep.model.checks import actuators, linear_part, nonlinearity, plausibility
from lockstep.model.checks.proved.all_checks import prove
from lockstep.model.checks.proved.interval_algebra.definite import BOXES as PROVING_BOXES
from lockstep.model.checks.report import CheckReport
from lockstep.model.problem import Problem


def check_problem(
    problem: Problem,
    *,
    boxes: int = BOXES,
    progress: Report | None = None,
    every: bool = False,
    proving: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Check what the certificate will rest on, and report it row by row.

    Args:
        problem: the problem.
        boxes: the budget of the search that proves the bound, a count.
        progress: called with the state of that proof now and then.
        every: also run the checks that prove (`lockstep.model.checks.proved`), each question with at most so many boxes.
        proving: called with the name of the next of these.

    Raises:
        ProblemError: no spanning tree, a pair that is not stabilisable or detectable, or no finite bound: the
            input is bad, and the message says what to change; with `every` also units that contradict each other.
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
    bound = bound_of(agent, boxes=boxes, alpha=problem.design.alpha, progress=progress)
    findings = prove(problem, boxes=min(boxes, PROVING_BOXES), progress=proving) if every else ()
    everywhere = nonlinearity.holds_everywhere(agent, bound)
    controllable, inputs = linear_part.controllable(agent, agents_B)
    observable, outputs = linear_part.observable(agent)
    zeros, right = linear_part.zeros(agent, agents_B)
    rows = (
        nonlinearity.bound(agent, bound),
        *([nonlinearity.entries(agent, bound)] if bound.entries else []),
        nonlinearity.reach(agent, graph, everywhere=everywhere),
        nonlinearity.centring(agent),
        nonlinearity.origin(agent),
        nonlinearity.numbers(agent),
        linear_part.spanning_tree(graph),
        linear_part.row_sums(graph),
        controllable,
        observable,
        zeros,
        *plausibility.alone(problem),
        plausibility.period(problem),
        *actuators.period(problem),
        *plausibility.units(problem),
        *plausibility.initial(problem),
    )
    return CheckReport(
        rows=rows,
        bound=bound,
        plant=network_of(problem, bound).plant,
        roots=graph.roots,
        controllable=inputs.controllable,
        stabilisable=inputs.stabilisable,
        observable=outputs.observable,
        detectable=outputs.detectable,
        everywhere=everywhere,
        zeros=right,
        findings=findings,
    )
