"""Between a design, its file, and the answers of the commands: what is claimed, what proves it, what is remarked."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.bound.decide import MOST_BOXES, decide_bound
from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.initial_set import InitialSet
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.design_file import content as design_file
from lockstep.check.design_file.claims import Claims, Scales
from lockstep.check.design_file.content import DesignFile
from lockstep.check.design_file.proofs import BoundProof, Proofs
from lockstep.check.json_text import load_json
from lockstep.check.system.domain import claimed_box
from lockstep.lmi.analysis.covered_start import limits_answer
from lockstep.lmi.design_json import (
    claims_document,
    file_document,
    gains_document,
    message_claims_document,
    sampled_document,
)
from lockstep.lmi.diagnosis.open_loop import part_of_states
from lockstep.lmi.initial_set import InitialStates, sampled_rate
from lockstep.lmi.proposal import Proposal
from lockstep.lmi.upgrade import FORMAT_1, upgraded
from lockstep.model.bound_search import Bound, slopes_of
from lockstep.model.plain_json import plain
from lockstep.model.problem import Problem

ALWAYS = ("rho", "floor")
"""Keys of an answer that are there even where nothing is claimed."""


class Stored(DesignFile[Problem]):
    """A design file with its problem as this layer builds it, to be written down."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the text."""
        return parse, (self.document(), self.problem.title)

    def document(self) -> dict[str, Any]:
        """Return the file as plain JSON types."""
        return file_document(self)

    @property
    def claim(self) -> Claim:
        """What its certificate claims, besides rho."""
        claims = self.claims
        delta = np.tile([claims.fragility[letter] for letter in "ABCD"], (self.gains.N, 1))
        return Claim(claims.alpha, delta=delta, entries=claims.entries, **self.problem.performance._asdict())


def design_file_of(design: Proposal) -> Stored:
    """Return what is to be written down of a design; nothing is claimed of its sampled controllers yet."""
    c, floor, initial, decay = design.certificate, design.floor, design.initial, design.guarantees.decay
    claims = Claims(
        design.certified,
        None if c is None else c.rho,
        design.claim.alpha,
        design.problem.fragility,
        design.scope,
        _scales(design.bound),
        design.claim.entries,
        initial if isinstance(initial, InitialSet) else None,
        None if floor is None else floor.rho,
        None if decay is None else decay[0],
        design.guarantees.stable,
    )
    info, graph = {"figures": design.figures}, design.problem.membership
    if graph is not None:
        info["graph"] = graph.document()
    if initial is not None:
        info["initial_set"] = initial.remarks()
    bound, own = _bound_proof(design.problem, claims), design.initial_and_proof[1]
    proofs = Proofs(c, None if decay is None else decay[1], floor, bound=bound, initial_set=own)
    return Stored(design.problem, design.gains, claims, proofs, info)


def with_bound_proof(stored: Stored) -> Stored:
    """Return a design file with what its bound is proved with, which a file of format 1 does not say."""
    if not stored.claims.certified or stored.proofs.bound is not None:
        return stored
    bound = _bound_proof(stored.problem, stored.claims)
    return replace(stored, proofs=replace(stored.proofs, bound=bound))


def _bound_proof(problem: Problem, claims: Claims) -> BoundProof | None:
    """Ask the checker's decision how many boxes it takes for what is claimed, on the box that it is claimed for."""
    agent = problem.agent()
    box = claimed_box(claims.scope or "local", agent.argument_box)
    D_w, D_v = claims.scales or (None, None)
    decided = decide_bound(agent.exact.phi, box, claims.alpha, D_w, D_v, claims.entries, boxes=MOST_BOXES)
    return BoundProof(decided.figures["boxes"], agent.moves) if decided.proved else None


def _scales(bound: Bound) -> Scales | None:
    """Return D_w and D_v, which G and H are scaled with; None if they are all one."""
    scales = bound.output_scale, bound.input_scale
    return None if set(scales[0]) | set(scales[1]) <= {1.0} else scales


