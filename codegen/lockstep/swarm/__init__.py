"""The closed loop of thousands of agents on a sparse graph: compiled, on all cores, or in NumPy where no compiler is.

from lockstep.swarm import NeighbourLists, simulate_swarm, swarm_of_design
"""

from lockstep.swarm.loop import SwarmLoop, swarm_of_design
from lockstep.swarm.neighbours import NeighbourLists
from lockstep.swarm.run import SwarmRun, simulate_swarm

__all__ = ["NeighbourLists", "SwarmLoop", "SwarmRun", "simulate_swarm", "swarm_of_design"]
