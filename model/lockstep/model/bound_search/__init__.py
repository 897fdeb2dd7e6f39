"""The search for a bound of a nonlinearity: |phi(a, t) - phi(b, t)| <= alpha |a - b| on a box.

phi's SX graph is read as an exact expression. alpha, the scales of phi and the bounds of its single slopes are searched
for (samples, polishing, a branch and bound with the checker's enclosures); they are a proposal, which the checker decides
(`lockstep.check.bound.decide`). A locally Lipschitz phi on a convex box has the constant sup |J| over the points where
it is differentiable.
"""

from lockstep.check.bound.box import Box
from lockstep.check.bound.slope_bounds import Entry
from lockstep.model.bound_search.branch_and_bound import UNFINISHED, SearchState
from lockstep.model.bound_search.casadi_graph import read
from lockstep.model.bound_search.entries import slopes_of, with_entries
from lockstep.model.bound_search.proof import BOXES, confirmed_bound, prove_bound, search_bound
from lockstep.model.bound_search.result import Bound

__all__ = [
    "BOXES",
    "UNFINISHED",
    "Bound",
    "Box",
    "Entry",
    "SearchState",
    "confirmed_bound",
    "prove_bound",
    "read",
    "search_bound",
    "slopes_of",
    "with_entries",
]
