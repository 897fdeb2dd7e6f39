"""`pil/`, processor in the loop: test vectors and a runner in plain C for any board and any compiler.

The runner prints what the C computes, bits in hexadecimal; `lockstep verify DIR --from LOG` reads that and compares.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.vectors import vectors
from lockstep.codegen.exports.view import agent_view
from lockstep.codegen.manifest import AgentEntry, Manifest, sha256

LOG_FORMAT = "lockstep-pil/1"


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return the runner with the vectors of every agent."""
    return runner(manifest, {agent.name: vectors(agent, manifest) for agent in manifest.agents})


def runner(manifest: Manifest, calls: Mapping[str, Calls]) -> dict[str, str]:
    """Return the runner's files for given calls of each agent that is to run.

    Args:
        manifest: of the folder whose C is run.
        calls: by the agent's name.
    """
    views = [_view(agent, manifest, calls[agent.name]) for agent in manifest.agents if agent.name in calls]
    shared = {
        f"pil/{name}": render(f"exports/{name}.j2", agents=views)
        for name in ("README.md", "pil.h", "pil.c", "pil_run.c", "pil_semihosting.c", "pil_stdio.c")
    }
    head = f"{LOG_FORMAT} {identity(manifest)}"
    return shared | {
        f"pil/{view['name']}_pil.c": render("exports/pil_agent.c.j2", a=view, head=head) for view in views
    }


def identity(manifest: Manifest) -> str:
    """Return what a log says it is of: 16 digits of the SHA-256 of all headers and sources, by their hashes."""
    product = [
        f"{path} {digest}" for path, digest in manifest.files.items() if path.startswith(("include/", "src/"))
    ]
    return sha256("\n".join(sorted(product)))[:16]


def _view(agent: AgentEntry, manifest: Manifest, calls: Calls) -> dict[str, Any]:
    q, nn, width = len(agent.outputs), len(agent.neighbours), manifest.real_type.bytes
    S = len(calls)
    values = np.concatenate([calls.y, calls.neighbour_y.reshape(S, nn * q), calls.r], axis=1)
    bits = np.ascontiguousarray(values).view(f"u{width}")
    suffix = "u" if width == 4 else "ull"
    return agent_view(agent, manifest) | {
        "bits": 8 * width,
        "operation": calls.operation.tolist(),
        "received": [f"0x{mask:x}{'ull' if nn > 32 else 'u'}" for mask in calls.received.tolist()],
        "values": [", ".join(f"0x{word:0{2 * width}x}{suffix}" for word in row) for row in bits.tolist()],
    }
