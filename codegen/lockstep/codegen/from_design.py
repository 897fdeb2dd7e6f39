"""From a design file to the specification of the C: controllers, Laplacian rows, and the datasheet's figures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.design_file.fixed_point import FixedClaims
from lockstep.check.errors import ProblemError, demand
from lockstep.check.sampled.controller import PRECISIONS
from lockstep.check.sampled.discretise import measured_offsets
from lockstep.codegen.cost.bound_coefficients import Optimize
from lockstep.codegen.emission.formation_claims import said_of_formation, said_of_leader, two_digits
from lockstep.codegen.manifest import FixedEntry, digest_of
from lockstep.codegen.message_claims import said_of_messages
from lockstep.codegen.one_image import OneImage, Table
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant, MessageLimits, Neighbour, Signal
from lockstep.lmi.analysis.decimals import round_down
from lockstep.lmi.diagnosis.open_loop import softer
from lockstep.lmi.document import Stored
from lockstep.lmi.initial_set import sampled_rate
from lockstep.lmi.shapes import Vector
from lockstep.model.agents.arguments import units_text
from lockstep.model.checks.plausibility import unstable_alone

NAMED = "_controllers"
"""What the name of a folder ends with, which is that of its umbrella header: `lockstep-check` reads no other."""

MANY = 17
"""Agents from which controllers that are all the same are described once."""

CONTINUOUS_ONLY = (
    "the continuous controller in real arithmetic alone: nothing is proved of the sampled, rounded one here"
)

RHO = "rho: the L2 gain from the disturbances to what is weighed, from agreement at rest"
WHERE = "not proved; in consensus all agents move as one of them does with u = 0"
ALONE = "; alone that is unstable (computed): nothing here holds what all agents do together"
MOVED = "; while they are apart, a load on one moves all: gains that differ leave a sum of inputs"
EQUAL = ' (method = "modal" has equal ones)'
"""Of undirected graphs."""


@dataclass(frozen=True)
class CodeOptions:
    """What a caller chooses of the C, beside the design.

    Args:
        optimize: "speed" or "size".
        name: of the folder's target and umbrella header; "": the agent's, and `_controllers`.
        prefix: put before the agent's name in all that is generated.
        one_image: one image for all nodes, their neighbours given at run time: the gains once where they are all the same,
            else by the node's number.
        max_neighbours: of a node of one image; by default the largest in-degree of the design's graph.
        table: of whom each node hears: "none", "csv" or "c".
    """

    optimize: Optimize = "speed"
    name: str = ""
    prefix: str = ""
    one_image: bool = False
    max_neighbours: int | None = None
    table: Table = "none"


BY_DEFAULT = CodeOptions()


def specification(stored: Stored, options: CodeOptions = BY_DEFAULT) -> CodegenSpec:
    """Return what to generate for a stored design. Its datasheet prints what the design claims: decide that first."""
    problem, agent = stored.problem, stored.problem.agent()
    name, one_image = options.name, options.one_image
    if not one_image:
        problem.demand_one_graph("for C that names the neighbours of each agent")
    found = "offsets in one image for all nodes"
    expected = "the C of each agent, which holds its own and its neighbours': --per-agent"
    demand(not one_image or problem.offsets is None, found, "[network] offsets, --one-image", expected)
    graph, lure, x0 = problem.graph(), agent.lure, problem.initial_states()
    demand(name.endswith(NAMED) or not name, f"`{name}`", "folder", f"a name that ends in {NAMED}")
    base, units, gains = f"{options.prefix}{agent.name}", agent.shown_units, stored.gains
    names = [f"{base}{i}" for i in range(1, graph.N + 1)]
    sources: list[list[tuple[int, float]]] = [[] for _ in names]
    for listener, source, weight in graph.edges:
        sources[listener - 1].append((source - 1, weight))
    # An output that is a state as it is has the unit of the state.
    measured = [Signal(y, units.get(y) or units.get(text, "")) for y, text in problem.file.agent.outputs]
    outputs, inputs = tuple(measured), tuple(Signal(name, units.get(name, "")) for name in agent.inputs)
    heard = [() if one_image else tuple(Neighbour(names[j], a) for j, a in row) for row in sources]
    alike = one_image and has_one_controller(stored)
    seen = measured_offsets(agent.exact, problem.offsets, problem.controller.real)
    controllers = tuple(
        Controller(
            *(name, gains.A[i], gains.B[i], gains.C[i], gains.D[i], heard[i]),
            outputs=outputs,
            inputs=inputs,
            limits=problem.sides,
            offsets=None if seen is None else seen[[i, *(j for j, _ in sources[i])]],
        )
        for i, name in enumerate([base] if alike else names)
    )
    plants = tuple(
        LinearPlant(lure.A, B, lure.C, np.asarray(x0[i]))
        for i, B in enumerate(() if alike else problem.agents_B())
    )
    image = _image(stored, f"{base}_node", sources, options) if one_image else None
    controller = problem.controller
    return CodegenSpec(
        agents=controllers,
        period=controller.period,
        delay=controller.delay,
        discretization=controller.discretization,
        real=controller.real,
        optimize=options.optimize,
        name=name or f"{base}{NAMED}",
        prefix=options.prefix,
        title=problem.title,
        certificate=_datasheet(stored),
        design_hash=fingerprint(stored),
        plants=plants,
        image=image,
        messages=_messages(stored),
        fixed=None if stored.claims.fixed is None else formats_of(stored.claims.fixed, stored),
    )


def formats_of(claims: FixedClaims, stored: Stored) -> FixedEntry:
    """Return the formats of the controllers in integers, and what is claimed of them in words."""
    rho = (
        f"{claims.rho:g}, and {two_digits(claims.rho_rounding)} from rounding" if claims.rho else "not proved"
    )
    radius = "not proved" if claims.radius is None else f"{claims.radius:g}"
    count = 2.0 ** -min(claims.outputs)
    read = claims.residual_from_rounding + claims.residual_per_message_error * count / 2
    residual, per_error, rounded = map(
        two_digits, (claims.residual_from_rounding, claims.residual_per_message_error, read)
    )
    more: tuple[str, ...] = (f"disturbances: {said}",) if (said := _counted(stored)) else ()
    more += (f"assumes: {_domain(stored)}",) if stored.claims.scope != "global" else ()
    lines = (
        "assumes: the agents obey their model; synchronous sampling; every message arrives in time",
        *more,
        "all agents come to agree, between the samples too, while no step is CLIPPED or SATURATED and no reading leaves its",
        "    counts: saturate it on conversion, and take one at the end of its range for a fault, which no status tells",
        f"residual_from_rounding = {residual}: the distance of the states from agreement in the end, readings exact",
        f"residual_per_message_error = {per_error}: times the largest error of a reading, besides",
        f"residual with readings rounded to counts = {rounded}: if that is too much, `output_range` makes counts smaller",
        f"rho = {rho}: the square of what is weighed, integrated up to a sample at t, is at most",
        "    V_0 + rho^2 times the energy of the disturbance + t times the square of the part from rounding, readings exact",
        f"radius = {radius}: from disagreements up to it, at rest, undisturbed, readings exact, "
        "no step is CLIPPED or SATURATED",
    )
    return FixedEntry(outputs=claims.outputs, inputs=claims.inputs, states=claims.states, claims=lines)


def _image(
    stored: Stored, name: str, sources: list[list[tuple[int, float]]], options: CodeOptions
) -> OneImage:
    """Return what one image is made for: the design's graph, or any with its spectrum, whose lists hold what is proved."""
    spectrum, degree = stored.problem.spectrum, max(map(len, sources))
    most, table = options.max_neighbours, options.table
    if spectrum is None:
        lists = () if table == "none" else tuple(map(tuple, sources))
        return OneImage(name, len(sources), degree, degree if most is None else most, table, lists)
    if table != "none":
        stored.problem.demand_one_graph("whose lists `--table` writes")
    found = f"a list of {most}"
    expected = f"{spectrum.neighbours}, for so many the design is proved"
    remedy = "name `max_degree` in [network] and design again"
    demand(most in (None, spectrum.neighbours), found, "--max-neighbours", expected, remedy)
    return OneImage(name, 1, spectrum.neighbours, spectrum.neighbours)


