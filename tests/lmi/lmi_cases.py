"""The networks these tests share: the paper's arms (38), (39) with the gains of Table 1, and small ones of our own."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from amini.claims.example import arm
from cart import cart
from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Gains
from lockstep.lmi.design import design
from lockstep.lmi.document import Stored, design_file_of, parse
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.specification.defaults import specifications
from lockstep.model.assembly import network_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem, parse_problem

EXAMPLES = Path(__file__).parents[2] / "examples"
ALPHA = 3.33
"""m g l over the inertia of the link, (38): the incremental bound of 3.33 sin."""

# Table 1 of the paper; C_C of Corollary 1 is printed times 10^-3.
TABLE_1: dict[str, dict[str, list[Any]]] = {
    "theorem_1": {
        "A": [
            [[-1.1021, 0.0447], [0.0453, -1.0901]],
            [[-1.0819, 0.0649], [0.0645, -1.0628]],
            [[-1.121, 0.019], [0.019, -1.122]],
        ],
        "B": [
            [[0.1262, 0.4236], [-1.1873, -1.1258]],
            [[-0.2333, -0.1823], [0.3441, 0.4822]],
            [[-0.0115, -0.01522], [-0.0069, -0.0027]],
        ],
        "C": [[[-0.0163, 0.1477]], [[0.0364, -0.0339]], [[0.0011, 0.0007]]],
        "D": [[[-0.4987, -0.5512]], [[-0.4951, -0.5681]], [[0.009, 0.011]]],
    },
    "corollary_1": {
        "A": [
            [[-1.818, -0.0097], [-0.0099, -1.859]],
            [[-1.8164, -0.0087], [-0.0087, -1.8167]],
            [[-1.8184, -0.0103], [-0.0104, -1.8174]],
        ],
        "B": [
            [[-0.0066, -0.0078], [-0.0082, -0.0088]],
            [[-0.0066, -0.0089], [-0.0069, -0.0038]],
            [[0.0012, 0.0044], [0.0015, 0.0059]],
        ],
        "C": [[[0.000508, 0.000639]], [[0.000627, 0.000641]], [[0.000415, 0.000371]]],
        "D": [[[-0.739, -0.823]], [[-0.741, -0.853]], [[0.003, 0.009]]],
    },
}


def published(which: str = "corollary_1") -> Gains:
    """Return the gains of Table 1."""
    return Gains(*(tuple(np.array(block) for block in TABLE_1[which][letter]) for letter in "ABCD"))


def arms(**options: Any) -> Network:
    """Return three of them on the cycle (39)."""
    return Network(arm(), Graph.topology("cycle", 3), **options)


def claim(
    network: Network, order: int, alpha: float, *, Q: float = 2.0, delta: Sequence[float] = (0.0,) * 4
) -> Claim:
    """Return a claim with R = I, Q = 2 I as in Section 4 of the paper."""
    return Claim(
        alpha,
        np.eye(network.agent.n),
        Q * np.eye(order),
        np.tile(np.array(delta, dtype=float), (network.N, 1)),
    )


def table_1_problem() -> Problem:
    """Return the committed example with the gains of Corollary 1."""
    return parse_problem((EXAMPLES / "table_1.toml").read_text(encoding="utf-8"))


def problem(
    *,
    dynamics: dict[str, str],
    outputs: dict[str, str],
    inputs: Sequence[str] = ("u",),
    network: str = 'agents = 3\ntopology = "path"',
    design: str = "order = 1",
    agent: str = "",
) -> Problem:
    """Return a problem from the parts that differ."""
    text = [
        "[agent]",
        f"states = {json.dumps(list(dynamics))}",
        f"inputs = {json.dumps(list(inputs))}",
        agent,
        "[agent.dynamics]",
        *[f"{state} = {json.dumps(formula)}" for state, formula in dynamics.items()],
        "[agent.outputs]",
        *[f"{name} = {json.dumps(formula)}" for name, formula in outputs.items()],
        "[network]",
        network,
        "[design]",
        design,
    ]
    return parse_problem("\n".join(text))


DOUBLE_INTEGRATOR = {"p": "v", "v": "u"}
"""x'' = u."""


CARTS = (
    cart("f - 0.3*sin(p)")
    + """
[network]
agents = 4
topology = "path"
[design]
method = "modal"
order = 0
gain_limit = 50.0
starts = 1
"""
)


def carts(**changes: str) -> str:
    """The carts' file with values of keys replaced, each key at its first line."""
    lines = CARTS.splitlines()
    for key, value in changes.items():
        index = next(i for i, line in enumerate(lines) if line.startswith(f"{key} = "))
        lines[index] = f"{key} = {value}"
    return "\n".join(lines)


PATH_2 = 'agents = 2\ntopology = "path"'


def first_wishes(posed: Problem) -> dict[str, Any]:
    """Return [design] with the defaults that are tried first."""
    bound = proved_bound(posed)
    first, *_ = specifications(posed, network_of(posed, bound), claim_of(posed, bound))
    return first.problem.document()["design"]


def stored(posed: Problem) -> Stored:
    """Return the design of a problem as its file holds it."""
    return parse(json.loads(json.dumps(design_file_of(design(posed, jobs=1)).document())), "memory")
