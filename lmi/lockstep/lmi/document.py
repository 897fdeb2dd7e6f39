"""design.json: a design as text, complete enough to be proved again by someone who trusts nothing here.

The file holds the problem, not matrices derived from it: `certify` builds them anew. Every number is read as
the IEEE double it denotes, and that double is taken exactly.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.lmi.design import Design
from lockstep.lmi.inequality import Certificate
from lockstep.lmi.modes import ModalCertificate, Segment
from lockstep.model.bound import Bound
from lockstep.model.errors import ProblemError
from lockstep.model.loop import Gains
from lockstep.model.problem import Problem

FORMAT = "lockstep-design/1"
MODAL = "modal"
GIVEN = "given"


_A_DESIGN = "a file written by `lockstep design`"


@dataclass(frozen=True)
class Stored:
    """What a design file says: the problem, the gains, and what is claimed of them.

    scales: D_w and D_v of the bound that the certificate was proved with, where they are not all one.
    """

    problem: Problem
    gains: Gains
    alpha: float
    fragility: Mapping[str, float]
    certificate: Certificate | ModalCertificate | None
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None


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
        "certificate": None if c is None else _witnesses(c, design.network.graph.N),
        **_stated_scales(design.bound),
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


def _problem_part(problem: Problem) -> dict[str, Any]:
    """Return the problem; gains that are given are left to the `gains` of the file, where all gains are."""
    table = problem.document()
    table["design"].pop("gains", None)
    return table


def _witnesses(c: Certificate | ModalCertificate, N: int) -> dict[str, Any]:
    if isinstance(c, ModalCertificate):
        return {
            "kind": MODAL,
            "lower": c.lower,
            "segments": [{"upper": segment.upper, "P": segment.P.tolist()} for segment in c.segments],
            "mu": c.mu,
            "P_mean": c.P_mean.tolist(),
        }
    return {
        "P": c.P.tolist(),
        "m": c.m.tolist(),
        "t": c.t.tolist(),
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
            f"it holds a JSON {type(content).__name__}, not an object", where=where, expected=_A_DESIGN
        )
    found = content.get("format")
    if found != FORMAT:
        raise ProblemError(
            f"`format` is {found!r}",
            where=where,
            expected=repr(FORMAT),
            remedy=f"give {_A_DESIGN}",
        )
    try:
        problem = Problem.from_document(_with_given_gains(content))
    except ProblemError as error:
        raise error.within(where) from None
    try:
        delta = _fragility(content)
        return Stored(
            problem,
            _gains(content, problem),
            _number(content.get("alpha"), "alpha"),
            delta,
            _certificate(content, problem, delta),
            _scales(content),
        )
    except ProblemError as error:
        raise error.within(where) from None


def _with_given_gains(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem of a file, with the file's gains for a method that takes gains and does not repeat them."""
    table: dict[str, Any] = _part(content, "problem", dict)
    asked = table.get("design")
    if not isinstance(asked, dict) or asked.get("method") != GIVEN or "gains" in asked:
        return table
    return {**table, "design": {**asked, "gains": _part(content, "gains", list)}}


def _scales(content: Mapping[str, Any]) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if "scales" not in content:
        return None
    both = _part(content, "scales", dict)
    G, H = (tuple(_number(d, f"scales, `{key}`") for d in _part(both, key, list)) for key in "GH")
    if min((*G, *H), default=1.0) <= 0:
        raise ProblemError(f"`scales` is {both}", expected="numbers above 0")
    return G, H


def _gains(content: Mapping[str, Any], problem: Problem) -> Gains:
    gains = Gains(
        *(
            tuple(
                _matrix(one, letter, f"gains of agent {i}", _gain_shape(problem, letter))
                for i, one in enumerate(_part(content, "gains", list), start=1)
            )
            for letter in "ABCD"
        )
    )
    if gains.N != problem.graph().N:
        raise ProblemError(f"gains for {gains.N} agents", where="gains", expected=f"{problem.graph().N}")
    return gains


def _fragility(content: Mapping[str, Any]) -> dict[str, float]:
    stored = _part(content, "fragility", dict)
    delta = {letter: _number(stored.get(letter), f"fragility {letter}") for letter in "ABCD"}
    if min(delta.values()) < 0:
        raise ProblemError(f"`fragility` is {dict(delta)}", expected="numbers that are not negative")
    return delta