def has_one_controller(stored: Stored) -> bool:
    """Tell whether all agents have the same gains."""
    blocks = stored.gains.blocks
    return bool((blocks == blocks[0]).all())


def moves_all(stored: Stored) -> bool:
    """Tell whether controllers move the consensus: sum_i p_i B_i u_i is not always 0, p'L = 0, p_i > 0 for roots alone.

    Equal gains and B_i of the roots make it B (C sum p_i x_Ci + D C p'L x) = 0 from rest; a leader's u is 0.
    """
    if has_one_controller(stored) and len(set(map(bytes, stored.problem.agents_B()))) == 1:
        return False
    roots = [one - 1 for one in stored.problem.graph().roots]
    of_roots = stored.gains.blocks[roots], np.array(stored.problem.agents_B())[roots]
    return any(len(np.unique(one, axis=0)) > 1 for one in of_roots)


def _messages(stored: Stored) -> MessageLimits | None:
    """Return what the message layer is told, or None for its defaults.

    Own readings are kept, and a neighbour is not stale, for as long as [network.messages] lets a message be late or missing.
    """
    asked, ranges = stored.problem.messages, stored.problem.output_range
    if asked is None:
        return MessageLimits(ranges=ranges) if ranges else None
    usual = MessageLimits()
    kept = max(usual.kept, 1 << asked.delay[1].bit_length())
    return MessageLimits(kept, max(usual.limit, asked.age), ranges)


