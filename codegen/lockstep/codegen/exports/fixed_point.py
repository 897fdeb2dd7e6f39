"""`fixed/`: each agent's controller in integers, for cores without floating point, with a certificate of its own.

The integers are those nearest to the gains of the manifest beside its formats; what is claimed of them is the design's.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lockstep.check.c_source.fixed_point import row_of
from lockstep.check.c_source.reader import in_microseconds
from lockstep.check.errors import ProblemError
from lockstep.check.sampled.fixed_point import FixedController, integers_of
from lockstep.codegen.cost.bounds import by_core
from lockstep.codegen.emission.emit import plain
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import FORMAT, AgentEntry, Manifest


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return a header and a source for each agent.

    Raises:
        ProblemError: a folder whose design claims nothing of integers.
    """
    texts = {}
    for agent in manifest.agents:
        view = _view(agent, controller_of(agent, manifest), manifest)
        whole = {"format": FORMAT, "title": plain(manifest.title), "period": repr(manifest.period), "a": view}
        claims = manifest.fixed.claims if manifest.fixed else ()
        for end in ("h", "c"):
            name = f"exports/fixed.{end}.j2"
            text = render(name, **whole, claims=claims, in_microseconds=in_microseconds)
            texts[f"fixed/{agent.name}_fixed.{end}"] = text
    return texts


def controller_of(agent: AgentEntry, manifest: Manifest) -> FixedController:
    """Return the integers of an agent."""
    formats = manifest.fixed
    if formats is None:
        found = "the design claims nothing of integers"
        raise ProblemError(found, where="--fixed", expected="a certified one")
    place = [one.name for one in manifest.agents].index(agent.name)
    limits = np.array(agent.limits or [[-np.inf, np.inf]] * len(agent.inputs))
    own = formats.states[place], formats.outputs, formats.inputs
    return integers_of(agent.table(manifest.real_type), own, limits, agent.weights(manifest.real_type))


def _view(agent: AgentEntry, one: FixedController, manifest: Manifest) -> dict[str, Any]:
    nn = len(agent.neighbours)
    signals = [("x", f"state {k + 1}", "", e, "within 2^28") for k, e in enumerate(one.x)]
    signals += [
        (f"y[{k}]", s.name, s.unit, e, "16 bits")
        for k, (s, e) in enumerate(zip(agent.outputs, one.r, strict=True))
    ]
    signals += [
        (f"u[{k}]", s.name, s.unit, e, f"from {low} to {high}")
        for k, (s, e, (low, high)) in enumerate(zip(agent.inputs, one.u, one.sides, strict=True))
    ]
    return {
        "name": agent.name,
        "NAME": agent.name.upper(),
        "n": len(one.x),
        "q": len(one.r),
        "m": len(one.u),
        "nn": nn,
        "bits": 64 if nn > 32 else 32,
        "word": f"0x{int(manifest.identity.design[:8], 16) | 1:08x}u",
        "x": one.x,
        "r": one.r,
        "u": one.u,
        "rows": [row_of(agent.name, *row) for row in zip(one.a, one.h, one.d, one.g, strict=True)],
        "sides": one.sides,
        "instructions": by_core(agent.integer_instruction_budget or {}),
        "neighbours": [plain(each.source) for each in agent.neighbours],
        "formats": [
            {
                "signal": s,
                "name": plain(name),
                "unit": plain(unit),
                "exponent": e,
                "count": repr(2.0**-e),
                "range": text,
            }
            for s, name, unit, e, text in signals
        ],
    }
