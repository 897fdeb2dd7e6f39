"""What each key of a problem file is, and its unit: shown by editors that read the JSON Schema.

By table as in `lockstep.model.problem.tables.schema`; the unit is empty where there is none.
docs/problem.md says the same at length.
"""

from collections.abc import Mapping

MEANINGS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "ProblemFile": {
        "title": ("A title for people: reports and headers show it", ""),
        "agent": ("What each of the agents obeys", ""),
        "network": ("How many agents there are, and who listens to whom", ""),
        "design": ("What is asked of the controllers", ""),
        "controller": ("How the controllers run on the target", ""),
        "simulation": ("The run that is shown; no design depends on it", ""),
    },
    "AgentTable": {
        "name": ("Prefix of the generated files, types and functions", ""),
        "states": ("Names of the states x; all names are C identifiers", ""),
        "inputs": ("Names of the inputs u, which enter the equations linearly", ""),
        "parameters": (
            "Numbers by name, for the formulas; their units are yours, see `units`",
            "as in `units`",
        ),
        "dynamics": (
            "d/dt of each state: + - * / **, sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt abs fabs min max"
            " sign if_else(condition, a, b), t, pi; angles in radians",
            "unit of the state per second",
        ),
        "outputs": (
            "What is measured and sent, linear in the states; their order is that of y",
            "as in `units`",
        ),
        "limits": (
            "Limits of the actuators, at which the C clips: from how large a disagreement none is met is then proved",
            "unit of the input",
        ),
        "output_range": (
            "Plausible values: a message with another is refused and counted",
            "unit of the output",
        ),
        "domain": (
            "Box of states on which the bound of the nonlinearity is proved; absent: everywhere",
            "unit of the state",
        ),
        "units": ("Units as pint reads them, for figures, headers and `lockstep check --all`", ""),
        "split": (
            "Where A and B come from: the linear terms of the formulas, or the slope at the origin",
            "",
        ),
        "centre": (
            "Move the middle of the nonlinearity's slopes into A where that makes their bound smaller",
            "",
        ),
    },
    "NetworkTable": {
        "agents": ("How many agents there are; not needed with `laplacian`", "agents"),
        "edges": ("Who listens to whom: the listener comes first; agents count from 1", ""),
        "laplacian": (
            "L row by row: the sum of what agent i listens with on the diagonal, -weight elsewhere",
            "",
        ),
        "leader": (
            "Where a single leader stays, for a local certificate; absent: the middle half of the domain",
            "",
        ),
        "topology": (
            "cycle: each listens to the next; ring: both neighbours on a circle; path: both on a line; complete: all; star:"
            " all to agent 1; leader_path: each to the one before",
            "",
        ),
        "parameters": ("What differs between agents: parameters that multiply inputs only", "as in `units`"),
        "file": ("The graph, in a file of its own", ""),
        "spectrum": (
            "In place of a graph: all undirected ones with their nonzero Laplacian eigenvalues there",
            "",
        ),
        "max_degree": (
            "With `spectrum`: the most neighbours that an agent has; roundings are counted for so many",
            "agents",
        ),
        "offsets": (
            "A formation: of each agent the offset of its states, in their order; the states less it are to agree",
            "unit of each state",
        ),
        "messages": ("What the network may do to messages; part of what is proved", ""),
    },
    "MessagesTable": {
        "loss": ("The largest probability that a message is lost, for each link and period, independent", ""),
        "burst": ("The most messages of a link lost in a row, in any pattern", "periods"),
        "delay": ("The least and the most that a message is late, varying within it", "periods"),
        "jitter": ("The part of the period by which a reading may be early", "periods"),
    },
    "WeightsTable": {
        "state": (
            "R: what the disagreement of the states weighs in rho",
            "rho^2 per unit of the states squared",
        ),
        "controller": ("Q: what the states of the controllers weigh in rho", ""),
        "input": ("W: what the inputs weigh in rho: small gains, at the price of a larger rho", ""),
    },
    "DisturbancesTable": {
        "states": ("Scale of the disturbance of each state", "unit of the state per second"),
        "outputs": ("Scale of the noise of each output", "unit of the output"),
    },
    "GainUnitsTable": {
        "time": ("The time in which A and B of a controller are counted", "s"),
        "inputs": ("How much of each input counts as one", "unit of the input"),
        "outputs": ("How much of each output counts as one", "unit of the output"),
    },
    "FragilityTable": {
        letter: (f"By how much {letter} of each continuous controller may be off, as a spectral norm", "")
        for letter in "ABCD"
    },
    "GainsTable": {
        "A": ("A of x_C' = A x_C + B r", "1/s"),
        "B": ("B of x_C' = A x_C + B r", ""),
        "C": ("C of u = C x_C + D r", ""),
        "D": ("D of u = C x_C + D r", "unit of the input per unit of the output"),
    },
    "DesignTable": {
        "method": (
            "certified: searched for; modal: one controller for a symmetric graph of any size; given: [[design.gains]] as"
            " they are; lipschitz, theorem1, corollary1: of the literature",
            "",
        ),
        "order": (
            "States of each controller; 0 is a static gain; absent: 0 where it will do, else 2 or more",
            "states",
        ),
        "weights": ("What rho weighs", ""),
        "disturbances": ("What rho is a gain from; absent: 1 on every state, no noise", ""),
        "decay": ("Every disagreement is to shrink at least as exp(-decay t), proved", "1/s"),
        "search_decay": ("A decay that the search keeps to beside rho, and nobody is promised", "1/s"),
        "stable_controllers": ("Whether each controller is to be stable by itself, proved", ""),
        "gain_limit": ("The largest spectral norm of [A B; C D] of each controller", ""),
        "gain_units": ("The units in which `gain_limit` is meant; absent: those of the file, s", ""),
        "fragility": ("By how much gains may be off", ""),
        "alpha": (
            "The slope of the nonlinearity to design for; absent: the smallest one proved",
            "as phi(H x) is written",
        ),
        "objective": (
            "Minimise rho, raise alpha with `rho` given, raise the decay, or enlarge the initial set",
            "",
        ),
        "rho": ("The rho to keep while alpha is raised", "s"),
        "coordinates": ("Of the disagreement; laplacian_rows are the paper's", ""),
        "for_period": ("Design for the sampled controllers at once", ""),
        "starts": (
            "Starts that are pursued to the end: more take longer and may find a smaller rho",
            "starts",
        ),
        "seed": ("Where the starts are drawn from", ""),
        "gains": ("With method given: the controllers", ""),
    },
    "ControllerTable": {
        "period": ("How often each controller reads, computes and writes", "s"),
        "discretization": ("How the continuous controllers become sampled ones", ""),
        "real": ("What the C computes in", ""),
        "delay": ("From reading to writing", "periods"),
    },
    "DisturbanceTable": {
        "kind": ("What disturbs the run", ""),
        "amplitude": ("How strongly", "unit of each state per second"),
        "agents": ("Which agents are disturbed", ""),
        "frequency": ("Of a sine", "Hz"),
        "start": ("When it begins", "s"),
        "stop": ("When it ends", "s"),
        "intensity": ("Of noise, in place of `amplitude`", "amplitude squared times s"),
    },
    "PerturbationTable": {
        "kind": ("How the gains of continuous controllers are off in the run", ""),
        "interval": ("How often random errors are drawn anew", "s"),
    },
    "ChannelTable": {
        "noise": (
            "Standard deviation of the noise of an output at each reading of the run",
            "unit of the output",
        ),
        "delay": ("How late messages are in the run", "periods"),
        "drop": ("Probability that a message is lost in the run", ""),
        "bits": ("How finely messages are quantised", "bits"),
        "full_scale": ("The largest output the converter gives", "unit of the outputs"),
    },
    "SimulationTable": {
        "initial": (
            "Initial states, one list per agent in the order of `states`; angles in radians",
            "unit of each state",
        ),
        "spread": (
            "Random initial states are within plus and minus this, and half-way to the sides of a domain",
            "unit of each state",
        ),
        "horizon": ("How long the run is", "s"),
        "seed": ("Of all that is random in the run", ""),
        "disturbance": ("What disturbs the run", ""),
        "perturbation": ("How the gains of continuous controllers are off in the run", ""),
        "channel": ("What happens to messages in the run", ""),
        "reference": (
            "Inputs of a single leader's own: the others are to follow it; proved of it is what is proved of a disturbance",
            "as in `units`",
        ),
    },
}


def described(table: str, key: str, expected: str) -> str:
    """Return what an editor shows of a key: what it is, its unit, what may be written.

    >>> described("ControllerTable", "period", "a number of seconds above 0")
    'How often each controller reads, computes and writes. Unit: s. Expected: a number of seconds above 0'
    """
    meaning, unit = MEANINGS.get(table, {}).get(key, ("", ""))
    parts = (meaning, f"Unit: {unit}" if unit else "", f"Expected: {expected}" if expected else "")
    return ". ".join(filter(None, parts))
