"""The bound of a design file, proved again: alpha, with the scales D_w and D_v that its certificate was proved with."""

from lockstep.lmi.document import Stored
from lockstep.model.assembly import bound_of, bound_with_scales
from lockstep.model.bound_search import Bound


def reproved_bound(stored: Stored) -> Bound:
    """Return the file's alpha as a proved bound of its agent's nonlinearity, and its entries as proved bounds of slopes.

    With several independent components of phi the certificate is about G D_w and D_v^-1 H, and a file states the scales;
    none are stated where they are all one, or in a file of an earlier version: then they are found again.

    Raises:
        BoundNotProved: alpha or an entry is too small, or could not be proved, or an entry is missing.
        ProblemError: scales that do not fit phi.
    """
    agent = stored.problem.agent()
    if stored.claims.scales is None and not stored.claims.entries:
        return bound_of(agent, alpha=stored.claims.alpha)
    ones = (1.0,) * agent.lure.G.shape[1], (1.0,) * agent.lure.H.shape[0]
    return bound_with_scales(agent, stored.claims.alpha, stored.claims.scales or ones, stored.claims.entries)
