"""What a problem asks for where it says nothing: controllers that an engineer would deploy, not the least rho alone.

The last third of rho costs large gains, controllers that are unstable by themselves, slow modes and noise. So where [design]
names neither `weights` nor `gain_limit` or its units (nor a rho to keep), and its method searches,

    order               0 where static gains come within `NEAR` of the floor, which is that of controllers of any order, or
                        within `CALM` if the inputs stay within their limits from the file's initial states or a decay is
                        asked for, or states lower their rho by less than a tenth; else the usual one; unless it is named
    gain_limit          6.4, or more where gains of size one, in natural units, are larger; first what takes about half of
                        [agent.limits] in the initial states of the file, where it names both: of static gains always,
                        of controllers with states where that is less for some entry, or in natural units
    gain_units          natural units, where gains of size one are further apart than 300, or a norm would leave C and D more
                        than ten times what actuators can, or let the first u of controllers with states be larger than limits
                        in natural units let it, or of static gains than five times the limits: `gain_limit` counts in them
    weights.input       1e-3, in natural units, unless it alone of `weights` is named
    disturbances        noise of 0.03 on the outputs, in natural units, unless `disturbances` are named
    stable_controllers  true, unless it is named
    search_decay        0.037, in natural units of time, at most 0.01 per period, and at most half of that of a mode that no
                        controller moves, unless it or `decay` is named; of gains within the actuators' limits half of the
                        decay that was proved, for their period

and, where the states' natural units are further apart than 300 (a resonator in SI units moves by 1e-6 m at 1 m/s), weights
and disturbances of the states in those units, too, so chosen that both are 1 for the state of the smallest unit.

Natural units are those in which the numbers of plant and R are nearest to one (`search.unit_scaling`); of gains within the
actuators' limits, with the unit of time in which actuators move the outputs as far as they are apart at first, with that of
u which moves a state by one in it, and with weights and disturbances of the states in them always, so that an agent in m is
given the controllers of one in mm: that of a train is otherwise the quarter of an hour in which it rolls to a stop. Where
no gains are found for them, or none with a rho near the floor, or no floor is proved, the limit is raised, twice, of gains
within the actuators' limits first to 1.5 times these (and to 5 times, where a decay is asked for that half of the actuators
may not reach: of static gains, too, before controllers have states), and then stability and decay are not asked for. What
was taken is written into the problem: a design file names all of it, and nothing is filled in when it is read.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.lmi.shapes import Vector
from lockstep.model.checks.actuators import outputs_apart, time_to_move
from lockstep.model.checks.lost_modes import slowest_lost_mode
from lockstep.model.graphs.graph import Graph
from lockstep.model.loop_transformation.natural_units import natural_units
from lockstep.model.network import Network
from lockstep.model.problem import Problem
from lockstep.model.problem.tables.schema import DisturbancesTable, GainUnitsTable, WeightsTable

GAIN_LIMIT, HIGH_GAIN_LIMIT = 6.4, 50.0
"""Where gains of size one have a norm below `SIZE_ONE`; else as many parts of it as here, times that norm."""

KEPT = 0.5
"""Of the decay of gains within the actuators' limits: what a design for the period keeps to. And of what can be had."""

HALF = 0.5
"""Of what the actuators can, for what r becomes on the way: the initial states say what it is at first."""

SIZED = ((1.0, "half of"), (3.0, "1.5 times"), (10.0, "5 times"))
"""Times gains within half of the actuators' limits: the last where a decay is asked for alone, which may take all of them."""

VERY_HIGH = 10.0
"""Times the high limit, which is a norm that holds A_C in 1/s beside gains from y to u: what fast plants in SI units need."""

SIZE_ONE = 17.0
"""About the norm of order 2 gains of size one of the flexible-joint arms, with which the limits were chosen."""

INPUT, NOISE, DECAY = 1e-3, 0.03, 0.037
"""In natural units: of u in what rho weighs, of the noise beside a disturbance, of the decay that the search keeps to."""

