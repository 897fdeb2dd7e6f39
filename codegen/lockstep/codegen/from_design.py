"""From a design file to the specification of the C: controllers, Laplacian rows, and the datasheet's figures."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant, Neighbour, Optimize, Signal
from lockstep.lmi.certify import Verdict
from lockstep.lmi.document import Stored

CONTINUOUS_ONLY = (
    "the continuous controller in real arithmetic; the sampled, rounded one of this folder is not covered yet"
)


def specification(
    stored: Stored, verdict: Verdict, *, content: Mapping[str, Any], optimize: Optimize = "speed"
) -> CodegenSpec:
    """Return what to generate for a stored design.

    Args:
        stored: the design.
        verdict: what the checker says of it just now; what the file says of itself does not count.
        content: the design file as JSON types, for its hash.
        optimize: "speed" or "size".
    """
    problem, agent = stored.problem, stored.problem.agent()
    graph, lure, x0 = problem.graph(), agent.lure, problem.initial_states()
    names = [f"{agent.name}{i}" for i in range(1, graph.N + 1)]
    units = agent.units
    sources: list[list[Neighbour]] = [[] for _ in names]
    for listener, source, weight in graph.edges:
        sources[listener - 1].append(Neighbour(names[source - 1], weight))
    signals = {
        "outputs": tuple(Signal(name, units.get(name, "")) for name in agent.outputs),
        "inputs": tuple(Signal(name, units.get(name, "")) for name in agent.inputs),
    }
    gains = stored.gains
    controllers = tuple(
        Controller(name, gains.A[i], gains.B[i], gains.C[i], gains.D[i], tuple(sources[i]), **signals)
        for i, name in enumerate(names)
    )
    plants = tuple(
        LinearPlant(lure.A, B, lure.C, np.asarray(x0[i])) for i, B in enumerate(problem.agents_B())
    )
    table = problem.controller
    return CodegenSpec(
        agents=controllers,
        period=table.period,
        discretization=table.discretization,
        real=table.real,
        optimize=optimize,
        name=f"{agent.name}_controllers",
        title=problem.title,
        certificate=_datasheet(stored, verdict),
        design_hash=fingerprint(content),
        plants=plants,
    )


def fingerprint(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a design file's content, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _datasheet(stored: Stored, verdict: Verdict) -> dict[str, str | float | bool | None]:
    if not verdict.certified or stored.certificate is None:
        return {"certified": False}
    delta = {f"delta_{letter}": value for letter, value in stored.fragility.items() if value}
    return {
        "certified": True,
        "proof": "exact",
        "covers": CONTINUOUS_ONLY,
        "scope": verdict.scope,
        "rho": stored.certificate.rho,
        "alpha": stored.alpha,
        **delta,
    }
