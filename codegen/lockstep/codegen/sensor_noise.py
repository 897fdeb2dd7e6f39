"""How far noise of the sensors of a design moves its inputs, in words: computed, not proved."""

from lockstep.codegen.limit_claims import MOST_STATES
from lockstep.codegen.sampled_design import sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.sensor_noise import noise_to_inputs


def noise_on_inputs(stored: Stored) -> str:
    """Return how far noise of each output moves each input, computed; nothing of loops that are not assembled."""
    problem, agent = stored.problem, stored.problem.agent()
    if problem.spectrum is not None or problem.sizes.N * (problem.sizes.n + problem.sizes.n_C) > MOST_STATES:
        return ""
    controllers = sampled_controllers(stored, problem.controller.period)
    found = noise_to_inputs(sampled_network(stored), controllers)
    if found is None:
        return ""
    names = [name for name, _ in problem.file.agent.outputs]
    per = [", ".join(f"{x:.3g} per {y}" for x, y in zip(row, names, strict=True)) for row in found]
    return "; ".join(f"{u}: {said}" for u, said in zip(agent.inputs, per, strict=True))
