"""The proved bound of a nonlinearity: |phi(a, t) - phi(b, t)| <= alpha |a - b| on a box.

phi's SX graph is read as an exact expression, differentiated symbolically, and its slope enclosed by
interval arithmetic (outward-rounded doubles; elementary functions from python-flint's balls) in a branch
and bound search. A locally Lipschitz phi on a convex box has the constant sup |J| over the points where it
is differentiable.
"""

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.result import Bound, Entry, Witness
from lockstep.model.bound_search.entries import entries_hold, entry_bounds
from lockstep.model.bound_search.proof import BOXES, prove_bound, smallest_bound
from lockstep.model.bound_search.search import UNFINISHED, Progress

__all__ = [
    "BOXES",
    "EVERY_TIME",
    "UNFINISHED",
    "Bound",
    "Box",
    "Entry",
    "Progress",
    "Witness",
    "entries_hold",
    "entry_bounds",
    "prove_bound",
    "smallest_bound",
]
