"""What a design file claims of the limits of inputs, one verdict for each claim; the sampled loop is taken as decided."""

from collections.abc import Iterator, Sequence

import numpy as np

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.inputs.input_limits import Radius, proves_gain, proves_radius
from lockstep.check.sampled.inputs.saturation import proves_clipped_radius
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled_claims import CheckedFile, sampled_network
from lockstep.check.system.network import ExactNetwork
from lockstep.check.verdict import Verdict


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
        holds = None if w is None else proves_radius(plain, w, limits, *kept)
        yield "limits", Verdict.of(f"{_starts(kept, states)}, {calm}", holds)
    if gain is not None:
        w, noisy = proofs.limits_gain, sampled_loop(at, held, weights.outputs)
        holds = None if w is None else proves_gain(noisy, w, limits, weights, gain)
        said = (
            f"under a disturbance of at most {gain:g} in L2, counted as [design] does, from agreement at rest"
        )
        yield "limits_gain", Verdict.of(f"{said}, {calm}", holds)
    if clipped:
        c = proofs.clipped
        holds = None if c is None else proves_clipped_radius(plain, c, limits, *clipped)
        said = f"{timely}the loop converges with its inputs clipped"
        yield "clipped", Verdict.of(f"{_starts(clipped, states)}, {said}", holds)


def _starts(radii: Sequence[Radius], states: Sequence[str]) -> str:
    sets = (f"|x_d(0)| <= {one:g}" if isinstance(one, float) else axes_text(one, states) for one in radii)
    return f"from {', or '.join(sets)}, controllers at rest"
