"""What the tables of a problem file demand of one another, beyond what each says alone."""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.problem.from_tables import build_graph
from lockstep.model.problem.tables.schema import AgentTable, DisturbancesTable, ProblemFile
from lockstep.model.problem.weights import scale_of_each


def check_tables(file: ProblemFile) -> None:
    """Refuse keys that contradict one another.

    Raises:
        ProblemError: the first such, with what would go together.
    """
    _check_objective(file)
    _check_method(file)
    _check_spectrum(file)
    _check_disturbance(file)


def input_sides(agent: AgentTable) -> Float[np.ndarray, "m 2"]:
    """Return the lowest and the highest value of each input, infinite where there is none."""
    known, where = agent.limits or {}, "[agent.limits]"
    for name, (low, high) in known.items():
        expected = f"one of {', '.join(f'`{one}`' for one in agent.inputs)}"
        demand(name in agent.inputs, f"`{name}` is no input", where, expected)
        rising = low is None or high is None or low < high
        demand(rising, f"[{low}, {high}]", f"{where} {name}", "a lower below an upper end")
        around = (low is None or low < 0) and (high is None or high > 0)
        remedy = f"count {name} from its value at rest: `{name}_0 + {name}` in [agent.dynamics], limits less {name}_0"
        demand(around, f"[{low}, {high}]", f"{where} {name}", "a range around 0", remedy)
    sides = np.array([known.get(name, (None, None)) for name in agent.inputs], dtype=float)
    return np.where(np.isnan(sides), [-np.inf, np.inf], sides)


def output_ranges(agent: AgentTable) -> dict[str, tuple[float | None, float | None]]:
    """Return lowest and highest plausible value by output, where one is given."""
    given, where = agent.output_range or {}, "[agent.output_range]"
    outputs = [name for name, _ in agent.outputs]
    for name, (low, high) in given.items():
        if name not in outputs:
            names = ", ".join(f"`{one}`" for one in outputs)
            raise ProblemError(f"`{name}` is no output", where=where, expected=f"one of {names}")
        expected = "a lower below an upper end"
        demand(low is None or high is None or low < high, f"[{low}, {high}]", f"{where} {name}", expected)
    return dict(given)


def _check_objective(file: ProblemFile) -> None:
    design = file.design
    found = "the key `rho` is missing"
    expected = 'the rho to keep while alpha grows, for objective = "alpha"'
    demand(design.objective != "alpha" or design.rho is not None, found, "[design]", expected)
    found = f"`rho` is {design.rho}, but rho is what is minimised"
    expected = 'no `rho`, or objective = "alpha", "decay" or "initial_set"'
    demand(design.objective != "rho" or design.rho is None, found, "[design] rho", expected)
    found, where = f'`method` is "{design.method}"', "[design] objective"
    expected = 'method = "certified", the one that looks for more than rho'
    more = design.objective in ("decay", "initial_set")
    demand(not more or design.method == "certified", found, where, expected)
    if design.objective == "initial_set":
        found = "no agent leads alone" if file.agent.domain else "there is no [agent.domain] to stay in"
        expected = "initial states from which all stay in [agent.domain], behind a single leader"
        remedy = 'topology = "leader_path" has one; without a domain every certificate is global'
        led = file.agent.domain and len(build_graph(file.network).roots) == 1
        demand(led, found, where, expected, remedy)
        scales, where = (design.disturbances or DisturbancesTable()).states, "[design.disturbances] states"
        least = scale_of_each(scales, file.agent.states, where=where, per="state").min(initial=1.0)
        found = f'a scale of {least:g}, and objective = "initial_set": rho is then no gain from all that moves the states'
        remedy = 'name each state with 1 or more, leave `states` out, or take another objective ("rho")'
        demand(least >= 1.0, found, where, "a scale of 1 or more for every state", remedy)


def _check_spectrum(file: ProblemFile) -> None:
    network, where = file.network, "[network] spectrum"
    if network.spectrum is None:
        demand(network.max_degree is None, "`max_degree` is given", "[network]", "it with `spectrum` only")
        return
    expected = '[design] method = "modal": the same gains for all agents of every graph'
    demand(file.design.method == "modal", f'`method` is "{file.design.method}"', where, expected)
    demand(network.parameters is None, "`parameters` are given", where, "agents that are all alike")
    expected = "one graph, such as `edges`: what is proved of messages that are lost or late is of one"
    demand(network.messages is None, "`messages` is given", where, expected)


def _check_method(file: ProblemFile) -> None:
    given = file.design.method == "given"
    found = 'there are no gains, but `method` is "given"'
    expected = "one [[design.gains]] table per agent, with A, B, C, D"
    demand(not given or file.design.gains is not None, found, "[design]", expected)
    found = f'there are gains, but `method` is "{file.design.method}"'
    demand(given or file.design.gains is None, found, "[[design.gains]]", 'method = "given", or no gains')


def _check_disturbance(file: ProblemFile) -> None:
    table = file.simulation.disturbance
    found = f'`intensity` is given, but `kind` is "{table.kind}"'
    expected = 'kind = "noise"'
    demand(table.intensity is None or table.kind == "noise", found, "[simulation.disturbance]", expected)