DECAY_PER_PERIOD = 0.01
"""The most of the decay that the search keeps to, times period and delay: a slope that a small part of the domain has may
make the natural unit of time far shorter than the period. No example or field that takes the defaults is above 0.0015."""

FAR_APART = 300.0
"""Between natural units of states: beyond, |x|^2 is of one state, and the others are free. Most problems have below 50. And
between gains of size one: beyond, the norm of [A B; C D] is that of the largest entry."""

OF_U = 10.0
"""Times half of what actuators can, to which a norm may let C and D grow that holds A_C in 1/s, or static gains in units far
apart: beyond, each entry has its own size. Below, a norm of static gains serves better (four lifting jacks in mm and bar)."""

TRIED = {"given_up": "before that", "not_taken": "after that, and not taken"}
"""What is said in a design of the other specifications that were tried, by key, and when that was."""

KEYS = ("gain_limit", "gain_units", "stable_controllers", "search_decay")

FAR, MUCH = 4.0, 0.5
"""A rho above so many floors is far: gains within the next limit are taken if theirs is less than this part of it."""

NEAR, STATES = 1.25, 0.9
"""A rho of static gains below so many floors is near: states, of which the floor knows as well, could lower it by a fifth at
most. Of other static gains controllers with states are taken where they lower rho to this part. Static gains within the
actuators' limits are near within `VERY_FAR` where controllers with states would not be sized for these."""

CALM = 2.0
"""Floors within which static gains are near that keep the inputs within their limits in the file's run, or have the decay
that is asked for: states would lower rho at the price of inputs that are clipped (four pools of a canal: none from 1.38 times
the start, then from 0.49), or of a search that takes far longer."""

VERY_FAR = 10.0
"""A rho above so many floors, without gain errors, which the floor does not know: as many starts are drawn anew."""


class Specification(NamedTuple):
    """A problem that names what it asks for.

    sized: by what, where that is said;  enough: whether gains that are found are taken up to `VERY_FAR` from the floor:
    actuators are the reason;  not_asked: what is given up;  static: of static gains that are tried before others, how many
    floors their rho may be for them to be taken at once.
    """

    problem: Problem
    sized: str = ""
    enough: bool = False
    not_asked: str = ""
    static: float = 0.0

    def with_limit(self, came: str) -> str:
        """Say how far a search for it came."""
        order = "order 0, " * bool(self.static)
        return f"{order}gain_limit {self.problem.design.gain_limit:g}{self.sized}: {came}"


def specifications(problem: Problem, network: Network, claim: Claim) -> Iterator[Specification]:
    """Yield a problem with its defaults written down: the first to be tried, then with less asked; or the problem itself.

    Args:
        problem: as it was read.
        network, claim: of this problem.
    """
    if not problem.has_defaults:
        yield Specification(problem)
        return
    said, limits = _asked(problem, _of_two(problem, network), claim)
    within, most = _within_limits(problem, network, claim, limits[0]), 0.0
    may_be_static = problem.design.objective == "rho" and not claim.delta[:, :3].any()
    if problem.design.order is None and problem.order and may_be_static:
        for number, spec in enumerate(specifications(_with(problem, {"order": 0}), network, claim)):
            if number and not (problem.design.decay and spec.sized):
                break
            yield spec._replace(static=VERY_FAR if spec.enough and within is None else NEAR)
    if within is not None:
        for more, part in SIZED if problem.design.decay else SIZED[:2]:
            size = float(f"{more * within['gain_limit']:.2g}")
            asked = _with(problem, within | {"gain_limit": size})
            yield Specification(asked, f", sized for {part} [agent.limits]", enough=True)
            most = 0.0 if "gain_units" in within else asked.design.gain_limit
    for limit in limits:
        if "gain_units" not in limit and limit["gain_limit"] <= most:
            continue  # it was within the one before
        yield Specification(_with(problem, said | limit), enough=within is not None)
    if said.pop("stable_controllers", None) or "search_decay" in said:
        said.pop("search_decay", None)
        yield Specification(
            _with(problem, said | limits[1]), not_asked="not asked for: stable controllers and a decay"
        )


