"""The checker: from a design file, or a folder of C with its design, to a verdict for each claim, nothing being searched for.

    formation      offsets change no agent's equation, where there are some
    offset         the terms in t alone have a value at every t >= 0, where an operation in them needs it
    bound          |phi(a, t) - phi(b, t)| <= alpha |a - b|, and the bounds of single slopes, where they are claimed
    certificate    rho of the continuous controllers, in rationals
    asked          the file claims no less than its problem asks for
    decay, controllers_stable, floor, initial_set   where they are claimed
    sampled        agreement of the sampled, rounded controllers, in balls;  sampled_decay, sampled_rho, max_period,
                   limits: where claimed
    fixed, fixed_rho, fixed_radius   the controllers in integers, read out of the C of a folder: where claimed
    messages       the same with messages lost or late, at least as asked;  messages_rho: where claimed
    code           the controllers read out of the C are those of the design

The first claim that fails ends the list: what follows rests on it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check import continuous_claims as continuous
from lockstep.check.bound.box import Box
from lockstep.check.bound.decide import MOST_BOXES, decide_bound, decide_offset
from lockstep.check.c_source.folder import controllers_in
from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.initial_set import Domain, box_text, contains
from lockstep.check.design_file import content
from lockstep.check.design_file.claims import Claims, SampledClaims
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.files import text_inside
from lockstep.check.fixed_point import decide_fixed
from lockstep.check.json_text import A_DESIGN, load_json, parse_json
from lockstep.check.limits import decide_limits
from lockstep.check.messages import decide_messages
from lockstep.check.requirements import shortfalls
from lockstep.check.sampled.certificate import SampledVerdict
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.modes import SampledModalWitness, proves_modal_rho
from lockstep.check.sampled_claims import (
    CheckedFile,
    decide_held,
    held_controllers,
    modal_loop_of,
    sampled_network,
)
from lockstep.check.system.agent import ExactAgent
from lockstep.check.system.domain import claimed_box
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict

DESIGN_NAME = "design.json"
FLAT = 1e-6
"""Of alpha: a slope of phi at 0 that counts as none."""

Verdicts = Iterator[tuple[str, Verdict]]


@dataclass(frozen=True)
class Certified:
    """The verdicts, claim by claim, in the order in which they were decided."""

    title: str
    verdicts: dict[str, Verdict]

    @property
    def proved(self) -> bool:
        """Whether every claim is proved."""
        return all(one.proved for one in self.verdicts.values())

    def document(self) -> dict[str, Any]:
        """Return the verdicts as plain JSON types."""
        claims = {name: {"status": one.status, "reason": one.reason} for name, one in self.verdicts.items()}
        return {"certified": self.proved, "title": self.title, "claims": claims}


def certify(path: Path) -> Certified:
    """Decide every claim of a design file, or of a folder of C with its design.

    Raises:
        ProblemError: a file that is none of ours, or that says what cannot be.
    """
    if not path.is_dir():
        return certified(content.parse(load_json(path), str(path), ProblemTables.from_document))
    found = parse_json(text_inside(path, DESIGN_NAME, expected=A_DESIGN), DESIGN_NAME)
    return certified(content.parse(found, str(path / DESIGN_NAME), ProblemTables.from_document), path)


def certified(stored: CheckedFile, folder: Path | None = None) -> Certified:
    """Decide every claim of a design file that was read, or of the C in a folder with it, up to the first that fails."""
    verdicts: dict[str, Verdict] = {}
    for name, verdict in decide(stored, folder):
        verdicts[name] = verdict
        if not verdict.proved:
            break
    return Certified(stored.problem.title, verdicts)


def decide(stored: CheckedFile, folder: Path | None = None) -> Verdicts:
    """Yield the verdict of one claim after the other; each rests on those before it."""
    problem, claims, proofs = stored.problem, stored.claims, stored.proofs
    if not claims.certified or proofs.certificate is None or proofs.bound is None:
        yield "certificate", Verdict("undecided", "the file claims or proves no certificate")
        return
    network, agent = problem.network(proofs.bound.moves, claims.scales)
    if problem.offsets is not None:
        said = "no agent's equation sees the offsets: what is proved of x is of x less them"
        yield "formation", Verdict("proved", said)
    if agent.offset_needs.conditions:
        yield "offset", decide_offset(agent.offset_needs)
    yield "bound", _bound(stored, agent)
    delta = np.tile([claims.fragility[letter] for letter in "ABCD"], (network.N, 1))
    claim = Claim(claims.alpha, delta=delta, entries=claims.entries, **problem.performance._asdict())
    yield "certificate", continuous.decide_certificate(network, stored.gains, claim, proofs.certificate)
    split = problem.tables["agent"].get("split") == "jacobian" and _is_flat_at_zero(agent, claims)
    moved = () if split else [one.amount for one in proofs.bound.moves]
    short = "; ".join(shortfalls(problem.design, claims, stored.gains, problem.gain_units, moved))
    said = f"less is claimed than is asked for: {short}"
    enough = Verdict("proved", "no less is claimed than the problem asks for")
    yield "asked", Verdict("refuted", said) if short else enough
    if claims.decay is not None:
        yield "decay", _decay(stored, network, claim)
    if claims.controllers_stable:
        yield "controllers_stable", continuous.decide_stable_controllers(stored.gains.A)
    if proofs.floor is not None:
        yield "floor", continuous.decide_floor(network, claim, proofs.floor)
    if claims.initial_set is not None:
        yield "initial_set", _initial_set(stored, network, Domain(agent.H, problem.box, agent.states), claim)
    yield from _sampled(stored, network, folder)


def _decay(stored: CheckedFile, network: ExactNetwork, claim: Claim) -> Verdict:
    decay, certificate = stored.claims.decay, stored.proofs.decay
    said = f"every disagreement decays at {decay:g} 1/s"
    if certificate is None or decay is None:
        return Verdict.of(said, None)
    found = continuous.decide_certificate(network.decaying(decay), stored.gains, claim, certificate)
    reason = said if found.proved else f"it is claimed that {said}, but {found.reason}"
    return Verdict(found.status, reason, found.figures)


def _initial_set(stored: CheckedFile, network: ExactNetwork, domain: Domain, claim: Claim) -> Verdict:
    """Decide an initial set by the certificate of rho, or by one of its own."""
    claimed, main, own = stored.claims.initial_set, stored.proofs.certificate, stored.proofs.initial_set
    assert claimed is not None and main is not None
    if not claim.performance.covers_xi:
        return Verdict("undecided", "initial states are claimed, but rho is no gain from all of xi")
    stays = stored.problem.leader
    if stays is not None and not contains(claimed.inner, stays):
        said = f"the leader is taken to stay in {box_text(claimed.inner)}, but [network] leader says {box_text(stays)}"
        return Verdict("refuted", said)
    if (
        own is not None
        and not (found := continuous.decide_certificate(network, stored.gains, claim, own)).proved
    ):
        return found
    return continuous.decide_initial_set(network, own or main, domain, claimed)


def _bound(stored: CheckedFile, agent: ExactAgent) -> Verdict:
    claims, proof = stored.claims, stored.proofs.bound
    assert proof is not None
    box = claimed_box(claims.scope or "local", stored.problem.box)
    D_w, D_v = claims.scales or (None, None)
    boxes = min(proof.boxes, MOST_BOXES)
    found = decide_bound(agent.phi, box, claims.alpha, D_w, D_v, claims.entries, boxes=boxes)
    local = "; it holds, as all below, while every agent stays in the domain of the file"
    return replace(found, reason=found.reason + local * (found.proved and claims.scope != "global"))


def _is_flat_at_zero(agent: ExactAgent, claims: Claims) -> bool:
    """Whether phi has no slope at 0, to a millionth of alpha: it was moved into A, which split = "jacobian" asks for."""
    zero, scales = Box(*[(0.0,) * len(agent.H)] * 2), claims.scales or (None, None)
    return decide_bound(agent.phi, zero, FLAT * claims.alpha, *scales, boxes=1).proved


def _sampled(stored: CheckedFile, network: ExactNetwork, folder: Path | None) -> Verdicts:
    """Yield what is proved of the sampled controllers: of the C of a folder, else of the design's gains."""
    claims, proofs, problem = stored.claims.sampled, stored.proofs, stored.problem
    held = held_controllers(stored, problem.period)
    if folder is not None:
        read, refused = controllers_in(folder, stored, held)
        yield "code", refused
        held = read
    if stored.claims.controllers_stable:
        tables = [one.table[: stored.gains.order, : stored.gains.order] for one in held]
        yield "controllers_stable_sampled", continuous.decide_stable_controllers(tables, sampled=True)
    if claims.certified or folder is not None:
        found = decide_held(stored, network, held, proofs.sampled)
        yield "sampled", _as_claimed(claims, found)
    if (decay := claims.fastest_decay) is not None:
        fast = decide_held(stored, network, held, proofs.sampled_decay)
        holds = fast.certified and fast.decay <= decay if proofs.sampled_decay else None
        yield "sampled_decay", Verdict.of(f"a V shrinks by {decay:.10g} in a period", holds)
    if claims.rho is not None:
        yield "sampled_rho", _rho(stored, network, held)
    if claims.max_period is not None and not (claims.certified and claims.max_period == problem.period):
        own = held_controllers(stored, claims.max_period)
        found = decide_held(stored, network, own, proofs.max_period, claims.max_period)
        yield "max_period", Verdict("proved" if found.certified else "undecided", found.reason)
    yield from decide_limits(stored, network, held)
    if stored.claims.fixed is not None:
        yield from decide_fixed(stored, network, held, folder)
    asked, claimed = problem.messages, stored.claims.messages
    if claimed and problem.spectrum is not None:
        said = "messages are lost or late in one graph, and `spectrum` names many"
        yield "messages", Verdict("undecided", said)
    elif claimed or asked:
        weights = problem.performance
        loop = sampled_loop(sampled_network(stored, network, problem.period), held, weights.outputs)
        yield from decide_messages(asked, claimed, proofs, loop, weights)


def _as_claimed(claims: SampledClaims, found: SampledVerdict) -> Verdict:
    """Hold what is claimed of the loop against what is proved of it; rho and the longest period are decided apart."""
    if not found.certified:
        return Verdict("undecided", found.reason)
    broken = next(claims.better_than(found), None)
    return Verdict("undecided", broken) if broken else Verdict("proved", found.reason)


def _rho(stored: CheckedFile, network: ExactNetwork, held: tuple[HeldController, ...]) -> Verdict:
    rho, witness = stored.claims.sampled.rho, stored.proofs.sampled_rho
    said = f"the sampled loop has the gain {rho:g}"
    if witness is None or rho is None:
        return Verdict.of(said, None)
    weights, period = stored.problem.performance, stored.problem.period
    if isinstance(witness, SampledModalWitness):
        holds = proves_modal_rho(modal_loop_of(stored, network, held, period), weights, rho, witness)
    else:
        at = sampled_network(stored, network, period)
        holds = proves_rho(sampled_loop(at, held, weights.outputs), weights, rho, witness)
    return Verdict.of(said, holds)
