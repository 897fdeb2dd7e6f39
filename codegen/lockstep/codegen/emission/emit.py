"""A specification as the text of a folder: headers, sources, CMakeLists.txt, README.md, manifest.json.

Pure and deterministic to the byte: no dates, no paths, no versions of tools. Gains are correctly rounded (see
`lockstep.check.sampled.discretise`), so the same specification gives the same text on every machine.
"""

import unicodedata
from collections.abc import Mapping
from typing import Any

import numpy as np

from lockstep.check.c_source.reader import ANSWERS, in_microseconds
from lockstep.check.sampled.discretise import clipped_at, discretise
from lockstep.codegen import manifest as entries
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bound_coefficients import Optimize
from lockstep.codegen.cost.bounds import by_core, integer_budgets
from lockstep.codegen.cost.budget import state_bytes
from lockstep.codegen.emission.agent_view import Sampled, agent_view
from lockstep.codegen.emission.identity import Identity
from lockstep.codegen.emission.kernel import straight_line
from lockstep.codegen.emission.known_answers import SCALE, known_answers
from lockstep.codegen.emission.one_image import node_bytes, node_view, table_files
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.one_image import OneImage
from lockstep.codegen.spec import CodegenSpec, Controller, LinearPlant

_RULES = {
    "tustin": "Tustin's rule (trapezoidal)",
    "zoh": "exact response to a held input (zero-order hold)",
    "euler": "forward Euler",
}
EVA_LIMIT = 1e6
"""Magnitude of inputs and state for which the Frama-C harness asks for a proof that nothing overflows."""
ORDER_OF_SUMS = (
    "rows of [A B; C D] times (x, r) from left to right, from +0 where zero terms are kept; "
    "r = 0 + a_1 (y - y_1) + a_2 (y - y_2) + ..."
)


def emit(spec: CodegenSpec) -> dict[str, str]:
    """Return relative path -> text of every file of the folder, `manifest.json` last.

    Raises `ProblemError` if a gain cannot be sampled or is not representable in the target type.
    """
    real = RealType(spec.real)
    agents = [_sample(agent, spec, real) for agent in spec.agents]
    context = _folder_context(spec, real)
    views = [_agent_context(agent, real, spec.optimize) for agent in agents]
    files: dict[str, str] = {}
    for view in views:
        files[f"include/{view['name']}.h"] = render("header.h.j2", **context, a=view)
        files[f"src/{view['name']}.c"] = render("source.c.j2", **context, a=view)
        files[f"proof/{view['name']}_eva.c"] = render(
            "eva.c.j2", **context, a=view, limit=real.literal(EVA_LIMIT)
        )
    if spec.image is not None:
        names, limits = [view["name"] for view in views], bool(len(agents[0].limits))
        node = node_view(spec.image, agents[0].shape, names, real, limits=limits)
        for path, template in (("include/{}.h", "node.h"), ("src/{}.c", "node.c")):
            files[path.format(spec.image.name)] = render(f"{template}.j2", **context, k=node)
        files |= table_files(spec.image, real, lambda name, view: render(name, **context, k=view))
        views = [view | {"state_bytes": node["state_bytes"]} for view in views]  # what a node holds
    whole = {
        f"include/{spec.name}.h": "umbrella.h",
        f"src/{spec.name}.c": "umbrella.c",
        f"cmake/{spec.name}-config.cmake": "config.cmake",
    }
    whole |= {"CMakeLists.txt": "CMakeLists.txt", "README.md": "README.md"}
    for path, template in whole.items():
        files[path] = render(f"{template}.j2", **context, agents=views)
    files[entries.FILE_NAME] = _manifest(spec, agents, real, files).sealed().text()
    return files


