"""The search for gains: starts, local search, and which of the results is kept. Nothing here is trusted.

unit_scaling    the loop in units in which its numbers are near one, by powers of two
stabilise       gains that make the linear loop stable
smoothed_norm   a smooth stand-in for the H-infinity norm of the loop, as a function of the gains
random_start    random stable gains, taken down that norm; the climb of those that it does not help
common_gains    starts with the same gains for all agents, from a few modes of the graph
local_search    gains and certificate together, by a nonlinear program (`barrier`, `logdet`), as long as it pays
hold_delay      starts for a period that the fastest loop is too fast for
fastest_decay, initial_set   the two other objectives
multistart      many starts, the promising ones pursued side by side over the cores
stopping, search_time        when it ends early, and how long it is likely to take
"""

from lockstep.lmi.search.local_search import Polished
from lockstep.lmi.search.multistart import SearchResult, search_gains
from lockstep.lmi.search.random_start import GainSearch, Score

__all__ = ["GainSearch", "Polished", "Score", "SearchResult", "search_gains"]
