"""The nodes of a folder on a target against their reference."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lockstep.codegen.exports import exports_of
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.comparison import compare
from lockstep.verification.messages.events import Events, NodeTrace, faulty_events, run_node
from lockstep.verification.targets import Target

PERIODS_PER_STEP = 0.1
"""Periods of the network for each adversarial call that is asked for: an event or two each."""


@dataclass(frozen=True)
class NodeResult:
    """One agent with its messages on one target: of `events` calls, whether every bit is equal, and the RAM of a node."""

    agent: str
    bitwise: bool
    events: int
    differing_calls: int
    first_difference: str
    ram_bytes: int


def compare_nodes(
    target: Target, manifest: Manifest, folder: Path, directory: Path, *, adversarial: int
) -> tuple[NodeResult, ...]:
    """Run the nodes of a folder that has some, where the target can; raises `ClaimError` as its runner does.

    adversarial: calls that the comparison of the controllers is asked for.
    """
    if target.nodes is None or "messages" not in exports_of(manifest):
        return ()
    periods = max(50, int(adversarial * PERIODS_PER_STEP))
    expected = _expected(manifest.text(), periods)
    place = directory / "nodes"
    place.mkdir()
    events = {agent.name: given for agent, given, _ in expected}
    results = []
    for agent, found, size in target.nodes(manifest, folder, events, place):
        trace = next(one for other, _, one in expected if other.name == agent.name)
        difference = compare(found, trace)
        calls = len(events[agent.name])
        results.append(
            NodeResult(agent.name, difference.bitwise, calls, difference.calls, difference.first, size)
        )
    return tuple(results)


@lru_cache(maxsize=1)
def _expected(text: str, periods: int) -> tuple[tuple[AgentEntry, Events, NodeTrace], ...]:
    """Return each agent's events and the reference's trace, once for all targets of a folder."""
    manifest = Manifest.model_validate_json(text)
    made = []
    for agent in manifest.agents:
        events = faulty_events(manifest, agent, periods)
        made.append((agent, events, run_node(agent, manifest, events)))
    return tuple(made)