def _sample(agent: Controller, spec: CodegenSpec, real: RealType) -> Sampled:
    """Discretise in float64, then round once to the target type."""
    where = f"controller `{agent.name}`"
    gains = discretise(agent.A, agent.B, agent.C, agent.D, spec.period, spec.discretization)
    table = real.round(gains, where)
    weights = real.round(np.array([n.weight for n in agent.neighbours], dtype=float), f"{where}, weights")
    limits = clipped_at(spec.real, agent.limits)
    offsets = None if agent.offsets is None else real.round(agent.offsets, f"{where}, offsets")
    return Sampled(agent, table, weights, straight_line(table, agent.order, real), limits, offsets)


def plain(text: str) -> str:
    """One line that is safe inside a C comment, a CMake comment and Markdown.

    >>> plain("evil */ int x; /* \\n rad/s")
    'evil * / int x; / * rad/s'
    """
    visible = "".join(c if unicodedata.category(c)[0] != "C" else " " for c in text)
    safe = visible.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "? ?")
    return " ".join(safe.split())


def claims(certificate: Mapping[str, str | float | bool | None]) -> list[str]:
    """The datasheet's lines on what is proved; anything but `certified: True` is said to be no certificate.

    >>> claims({"certified": False, "rho": 6.5})
    ['NOT CERTIFIED: no proof covers these gains', 'rho: 6.5 (not certified)']
    """
    certified = certificate.get("certified") is True
    proof = certificate.get("proof")
    head = "NOT CERTIFIED: no proof covers these gains"
    if certified:
        head = "certified" + (f" (proof: {plain(str(proof))})" if proof else " (kind of proof not given)")
    if "covers" in certificate:
        head = f"the continuous controllers are {head}; THE C OF THIS FOLDER IS NOT"
    rest = [
        f"{plain(key)}: {plain(str(value))}" + ("" if certified else " (not certified)")
        for key, value in certificate.items()
        if key not in ("certified", "proof") and value is not None
    ]
    return [head, *rest]


def _folder_context(spec: CodegenSpec, real: RealType) -> dict[str, Any]:
    identity = Identity.of(spec)
    return {
        "format": entries.FORMAT,
        "name": spec.name,
        "NAME": spec.name.upper(),
        "title": plain(spec.title),
        "design_hash": plain(spec.design_hash),
        "discretization": spec.discretization,
        "rule": _RULES[spec.discretization],
        "period": repr(float(spec.period)),
        "delay": spec.delay,
        "period_literal": real.literal(spec.period),
        "in_microseconds": in_microseconds,
        "real_name": real.name,
        "c_real": real.c_name,
        "zero": real.literal(0.0),
        "one": real.literal(1.0),
        "scale": real.literal(SCALE),
        "digits": "FLT_MANT_DIG != 24" if real.c_name == "float" else "DBL_MANT_DIG != 53",
        "identity": identity.design,
        "identity_word": identity.word,
        "claims_id": identity.claims,
        "optimize": spec.optimize,
        "claims": claims(spec.certificate),
        "image": None if spec.image is None else spec.image.name,
        "table": spec.image is not None and spec.image.table == "c",
    }


def _agent_context(agent: Sampled, real: RealType, optimize: Optimize) -> dict[str, Any]:
    """What the templates need: the C's own view, and what its comments say."""
    controller, M, shape = agent.controller, agent.table, agent.shape
    known = known_answers(shape, M, agent.weights, optimize == "speed", controller.name, agent.limits)
    return agent_view(agent, real) | {
        "given": [real.literal(v) for v in known.given.ravel()],
        "known": [real.literal(v) for v in known.answers.ravel()],
        "answers": ANSWERS,
        "outputs": [{"name": plain(s.name), "unit": plain(s.unit)} for s in controller.outputs],
        "inputs": [{"name": plain(s.name), "unit": plain(s.unit)} for s in controller.inputs],
        "neighbours": [
            {"source": plain(s.source), "weight": real.decimal(w)}
            for s, w in zip(controller.neighbours, agent.weights, strict=True)
        ],
        "static": [] if controller.order else [[real.decimal(d) for d in row] for row in M],
        "multiplications": agent.kernel.multiplications if optimize == "speed" else M.size,
        "additions": agent.kernel.additions if optimize == "speed" else M.size,
        "state_bytes": state_bytes(shape, real),
        **{what: by_core(each) for what, each in agent.bounds(real, optimize).items()},
    }


