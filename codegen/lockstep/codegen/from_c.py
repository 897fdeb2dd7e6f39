"""The controllers' numbers, read from the generated C itself.

Nothing here believes manifest.json: orders, the period, the sources and every coefficient come from the header and the
source. What is read is then rendered again through the templates, and the result must be the file, comments aside: C of
any other form is refused, since nobody knows what it computes.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import PRECISIONS, HeldController
from lockstep.codegen.agent_view import agent_view
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.budget import Shape
from lockstep.codegen.c_file import INDEX, LITERAL, CFile
from lockstep.codegen.kernel_reader import read_kernel
from lockstep.codegen.rendering import templates

_CODE_ONLY = templates("lockstep.codegen", undefined=jinja2.ChainableUndefined)
"""The templates, with nothing where comments want to be filled. Code that is not filled differs, and is refused."""

_SOURCE = re.compile(
    r"^ \* +neighbour ([0-9]+) +([A-Za-z][A-Za-z0-9_]*), weight a = ([^ ,]+), bit 0x[0-9a-f]+ of `received`$",
    re.MULTILINE,
)


@dataclass(frozen=True, eq=False)
class ReadController:
    """One agent as its C has it: its controller, the period in s that its header states, and its arithmetic."""

    name: str
    controller: HeldController
    period: float
    period_literal: str
    real: str


def read_controllers(folder: Path, names: list[str]) -> list[ReadController]:
    """Read `include/<name>.h` and `src/<name>.c` of each agent.

    Raises:
        ProblemError: a file is missing or is no text.
        NotCertified: a file is not of the form that `lockstep generate` writes.
    """
    return [_read(CFile.read(folder, name, "h"), CFile.read(folder, name, "c"), names) for name in names]


def read_controller(name: str, header: str, source: str, names: list[str]) -> ReadController:
    """Read one agent from the text of its header and source.

    Args:
        name: prefix of the generated code.
        header: text of the header;  source: text of the source.
        names: of all agents, in the network's order: a source of another name is refused.
    """
    return _read(CFile(name, "h", header), CFile(name, "c", source), names)


def _read(header: CFile, source: CFile, names: list[str]) -> ReadController:
    header.check()
    source.check()
    shape = Shape(*(int(_macro(header, key)) for key in ("ORDER", "OUTPUTS", "INPUTS", "NEIGHBOURS")))
    period = _macro(header, "PERIOD_S")
    real = RealType("float32" if period.endswith("f") else "float64")
    sources, header_weights = _sources(header, shape.neighbours, names, real)
    weights, weight_literals = _weights(source, shape.neighbours, real)
    if not np.array_equal(weights, header_weights):
        raise header.refusal("its weights are not those of the source")
    kernel = read_kernel(source, shape, real)
    view = agent_view(
        source.name,
        shape,
        kernel.table,
        weights,
        statements=kernel.statements,
        table=kernel.literals,
        weight_literals=weight_literals,
    )
    _check_form(header, source, view, real, period)
    precision = PRECISIONS[real.name]
    controller = HeldController.row_by_row(kernel.table, shape.order, sources, weights, precision)
    if kernel.roundings is not None:
        controller = replace(controller, roundings=kernel.roundings)
    return ReadController(source.name, controller, float(period.rstrip("f")), period, real.name)


def _macro(header: CFile, key: str) -> str:
    macro = f"{header.name.upper()}_{key}"
    found = re.findall(rf"^#define {macro} ([0-9][0-9.e+-]*f?)$", header.code, re.MULTILINE)
    if len(found) != 1 or (key != "PERIOD_S" and not re.fullmatch(INDEX, found[0])):
        raise header.refusal(f"{macro} is not defined once, as a number")
    if key == "PERIOD_S" and not (LITERAL.fullmatch(found[0]) and float(found[0].rstrip("f")) > 0):
        raise header.refusal(f"the period is `{found[0]}`")
    return str(found[0])


def _sources(
    header: CFile, count: int, names: list[str], real: RealType
) -> tuple[tuple[int, ...], Float[np.ndarray, " nn"]]:
    found = _SOURCE.findall(header.text)
    if [index for index, _, _ in found] != [str(k) for k in range(count)]:
        raise header.refusal(f"it does not name its {count} neighbours in order")
    if unknown := [source for _, source, _ in found if source not in names]:
        raise header.refusal(f"the neighbour `{unknown[0]}` is no agent of this folder")
    suffix = "f" if real.name == "float32" else ""
    weights = np.array([header.value(weight + suffix, real.name) for _, _, weight in found], dtype=float)
    return tuple(names.index(source) for _, source, _ in found), weights


def _weights(source: CFile, count: int, real: RealType) -> tuple[Float[np.ndarray, " nn"], tuple[str, ...]]:
    found = re.findall(rf"static const {real.c_name} weight\[{count}\] = (\{{.*\}});", source.text)
    if not found:
        return np.ones(count), ()
    literals = source.row(found[0])
    return np.array([source.value(text, real.name) for text in literals]), literals


def _check_form(header: CFile, source: CFile, view: Mapping[str, Any], real: RealType, period: str) -> None:
    """Print both files again from what was read, and refuse those that differ."""
    context = {
        "period_literal": period,
        "c_real": real.c_name,
        "zero": real.literal(0.0),
        "optimize": "size" if view["table"] else "speed",
    }
    for file, template in ((header, "header.h.j2"), (source, "source.c.j2")):
        ours = _CODE_ONLY.get_template(template).render(**context, a=view)
        if difference := file.differs_from(ours):
            raise file.refusal(difference)