def _within_limits(
    problem: Problem, network: Network, claim: Claim, most: dict[str, Any]
) -> dict[str, Any] | None:
    """Return defaults for gains that take about half of what the actuators can in the file's initial states.

    The unit of time is that in which the actuators move the outputs as far as they are apart, d are the proportions that
    gains of size one have then, and |u| <= |D| d'|r|, r = L (x - o) C': of a vehicle's position and speed, from rest, the
    position counts. Where they never move them so far, it is the natural one. How fast actuators can bring agents together is
    theirs: no decay is searched for. The rest of a controller has the proportions of gains of size one, too. None where the
    file names no such states or no limits, or controllers have states and the gain limit `most`, in the units of the
    file, is no more than theirs, entry by entry.
    """
    outputs, tau = outputs_apart(problem), time_to_move(problem)
    if outputs is None or not (heard := np.abs(problem.graph().laplacian @ outputs)).any():
        return None
    _, S_u, S_y, time, _ = natural_units(network.plant, claim.alpha, claim.R, rounded=False, tau=tau)
    u = HALF * problem.limits / float((heard @ S_y).max())
    sizes = _sizes(problem.order, np.where(np.isinf(u), S_u, u), S_y, time)
    of_u = np.linalg.norm(sizes, 2) / np.linalg.norm(sizes[problem.order :], 2)
    own = problem, np.where(np.isinf(u), S_u, u), S_y, time, 1.0
    limit = _limit(*own, apart=FAR_APART if of_u <= OF_U else 0.0)
    if "gain_units" not in limit:
        limit = _limit(problem, u[[u.argmin()]], S_y, time, 1.0)
    ours, theirs = (np.asarray(_with(problem, one).gain_limit) for one in (limit, most))
    if problem.order and "gain_units" not in most and (ours >= theirs).all():
        return None
    norm = np.linalg.norm(sizes, 2) if problem.order else limit["gain_limit"]
    first = norm * np.linalg.norm(heard, axis=1).max()
    if first > (np.sqrt(sizes.size) if problem.order else OF_U) * HALF * problem.limits.min():
        limit = _limit(*own, apart=0.0)
    said = _asked(problem, _of_two(problem, network), claim, tau, within=True)[0]
    said.pop("search_decay", None)
    return said | limit


def _sizes(order: int, S_u: Vector, S_y: Vector, time: float) -> Float[np.ndarray, "k l"]:
    """Return gains of size one in natural units, [A B; C D], in those of the file."""
    return np.outer(np.append(np.full(order, 1 / time), S_u), np.append(np.ones(order), S_y))


def _limit(
    problem: Problem,
    S_u: Vector,
    S_y: Vector,
    time: float,
    part: float,
    least: float = 0.0,
    apart: float = FAR_APART,
) -> dict[str, Any]:
    """Return a limit of the gains: parts of a norm of numbers in the units of the file, or in natural ones if far apart.

    Beside a D of 1e5 N/m a norm holds neither A nor B nor C, and B C is the gain at high frequencies.

    Args:
        problem, S_u, S_y, time: natural units.
        part: of the norm of gains of size one.
        least: of the norm of numbers in the units of the file.
        apart: from where on gains of size one are far apart.
    """
    sizes = _sizes(problem.order, S_u, S_y, time)
    if sizes.max() <= apart * sizes.min():
        return {"gain_limit": max(least, _short(part * float(np.linalg.norm(sizes, 2))))}
    outputs = [name for name, _ in problem.file.agent.outputs]
    units = GainUnitsTable(
        time=_short(time),
        inputs=dict(zip(problem.file.agent.inputs, map(_short, S_u), strict=True)),
        outputs=dict(zip(outputs, map(_short, 1 / S_y), strict=True)),
    )
    return {"gain_limit": _short(part * float(np.sqrt(sizes.size))), "gain_units": units}


