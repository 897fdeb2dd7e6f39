"""What can be claimed of a design's controllers sampled and rounded, with its witnesses; and the checker's word on their C.

Both sides meet here: `lockstep.lmi.sampled` looks for witnesses and knows no C, this layer samples and rounds as `emit` does.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.certify import DESIGN_NAME
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.errors import BoundNotProved, ProblemError
from lockstep.check.sampled.certificate import decide_sampled
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled_claims import sector
from lockstep.codegen.message_claims import MessageProof, prove_messages
from lockstep.codegen.sampled_modes import ModalRho, asked_decay, prove_modes_of, sampled_controllers, splits
from lockstep.lmi.design_verdict import ClaimDecisions, certify
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import (
    HeldController,
    SampledNetwork,
    SampledRho,
    SampledVerdict,
    certify_sampled,
    max_period,
    sampled_rho,
)
from lockstep.lmi.sampled.loop_gain import common_pair_weights
from lockstep.lmi.sampled.witnesses import certify_decay
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.model.assembly import network_of
from lockstep.model.plain_json import to_json

FOR_PERIOD, NOT_FOR_PERIOD = "designed_for_period", "not_designed_for_period"
"""Of `sampled`: that the gains were designed for the sampled loop, not for the continuous one; or why they were not."""

FOR_MESSAGES, NOT_FOR_MESSAGES = "designed_for_messages", "not_designed_for_messages"
"""Of `sampled`, that the gains were designed for what `[network.messages]` asks; of `messages`, why none were found."""

PairWeights = Float[np.ndarray, " pairs"]


@dataclass(frozen=True)
class HeldVerdict:
    """What is proved of sampled, rounded controllers.

    verdict: at their period;  longest: at the largest period certified for the design's gains, sampled anew;  rho: the
    disturbance gain of the sampled loop, if proved;  messages: what is proved of messages that are lost or late;  fastest:
    the verdict by a V that decays faster, if there is one.
    """

    verdict: SampledVerdict
    longest: SampledVerdict | None = None
    rho: SampledRho | ModalRho | None = None
    messages: MessageProof = field(default_factory=MessageProof)
    fastest: SampledVerdict | None = None

    def claims(self) -> SampledClaims:
        """Return what may be claimed."""
        sampled, longest = self.verdict, None if self.longest is None else self.longest.period
        if not sampled.certified:
            return SampledClaims(max_period=longest)
        return SampledClaims(
            True,
            sampled.period,
            sampled.delay,
            sampled.decay,
            None if self.rho is None else self.rho.rho,
            sampled.residual_per_message_error,
            sampled.residual_rms_per_message_error,
            sampled.residual_from_underflow,
            sampled.deltas,
            longest,
            fastest_decay=None if self.fastest is None else self.fastest.decay,
        )

    def remarks(self) -> dict[str, Any]:
        """Return what is known besides.

        Figures of the search (a spectral radius, a gain around phi) tell why a proof fails; beside one that holds they
        are left out, being computed and not proved.
        """
        searched = {} if self.verdict.certified else self.verdict.figures
        return {"reason": self.verdict.reason, **searched}


def prove_design(stored: Stored, guess: PairWeights | None = None) -> HeldVerdict:
    """Look for what can be proved of a design's gains sampled and rounded as `emit` does: agreement, rho, the largest period.

    The counts of roundings are those of full rows; C that skips zeros rounds less often.

    Args:
        stored: the design; its witnesses are tried first.
        guess: pair weights to start from; by default those of the design.
    """
    period, delay = stored.problem.controller.period, stored.problem.controller.delay
    try:
        if splits(stored) and (stored.problem.messages is None or stored.problem.spectrum is not None):
            modes = prove_modes_of(stored, sector(stored, stored.problem.agent().lure))
            return HeldVerdict(modes.verdict, modes.longest, modes.rho, fastest=modes.fastest)
        guess = _guess(stored) if guess is None else guess
        network, controllers, verdict = prove_agreement(stored, guess)
    except (BoundNotProved, ProblemError) as error:
        return HeldVerdict(SampledVerdict(False, str(error), period, delay))
    rho = None
    if verdict.certified:
        weights = stored.problem.performance
        rho = _stated_rho(stored, network, controllers) or sampled_rho(network, controllers, weights, guess)
    reach = _longest_stated(stored, network) or longest_period(stored, network, guess)
    if verdict.certified and (reach is None or reach.period < verdict.period):
        reach = verdict
    if verdict.witness is None:
        return HeldVerdict(verdict, reach, rho)
    fast, proved = stored.proofs.sampled_decay, (verdict.witness, rho and rho.witness, stored.proofs.decay)
    tried = [one.m for one in proved if isinstance(one, Witness | Certificate)]
    own = [fast] if isinstance(fast, Witness) else []
    fastest = certify_decay(network, controllers, tried, verdict.decay, asked_decay(stored), own)
    messages = prove_messages(stored, network, controllers, verdict.witness, rho)
    return HeldVerdict(verdict, reach, rho, fastest=fastest, messages=messages)


def prove_agreement(
    stored: Stored, guess: PairWeights | None = None
) -> tuple[SampledNetwork, tuple[HeldController, ...], SampledVerdict]:
    """Return the network and the controllers of a design, and what is proved of them where all messages arrive.

    guess: pair weights to start from; by default those of the design.

    Raises:
        BoundNotProved: alpha does not bound the nonlinearity, or an entry does not bound its slope.
        ProblemError: a gain has no value in the target type.
    """
    network = sampled_network(stored)
    controllers = sampled_controllers(stored, stored.problem.controller.period)
    known = stored.proofs.sampled if isinstance(stored.proofs.sampled, Witness) else None
    m = _guess(stored) if guess is None else guess
    return network, controllers, certify_sampled(network, controllers, m, witness=known)


def with_sampled(stored: Stored, held: HeldVerdict, **remarks: Any) -> Stored:
    """Return a design file with what is proved of its sampled controllers, and its witnesses; nothing of limits."""
    said = stored.info.get("sampled")
    said = said if isinstance(said, dict) else {}
    kept = {key: said[key] for key in (FOR_PERIOD, NOT_FOR_PERIOD, FOR_MESSAGES) if key in said}
    proofs = replace(
        stored.proofs,
        sampled=held.verdict.witness,
        sampled_rho=None if held.rho is None else held.rho.witness,
        max_period=None if held.longest is None else held.longest.witness,
        sampled_decay=None if held.fastest is None else held.fastest.witness,
        messages=held.messages.witness,
        messages_rho=held.messages.of_rho,
        radius=None,
        limits_gain=None,
        clipped=None,
    )
    return replace(
        stored,
        claims=replace(stored.claims, sampled=held.claims(), messages=held.messages.claims),
        proofs=proofs,
        info={
            **{key: one for key, one in stored.info.items() if key != "messages"},
            "sampled": {**held.remarks(), **kept, **remarks},
            **({"messages": dict(held.messages.remark)} if held.messages.remark else {}),
        },
    )


def certify_files(files: Mapping[str, str], stored: Stored) -> ClaimDecisions:
    """Decide a design by the numbers in its C, which is printed and not yet written.

    Args:
        files: what `emit` returns: relative path -> text;  stored: the design that they were emitted from.
    """
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        folder = Path(temporary)
        for path, text in {**files, DESIGN_NAME: to_json(stored.document())}.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
        return certify(stored, folder)


def longest_period(
    stored: Stored, network: SampledNetwork, guess: PairWeights | None
) -> SampledVerdict | None:
    """Return the verdict at the largest period certified for a design's gains, or None."""
    return max_period(network, lambda period: sampled_controllers(stored, period), guess)