def _manifest(
    spec: CodegenSpec, agents: list[Sampled], real: RealType, files: Mapping[str, str]
) -> entries.Manifest:
    identity = Identity.of(spec)
    plants: list[LinearPlant | None] = list(spec.plants) or [None] * len(agents)
    return entries.Manifest(
        format="lockstep-controllers/2",
        name=spec.name,
        title=spec.title,
        design_hash=spec.design_hash,
        period=float(spec.period),
        discretization=spec.discretization,
        real=spec.real,
        optimize=spec.optimize,
        arithmetic=entries.Arithmetic(
            order=ORDER_OF_SUMS,
            zero_terms="skipped" if spec.optimize == "speed" else "kept",
            contraction="off",
        ),
        certificate=dict(spec.certificate),
        identity=entries.Identification(design=identity.design, claims=identity.claims),
        prefix=spec.prefix,
        messages=None if spec.messages is None else entries.MessagesEntry(**vars(spec.messages)),
        fixed=spec.fixed,
        agents=tuple(_agent_record(a, real, p, spec) for a, p in zip(agents, plants, strict=True)),
        files={path: entries.sha256(text) for path, text in files.items()},
        image=None if spec.image is None else _image_record(spec.image, agents, real),
    )


def _image_record(image: OneImage, agents: list[Sampled], real: RealType) -> entries.ImageEntry:
    size = node_bytes(image, agents[0].shape, len(agents), real)
    return entries.ImageEntry(
        name=image.name,
        agents=image.agents,
        largest_in_degree=image.degree,
        max_neighbours=image.most,
        table=image.table,
        state_bytes=size,
    )


def _agent_record(
    agent: Sampled, real: RealType, plant: LinearPlant | None, spec: CodegenSpec
) -> entries.AgentEntry:
    c, n, M, shape = agent.controller, agent.controller.order, agent.table, agent.shape
    most = agent.bounds(real, spec.optimize)
    blocks = {"A": M[:n, :n], "B": M[:n, n:], "C": M[n:, :n], "D": M[n:, n:]}
    return entries.AgentEntry(
        name=c.name,
        order=n,
        outputs=tuple(entries.Named(name=s.name, unit=s.unit) for s in c.outputs),
        inputs=tuple(entries.Named(name=s.name, unit=s.unit) for s in c.inputs),
        neighbours=tuple(
            entries.NeighbourEntry(source=s.source, weight=float(real.decimal(w)))
            for s, w in zip(c.neighbours, agent.weights, strict=True)
        ),
        continuous={"A": _rows(c.A), "B": _rows(c.B), "C": _rows(c.C), "D": _rows(c.D)},
        sampled=entries.GainsEntry(
            **{letter: entries.Coefficients.of(block, real) for letter, block in blocks.items()}
        ),
        state_bytes=state_bytes(shape, real),
        stack_budget_bytes=most["stack"],
        flash_budget_bytes=most["flash"],
        instruction_budget=most["instructions"],
        integer_instruction_budget=None if spec.fixed is None else integer_budgets(shape),
        limits=_rows(agent.limits) if len(agent.limits) else None,
        offsets=None if agent.offsets is None else _rows(agent.offsets),
        plant=None if plant is None else _plant_record(plant),
    )


def _plant_record(plant: LinearPlant) -> entries.PlantEntry:
    x0 = tuple(plant.x0.tolist())
    return entries.PlantEntry(A=_rows(plant.A), B=_rows(plant.B), C=_rows(plant.C), x0=x0)


def _rows(M: np.ndarray) -> entries.Rows:
    return tuple(tuple(float(v) for v in row) for row in M)