def keeping(problem: Problem, decay: float) -> Problem:
    """Return the problem with half of the decay that its gains are proved to have as that to keep to, if none is named."""
    named = problem.design.model_fields_set & {"decay", "search_decay"}
    return problem if named else _with(problem, {"search_decay": float(f"{KEPT * decay:.2g}")})


def defaults_of(problem: Problem) -> dict[str, Any]:
    """Return what defaults wrote into a problem, as plain JSON types, for people."""
    table = problem.design.model_dump(mode="json", exclude_none=True)
    return {key: table[key] for key in (*KEYS, "weights", "disturbances") if key in table}


def _of_two(problem: Problem, network: Network) -> Network:
    """Return two agents with the middle eigenvalue where one controller is for all: units do not grow with N."""
    if problem.design.method != "modal":
        return network
    if network.spectrum is not None:
        middle = float(np.sqrt(np.prod(network.spectrum)))
    else:
        middle = float(np.trace(network.graph.laplacian)) / (network.N - 1)
    pair = Graph(middle / 2 * np.array([[0.0, 1.0], [1.0, 0.0]]))
    return replace(network, graph=pair, B=(network.B[0], network.B[0]), spectrum=None)


def _asked(
    problem: Problem, network: Network, claim: Claim, tau: float | None = None, *, within: bool = False
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the defaults of what the file does not name, in natural units or those whose time is tau, and gain limits.

    States are weighed in natural units where these are far apart, or gains are to be `within` the actuators' limits.
    """
    X, S_u, S_y, time, _ = natural_units(network.plant, claim.alpha, claim.R, rounded=False, tau=tau)
    apart = within or X.max() > FAR_APART * X.min()
    scales = X.max() / X if apart else np.ones_like(X)
    R = 1 / scales**2 if apart else np.diag(claim.R)
    cost = float(np.exp(np.log(R / X**2).mean()))
    disturbance = float(np.exp(np.log(time * X * scales).mean()))
    states = dict(zip(problem.file.agent.states, map(_short, scales), strict=True)) if apart else 1.0
    noise = [_short(NOISE * disturbance / scale) for scale in S_y]
    names = [name for name, _ in problem.file.agent.outputs]
    late = problem.controller.period * (1 + problem.controller.delay)
    lost = slowest_lost_mode(network, claim.alpha, claim.entries)
    most = min(DECAY_PER_PERIOD / late, max(KEPT * lost.decay, 0.0) if lost else np.inf)
    said: dict[str, Any] = {
        "weights": WeightsTable(
            state=tuple(map(_short, R)) if apart else 1.0,
            controller=1.0,
            input=tuple(_short(INPUT * cost / u**2) for u in S_u),
        ),
        "disturbances": DisturbancesTable(states=states, outputs=dict(zip(names, noise, strict=True))),
        "stable_controllers": True,
        "search_decay": float(f"{min(DECAY / time, most):.2g}"),
    }
    table = problem.design
    for key in ("disturbances", "stable_controllers", "decay", "search_decay"):
        if key in table.model_fields_set:
            said.pop("search_decay" if key == "decay" else key, None)
    if table.weights.input is not None:
        said["weights"] = said["weights"].model_copy(update={"input": table.weights.input})
    limits = (GAIN_LIMIT, HIGH_GAIN_LIMIT, VERY_HIGH * HIGH_GAIN_LIMIT)
    return said, [_limit(problem, S_u, S_y, time, one / SIZE_ONE, one) for one in limits]


def _short(value: float) -> float:
    """Return a value to one significant decimal."""
    return float(f"{value:.1g}")


def _with(problem: Problem, said: dict[str, Any]) -> Problem:
    """Return the problem with keys of [design] written down."""
    table = problem.design.model_copy(update=said)
    return replace(problem, file=problem.file.model_copy(update={"design": table}))
