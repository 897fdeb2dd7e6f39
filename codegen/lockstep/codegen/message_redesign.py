"""Design for the messages: gains that carry what `[network.messages]` asks for, where those that were found do not.

`lockstep.lmi.sampled.messages.redesign` proposes them. All that the design file claims is proved anew of gains that are kept.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.errors import Infeasible
from lockstep.check.system.loop import Gains
from lockstep.codegen import sampled_design
from lockstep.codegen.message_claims import part_certified
from lockstep.codegen.other_gains import obstacle, with_figures, with_gains
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.synthesis.gains_for_period import StartingGains
from lockstep.lmi.search.stopping import Stop

PROVING = "proving the gains for the messages"

Tell = Callable[[str, float], None]


def lacks_messages(stored: Stored) -> bool:
    """Tell whether the problem asks for more of the messages than is claimed of the design."""
    return stored.problem.messages is not None and stored.claims.messages is None


def for_messages(kept: Stored, tell: Tell, stop: Stop) -> Stored:
    """Return a design whose gains carry the messages asked for, or the same with the reason why there is none."""
    found = obstacle(kept)
    if found is None:
        try:
            made = stop.optional(lambda: designed_for_messages(kept, tell), otherwise=None)
            if made is not None:
                return made
            found = "interrupted"
        except Infeasible as error:
            found = str(error)
    part = stop.optional(lambda: _part_certified(kept, tell), otherwise=kept.info.get("messages", {}))
    return replace(kept, info={**kept.info, "messages": {**part, sampled_design.NOT_FOR_MESSAGES: found}})


def _part_certified(kept: Stored, tell: Tell) -> Mapping[str, Any]:
    network, controllers, agreed = sampled_design.prove_agreement(kept)
    asked, witness = kept.problem.messages, agreed.witness
    if asked is None or witness is None:
        return {}
    tell("looking for the part that is carried", 0.0)
    return part_certified(network, controllers, asked, witness.P)


def designed_for_messages(stored: Stored, tell: Tell) -> Stored:
    """Return the design file with gains that carry what `[network.messages]` asks for, all certificates proved anew.

    Args:
        stored: the design file, with what is proved of its sampled controllers.
        tell: called with what is being done and the part of it that is done.

    Raises:
        Infeasible: none were found, or none that are proved.
    """
    from lockstep.lmi.analysis.rounding import short_gains
    from lockstep.lmi.sampled.messages.redesign import gains_for_messages
    from lockstep.lmi.sampled.messages.witnesses import certify_messages
    from lockstep.lmi.sampled.synthesis.gains_for_period import AtPeriod

    problem, c, m = stored.problem, stored.proofs.certificate, sampled_design.pair_weights(stored)
    asked, limit, period = problem.messages, problem.gain_limit, problem.controller.period
    if not isinstance(c, Certificate) or m is None or asked is None:
        raise Infeasible("there is no continuous certificate to start from")
    network, order = sampled_design.sampled_network(stored), stored.gains.order
    at = AtPeriod(network, problem.graph().edges, problem.performance, order, limit)
    start, held = StartingGains(stored.gains.blocks, m, c.rho), sampled_controllers(stored, period)
    reason = "no gains were brought near it"

    def further(part: float) -> None:
        tell("designing for the messages", part)

    for found in gains_for_messages(at, start, asked, held, problem.design.rho, further):
        tell(PROVING, 0.0)
        gains = Gains.from_blocks(short_gains(found.K, limit), order)
        reason = "gains were found for it, but not proved"
        if (
            certify_messages(network, sampled_controllers(replace(stored, gains=gains), period), asked)
            is None
        ):
            continue
        tell(PROVING, 0.1)
        try:
            made = with_gains(stored, gains)
        except Infeasible as error:
            reason = str(error)
            continue
        tell(PROVING, 0.25)
        sampled = sampled_design.prove_design(made, found.m)
        if sampled.verdict.certified and sampled.messages.claims is not None:
            return sampled_design.with_sampled(
                with_figures(made, stored), sampled, **{sampled_design.FOR_MESSAGES: True}
            )
    raise Infeasible(reason)
