"""The controllers in the C of a folder, held against those of the design that lies beside it."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.c_source.one_image import read_node
from lockstep.check.c_source.reader import AGENT, ReadController, read_controller
from lockstep.check.c_source.tokens import CText
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import NotCertified, demand
from lockstep.check.files import named, text_inside
from lockstep.check.json_text import parse_json
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.discretise import clipped_at
from lockstep.check.sampled_claims import CheckedFile
from lockstep.check.verdict import Verdict
from lockstep.check.wording import shorten

_OPENS = ("=", ",", "{", "struct", '"C"')
"""After these a brace opens a list, a structure or a linkage, and no body of a function."""


def manifest_in(folder: Path) -> dict[str, Any]:
    """Return what a folder's manifest says: how its files are named, of which nothing is believed."""
    found = parse_json(text_inside(folder, "manifest.json"), "manifest.json")
    return found if isinstance(found, dict) else {}


def controllers_in(
    folder: Path, stored: CheckedFile, held: tuple[HeldController, ...]
) -> tuple[tuple[HeldController, ...], Verdict]:
    """Read the controllers out of the C, and hold them against the design's.

    In one image for all nodes each controller is read as often as it serves: the weights and sources of a node are its row of
    the design's graph, which it is given at run time. With `spectrum` it is a row of any graph that this names, and one
    controller with the most neighbours stands for all: then a list may hold no more than these.
    """
    listed, N = manifest_in(folder), len(held)
    base, image = f"{listed.get('prefix', '')}{stored.problem.agent.name}", listed.get("image") is not None
    # One image holds one controller where all gains are the same, and else each agent's.
    alike = image and bool((stored.gains.blocks == stored.gains.blocks[0]).all())
    cores = [base] if alike else [f"{base}{i}" for i in range(1, N + 1)]
    many = stored.problem.spectrum is not None
    if many and not image:
        return held, Verdict("undecided", "`spectrum` names many graphs, and this C the neighbours of one")
    read: dict[str, ReadController] = {}
    try:
        where = "manifest.json, `prefix`"
        demand(AGENT.fullmatch(cores[-1]), f"`{shorten(base)}` begins no C identifier", where)
        if extra := _unread(folder, cores, f"{base}_node" if image else "", str(listed.get("name"))):
            return held, Verdict("undecided", f"{extra}: a compiler may read it, and nothing here does")
        for name in cores:
            read[name] = read_controller(name, *_pair(folder, name), [] if image else cores)
        if image:
            most = read_node(f"{base}_node", cores, read[cores[-1]], *_pair(folder, f"{base}_node"))
    except NotCertified as error:
        return held, Verdict("undecided", str(error))
    found = []
    for i, mine in enumerate(held):
        name = cores[0] if alike else cores[i]
        one, theirs = read[name], read[name].controller
        if image:
            fits = most == len(mine.sources) if many else len(mine.sources) <= most
            rows = theirs.sources == () and fits
            theirs = replace(theirs, sources=mine.sources, weights=mine.weights, before=mine.before)
        period = stored.problem.period
        rounded = float(np.float32(period) if one.real == "float32" else period)
        same = {
            "period": one.period == rounded,
            "arithmetic": one.real == stored.problem.controller["real"],
            "gains": np.array_equal(theirs.table, mine.table),
            "neighbours": theirs.sources == mine.sources and (not image or rows),
            "weights": np.array_equal(theirs.weights, mine.weights),
            "offsets": _same_offsets(stored.problem, i, mine.sources, one.offsets),
            "limits": _same_limits(stored.problem, one.limits),
        }
        if differs := ", ".join(word for word, holds in same.items() if not holds):
            return held, Verdict("refuted", f"{name}: not the design's {differs}")
        found.append(theirs)
    said = f"the C of {cores[0]}{', ...' if len(cores) > 1 else ''} holds the design's controllers, and no other code"
    if image:
        said += f" but {base}_node_table, where there is one: a function that fills a list, which is not read"
        degree = max(len(one.sources) for one in held)
        given = "rows" if alike else "numbers and rows"
        of = "a graph with its spectrum" if many else "its graph"
        said += f"; nodes are given their {given} of {of}, in-degree {degree} at most, a list holding {most}"
    return tuple(found), Verdict("proved", f"{said}; comments, README and manifest are not read")


_CALLED = "asm|abort|main|bcmp|strlen|mem(cpy|move|set|cmp)"
"""What compilers call by themselves, or take as a word of their own."""


def _unread(folder: Path, cores: Sequence[str], node: str, table: str) -> str:
    """Return an entry of include/ or src/ that is neither read here nor the table of the controllers, or nothing.

    A header that stands there is found before one of the compiler's: no `stdint.h`, no precompiled `arm1.h.gch`. The table,
    whose name ends as no compiler's header does, includes the agents' headers and declares and initialises names of its
    own: no directive says more, and no function's body begins, so that it is no code whatever it is called, which is nothing
    that compilers call by themselves. That of an image's graph is read by nobody here.

    Args:
        folder: of the C.
        cores: names of the controllers;  node: of an image's nodes, or nothing;  table: of the table of the controllers.
    """
    names = [*cores, node, f"{node}_table"] if node else list(cores)
    names += [table] if re.fullmatch("[A-Za-z][A-Za-z0-9_]*_controllers", table) else []
    for part, end in (("include", "h"), ("src", "c")):
        with named(folder / part, "a folder"):
            there = sorted(one.name for one in (folder / part).iterdir())
        for name in there:
            if name not in {f"{one}.{end}" for one in names}:
                return f"{part}/{shorten(name)}"
        path, known, own = f"{part}/{table}.{end}", "|".join(names), re.escape(table.upper())
        form = re.compile(
            rf'#include ("({known})\.h"|<stdint\.h>)|#ifdef __cplusplus|#endif|#(ifndef|define) {own}_H'
            rf"|#define {own}_[A-Z0-9_]+ [0-9]+u?|(?!({_CALLED})$)[A-Za-z]\w*"
            r'|[0-9]\w*|"[^"]*"|[{},;=*()]|\[|\]',
            re.ASCII,
        )
        tokens = CText(path, text_inside(folder, path)).tokens[:-1] if f"{table}.{end}" in there else []
        opened = all(before in _OPENS for before, token in pairwise(["", *tokens]) if token == "{")
        if not (opened and all(map(form.fullmatch, tokens))):
            return path
    return ""


def _same_limits(problem: ProblemTables, read: Any) -> bool:
    if read is None or np.isinf(problem.sides).all():
        return read is None and bool(np.isinf(problem.sides).all())
    return bool(np.array_equal(read, clipped_at(problem.controller["real"], problem.sides)))


def _same_offsets(problem: ProblemTables, i: int, sources: tuple[int, ...], read: Any) -> bool:
    """Tell whether the C takes C o from its own output and from those it hears; one without incoming edges takes none."""
    seen = problem.measured_offsets
    if seen is None or not sources:
        return read is None
    return read is not None and np.array_equal(read, seen[[i, *sources]])


def _pair(folder: Path, name: str) -> tuple[str, str]:
    paths = [f"include/{name}.h", f"src/{name}.c"]
    for path in paths:
        there, where = (folder / path).is_file(), "manifest.json, `prefix`"
        demand(there, f"there is no {shorten(path)}", where, "what names of files begin with")
    return text_inside(folder, paths[0]), text_inside(folder, paths[1])