def load_json(path: Path) -> Any:
    """Read a JSON file; NaN and infinities, which JSON does not have, are read as NaN and refused later.

    Raises:
        ProblemError: not there, not readable, not JSON, a key given twice, or a number of thousands of digits.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return json.loads(text, parse_constant=lambda _name: math.nan, object_pairs_hook=_object)
    except ProblemError as error:
        raise error.within(str(path)) from None
    except FileNotFoundError:
        raise ProblemError("there is no such file", where=str(path), expected=_A_DESIGN) from None
    except UnicodeDecodeError as error:
        raise ProblemError(
            f"it is not text: byte {error.start + 1} is 0x{error.object[error.start]:02x}",
            where=str(path),
            expected=_A_DESIGN,
        ) from None
    except OSError as error:
        raise ProblemError(f"it cannot be read ({error.strerror})", where=str(path)) from None
    except (ValueError, RecursionError) as error:
        # Python refuses whole numbers of more than 4300 digits with a plain ValueError.
        raise ProblemError(f"it is not JSON ({error})", where=str(path), expected=_A_DESIGN) from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON, each key of which is given once: of two values one would be ignored silently."""
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ProblemError(f"the key `{twice}` is given twice", expected="each key once")
    return found


def _part(content: Mapping[str, Any], key: str, kind: type) -> Any:
    value = content.get(key)
    if not isinstance(value, kind):
        raise ProblemError(
            f"`{key}` is {'missing' if value is None else 'a ' + type(value).__name__}",
            expected=f"a {kind.__name__}",
        )
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ProblemError(f"{value!r}", where=where, expected="a finite number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ProblemError(f"{number!r}", where=where, expected="a finite number")
    return number


def _gain_shape(problem: Problem, letter: str) -> tuple[int, int]:
    n_C, m, q = problem.order, problem.agent().m, problem.agent().q
    return {"A": (n_C, n_C), "B": (n_C, q), "C": (m, n_C), "D": (m, q)}[letter]


def _matrix(content: Any, key: str, where: str, shape: tuple[int, int]) -> Any:
    rows = content.get(key) if isinstance(content, dict) else None
    place = f"{where}, `{key}`"
    if (
        not isinstance(rows, list)
        or len(rows) != shape[0]
        or any(not isinstance(row, list) or len(row) != shape[1] for row in rows)
    ):
        raise ProblemError(
            "it is missing or has another shape",
            where=place,
            expected=f"{shape[0]} rows of {shape[1]} numbers",
        )
    return np.array([[_number(value, place) for value in row] for row in rows], dtype=float).reshape(shape)


def _certificate(
    content: Mapping[str, Any], problem: Problem, delta: Mapping[str, float]
) -> Certificate | ModalCertificate | None:
    stored = content.get("certificate")
    if stored is None:
        return None
    if not isinstance(stored, dict):
        raise ProblemError(
            f"`certificate` is a {type(stored).__name__}", expected="an object with P, m and t"
        )
    if "kind" in stored:
        return _modal_certificate(content, stored, problem)
    N, agent, n_C = problem.graph().N, problem.agent(), problem.order
    n_x = agent.n * (N - 1) + n_C * N
    sizes = {"A": n_C * n_C, "B": n_C * agent.q, "C": agent.m * n_C, "D": agent.m * agent.q}
    ways = N * sum(1 for letter in "ABCD" if delta[letter] > 0 and sizes[letter])
    m, t = _vector(stored, "m", N * (N - 1) // 2), _vector(stored, "t", ways)
    P = _matrix(stored, "P", "certificate", (n_x, n_x))
    return Certificate(_number(content.get("rho"), "rho"), _symmetric(P, "certificate, `P`"), m, t)


def _modal_certificate(
    content: Mapping[str, Any], stored: Mapping[str, Any], problem: Problem
) -> ModalCertificate:
    if stored["kind"] != MODAL:
        raise ProblemError(
            f"`kind` is {stored['kind']!r}", where="certificate", expected=f'"{MODAL}", or no kind'
        )
    n_C, size = problem.order, problem.agent().n + problem.order
    segments = tuple(
        Segment(
            _number(_item(one, "upper", place), f"{place}, `upper`"),
            _symmetric(_matrix(one, "P", place, (size, size)), f"{place}, `P`"),
        )
        for one, place in (
            (one, f"certificate, segment {i}")
            for i, one in enumerate(_part(stored, "segments", list), start=1)
        )
    )
    P_mean = _symmetric(_matrix(stored, "P_mean", "certificate", (n_C, n_C)), "certificate, `P_mean`")
    lower, mu = (_number(stored.get(key), f"certificate, `{key}`") for key in ("lower", "mu"))
    return ModalCertificate(_number(content.get("rho"), "rho"), lower, segments, mu, P_mean)


def _item(one: Any, key: str, where: str) -> Any:
    if not isinstance(one, dict):
        raise ProblemError(f"a {type(one).__name__}", where=where, expected="an object with `upper` and `P`")
    return one.get(key)


def _symmetric(P: Any, where: str) -> Any:
    if not np.array_equal(P, P.T):
        raise ProblemError("it is not symmetric", where=where, expected="P = P'")
    return P


def _vector(content: Mapping[str, Any], key: str, size: int) -> Any:
    values = content.get(key)
    if not isinstance(values, list) or len(values) != size:
        raise ProblemError(
            "it is missing or has another length", where=f"certificate, `{key}`", expected=f"{size} numbers"
        )
    return np.array([_number(value, f"certificate, `{key}`") for value in values], dtype=float)
