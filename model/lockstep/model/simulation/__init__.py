"""The nonlinear closed loop in time: `simulate(network, controllers, scenario)` gives a `Trajectory`."""

from lockstep.model.simulation.disturbance import Quiet, Samples, Sines, Steps, Sum, noise
from lockstep.model.simulation.divergence import Diverged
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.perturbation import HeldPerturbation, PaperPerturbation, random_perturbation
from lockstep.model.simulation.results.indices import Indices, effort_indices, indices
from lockstep.model.simulation.results.trajectory import Energies, RhoWeights, Trajectory, energies, l2_gain
from lockstep.model.simulation.run import simulate
from lockstep.model.simulation.sampled_controllers import SampledControllers, exact_controllers
from lockstep.model.simulation.scenario import Scenario

__all__ = [
    "Diverged",
    "Energies",
    "HeldPerturbation",
    "Indices",
    "MessageChannel",
    "PaperPerturbation",
    "Quiet",
    "RhoWeights",
    "SampledControllers",
    "Samples",
    "Scenario",
    "Sines",
    "Steps",
    "Sum",
    "Trajectory",
    "effort_indices",
    "energies",
    "exact_controllers",
    "indices",
    "l2_gain",
    "noise",
    "random_perturbation",
    "simulate",
]