def read(path: Path) -> Stored:
    """Read a design file; see `parse`."""
    return parse(load_json(path), str(path))


def parse(content: Any, where: str) -> Stored:
    """Return what a design file holds, from its JSON, a file of format 1 included.

    Raises:
        ProblemError: a part missing, unknown, or of the wrong shape; `where` names the file.
    """
    if isinstance(content, dict) and content.get("format") == FORMAT_1:
        content = upgraded(content)
    return Stored(**vars(design_file.parse(content, where, Problem.from_document)))


def answer_document(stored: Stored) -> dict[str, Any]:
    """Return what commands say of a design: the keys of the contract, claims at the top and remarks beside them."""
    claims, info, design = stored.claims, stored.info, stored.problem.design
    claimed, slopes = claims_document(claims), slopes_of(claims.entries, claims.scales)
    initial = {"available": False, **_table(info, "initial_set")}
    if claims.initial_set is not None:
        initial |= InitialStates.named(claims.initial_set, stored.problem.agent()).document()
    return {
        "title": stored.problem.title,
        "method": design.method,
        "coordinates": design.coordinates,
        **{key: value for key, value in claimed.items() if value is not None or key in ALWAYS},
        "entries": [one | {"slope": slope} for one, slope in zip(claimed["entries"], slopes, strict=True)],
        "floor_proof": "none" if claims.floor is None else "exact",
        **({"initial_set": initial} if claims.scope == "local" else {}),
        **(
            {"limits": limits_answer(claims.sampled, stored.problem, local=claims.scope == "local")}
            if stored.problem.has_limits
            else {}
        ),
        **graph_answer(stored),
        "gains": gains_document(stored.gains),
        "sampled": sampled_answer(stored),
        **messages_answer(stored, certified=claims.messages is not None),
        "figures": {**_table(info, "figures"), "part_of_states": part_of_states(stored.gains)},
    }


def graph_answer(stored: Stored) -> dict[str, Any]:
    """Return `spectrum`, and `graph_proof`: how it is known that a graph has the one that a certificate covers."""
    spectrum, known = stored.problem.spectrum, _table(stored.info, "graph")
    if spectrum is None:
        return {"graph_proof": "exact"} if isinstance(stored.proofs.certificate, ModalCertificate) else {}
    said = {"spectrum": [spectrum.lower, spectrum.upper], "max_degree": spectrum.neighbours}
    return said | ({"graph_proof": known["graph_proof"]} if "graph_proof" in known else {})


def sampled_answer(stored: Stored) -> dict[str, Any]:
    """Return what is claimed of the sampled controllers, and remarks of them."""
    claims = sampled_document(stored.claims.sampled)
    period, delay = stored.problem.controller.period, stored.problem.controller.delay
    rate = sampled_rate(period, stored.claims.sampled.decay, stored.claims.sampled.fastest_decay)
    asked = {} if (decay := stored.problem.design.decay) is None else {"rate_asked": decay}
    said = {**_table(stored.info, "sampled"), **claims, "rate": rate, **asked}
    return {**said, "period": period, "delay": delay}


def messages_answer(stored: Stored, *, certified: bool) -> dict[str, Any]:
    """Return the key `messages` where the problem asks or the design claims: what is claimed, or why nothing is."""
    claims, asked = stored.claims.messages, stored.problem.messages
    if claims is not None and certified:
        alike = claims.messages.alike(len(stored.problem.graph().edges))
        proved = {"certified": True, "proof": "ball", **message_claims_document(claims), "alike": alike}
        return {"messages": proved}
    if asked is None:
        return {}
    said = {"reason": "nothing is proved of it", **_table(stored.info, "messages")}
    return {"messages": {"certified": False, "proof": "none", **plain(asked), **said}}


def _table(info: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = info.get(key)
    return found if isinstance(found, Mapping) else {}
