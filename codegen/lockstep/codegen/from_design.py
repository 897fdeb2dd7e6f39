"""From a design file to the specification of the C: controllers, Laplacian rows, and the datasheet's figures."""

import math

import numpy as np

from lockstep.check.design_file.fixed_point import FixedClaims
from lockstep.check.errors import ProblemError, demand
from lockstep.check.sampled.controller import PRECISIONS
from lockstep.check.system.formation import measured_offsets
from lockstep.codegen.emission.one_image import OneImage, Table
from lockstep.codegen.manifest import digest_of
from lockstep.codegen.message_claims import said_of_messages
from lockstep.codegen.sampled_design import sampled_controllers
from lockstep.codegen.spec import (
    CodegenSpec,
    Controller,
    FixedFormats,
    LinearPlant,
    MessageLimits,
    Neighbour,
    Optimize,
    Signal,
)
from lockstep.lmi.document import Stored

MANY = 17
"""Agents from which controllers that are all the same are described once."""

CONTINUOUS_ONLY = (
    "the continuous controller in real arithmetic; the sampled, rounded one of this folder is not covered yet"
)

WHERE = "not proved; in consensus all agents move as one of them does with u = 0, behind a leader as it does"


def specification(
    stored: Stored,
    *,
    optimize: Optimize = "speed",
    name: str = "",
    prefix: str = "",
    one_image: bool = False,
    max_neighbours: int | None = None,
    table: Table = "none",
) -> CodegenSpec:
    """Return what to generate for a stored design. Its datasheet prints what the design claims: decide that first.

    Args:
        stored: the design.
        optimize: "speed" or "size".
        name: of the folder's target and umbrella header; "": the agent's, and `_controllers`.
        prefix: put before the agent's name in all that is generated.
        one_image: one image for all nodes, their neighbours given at run time: the gains once where they are all the same,
            else by the node's number.
        max_neighbours: of a node of one image; by default the largest in-degree of the design's graph.
        table: of whom each node hears: "none", "csv" or "c".
    """
    problem, agent = stored.problem, stored.problem.agent()
    if not one_image:
        problem.demand_one_graph("for C that names the neighbours of each agent")
    found = "offsets in one image for all nodes"
    expected = "the C of each agent, which holds its own and its neighbours': --per-agent"
    demand(not one_image or problem.offsets is None, found, "[network] offsets, --one-image", expected)
    graph, lure, x0 = problem.graph(), agent.lure, problem.initial_states()
    base, units, gains = f"{prefix}{agent.name}", agent.units, stored.gains
    names = [f"{base}{i}" for i in range(1, graph.N + 1)]
    sources: list[list[tuple[int, float]]] = [[] for _ in names]
    for listener, source, weight in graph.edges:
        sources[listener - 1].append((source - 1, weight))
    outputs, inputs = (
        tuple(Signal(name, units.get(name, "")) for name in names) for names in (agent.outputs, agent.inputs)
    )
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
    image = None
    if one_image:
        image = _image(stored, f"{base}_node", sources, max_neighbours, table)
    controller = problem.controller
    return CodegenSpec(
        agents=controllers,
        period=controller.period,
        delay=controller.delay,
        discretization=controller.discretization,
        real=controller.real,
        optimize=optimize,
        name=name or f"{base}_controllers",
        prefix=prefix,
        title=problem.title,
        certificate=_datasheet(stored),
        design_hash=fingerprint(stored),
        plants=plants,
        image=image,
        messages=_messages(stored),
        fixed=None if stored.claims.fixed is None else formats_of(stored.claims.fixed),
    )


def formats_of(claims: FixedClaims) -> FixedFormats:
    """Return the formats of the controllers in integers, and what is claimed of them in words."""
    rho = "not proved"
    if claims.rho:
        rho = f"{claims.rho:g}, and {_two_digits(claims.rho_rounding)} from rounding"
    radius = "not proved" if claims.radius is None else f"{claims.radius:g}"
    residual, per_error = (
        _two_digits(one) for one in (claims.residual_from_rounding, claims.residual_per_message_error)
    )
    lines = (
        "all agents come to agree, between the samples too, while no step is SATURATED",
        f"residual_from_rounding = {residual}: the distance of the states from agreement in the end, readings exact",
        f"residual_per_message_error = {per_error}: times the largest error of a reading, besides",
        f"rho = {rho}: the square of what is weighed, integrated up to a sample at t, is at most",
        "    V_0 + rho^2 times the energy of the disturbance + t times the square of the part from rounding, readings exact",
        f"radius = {radius}: from disagreements up to it, at rest, undisturbed, readings exact, no step is SATURATED",
    )
    return FixedFormats(claims.outputs, claims.inputs, claims.states, lines)


