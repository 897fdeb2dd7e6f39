"""One image under test: its nodes beside its controllers, with lists that change from step to step.

`with_nodes` puts an entry for each controller that a node may run behind the agents of a manifest; `verify` then feeds it as
it feeds them. Every fifth step hears another number of neighbours, one more than a list holds among them, and now and then a
slot is forgotten: `count_at` and `forgets_at` are in the harness too.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.codegen.manifest import AgentEntry, Manifest, NeighbourEntry
from lockstep.verification.reference import Reference

TOO_MANY = 5
_SEED = 20_260_102
_FORGET = 97


class NodeEntry(AgentEntry):
    """A node that runs a controller: its list holds as many neighbours as there are, with weights made up here.

    unit: the header and source;  number: of the node, None where there is one controller for all.
    """

    unit: str
    number: int | None = None


def unit_of(agent: AgentEntry) -> str:
    """Return the header and source that an agent's C is in."""
    return agent.unit if isinstance(agent, NodeEntry) else agent.name


def with_nodes(manifest: Manifest) -> Manifest:
    """Return the manifest with the nodes of one image among its agents; any other as it is."""
    image = manifest.image
    if image is None:
        return manifest
    real = manifest.real_type
    drawn = np.random.default_rng(_SEED).uniform(0.1, 3.0, image.max_neighbours).astype(real.dtype)
    heard = tuple(
        NeighbourEntry(source=f"peer{j}", weight=float(real.decimal(a))) for j, a in enumerate(drawn)
    )
    alone = len(manifest.agents) == 1
    nodes = tuple(
        NodeEntry(
            **{name: getattr(one, name) for name in AgentEntry.model_fields}
            | {
                "name": image.name if alone else f"{image.name}_{k}",
                "neighbours": heard,
                "state_bytes": image.state_bytes,
                "stack_budget_bytes": {},
                "flash_budget_bytes": {},
                "instruction_budget": {},
                "plant": None,
            },
            unit=image.name,
            number=None if alone else k,
        )
        for k, one in enumerate(manifest.agents)
    )
    agents = tuple(one.model_copy(update={"plant": None}) for one in manifest.agents)
    return manifest.model_copy(update={"agents": (*agents, *nodes)})


def without_nodes(manifest: Manifest) -> Manifest:
    """Return the manifest with its agents alone: what the runner of `pil` knows."""
    agents = tuple(one for one in manifest.agents if not isinstance(one, NodeEntry))
    return manifest.model_copy(update={"agents": agents})


def node_layout(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    """What the harness needs to know besides: where the controller's state is, and the list."""
    if not isinstance(agent, NodeEntry):
        return {"unit": agent.name, "UNIT": agent.name.upper(), "at": "", "listed": "", "number": ""}
    core = manifest.agents[agent.number or 0].name
    return {
        "unit": agent.unit,
        "UNIT": agent.unit.upper(),
        "at": "controller." if agent.number is None else f"controller.{core}.",
        "listed": ", &list",
        "number": "" if agent.number is None else f", {agent.number}u",
        "weights": [manifest.real_type.literal(a) for a in agent.weights(manifest.real_type)],
        "forget": _FORGET,
    }


def count_at(step: int, most: int) -> int:
    """Return how many neighbours the list of a step has: all, and each fifth time 0, 1, ... up to one too many."""
    return step // 5 % (most + 2) if step % 5 == 4 else most


def forgets_at(step: int) -> bool:
    """Tell whether slot `step` modulo their number is forgotten before a step."""
    return step % _FORGET == _FORGET - 1


class NodeReference(Reference):
    """The reference of a node: that of an agent with the neighbours that a step's list names."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._all, self._steps = self.weights, 0

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take one step with the list of this one."""
        most, step = len(self._all), self._steps
        count = count_at(step, most)
        self._steps += 1
        if forgets_at(step):
            slot, state = step % most, self.state
            state.heard[slot], state.age[slot], state.misses[slot] = False, 0, 0
            state.held[slot] = 0
        if count > most:
            return TOO_MANY, self.state.u.copy()
        self.weights = self._all[:count]
        found = super().step(y, neighbour_y[:count], received)
        self.weights = self._all
        return found


def reference_of(agent: AgentEntry, manifest: Manifest) -> Reference:
    """Return the reference of an agent or of a node."""
    kind = NodeReference if isinstance(agent, NodeEntry) else Reference
    return kind.of(agent, manifest)
