"""design.json: a design as text, complete enough to be proved again by someone who trusts nothing here.

The file holds the problem, not matrices derived from it: `certify` builds them anew. Every number is read as
the IEEE double it denotes, and that double is taken exactly.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lockstep.check.errors import ProblemError
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.inequality import Certificate, Claim
from lockstep.check.loop import Gains
from lockstep.check.modes import ModalCertificate, Segment
from lockstep.lmi.design import Design
from lockstep.lmi.floor.stored import floor_keys, floor_of
from lockstep.lmi.json_parts import (
    A_DESIGN,
    item,
    matrix,
    not_negative,
    number,
    part,
    position,
    rows_or_none,
    symmetric,
    vector,
)
from lockstep.lmi.json_parts import load_json as load_json
from lockstep.model.bound_search import Bound, Entry
from lockstep.model.problem import Problem

FORMAT = "lockstep-design/1"
MODAL = "modal"
GIVEN = "given"


@dataclass(frozen=True)
class Stored:
    """What a design file says: the problem, the gains, and what is claimed of them.

    scales: D_w and D_v of the bound that the certificate was proved with, where they are not all one;  entries: bounds of
    single slopes in these scales that the certificate uses besides alpha;  floor: what proves the floor of rho that the
    file claims, if it does.
    """

    problem: Problem
    gains: Gains
    alpha: float
    fragility: Mapping[str, float]
    certificate: Certificate | ModalCertificate | None
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    entries: tuple[Entry, ...] = ()
    floor: FloorWitness | None = None


def document(design: Design) -> dict[str, Any]:
    """Return a design as plain JSON types, with the keys of the contract."""
    c = design.certificate
    return {
        "format": FORMAT,
        "title": design.problem.title,
        "method": design.problem.design.method,
        "certified": design.certified,
        "proof": "exact" if design.certified else "none",
        "rho": None if c is None else c.rho,
        "alpha": design.claim.alpha,
        "scope": design.scope,
        "fragility": design.problem.fragility,
        "coordinates": design.network.coordinates,
        "gains": [
            {letter: getattr(design.gains, letter)[i].tolist() for letter in "ABCD"}
            for i in range(design.gains.N)
        ],
        "certificate": None if c is None else witnesses(c, design.network.graph.N),
        **_stated_scales(design.bound),
        **floor_keys(design.floor),
        **_stated_entries(design.claim),
        **({} if design.initial is None else {"initial_set": design.initial.document()}),
        "sampled": {"certified": False, "period": design.problem.controller.period, "max_period": None},
        "figures": design.figures,
        "problem": _problem_part(design.problem),
    }


def _stated_scales(bound: Bound) -> dict[str, Any]:
    """Return D_w and D_v, which G and H are scaled with; nothing if they are all one."""
    if set(bound.output_scale) | set(bound.input_scale) <= {1.0}:
        return {}
    return {"scales": {"G": list(bound.output_scale), "H": list(bound.input_scale)}}


def _stated_entries(claim: Claim) -> dict[str, Any]:
    """Return the bounds of single slopes, components and arguments counted from 1; nothing if there are none."""
    entries = [
        {"component": one.component + 1, "argument": one.argument + 1, "bound": one.bound}
        for one in claim.entries
    ]
    return {"entries": entries} if entries else {}


def _problem_part(problem: Problem) -> dict[str, Any]:
    """Return the problem; gains that are given are left to the `gains` of the file, where all gains are."""
    table = problem.document()
    table["design"].pop("gains", None)
    return table


def witnesses(c: Certificate | ModalCertificate, N: int) -> dict[str, Any]:
    """Return a certificate of N agents as plain JSON types."""
    if isinstance(c, ModalCertificate):
        return {
            "kind": MODAL,
            "lower": c.lower,
            "segments": [{"upper": segment.upper, "P": segment.P.tolist()} for segment in c.segments],
            "mu": c.mu,
            **({"mu_entries": list(c.mu_entries)} if c.mu_entries else {}),
            "P_mean": c.P_mean.tolist(),
        }
    return {
        "P": c.P.tolist(),
        "m": c.m.tolist(),
        "t": c.t.tolist(),
        **({"m_entries": c.m_entries.tolist()} if len(c.m_entries) else {}),
        "pairs": [[i, j] for i in range(1, N + 1) for j in range(i + 1, N + 1)],
    }


def read(path: Path) -> Stored:
    """Read a design file.

    Raises:
        ProblemError: not there, not JSON, not a design file, or a part missing or of the wrong shape.
    """
    return parse(load_json(path), str(path))


def parse(content: Any, where: str) -> Stored:
    """Check what a design file holds and return it."""
    if not isinstance(content, dict):
        raise ProblemError(
            f"it holds a JSON {type(content).__name__}, not an object", where=where, expected=A_DESIGN
        )
    found = content.get("format")
    if found != FORMAT:
        raise ProblemError(
            f"`format` is {found!r}",
            where=where,
            expected=repr(FORMAT),
            remedy=f"give {A_DESIGN}",
        )
    try:
        problem = Problem.from_document(_with_given_gains(content))
    except ProblemError as error:
        raise error.within(where) from None
    try:
        delta, entries = _fragility(content), _entries(content)
        return Stored(
            problem,
            _gains(content, problem),
            number(content.get("alpha"), "alpha"),
            delta,
            _certificate(content, problem, delta, len(entries)),
            _scales(content),
            entries,
            floor_of(content),
        )
    except ProblemError as error:
        raise error.within(where) from None


def _with_given_gains(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem of a file, with the file's gains for a method that takes gains and does not repeat them."""
    table: dict[str, Any] = part(content, "problem", dict)
    asked = table.get("design")
    if not isinstance(asked, dict) or asked.get("method") != GIVEN or "gains" in asked:
        return table
    return {**table, "design": {**asked, "gains": part(content, "gains", list)}}