def _image(
    stored: Stored, name: str, sources: list[list[tuple[int, float]]], most: int | None, table: Table
) -> OneImage:
    """Return what one image is made for: the design's graph, or any with its spectrum, whose lists hold what is proved."""
    spectrum, degree = stored.problem.spectrum, max(map(len, sources))
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
    covered, scope = sampled.certified, claims.scope or "local"
    continuous = "rho, delta and decay are" if delta else "rho and decay are"
    lines = signed_lines(stored) if covered else {"covers": CONTINUOUS_ONLY}
    if scope == "local":
        said = "assumes" if covered else "covers"
        lines = {**lines, said: f"{lines[said]}; {_domain(stored)}"}
    return {
        "certified": True,
        "proof": "ball" if covered else "exact",
        **lines,
        "where": WHERE,
        "scope": scope,
        "rho": claims.rho,
        **({"rho_sampled": sampled.rho or "not proved"} if covered else {}),
        "alpha": claims.alpha,
        **delta,
        "decay": None
        if claims.decay is None
        else f"{claims.decay:g} 1/s, of every disagreement, with the gains as they were designed, continuous",
        **({continuous: "of the continuous controllers (proof: exact)"} if covered else {}),
        **_limits(stored),
        **said_of_messages(stored),
        "controllers": _alone(stored),
        **_formation(stored),
        **_leader(stored),
    }


def _limits(stored: Stored) -> dict[str, str | None]:
    """Return from where no input meets its limit, and from where the clipped loop converges, as far as it is claimed."""
    claims, problem = stored.claims.sampled, stored.problem
    names = zip(problem.agent().inputs, problem.limits, strict=True)
    sides = ", ".join(f"|{name}| < {limit:g}" for name, limit in names if math.isfinite(limit))
    timely = ", every message in time" if problem.messages is not None else ""
    timely += ", while every agent stays in its domain" if stored.claims.scope != "global" else ""
    rest = f"controllers at rest, no disturbance{timely}"
    found: dict[str, str | None] = {"limits": None}
    if claims.radius is not None:
        found["limits"] = f"{sides} for ever from a disagreement of at most {claims.radius:g}, {rest}"
    if claims.limits_gain is not None:
        pushed = f"under a disturbance of at most {claims.limits_gain:g} in L2"
        found["limits_gain"] = f"{sides} for ever from agreement, {pushed}{timely}"
    if claims.clipped_radius is not None:
        reach = f"from a disagreement of at most {claims.clipped_radius:g}"
        found["clipped"] = f"{reach} all come to agree with u clipped, {rest}"
    return found


def _formation(stored: Stored) -> dict[str, str]:
    """Return what agrees where there are offsets: all that is proved of x is proved of x less them."""
    if stored.problem.offsets is None:
        return {}
    real = stored.problem.controller.real
    said = (
        "what agrees is each agent's x less its offset o: so are all distances above to be read, from the formation; outputs"
        f" are taken less C o, rounded to {real}, which errs by {PRECISIONS[real].u:.1e} of it: an error of a reading"
    )
    return {"formation": said}


def _leader(stored: Stored) -> dict[str, str]:
    """Return what is proved of agents behind a leader with inputs v of its own: they are its disturbance xi = B v.

    With the orthonormal T the disagreement of a disturbance of one agent is |xi_d|^2 = (1 - 1/N) |xi|^2; |B| is at most its
    Frobenius norm. Two digits, rounded up, cover the rounding of both.
    """
    problem, claims = stored.problem, stored.claims
    if problem.reference is None:
        return {}
    leader, N = problem.reference.leader, problem.sizes.N
    said = f"an input v of {problem.agent().name}{leader + 1}, which leads, is its disturbance B v"
    rho = claims.sampled.rho if claims.sampled.certified else claims.rho
    if rho is not None and problem.performance.covers_xi and problem.design.coordinates == "orthonormal":
        gain = rho * math.sqrt(1 - 1 / N) * float(np.linalg.norm(problem.agents_B()[leader])) * (1 + 1e-9)
        said += f": from agreement |z| <= {_two_digits(gain)} |v| in L2 is proved"
    return {"leader": f"{said}; not proved: that followers come to agree with it while v lasts"}


def _alone(stored: Stored) -> str | None:
    """Return how the sampled controllers behave by themselves: the largest |eigenvalue| of each, computed."""
    if not stored.gains.order:
        return None
    n_C, table = stored.gains.order, stored.problem.controller
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
    unclipped = (
        "does not saturate (where that is proved, `limits` says)"
        if stored.problem.has_limits
        else "unclipped"
    )
    arrives = "every message arrives"
    if stored.claims.messages is not None:
        arrives += ", or as `messages` says"
    residual, rms = (_two_digits(one) for one in (sampled.residual, sampled.residual_rms))
    return {
        "proved": f"all agents come to agree, between the samples too, under these {table.real} controllers stepped every"
        f" {table.period!r} s with u held, every rounding of a step counted",
        "assumes": f"the agents obey their model with slopes up to {_slopes(stored)}; synchronous sampling;"
        f" {arrives}; u acts {applied} and {unclipped}; no step overflows",
        "remains": "at the sampling instants, in the end, a distance of the states from agreement of up to"
        f" {residual} times the largest error of a message or of an own reading (root mean square: {rms} times);"
        f" rounding a message to {table.real} errs by {PRECISIONS[table.real].u:.1e} of its size",
    }


def _slopes(stored: Stored) -> str:
    return "alpha, and each single slope up to its bound" if stored.claims.entries else "alpha"


def _two_digits(value: float | None) -> str:
    """Round up to two digits, so that the last bits of a machine's arithmetic do not show.

    >>> _two_digits(4177144.9)
    '4.2e+06'
    """
    if value is None:
        return "an unclaimed number of"
    if value <= 0 or not math.isfinite(value):
        return f"{value:g}"
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / unit) * unit:.1e}"
