"""What a design file claims of the limits of inputs, one verdict for each claim; the sampled loop is taken as decided."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.inputs.input_limits import Radius, proves_gain, proves_radius
from lockstep.check.sampled.inputs.saturation import proves_clipped_radius
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled_claims import CheckedFile, sampled_network
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict

PARTS = (0.99, 0.9, 0.5)
"""Of a claim that is not proved: it is said of which of these it would be."""


def decide_limits(
    stored: CheckedFile, network: ExactNetwork, held: tuple[HeldController, ...]
) -> Iterator[tuple[str, Verdict]]:
    """Yield what is proved of the inputs' limits, as far as it is claimed: `limits`, `limits_gain`, `clipped`."""
    claims, proofs, limits = stored.claims.sampled, stored.proofs, stored.problem.limits
    pairs = ((claims.radius, claims.half_axes), (claims.clipped_radius, claims.clipped_half_axes))
    kept, clipped = (tuple(one for one in pair if one is not None) for pair in pairs)
    gain = claims.limits_gain
    if gain is None and not kept and not clipped:
        return
    if not np.isfinite(limits).any():
        yield "limits", Verdict("undecided", "something is claimed of limits, but [agent.limits] names none")
        return
    at, weights = sampled_network(stored, network, stored.problem.period), stored.problem.performance
    plain, states = sampled_loop(at, held), stored.problem.agent.states
    timely = "every message in time, " + "all agents in their domain, " * (stored.claims.scope != "global")
    calm = f"{timely}no input meets its limit"
    if kept:
        w = proofs.radius
        prove = None if w is None else partial(proves_radius, plain, w, limits)
        yield "limits", _decided(f"{_starts(kept, states)}, {calm}", prove, kept)
    if gain is not None:
        w, noisy = proofs.limits_gain, sampled_loop(at, held, weights.outputs)
        prove = None if w is None else partial(proves_gain, noisy, w, limits, weights)
        said = (
            f"under a disturbance of at most {gain:g} in L2, counted as [design] does, from agreement at rest"
        )
        yield "limits_gain", _decided(f"{said}, {calm}", prove, (gain,))
    if clipped:
        c = proofs.clipped
        prove = None if c is None else partial(proves_clipped_radius, plain, c, limits)
        said = f"{timely}the loop converges with its inputs clipped"
        yield "clipped", _decided(f"{_starts(clipped, states)}, {said}", prove, clipped)


def _decided(said: str, prove: Callable[..., bool] | None, claimed: Sequence[Radius]) -> Verdict:
    """Return the verdict; where a witness does not prove all that is claimed, with how much of it it does."""
    verdict = Verdict.of(said, prove and prove(*claimed))
    if prove is None or verdict.proved:
        return verdict
    for part in PARTS:
        if prove(*(part * np.array(one) for one in claimed)):
            return Verdict("undecided", f"{verdict.reason}; of {part:g} times as much it does")
    return verdict


def _starts(radii: Sequence[Radius], states: Sequence[str]) -> str:
    sets = (f"|x_d(0)| <= {one:g}" if isinstance(one, float) else axes_text(one, states) for one in radii)
    return f"from {', or '.join(sets)}, controllers at rest, undisturbed, readings exact"
