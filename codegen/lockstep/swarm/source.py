"""The closed loop of a swarm as C: one text for any number of agents on any graph."""

import re

import casadi as ca
import numpy as np

from lockstep.campaign.compiled.c_text import CFiles
from lockstep.campaign.compiled.lanes import LANES, lanes_header
from lockstep.campaign.compiled.statements import DOUBLE, LaneFunction, lane_function
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.emission.kernel import straight_line
from lockstep.codegen.emission.rendering import render
from lockstep.model.simulation.divergence import beyond
from lockstep.swarm.disturbances import Pace
from lockstep.swarm.loop import SwarmLoop

CHUNK = 32
"""Blocks of `LANES` agents whose figures are summed together."""

FIGURES = 6
"""Of each chunk, beside the sums of the states: |e|^2, e' R e, memory' Q memory, faults, strays, clipped steps."""

_PRODUCT = re.compile(r"= (-?[0-9][^ ]*) \*")
_NOTHING = re.compile(r"(_next\[\d+\]) = (-?[0-9][^ ]*);")


def swarm_source(loop: SwarmLoop, pace: Pace, *, held: bool, waves: bool) -> CFiles:
    """Return the C of a swarm.

    Args:
        loop: the swarm; of its graph only whether all weights are 1 is in the text.
        pace: of the record and the integration.
        held: whether a disturbance is held from instant to instant;  waves: whether one is a sinusoid.
    """
    agent, real, instant = loop.agent, RealType(loop.real), pace.instant
    own_gains, own_inputs = len(loop.tables) > 1, len(loop.B) > 1
    statements = (
        []
        if own_gains
        else [_in_lanes(s, real) for s in straight_line(loop.tables[0], loop.order, real).statements]
    )
    text = render(
        "swarm/loop.c.j2",
        title=agent.name,
        n=agent.n,
        m=agent.m,
        q=agent.q,
        order=loop.order,
        h=DOUBLE.literal(instant / pace.substeps),
        instant=DOUBLE.literal(instant),
        period=DOUBLE.literal(loop.period),
        substeps=pace.substeps,
        per=pace.per,
        chunk=CHUNK,
        figures=FIGURES,
        lanes=LANES,
        real=real.c_name,
        real_bytes=real.bytes,
        zero=real.literal(0.0),
        own_gains=own_gains,
        own_inputs=own_inputs,
        unit_weights=bool((loop.weights == 1).all()),
        delay=bool(loop.delay),
        held=held,
        waves=waves,
        statements=statements,
        functions=_functions(loop, own_inputs, held or waves),
        cost=_cost(loop.Q),
        lower=[real.literal(low) for low, _ in loop.limits],
        upper=[real.literal(high) for _, high in loop.limits],
        beyond=DOUBLE.literal(beyond(loop.agent)),
    )
    return CFiles((("campaign-lanes.h", lanes_header()), ("swarm-loop.c", text)))


def _functions(loop: SwarmLoop, own_inputs: bool, disturbed: bool) -> list[LaneFunction]:
    """slope(x, u, t[, B][, xi]) -> x' of (2);  measure(x) -> y;  weigh(e) -> e' R e."""
    agent, lure = loop.agent, loop.agent.lure
    n, m = agent.n, agent.m
    x, u, t, xi = ca.SX.sym("x", n), ca.SX.sym("u", m), ca.SX.sym("t"), ca.SX.sym("xi", n)
    given = ca.SX.sym("B", n * m)
    B = ca.reshape(given, m, n).T if own_inputs else ca.SX(ca.DM(loop.B[0]))
    drift = ca.DM(lure.A) @ x + ca.DM(lure.G) @ lure.phi(ca.DM(lure.H) @ x, t) + lure.offset(t)
    dx = drift + B @ u + (xi if disturbed else 0)
    names, inputs = ["x", "u", "t"], [x, u, t]
    for here, name, symbol in ((own_inputs, "B", given), (disturbed, "xi", xi)):
        if here:
            names.append(name)
            inputs.append(symbol)
    e = ca.SX.sym("e", n)
    return [
        lane_function("slope", inputs, [dx], " ".join([*names, "dx"])),
        lane_function("measure", [x], [ca.DM(lure.C) @ x], "x y"),
        lane_function("weigh", [e], [ca.dot(e, ca.DM(loop.R) @ e)], "e z"),
    ]


def _in_lanes(statement: str, real: RealType) -> str:
    """A statement of a controller's kernel on lanes of controllers.

    >>> _in_lanes("const float t1 = -0.5f * x0;", RealType("float32"))
    'const w t1 = W(-0.5f) * x0;'
    """
    lanes = re.sub(rf"^const {real.c_name} ", "const w ", statement)
    return _NOTHING.sub(r"\1 = W(\2);", _PRODUCT.sub(r"= W(\1) *", lanes))


def _cost(Q: np.ndarray) -> str:
    """x_C' Q x_C of the controller in lane l."""
    terms = [
        f"{DOUBLE.literal(value)} * ((double)x_C[{a}][l] * (double)x_C[{b}][l])"
        for (a, b), value in np.ndenumerate(Q)
        if value
    ]
    return " + ".join(terms) or "0.0"
