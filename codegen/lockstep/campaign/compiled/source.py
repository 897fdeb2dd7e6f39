"""The closed loop of a network and its controllers as C, for many runs at a time.

    x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t) + xi_i,        (2)

with u held between the steps of the C that ships, or of the continuous controllers (9) with Delta of (11). What the
certificate speaks of is integrated along: |z|^2 = x_d' (S (x) R) x_d + x_C' (I (x) Q) x_C and |xi_d|^2.
The sampled certificate counts the controllers' states at the sampling instants, held for a period; so does this.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from lockstep.campaign.compiled.c_text import CFiles
from lockstep.campaign.compiled.functions import (
    continuous_functions,
    cost_expression,
    monitors,
    sampled_functions,
)
from lockstep.campaign.compiled.lanes import lanes_header
from lockstep.campaign.compiled.layout import Features, Layout
from lockstep.campaign.compiled.statements import LaneFunction
from lockstep.check.continuous.inequality import LETTERS, Performance
from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.loop import Gains
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.model.network import Network
from lockstep.model.simulation.divergence import beyond

DIVERGED = 1e-3
"""A disagreement above this part of what a state is `beyond` counts as divergence even while it is finite."""


@dataclass(frozen=True)
class CampaignSource(CFiles):
    """C files by name and the layout of its rows: all that a worker elsewhere needs."""

    layout: Layout


def continuous_source(
    network: Network,
    gains: Gains,
    weights: Performance,
    *,
    period: float,
    step: float,
    fragility: Mapping[str, float] | None = None,
    features: Features | None = None,
) -> CampaignSource:
    """Return the C of the loop with the continuous controllers (9).

    Args:
        network: the agents on their graph.
        gains: of the controllers.
        weights: what rho of the certificate is a gain to and from.
        period: for which noise and given sequences are held, in s.
        step: the longest step of the integration, in s: as many equal steps as are needed make a period.
        fragility: delta of (11) by letter; where it is above 0 a Delta can be given.
        features: what the runs need; by default all that applies.

    Raises:
        ProblemError: a period or step that is not above 0; message drops, which only sampled controllers have.
    """
    letters = [letter for letter in LETTERS if (fragility or {}).get(letter, 0.0) > 0]
    features = features or Features(True, True, True, False, bool(letters))
    if features.drops:
        raise ProblemError("messages are dropped", where="campaign", expected="sampled controllers")
    sizes = {letter: getattr(gains, letter)[0].size for letter in letters} if features.uncertain else {}
    layout = _layout(network, gains.order, gains.N * sum(sizes.values()), period, step, False, features)
    return _source(network, weights, layout, continuous_functions(network, gains, weights, tuple(sizes)), {})


def sampled_source(
    network: Network,
    folder: Mapping[str, str],
    weights: Performance,
    *,
    step: float,
    delay: int = 0,
    features: Features | None = None,
) -> CampaignSource:
    """Return the C of the loop with the controllers that ship.

    Args:
        network: the agents on their graph, in the order of the folder's.
        folder: relative path -> text, as `lockstep.codegen.emission.emit.emit` returns it.
        weights, step, features: as in `continuous_source`.
        delay: periods between sampling y and applying u, 0 or 1.

    Raises:
        ProblemError: a folder for other agents, a step that is not above 0, or a Delta: these gains are exact.
    """
    manifest = Manifest.model_validate_json(folder[FILE_NAME])
    names = [agent.name for agent in manifest.agents]
    if len(names) != network.N or any(s.source not in names for a in manifest.agents for s in a.neighbours):
        raise ProblemError(
            f"{len(names)} controllers", where="campaign", expected=f"those of the {network.N} agents"
        )
    features = features or Features(True, True, True, True, False)
    expected = "the continuous controllers: the coefficients in the C are what they are"
    demand(not features.uncertain, "a Delta of (11) for the C that ships", "campaign", expected)
    layout = _layout(network, manifest.agents[0].order, 0, manifest.period, step, True, features)
    return _source(network, weights, layout, sampled_functions(network, weights), folder, manifest, delay)


def _layout(
    network: Network, order: int, deltas: int, period: float, step: float, sampled: bool, features: Features
) -> Layout:
    for value, what in ((period, "period"), (step, "step")):
        if not (math.isfinite(value) and value > 0):
            raise ProblemError(f"the {what} is {value!r}", where="campaign", expected="seconds above 0")
    # A step that is a decimal fraction of the period divides it although the doubles do not.
    substeps = max(1, math.ceil(Fraction(str(period)) / Fraction(str(step))))
    agent = network.agent
    return Layout(
        *(network.N, agent.n, agent.m, order, deltas, period, period / substeps, substeps, sampled, features)
    )


def _source(
    network: Network,
    weights: Performance,
    layout: Layout,
    functions: list[LaneFunction],
    folder: Mapping[str, str],
    manifest: Manifest | None = None,
    delay: int = 0,
) -> CampaignSource:
    agents = _agents(manifest, network.agent.n)
    q = network.agent.q
    text = render(
        "campaign/loop.c.j2",
        title=network.agent.name,
        N=layout.N,
        h=repr(layout.step),
        period=repr(layout.period),
        substeps=layout.substeps,
        sampled=layout.sampled,
        delay=delay,
        real="float" if manifest is None else manifest.real_type.c_name,
        agents=agents,
        links=max(1, sum(len(a["sources"]) for a in agents)),
        states=layout.N * layout.n,
        whole=layout.whole,
        inputs=layout.N * layout.m,
        outputs=layout.N * q,
        parameters=layout.parameters,
        figures=len(layout.columns),
        trace_width=layout.trace_width,
        places={name: place.start for name, place in layout.places.items()},
        functions=[*functions, *monitors(network, weights)],
        domain=bool(np.isfinite(network.agent.box).any()),
        diverged=repr(DIVERGED * beyond(network.agent)),
        cost=cost_expression(weights.Q) if layout.order else "0.0",
        **{name: getattr(layout.features, name) for name in layout.features.__dataclass_fields__},
    )
    # No agent's file has a hyphen in its name: agents are named by C identifiers.
    files = {"campaign-loop.c": text, "campaign-lanes.h": lanes_header()}
    for agent in agents:
        files[f"{agent['name']}.h"] = folder[f"include/{agent['name']}.h"]
        files[f"{agent['name']}.c"] = folder[f"src/{agent['name']}.c"]
    return CampaignSource(tuple(sorted(files.items())), layout)


def _agents(manifest: Manifest | None, plant_states: int) -> list[dict[str, Any]]:
    """What the template needs to know of each emitted controller."""
    if manifest is None:
        return []
    views, first, states = [], {"output": 0, "input": 0, "link": 0}, len(manifest.agents) * plant_states
    for agent in manifest.agents:
        q, m = len(agent.outputs), len(agent.inputs)
        views.append(
            {
                **{"name": agent.name, "NAME": agent.name.upper(), "order": agent.order, "q": q, "m": m},
                "limits": agent.limits is not None,
                # The loop is that of x less the offsets; the C is given the outputs of x.
                "offset": agent.offsets[0] if agent.offsets else None,
                **{"first_output": first["output"], "first_input": first["input"], "first_state": states},
                "sources": [
                    {"name": s.source, "link": first["link"] + k} for k, s in enumerate(agent.neighbours)
                ],
            }
        )
        first["output"] += q
        first["input"] += m
        first["link"] += len(agent.neighbours)
        states += agent.order
    return views
