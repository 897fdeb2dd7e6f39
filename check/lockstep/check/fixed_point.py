"""What a design file claims of its controllers in integers, decided by the integers in the C of its folder."""

import math
from collections.abc import Iterator
from pathlib import Path

from lockstep.check.c_source.fixed_point import read_fixed
from lockstep.check.c_source.folder import manifest_in
from lockstep.check.continuous_claims import decide_stable_controllers
from lockstep.check.design_file.claims import SURE
from lockstep.check.errors import NotCertified, demand
from lockstep.check.files import named, text_inside
from lockstep.check.sampled.certificate import ROUNDED_UP, decide_sampled
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.discretise import clipped_at
from lockstep.check.sampled.fixed_point import FixedController, integers_of, proves_range
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled_claims import CheckedFile, sampled_network
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict
from lockstep.check.wording import shorten


def decide_fixed(
    stored: CheckedFile, network: ExactNetwork, held: tuple[HeldController, ...], folder: Path | None
) -> Iterator[tuple[str, Verdict]]:
    """Yield what is proved of the integers in `fixed/`, as far as it is claimed.

    Args:
        stored: a design file that claims something of integers.
        network: of its problem.
        held: the design's controllers, for whom they hear.
        folder: that holds the C, whose integers must be those of the design's gains in its formats.

    Raises:
        ProblemError: formats that do not fit the agents, or gains that do not fit the formats.
    """
    claims, proofs, problem = stored.claims.fixed, stored.proofs.fixed, stored.problem
    if claims is None or proofs is None or problem.spectrum is not None or problem.offsets is not None:
        # The C in integers takes no offset from what it reads.
        said = "integers are claimed without witnesses, of many graphs, or of a formation"
        yield "fixed", Verdict("undecided", said)
        return
    demand(len(claims.states) == len(held), f"{len(claims.states)} agents", "claims, fixed", f"{len(held)}")
    sides = clipped_at(problem.controller["real"], problem.sides)
    integers = tuple(
        integers_of(one.table, (states, claims.outputs, claims.inputs), sides, one.weights)
        for one, states in zip(held, claims.states, strict=True)
    )
    mine = tuple(one.held(own.sources) for one, own in zip(integers, held, strict=True))
    if folder is not None and (wrong := _differs(stored, folder, integers, mine)):
        yield "fixed", Verdict("refuted", wrong)
        return
    if stored.claims.controllers_stable:
        n_C = stored.gains.order
        yield "fixed_stable", decide_stable_controllers([one.table[:n_C, :n_C] for one in mine], sampled=True)
    at, weights = sampled_network(stored, network, problem.period), problem.performance
    found = decide_sampled(at, mine, (proofs.agreement,))
    kept = (
        claims.decay >= found.decay
        and claims.residual_per_message_error >= SURE * found.residual_per_message_error
        and claims.residual_from_rounding >= SURE * found.residual_from_underflow
    )  # false where a figure is no number
    if not (found.certified and kept):
        said = "more is claimed of them than proved" if found.certified else found.reason
        yield "fixed", Verdict("undecided", f"the controllers in integers: {said}")
        return
    yield "fixed", Verdict("proved", f"the controllers in integers: {found.reason}")
    if claims.rho is not None:
        w, rounding = proofs.rho, claims.rho_rounding or 0.0
        said = f"in integers the loop has the gain {claims.rho:g}, up to {rounding:g}"
        loop = sampled_loop(at, mine, weights.outputs)
        covers = w is not None and rounding >= SURE * rho_rounding(w, mine, problem.period)
        holds = None if w is None else covers and proves_rho(loop, weights, claims.rho, w)
        yield "fixed_rho", Verdict.of(said, holds)
    if claims.radius is not None:
        w = proofs.radius
        holds = None if w is None else proves_range(sampled_loop(at, mine), integers, w, claims.radius)
        rest = "controllers at rest, undisturbed, every message in time, readings exact"
        said = f"from |x_d(0)| <= {claims.radius:g}, {rest}, no integer meets its limit"
        yield "fixed_radius", Verdict.of(said, holds)


def rho_rounding(witness: Witness, held: tuple[HeldController, ...], period: float) -> float:
    """Return the root of what the rounding adds to the integral of what is weighed, per unit of time."""
    mu = math.hypot(*(one.underflow for one in held))
    return ROUNDED_UP * math.sqrt(witness.kappa_mu / period) * mu


def _differs(
    stored: CheckedFile, folder: Path, integers: tuple[FixedController, ...], held: tuple[HeldController, ...]
) -> str:
    """Return in what the C of a folder is not these controllers, or nothing."""
    base = f"{manifest_in(folder).get('prefix', '')}{stored.problem.agent.name}"
    names = [f"{base}{i}" for i in range(1, len(held) + 1)]
    known = {f"{name}_fixed.{end}" for name in names for end in "hc"}
    with named(folder / "fixed", "a folder"):
        extra = sorted({one.name for one in (folder / "fixed").iterdir()} - known)
    if extra:
        return f"fixed/{shorten(extra[0])}: a compiler may read it, and nothing here does"
    for name, one, own in zip(names, integers, held, strict=True):
        header, source = (text_inside(folder, f"fixed/{name}_fixed.{end}") for end in "hc")
        try:
            read = read_fixed(name, header, source, names)
        except NotCertified as error:
            return str(error)
        if read != (one, own.sources, stored.problem.period):
            return f"fixed/{name}_fixed: not the design's integers, neighbours or period"
    return ""