def fingerprint(stored: Stored) -> str:
    """Return the SHA-256 of a design file's content, whatever the order of its keys."""
    return digest_of(stored.document())


def _datasheet(stored: Stored) -> dict[str, str | float | bool | None]:
    claims, sampled = stored.claims, stored.claims.sampled
    if not claims.certified:
        return {"certified": False}
    delta = {f"delta_{letter}": value for letter, value in claims.fragility.items() if value}
    covered, scope, units = sampled.certified, claims.scope or "local", units_text(claims.scales or ())
    decays = (sampled.decay, sampled.fastest_decay) if covered else ()
    rate = sampled_rate(stored.problem.controller.period, *decays)
    continuous = "rho, delta and decay" if delta else "rho and decay"
    lines = signed_lines(stored) if covered else {"covers": CONTINUOUS_ONLY}
    where = WHERE + ALONE * any(unstable_alone(stored.problem))
    if scope == "local":
        lines["assumes" if covered else "covers"] += f"; {_domain(stored)}"
    return {
        "certified": True,
        "proof": "ball" if covered else "exact",
        **lines,
        "where": where + (MOVED + EQUAL * stored.problem.graph().is_undirected if moves_all(stored) else ""),
        "distance, disagreement": "the root of the sum over agents and states of (x - mean)^2, in the units of the states",
        "scope": scope,
        **({"constant disturbance": soft} if (soft := softer(stored.info.get("figures", {}))) else {}),
        "disturbances": _counted(stored),
        **({"weighed": said} if (said := _weighed(stored)) else {}),
        "rho": claims.rho,
        **({"rho_sampled": sampled.rho or "not proved"} if covered else {}),
        "alpha": f"{round_down(claims.alpha, 6)}{units}" if units else round_down(claims.alpha, 6),
        **delta,
        "decay": claims.decay
        and f"{claims.decay:g} 1/s, of every disagreement, with the gains as they were designed, continuous",
        "decay_sampled": f"{rate:g} 1/s, of these controllers, but for rounded messages" if rate else None,
        **({continuous: f"of the continuous controllers (proof: exact); {RHO}"} if covered else {}),
        **_limits(stored),
        **said_of_messages(stored),
        "controllers": _alone(stored),
        **said_of_formation(stored),
        **said_of_leader(stored),
    }


def _limits(stored: Stored) -> dict[str, str | None]:
    """Return from where no input meets its limit, and from where the clipped loop converges, as far as it is claimed."""
    claims, problem = stored.claims.sampled, stored.problem
    agent = problem.agent()
    units = agent.shown_units
    sides = ", ".join(
        f"|{name}| < {limit:g} {units.get(name, '')}".rstrip()
        for name, limit in zip(agent.inputs, problem.limits, strict=True)
        if math.isfinite(limit)
    )
    timely = ", every message in time" if problem.messages is not None else ""
    timely += ", while every agent stays in its domain" if stored.claims.scope != "global" else ""
    rest = f"controllers at rest, no disturbance, readings and messages exact{timely}"
    found: dict[str, str | None] = {"limits": None}

    def start(radius: float, axes: Sequence[float] | None) -> str:
        more = f", or from {axes_text(axes, agent.states, agent.units)}" if axes else ""
        return f"from a disagreement of at most {radius:g}{more}"

    if claims.radius is not None:
        found["limits"] = f"{sides} for ever {start(claims.radius, claims.half_axes)}, {rest}"
    if claims.limits_gain is not None:
        pushed = (
            f"under a disturbance of at most {claims.limits_gain:g} in L2, counted as `disturbances` says"
        )
        found["limits_gain"] = f"{sides} for ever from agreement at rest, {pushed}, all else exact{timely}"
    if claims.clipped_radius is not None:
        reach = start(claims.clipped_radius, claims.clipped_half_axes)
        found["clipped"] = f"{reach} all come to agree with u clipped, {rest}"
    return found


