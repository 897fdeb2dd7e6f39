"""Design for the period: a design file whose gains are made for the sampled controllers that ship.

The gains of the file stay continuous ones, and what ships stays what they are sampled to by Tustin's rule: the discrete
controllers are what is designed, and these gains are their image under the inverse rule. So nothing else changes: the
continuous certificate is that of the new gains, and `certify` and `generate` read the file as any other.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous_claims import decide_stable_controllers
from lockstep.check.errors import Infeasible, NotCertified
from lockstep.check.system.loop import Gains
from lockstep.codegen.limit_claims import with_limits
from lockstep.codegen.message_redesign import for_messages, lacks_messages
from lockstep.codegen.other_gains import obstacle, with_figures, with_gains
from lockstep.codegen.sampled_design import (
    FOR_PERIOD,
    NOT_FOR_PERIOD,
    HeldVerdict,
    PairWeights,
    pair_weights,
    prove_design,
    sampled_network,
    with_sampled,
)
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.sampled.synthesis.gains_for_period import StartingGains
from lockstep.lmi.search.stopping import NEVER, Deadline, Stop

NEAR = 1.05
"""A sampled loop whose rho is above the continuous one by more is designed for its period."""

SPOILT = 2.0
"""Of a rho that is by so much larger than would be enough it is said why no gains were designed for the period."""

SECTORS, SETTLED = 3, 0.99
"""With slopes of their own the sector of the sampled loop is made of the continuous certificate's weights, which new gains
change: so often gains are designed with the sector of those before, while rho falls to less than this part of it, which is
that of the continuous design at first."""

KEPT_OF_DECAY = 0.5
"""What a design for the period holds, in continuous time, of the decay that an objective asked for."""


class Effort(NamedTuple):
    """What a design for the period is given beside the design file.

    tell: called with the part that is done;  others: gains to start from besides those of the file;  deadline: after which
    the best gains so far are taken.
    """

    tell: Callable[[float], None]
    others: Sequence[StartingGains] = ()
    deadline: Deadline = NEVER


def as_shipped(
    stored: Stored,
    tell: Callable[[str, float], None] = lambda _what, _part: None,
    others: Sequence[StartingGains] = (),
    stop: Stop | None = None,
    time_limit: float | None = None,
) -> Stored:
    """Return a design file with what is proved of its controllers sampled and rounded.

    Where `[network.messages]` asks for more than is proved, gains are designed for it (`message_redesign`). Else, where the
    period is too long for the continuous design, or costs more than 5 % of the least rho known, or the problem asks for it,
    gains are designed for the sampled loop. Where that fails, the continuous design is kept and the remarks say why.

    Args:
        stored: the design file.
        tell: called with what is being done and the part of it that is done.
        others: gains to start a design for the period from, besides those of the file.
        stop: leaves a design for the period out, and the figures say so.
        time_limit: seconds to search for gains for the period; then the best so far, which depend on the machine.

    Raises:
        NotCertified: the file says that the design is certified, and the checker refuses it; or controllers that are to be
            stable by themselves are not as they ship.
    """
    with one_thread():
        deadline = Deadline.after(time_limit)
        effort = Effort(lambda part: tell("designing for the period", part), others, deadline)
        stop = stop or Stop()
        shipped = _stable_as_rounded(_shipped(stored, tell, effort, stop))
        late = deadline.over and {FOR_PERIOD, NOT_FOR_PERIOD} & shipped.info["sampled"].keys()
        if np.isfinite(stored.problem.limits).any():
            tell("proving the limits of the inputs", 0.0)
        limited = with_limits(shipped, stored)
        cut = ({"time_limit": time_limit} if late else {}) | ({"interrupted": True} if stop.asked else {})
        return replace(limited, info={**limited.info, "figures": {**limited.info["figures"], **cut}})


def _stable_as_rounded(stored: Stored) -> Stored:
    """Return a design that claims of its controllers, sampled and rounded, no stability that they lost: A of 1 - 6e-10.

    Raises:
        NotCertified: it is asked for.
    """
    table, n_C = stored.problem.controller, stored.gains.order
    if not stored.claims.controllers_stable:
        return stored
    held = sampled_controllers(stored, table.period)
    verdict = decide_stable_controllers([one.table[:n_C, :n_C] for one in held], sampled=True)
    if verdict.proved:
        return stored
    if stored.problem.design.stable_controllers:
        said = f"{verdict.reason} as it ships, rounded to {table.real} every {table.period:g} s"
        raise NotCertified(f"{said}: raise [design] gain_limit or [controller] period, or take float64")
    return replace(stored, claims=replace(stored.claims, controllers_stable=False))


def _shipped(stored: Stored, tell: Callable[[str, float], None], effort: Effort, stop: Stop) -> Stored:
    """Return what ships, without what is proved of limits."""
    verdict = certify(stored)
    if stored.claims.certified and not verdict.certified:
        raise NotCertified(f"the checker refuses the design: {verdict.reason}", **verdict.figures)
    tell("proving the sampled controllers", 0.0)
    held = prove_design(stored)
    kept = with_sampled(stored, held)
    if kept.claims.sampled.certified and lacks_messages(kept):
        return for_messages(kept, tell, stop)
    asked = stored.problem.design.for_period or not kept.claims.sampled.certified
    enough = NEAR * min([stored.claims.rho or np.inf, *(one.rho for one in effort.others)])
    faster = stored.problem.design.objective == "decay"
    if not asked and (faster or (kept.claims.sampled.rho or np.inf) <= enough):
        return kept
    found = obstacle(stored)
    if found is None:
        try:
            made = stop.optional(lambda: designed_for_period(kept, effort), otherwise=None)
            if made is not None and not lacks_messages(made):
                return made
            if made is not None and not kept.claims.sampled.certified:
                return for_messages(made, tell, stop)
            found = "interrupted" if made is None else "the gains found do not carry the messages"
        except Infeasible as error:
            found = f"the time limit was over; until then: {error}" if effort.deadline.over else str(error)
    said = asked or effort.deadline.over or (kept.claims.sampled.rho or np.inf) > SPOILT * enough
    return with_sampled(stored, held, **{NOT_FOR_PERIOD: found}) if said else kept


def designed_for_period(stored: Stored, effort: Effort) -> Stored:
    """Return the design file with gains made for its period, both certificates proved anew.

    The figures of the gains that are replaced are kept among the remarks, under `replaced`.

    Args:
        stored: the design file, with what is proved of its sampled controllers.
        effort: how, and for how long, gains are searched for.

    Raises:
        Infeasible: no gains survive the period, or none with both certificates, or none that are better.
    """
    before, turns = stored.claims.sampled.rho or np.inf, SECTORS if sampled_network(stored).sector else 0

    def half(part: float, turn: int) -> None:
        """Tell half of what is left of the bar: how many turns there will be is not known."""
        effort.tell(1 - 0.5**turn * (1 - part / 2) if turns else part)

    least = before
    made, held, rho = _proved_for_period(stored, effort._replace(tell=partial(half, turn=0)), least)
    for turn in range(1, 1 + turns):
        if rho >= SETTLED * least or effort.deadline.over:
            break
        least = rho
        try:
            again = _proved_for_period(made, effort._replace(others=(), tell=partial(half, turn=turn)), least)
        except Infeasible:
            break
        made, held, rho = min((made, held, rho), again, key=lambda one: one[2])
    if rho >= before:
        raise _none_better(before)
    return with_sampled(with_figures(made, stored), held, **{FOR_PERIOD: True})


def _proved_for_period(stored: Stored, effort: Effort, least: float) -> tuple[Stored, HeldVerdict, float]:
    """Return a design with gains for its period, what is proved of it sampled, and its sampled rho.

    Raises:
        Infeasible: as `designed_for_period` does; at once where the gains are those of the design, of which `least`, if it is
            finite, is proved.
    """
    found, m = _searched(stored, effort)
    if np.isfinite(least) and np.array_equal(found.blocks, stored.gains.blocks):
        raise _none_better(least)
    made = with_gains(stored, found)
    held = prove_design(made, m)
    if not held.verdict.certified:
        raise Infeasible(f"gains were found for the period, but not proved: {held.verdict.reason}")
    if held.rho is None:
        raise Infeasible("gains were found for the period, but no rho of their sampled loop was proved")
    return made, held, held.rho.rho


def _none_better(rho: float) -> Infeasible:
    return Infeasible(f"no gains were found with a smaller rho of the sampled loop than {rho:g}", rho=rho)


def _searched(stored: Stored, effort: Effort) -> tuple[Gains, PairWeights]:
    from lockstep.lmi.analysis.rounding import short_gains
    from lockstep.lmi.sampled.synthesis.gains_for_period import AtPeriod, redesigned

    problem, table, c = stored.problem, stored.problem.design, stored.proofs.certificate
    m = pair_weights(stored)
    if not isinstance(c, Certificate) or m is None:
        raise Infeasible("there is no continuous certificate to start from")
    order, limit, period = stored.gains.order, problem.gain_limit, problem.controller.period
    network, edges = sampled_network(stored), problem.graph().edges
    decay = min(max(table.decay or 0.0, table.search_decay or 0.0), stored.claims.decay or 0.0)
    if table.objective == "decay":
        decay = max(decay, KEPT_OF_DECAY * (stored.claims.decay or 0.0))
    at = AtPeriod(network, edges, problem.performance, order, limit, decay=decay, deadline=effort.deadline)
    starts = [StartingGains(stored.gains.blocks, m, c.rho), *effort.others]
    enough = NEAR * min(one.rho for one in starts)
    found = redesigned(at, starts, rho_most=table.rho, enough=enough, tell=effort.tell)
    if found is None:
        raise Infeasible(
            f"no gains were found whose sampled loop is certified at {period:g} s: shorten [controller] period,"
            f" {'raise [design] order, ' * (order < problem.agent().n)}or lower [design] gain_limit or decay",
            period=period,
        )
    return Gains.from_blocks(short_gains(found.K, limit), order), found.m
