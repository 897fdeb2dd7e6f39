"""Design for the messages: gains that carry what `[network.messages]` asks for, where those that were found do not.

`lockstep.lmi.sampled.messages.gains` proposes them. All that the design file claims is proved anew of gains that are kept.
"""

from collections.abc import Callable
from dataclasses import replace

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.errors import Infeasible
from lockstep.check.system.loop import Gains
from lockstep.codegen.for_the_period import obstacle, with_figures, with_gains
from lockstep.codegen.sampled_design import (
    FOR_MESSAGES,
    NOT_FOR_MESSAGES,
    pair_weights,
    prove_design,
    sampled_controllers,
    sampled_network,
    with_sampled,
)
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.descending.improve import StartingGains
from lockstep.lmi.search.stopping import Stop

Tell = Callable[[str, float], None]


def for_messages(kept: Stored, tell: Tell, stop: Stop) -> Stored:
    """Return a design whose gains carry the messages asked for, or the same with the reason why there is none."""
    found = obstacle(kept)
    if found is None:
        tell("designing for the messages", 0.0)
        try:
            made = stop.optional(lambda: designed_for_messages(kept), otherwise=None)
            if made is not None:
                return made
            found = "interrupted"
        except Infeasible as error:
            found = str(error)
    said = {**kept.info.get("messages", {}), NOT_FOR_MESSAGES: found}
    return replace(kept, info={**kept.info, "messages": said})


def designed_for_messages(stored: Stored) -> Stored:
    """Return the design file with gains that carry what `[network.messages]` asks for, all certificates proved anew.

    Raises:
        Infeasible: none were found, or none that are proved.
    """
    from lockstep.lmi.analysis.rounding import short_gains
    from lockstep.lmi.sampled.descending.improve import AtPeriod
    from lockstep.lmi.sampled.messages.gains import gains_for_messages
    from lockstep.lmi.sampled.messages.witnesses import certify_messages

    problem, c, m = stored.problem, stored.proofs.certificate, pair_weights(stored)
    asked, limit, period = problem.messages, problem.design.gain_limit, problem.controller.period
    if not isinstance(c, Certificate) or m is None or asked is None:
        raise Infeasible("there is no continuous certificate to start from")
    network, order = sampled_network(stored), stored.gains.order
    at = AtPeriod(network, problem.graph().edges, problem.performance, order, limit)
    start, held = StartingGains(stored.gains.blocks, m, c.rho), sampled_controllers(stored, period)
    reason = "no gains were brought near it"
    for found in gains_for_messages(at, start, asked, held, problem.design.rho):
        gains = Gains.from_blocks(short_gains(found.K, limit), order)
        reason = "gains were found for it, but not proved"
        if (
            certify_messages(network, sampled_controllers(replace(stored, gains=gains), period), asked)
            is None
        ):
            continue
        try:
            made = with_gains(stored, gains)
        except Infeasible as error:
            reason = str(error)
            continue
        sampled = prove_design(made, found.m)
        if sampled.verdict.certified and sampled.messages.claims is not None:
            return with_sampled(with_figures(made, stored), sampled, **{FOR_MESSAGES: True})
    raise Infeasible(reason)