def _counted(stored: Stored) -> str:
    """Say in which scales and coordinates rho and the others count disturbances."""
    agent, performance = stored.problem.agent(), stored.problem.performance
    scales, noise = performance.states if len(performance.states) else np.ones(agent.n), performance.outputs
    none = " (0: not at all)" * (0 in scales)
    said = [f"each state's counted in its scale, in its unit per second: {_each(agent.states, scales)}{none}"]
    if noise.any():
        said.append(f"noise on each output in its scale, in its unit: {_each(agent.outputs, noise)}")
    mean = stored.problem.design.coordinates == "orthonormal"
    said.append(f"as differences from {'the mean of all agents' if mean else 'each other, by the rows of L'}")
    return "; ".join(said)


def _weighed(stored: Stored) -> str:
    """Say what rho weighs, where that is not each state alike, nor each state of a controller, and nothing else."""
    weights, agent, said = stored.problem.performance, stored.problem.agent(), []
    R, Q, W = weights.R, weights.Q if stored.gains.order else np.eye(1), weights.W
    if np.array_equal(R, np.eye(agent.n)) and np.array_equal(Q, np.eye(len(Q))) and not W.any():
        return ""
    said.append("each state 1" if np.array_equal(R, np.eye(agent.n)) else _weights(agent.states, R))
    if W.any():
        said.append(_weights(agent.inputs, W))
    if stored.gains.order:
        alike = np.array_equal(Q, Q[0, 0] * np.eye(len(Q)))
        said.append(f"each state of a controller {f'{Q[0, 0]:g}' if alike else Q.tolist()}")
    return f"squares by these weights: {', '.join(said)}"


def _weights(names: Sequence[str], M: Float[np.ndarray, "k k"]) -> str:
    diagonal = (np.diag(np.diag(M)) == M).all()
    return _each(names, np.diag(M)) if diagonal else f"{', '.join(names)} by {M.tolist()}"


def _each(names: Sequence[str], sizes: Vector) -> str:
    return ", ".join(f"{name} {size:g}" for name, size in zip(names, sizes, strict=True))


def _alone(stored: Stored) -> str | None:
    """Return how the sampled controllers behave by themselves: the largest |eigenvalue| of each, computed."""
    n_C, table = stored.gains.order, stored.problem.controller
    if not n_C:
        return None
    try:
        tables = [one.table[:n_C, :n_C] for one in sampled_controllers(stored, table.period)]
    except ProblemError:
        return None
    if len(tables) >= MANY and all(np.array_equal(one, tables[0]) for one in tables):
        tables = tables[:1]
    sizes = ", ".join(f"{np.abs(np.linalg.eigvals(A_C)).max():.3f}" for A_C in tables)
    proved = stored.claims.controllers_stable
    said = "each is stable by itself, which is proved" if proved else "not proved stable"
    return f"{said}; largest |eigenvalue| per step, by agent: {sizes}"


def _domain(stored: Stored) -> str:
    """Return the assumption of a local certificate, on the states of [agent.domain]."""
    sides = ", ".join(
        f"{low:g} <= {name} <= {high:g}" for name, (low, high) in stored.problem.agent().domain.items()
    )
    return f"every agent stays in its domain ({sides}), which is not proved of sampled controllers"


def signed_lines(stored: Stored) -> dict[str, str]:
    """Return what is claimed of the sampled controllers, under which assumptions, and what remains."""
    sampled, table = stored.claims.sampled, stored.problem.controller
    applied = "one period after its sample" if table.delay else "at once"
    saturates = "does not saturate (where that is proved, `limits` says)"
    unclipped = saturates if stored.problem.has_limits else "unclipped"
    arrives = "every message arrives"
    if stored.claims.messages is not None:
        arrives += " in time (of those that do not, `messages` alone says what is proved)"
    residual = two_digits(sampled.residual_per_message_error)
    rms = two_digits(sampled.residual_rms_per_message_error)
    return {
        "proved": f"all agents come to agree, between the samples too, under these {table.real} controllers stepped every"
        f" {table.period!r} s with u held, every rounding of a step counted",
        "assumes": f"the agents obey their model with slopes up to {_slopes(stored)}; synchronous sampling;"
        f" {arrives}; u acts {applied} and {unclipped}; no step overflows",
        "remains": "at the sampling instants, in the end, a distance of the states from agreement of up to"
        f" {residual} times the largest error of an entry of a message or of an own reading, each in its unit"
        f" (root mean square: {rms} times), a bound that is not tight;"
        f" rounding a message to {table.real} errs by {PRECISIONS[table.real].u:.1e} of its size",
    }


def _slopes(stored: Stored) -> str:
    return "alpha, and each single slope up to its bound" if stored.claims.entries else "alpha"
