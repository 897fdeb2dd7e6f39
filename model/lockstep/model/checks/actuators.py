"""How fast actuators are beside what agents are apart at first: a unit of time for gains, bounds for a period and a run."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lockstep.model.checks import plausibility
from lockstep.model.checks.report import CheckRow
from lockstep.model.loop_transformation.natural_units import step_response
from lockstep.model.problem import Problem

LONGEST, ROUNDED = 50, 1e-9
"""Factors of root two of a period, to 2^25 of them; and of a move, so that one that is reached exactly counts."""


def outputs_apart(problem: Problem) -> Float[np.ndarray, "N q"] | None:
    """Return the outputs of the initial states of the file, less the offsets; None without such, or without limits."""
    initial = problem.simulation.initial
    if isinstance(initial, str) or problem.spectrum or not problem.has_limits:
        return None
    away = np.asarray(initial) - (0.0 if problem.offsets is None else problem.offsets)
    return np.asarray(away @ problem.agent().lure.C.T)


def time_to_move(problem: Problem) -> float | None:
    """Return the time in s, within a factor of root two, in which inputs at their limits move each output so far, or None.

    The linear part, from rest: sum over the inputs l that have a limit of |C_k (integral of e^(A s) ds from 0 to t) B_l|
    limit_l. It is the period at least.
    """
    outputs, lure = outputs_apart(problem), problem.agent().lure
    if outputs is None:
        return None
    limits = np.where(np.isfinite(problem.limits), problem.limits, 0.0)
    with np.errstate(all="ignore"):
        for t in problem.controller.period * 2.0 ** (np.arange(LONGEST) / 2):
            moved = np.abs(lure.C @ step_response(t, lure.A, lure.B)) @ limits
            if not np.isfinite(moved).all():
                break
            if (moved >= np.ptp(outputs, axis=0) * (1 - ROUNDED)).all():
                return float(t)
    return None


def period(problem: Problem) -> Iterator[CheckRow]:
    """Yield the row of the period, for the modes of an agent; a note where inputs at their limits move the outputs within one
    period as far as they are apart at first, in its place if the modes have nothing against it."""
    outputs, T = outputs_apart(problem), problem.controller.period
    row = plausibility.period(problem)
    short = outputs is None or not np.ptp(outputs, axis=0).any() or time_to_move(problem) != T
    if short or row.verdict != "ok":
        yield row
    if not short:
        moved = "move the outputs as far as [simulation] has them apart, or farther"
        figure = f"in {T:g} s inputs at [agent.limits] {moved}: is it in s, limits and start in their units?"
        yield CheckRow("period", "note", figure, "a controller that sees so little of a motion overshoots it")


def limits(problem: Problem, *, controllable: bool) -> Iterator[CheckRow]:
    """Yield rows of limits that are too small, or too large, for the run, the domain and the unit they are in."""
    yield from slow(problem, controllable=controllable)
    yield from strong(problem)


def strong(problem: Problem) -> Iterator[CheckRow]:
    """Yield a row where inputs at their limits take an agent, its linear part, across its whole domain within a period."""
    agent, T = problem.agent(), problem.controller.period
    most = np.where(np.isfinite(problem.limits), problem.limits, 0.0)
    with np.errstate(all="ignore"):
        moved = np.abs(step_response(T, agent.lure.A, agent.lure.B)) @ most
        across = moved / np.ptp(agent.box, axis=1)
    for j in [int(np.nanargmax(across))] if (across > 1).any() else ():
        figure = f"in {T:g} s inputs at [agent.limits] move {agent.states[j]} by {moved[j]:.3g}, and [agent.domain] is"
        figure += f" {np.ptp(agent.box[j]):.3g} wide: are they in the unit of u?"
        yield CheckRow("limits", "note", figure, "of agents outside of their domain nothing is proved")


def slow(problem: Problem, *, controllable: bool) -> Iterator[CheckRow]:
    """Yield a row where inputs at their limits do not move the outputs within the run as far as they are apart at first.

    Not where an input has no limit, or a mode is not controllable, which is told by itself.
    """
    horizon = problem.simulation.horizon
    all_limited = outputs_apart(problem) is not None and np.isfinite(problem.limits).all()
    time = time_to_move(problem) if all_limited and controllable else horizon
    if time is None or time > horizon:
        how = "never move" if time is None else f"need {time:.3g} s, of a run of {horizon:g} s, to move"
        figure = f"inputs held at [agent.limits] {how} the outputs as far as [simulation] initial has them apart: are these,"
        figure += " and the parameters, in their units?"
        reason = "from there agents come together as slowly as by themselves, or as actuators let them"
        yield CheckRow("limits", "note", figure, reason)