def sampled_network(stored: Stored) -> SampledNetwork:
    """Return the agents of a design in rationals, at the period of its problem, alpha and the entries being proved anew.

    Raises:
        BoundNotProved: alpha does not bound the nonlinearity, or an entry does not bound its slope.
    """
    problem = stored.problem
    bound = reproved_bound(stored).or_raise()
    loop = network_of(problem, bound).loop(stored.gains.order, exact_arithmetic=True)
    return SampledNetwork(
        loop.plant,
        loop.d,
        stored.claims.alpha,
        problem.controller.period,
        problem.controller.delay,
        sector(stored, stored.problem.agent().lure),
    )


def _stated_rho(
    stored: Stored, network: SampledNetwork, controllers: tuple[HeldController, ...]
) -> SampledRho | None:
    known = known_rho(stored)
    weights = stored.problem.performance
    holds = known and proves_rho(sampled_loop(network, controllers, weights.outputs), weights, *known)
    return known if holds else None


def known_rho(stored: Stored) -> SampledRho | None:
    """Return the disturbance gain that a file states of the sampled loop, with its witness; None without them."""
    rho, witness = stored.claims.sampled.rho, stored.proofs.sampled_rho
    return SampledRho(rho, witness) if rho is not None and isinstance(witness, Witness) else None


def _longest_stated(stored: Stored, network: SampledNetwork) -> SampledVerdict | None:
    """Return the verdict at the period that a design file claims as its longest, if the file's witness proves it."""
    period, witness = stored.claims.sampled.max_period, stored.proofs.max_period
    if period is None or not isinstance(witness, Witness):
        return None
    try:
        controllers = sampled_controllers(stored, period)
    except ProblemError:
        return None
    verdict = decide_sampled(replace(network, period=period), controllers, [witness])
    return verdict if verdict.certified else None


def pair_weights(stored: Stored) -> PairWeights | None:
    """Return those of the continuous certificate, as far as one weight for each pair can stand for them."""
    c, known = stored.proofs.certificate, sector(stored, stored.problem.agent().lure)
    if not isinstance(c, Certificate):
        return None
    return c.m if known is None else common_pair_weights(stored.claims.entries, c, known)


def _guess(stored: Stored) -> PairWeights | None:
    """Return pair weights to start from: those that proved rho of the sampled loop, else the continuous ones."""
    known = known_rho(stored)
    if known is not None and len(known.witness.m) == stored.gains.N * (stored.gains.N - 1) // 2:
        return known.witness.m
    return pair_weights(stored)
