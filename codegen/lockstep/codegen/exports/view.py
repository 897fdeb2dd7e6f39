"""What the exports' templates need to know of a folder, from its manifest."""

from typing import Any

from lockstep.codegen.emission.emit import plain
from lockstep.codegen.manifest import AgentEntry, Manifest


def folder_view(manifest: Manifest) -> dict[str, Any]:
    """Return the folder's name, title and period, and a view of each agent."""
    return {
        "name": manifest.name,
        "title": plain(manifest.title),
        "period": repr(manifest.period),
        "agents": [agent_view(agent, manifest) for agent in manifest.agents],
    }


def agent_view(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    """Return an agent's sizes under the names of the C's own templates."""
    nn = len(agent.neighbours)
    return {
        "name": agent.name,
        "NAME": agent.name.upper(),
        "order": agent.order,
        "q": len(agent.outputs),
        "m": len(agent.inputs),
        "nn": nn,
        "mask_bits": 64 if nn > 32 else 32,
        "all_received": 2**nn - 1,
        "sources": ", ".join(plain(one.source) for one in agent.neighbours),
        "state_bytes": agent.state_bytes,
        "limits": agent.limits is not None,
        "c_real": manifest.real_type.c_name,
        "real": manifest.real,
    }