def _scales(content: Mapping[str, Any]) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if "scales" not in content:
        return None
    both = part(content, "scales", dict)
    G, H = (tuple(number(d, f"scales, `{key}`") for d in part(both, key, list)) for key in "GH")
    if min((*G, *H), default=1.0) <= 0:
        raise ProblemError(f"`scales` is {both}", expected="numbers above 0")
    return G, H


def _entries(content: Mapping[str, Any]) -> tuple[Entry, ...]:
    if "entries" not in content:
        return ()
    return tuple(
        Entry(
            position(item(one, "component", where), f"{where}, `component`"),
            position(item(one, "argument", where), f"{where}, `argument`"),
            not_negative(item(one, "bound", where), f"{where}, `bound`"),
        )
        for one, where in (
            (one, f"entry {i}") for i, one in enumerate(part(content, "entries", list), start=1)
        )
    )


def _gains(content: Mapping[str, Any], problem: Problem) -> Gains:
    gains = Gains(
        *(
            tuple(
                matrix(one, letter, f"gains of agent {i}", _gain_shape(problem, letter))
                for i, one in enumerate(part(content, "gains", list), start=1)
            )
            for letter in "ABCD"
        )
    )
    if gains.N != problem.graph().N:
        raise ProblemError(f"gains for {gains.N} agents", where="gains", expected=f"{problem.graph().N}")
    return gains


def _fragility(content: Mapping[str, Any]) -> dict[str, float]:
    stored = part(content, "fragility", dict)
    delta = {letter: number(stored.get(letter), f"fragility {letter}") for letter in "ABCD"}
    if min(delta.values()) < 0:
        raise ProblemError(f"`fragility` is {dict(delta)}", expected="numbers that are not negative")
    return delta


def _gain_shape(problem: Problem, letter: str) -> tuple[int, int]:
    n_C, m, q = problem.order, problem.agent().m, problem.agent().q
    return {"A": (n_C, n_C), "B": (n_C, q), "C": (m, n_C), "D": (m, q)}[letter]


def _certificate(
    content: Mapping[str, Any], problem: Problem, delta: Mapping[str, float], entries: int
) -> Certificate | ModalCertificate | None:
    stored = content.get("certificate")
    if stored is None:
        return None
    if not isinstance(stored, dict):
        raise ProblemError(
            f"`certificate` is a {type(stored).__name__}", expected="an object with P, m and t"
        )
    if "kind" in stored:
        return _modal_certificate(content, stored, problem, entries)
    N, agent, n_C = problem.graph().N, problem.agent(), problem.order
    n_x = agent.n * (N - 1) + n_C * N
    sizes = {"A": n_C * n_C, "B": n_C * agent.q, "C": agent.m * n_C, "D": agent.m * agent.q}
    ways = N * sum(1 for letter in "ABCD" if delta[letter] > 0 and sizes[letter])
    m, t = vector(stored, "m", N * (N - 1) // 2), vector(stored, "t", ways)
    P = matrix(stored, "P", "certificate", (n_x, n_x))
    m_entries = rows_or_none(stored, "m_entries", (entries, N * (N - 1) // 2))
    return Certificate(number(content.get("rho"), "rho"), symmetric(P, "certificate, `P`"), m, t, m_entries)


def _modal_certificate(
    content: Mapping[str, Any], stored: Mapping[str, Any], problem: Problem, entries: int
) -> ModalCertificate:
    if stored["kind"] != MODAL:
        raise ProblemError(
            f"`kind` is {stored['kind']!r}", where="certificate", expected=f'"{MODAL}", or no kind'
        )
    n_C, size = problem.order, problem.agent().n + problem.order
    segments = tuple(
        Segment(
            number(item(one, "upper", place), f"{place}, `upper`"),
            symmetric(matrix(one, "P", place, (size, size)), f"{place}, `P`"),
        )
        for one, place in (
            (one, f"certificate, segment {i}")
            for i, one in enumerate(part(stored, "segments", list), start=1)
        )
    )
    P_mean = symmetric(matrix(stored, "P_mean", "certificate", (n_C, n_C)), "certificate, `P_mean`")
    lower, mu = (number(stored.get(key), f"certificate, `{key}`") for key in ("lower", "mu"))
    own = tuple(vector({"mu_entries": [], **stored}, "mu_entries", entries).tolist())
    return ModalCertificate(number(content.get("rho"), "rho"), lower, segments, mu, P_mean, own)
