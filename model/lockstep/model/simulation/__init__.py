"""The nonlinear closed loop in time: `simulate(network, controllers, scenario)` gives a `Trajectory`."""

from lockstep.model.simulation.disturbance import noise
from lockstep.model.simulation.divergence import Diverged
from lockstep.model.simulation.results.indices import effort_indices, indices
from lockstep.model.simulation.results.trajectory import RhoWeights, Trajectory, energies
from lockstep.model.simulation.run import simulate
from lockstep.model.simulation.sampled_controllers import SampledControllers
from lockstep.model.simulation.scenario import Scenario

__all__ = [
    "Diverged",
    "RhoWeights",
    "SampledControllers",
    "Scenario",
    "Trajectory",
    "effort_indices",
    "energies",
    "indices",
    "noise",
    "simulate",
]
