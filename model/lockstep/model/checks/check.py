"""All symbolic checks of a problem, in the order in which they are worth reading."""

from collections.abc import Callable, Iterator

from lockstep.model.assembly import Report, bound_of, network_of
from lockstep.model.bound_search import BOXES
from lockstep.model.checks import actuators, linear_part, lost_modes, nonlinearity, plausibility
from lockstep.model.checks.proved.all_checks import prove
from lockstep.model.checks.proved.dimensions import check_units
from lockstep.model.checks.proved.interval_algebra.definite import BOXES as PROVING_BOXES
from lockstep.model.checks.report import CheckReport, CheckRow
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
            input is bad, and the message says what to change; or units that contradict the formulas.
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
    units = tuple(_units(problem))  # first: a slip in one may lose a mode, too
    problem.validate()
    agent, graph, agents_B = problem.agent(), problem.graph(), problem.agents_B()
    bound = bound_of(agent, boxes=boxes, alpha=problem.design.alpha, progress=progress)
    findings = prove(problem, boxes=min(boxes, PROVING_BOXES), progress=proving) if every else ()
    everywhere = nonlinearity.holds_everywhere(agent, bound)
    controllable, inputs = linear_part.controllable(agent, agents_B)
    observable, outputs = linear_part.observable(agent)
    zeros, right = linear_part.zeros(agent, agents_B)
    network = network_of(problem, bound)
    rows = (
        nonlinearity.bound(agent, bound),
        *([nonlinearity.entries(agent, bound)] if bound.entries else []),
        nonlinearity.where_it_holds(agent, graph, everywhere=everywhere),
        nonlinearity.centring(agent),
        nonlinearity.origin(agent),
        nonlinearity.exact_numbers(agent),
        linear_part.spanning_tree(graph, listed=bool(problem.file.network.edges)),
        linear_part.row_sums(graph),
        controllable,
        observable,
        *lost_modes.check(problem, network, bound),
        zeros,
        linear_part.directions(agent),
        *plausibility.unstable_alone(problem),
        *actuators.period(problem),
        *actuators.limits(problem, controllable=inputs.controllable),
        *units,
        *plausibility.initial(problem),
    )
    return CheckReport(
        rows=rows,
        bound=bound,
        plant=network.plant,
        roots=graph.roots,
        controllable=inputs.controllable,
        stabilisable=inputs.stabilisable,
        observable=outputs.observable,
        detectable=outputs.detectable,
        everywhere=everywhere,
        zeros=right,
        findings=findings,
    )


def seldom_meant(problem: Problem) -> Iterator[CheckRow]:
    """Yield what `check_problem` says of signs, period, limits, units and start, and of a pair that is nearly lost."""
    agent = problem.agent()
    pairs = linear_part.controllable(agent, problem.agents_B()), linear_part.observable(agent)
    yield from plausibility.unstable_alone(problem)
    yield linear_part.spanning_tree(problem.graph(), listed=bool(problem.file.network.edges))
    yield from actuators.period(problem)
    yield from actuators.limits(problem, controllable=pairs[0][1].controllable)
    for row, pair in pairs:
        yield from [row] * (pair.relative_margin > pair.tolerance)
    yield from plausibility.units(problem)
    yield from plausibility.initial(problem)


def _units(problem: Problem) -> Iterator[CheckRow]:
    """Yield rows where what the units of the file make of time is seldom meant, or parameters without one hide a slip.

    Raises:
        ProblemError: units that contradict the formulas.
    """
    yield from plausibility.units(problem, refuse=True)
    agent = problem.file.agent
    if clock := (check_units(agent).value or {}).get("unit_of_time"):
        reason = "the first equation whose units are all given says what time is counted in"
        figure = f"they fit with time, and the period, in units of {clock:g} s alone: a slip in a unit?"
        yield CheckRow("units", "note", figure, reason)
    missing = [name for name in agent.parameters if name not in agent.units]
    if missing and not agent.units.keys().isdisjoint((*agent.states, *agent.inputs)):
        shown = ", ".join(missing[:8]) + (", ..." if len(missing) > 8 else "")
        with_them = 'with a unit for each ("1" for a pure number) every term of the equations is checked'
        figure = f"{len(missing)} {'have' if len(missing) > 1 else 'has'} none ({shown}): {with_them}"
        reason = "a number that may stand for any unit hides a slip of a factor, m^2 for mm^2 or Pa for bar"
        yield CheckRow("units of parameters", "note", figure, reason)
