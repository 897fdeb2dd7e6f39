"""One image for all nodes: the gains once, or by the node's number, and whom a node hears given at run time.

What each agent's own C does with a fixed row of the Laplacian, `<agent>_node` does with a list: r = sum_j a_j (y - y_j) from
left to right, then a step of the controller on r. The controller is the C of an agent without neighbours.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.budget import state_bytes
from lockstep.codegen.emission.known_answers import KnownAnswers, known_answers
from lockstep.codegen.one_image import OneImage, Table

CSV = "nodes.csv"

KNOWN_STEPS = 2
"""Sums of the self-check."""


def table_files(
    image: OneImage, real: RealType, render: Callable[[str, dict[str, Any]], str]
) -> dict[str, str]:
    """Return the table of whom each node hears: relative path -> text.

    Args:
        image: what it is made for.
        real: the arithmetic, which the weights are rounded to.
        render: of a template's name and what it needs to know.
    """
    if image.table == "none":
        return {}
    edges = [
        (i, j, float(real.round(np.array([a]), "weights")[0]))
        for i, row in enumerate(image.lists)
        for j, a in row
    ]
    if image.table == "csv":
        rows = [f"{i + 1},{j + 1},{real.decimal(a)}" for i, j, a in edges]
        return {CSV: "\n".join(["agent,hears,weight", *rows]) + "\n"}
    ends = np.cumsum([0, *map(len, image.lists)])
    view = {
        "name": image.name,
        "NAME": image.name.upper(),
        "table": f"{image.name}_table",
        "TABLE": f"{image.name}_table".upper(),
        "agents": image.agents,
        "most": image.most,
        "first": ends.tolist(),
        "source": [j for _, j, _ in edges],
        "weight": [real.literal(a) for _, _, a in edges],
    }
    paths = table_paths(image.name, image.table)
    return {
        path: render(template, view)
        for path, template in zip(paths, ("table.h.j2", "table.c.j2"), strict=True)
    }


def table_paths(name: str, table: Table) -> list[str]:
    """Return where the table of an image is."""
    c = [f"include/{name}_table.h", f"src/{name}_table.c"]
    return {"none": [], "csv": [CSV], "c": c}[table]


def node_view(
    image: OneImage, shape: Shape, cores: Sequence[str], real: RealType, *, limits: bool = False
) -> dict[str, Any]:
    """Return what the templates of the nodes need to know.

    Args:
        image: what it is made for.
        shape: nc, q, m of every controller.
        cores: names of the controllers, by the node's number.
        real: the arithmetic.
        limits: whether the controllers clip.
    """
    known, weights = node_answers(image, shape.outputs, real)
    literals: dict[str, Any] = {
        "count": len(weights),
        "weights": [real.literal(v) for v in (*weights, *[0.0] * (image.most - len(weights)))],
        "given": [real.literal(v) for v in known.given[1 : 1 + KNOWN_STEPS + len(weights)].ravel()],
        "answers": [real.literal(v) for v in known.answers[1 : 1 + KNOWN_STEPS].ravel()],
    }
    return {
        "name": image.name,
        "NAME": image.name.upper(),
        "agents": image.agents,
        "degree": image.degree,
        "limits": limits,
        "most": image.most,
        "mask_bits": image.mask_bits,
        "q": shape.outputs,
        "m": shape.inputs,
        "cores": [{"name": name, "NAME": name.upper()} for name in cores],
        "state_bytes": node_bytes(image, shape, len(cores), real),
        "known": {**literals, "steps": KNOWN_STEPS, "mask": f"0x{2 ** len(weights) - 1:x}u"},
    }


def node_answers(image: OneImage, outputs: int, real: RealType) -> tuple[KnownAnswers, np.ndarray]:
    """Return inputs and sums of the self-check, and its weights: those of a controller u = r with two neighbours."""
    count = min(2, image.most)
    weights = np.array([0.7, 1.3], real.dtype)[:count]
    eye = np.eye(outputs, dtype=real.dtype)
    return known_answers(Shape(0, outputs, outputs, count), eye, weights, True, image.name), weights


def node_bytes(image: OneImage, shape: Shape, cores: int, real: RealType) -> int:
    """`sizeof` of a node's state with natural alignment.

    >>> image = OneImage("arm_node", 20, 2, 2)
    >>> node_bytes(image, Shape(2, 2, 1, 0), 1, RealType("float32"))
    60
    """
    controller = state_bytes(Shape(*shape[:3], 0), real)
    widest = max(real.bytes, 4)
    sizes = [(controller, widest), *([(4, 4)] if cores > 1 else [])]
    sizes += [(real.bytes, real.bytes)] * (shape.inputs + image.most * shape.outputs)
    sizes += [(image.mask_bits // 8, image.mask_bits // 8)] + [(4, 4)] * (2 * image.most + 1)
    end = 0
    for size, alignment in sizes:
        end = -(-end // alignment) * alignment + size
    widest = max(widest, image.mask_bits // 8)
    return -(-end // widest) * widest
