"""The search for gains: starts, local search, and which of the results is kept. Nothing here is trusted.

units        the loop in units in which its numbers are near one, by powers of two
smoothed     a smooth stand-in for the H-infinity norm of the loop, as a function of the gains
start        random stable gains, taken down that norm; the climb of those that it does not help
polish       gains and certificate together, by a nonlinear program, as long as it pays
held         starts for a period that the fastest loop is too fast for
multistart   many starts, the promising ones pursued side by side over the cores
"""

from lockstep.lmi.search.local_search import Polished
from lockstep.lmi.search.multistart import SearchResult, search_gains
from lockstep.lmi.search.random_start import GainSearch, Score

__all__ = ["GainSearch", "Polished", "Score", "SearchResult", "search_gains"]
