"""[network] offsets: the agents are to agree but for an offset each, in formation."""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.agent import ExactAgent
from lockstep.check.system.formation import WHERE, check_formation
from lockstep.model.problem.tables.schema import ProblemFile


def formation_of(file: ProblemFile, agent: ExactAgent, N: int) -> Float[np.ndarray, "N n"] | None:
    """Return o_i of each of N agents; None where the file has none.

    Raises:
        ProblemError: another number of them, one that an agent's equation sees, or what goes with them in no way.
    """
    given, states = file.network.offsets, file.agent.states
    if given is None:
        return None
    expected = "none with `spectrum`, which names no agents"
    demand(file.network.spectrum is None, "offsets are given", WHERE, expected)
    if len(given) != N or any(len(row) != len(states) for row in given):
        lengths = ", ".join(sorted({str(len(row)) for row in given}))
        found = f"{len(given)} rows of {lengths} numbers" if given else "no rows"
        raise ProblemError(
            found, where=WHERE, expected=f"{N} rows, one per agent, of {len(states)}, one per state"
        )
    offsets = np.array(given, dtype=float)
    check_formation(agent, offsets)
    for name, column in zip(states, offsets.T, strict=True):
        if name in file.agent.domain and column.any():
            raise ProblemError(
                f"agents are set apart in `{name}`, which has a domain",
                where=WHERE,
                expected="a domain on states without offsets: what is proved there is of states less their offsets",
            )
    if file.agent.output_range and offsets.any():
        raise ProblemError(
            "`output_range` beside offsets",
            where="[agent.output_range]",
            expected="one or the other: messages are of outputs less their offsets",
        )
    return offsets
