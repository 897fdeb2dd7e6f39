"""The controllers' numbers, read from the generated C itself.

Nothing here believes manifest.json: orders, the period, the sources and every coefficient come from the header and the
source. What is read is then rendered again through the templates, and the result must be the file, comments aside: C of
any other form is refused, since nobody knows what it computes. Unrolled statements are interpreted one by one,
each value a linear form in (x, r) with the number of roundings behind every coefficient, so the order of
operations is the file's.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from jaxtyping import Float

from lockstep.lmi.sampled.controller import PRECISIONS, HeldController
from lockstep.model.errors import NotCertified, ProblemError

_CODE_ONLY = jinja2.Environment(
    loader=jinja2.PackageLoader("lockstep.codegen", "templates"),
    undefined=jinja2.ChainableUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
"""The templates, with nothing where comments want to be filled. Code that is not filled differs, and is refused."""

# Without a point or an exponent it would be an integer, and octal after a leading 0.
_LITERAL = re.compile(r"-?[0-9]+(?:\.[0-9]+(?:e[+-]?[0-9]{1,3})?|e[+-]?[0-9]{1,3})f?")
_INDEX = "(0|[1-9][0-9]*)"
_COMMENT_OR_STRING = re.compile(r'/\*.*?\*/|"[^"\n]*"|"', re.DOTALL)
_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f]")
_SOURCE = re.compile(
    r"^ \* +neighbour ([0-9]+) +([A-Za-z][A-Za-z0-9_]*), weight a = ([^ ,]+), bit 0x[0-9a-f]+ of `received`$",
    re.MULTILINE,
)

Form = dict[tuple[str, int], tuple[Fraction, int]]
"""A linear form: (letter, index) -> (coefficient, roundings it has passed through)."""


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
    return [
        read_controller(
            name, _text(folder / "include" / f"{name}.h"), _text(folder / "src" / f"{name}.c"), names
        )
        for name in names
    ]


def read_controller(name: str, header: str, source: str, names: list[str]) -> ReadController:
    """Read one agent from the text of its header and source.

    Args:
        name: prefix of the generated code.
        header: text of the header;  source: text of the source.
        names: of all agents, in the network's order: a source of another name is refused.
    """
    for text, kind in ((header, "h"), (source, "c")):
        # A backslash at a line's end or a trigraph may change where a comment ends.
        if "\\" in text or "??" in text:
            raise _refusal(name, kind, "it holds a backslash or a trigraph")
        # Python and C do not agree on which of these ends a line.
        if found := _CONTROL.search(text):
            raise _refusal(name, kind, f"it holds the control character {found[0]!r}")
    sizes = {key: int(_macro(name, header, key)) for key in ("ORDER", "OUTPUTS", "INPUTS", "NEIGHBOURS")}
    period_literal = _macro(name, header, "PERIOD_S")
    real = "float32" if period_literal.endswith("f") else "float64"
    sources, header_weights = _sources(name, header, sizes["NEIGHBOURS"], names, real)
    weights, weight_literals = _weights(name, source, sizes["NEIGHBOURS"], real)
    if not np.array_equal(weights, header_weights):
        raise _refusal(name, "h", "its weights are not those of the source")
    kernel = _kernel(name, source, sizes, real)
    view = _view(name, sizes, kernel, weight_literals, weights)
    _check_form(name, header, source, view, real, period_literal)
    controller = HeldController.row_by_row(kernel.table, sizes["ORDER"], sources, weights, PRECISIONS[real])
    if kernel.roundings is not None:
        controller = replace(controller, roundings=kernel.roundings)
    return ReadController(name, controller, float(period_literal.rstrip("f")), period_literal, real)


@dataclass(frozen=True, eq=False)
class _Kernel:
    """[A B; C D], the roundings behind each product if they were counted, and what the templates need to print it."""

    table: Float[np.ndarray, "rows cols"]
    roundings: Any
    statements: tuple[str, ...]
    literals: tuple[tuple[str, ...], ...]


def _kernel(name: str, source: str, sizes: Mapping[str, int], real: str) -> _Kernel:
    rows, columns = sizes["ORDER"] + sizes["INPUTS"], sizes["ORDER"] + sizes["OUTPUTS"]
    table = re.search(rf"{name}_gain\[{rows}\]\[{columns}\] = \{{\n(.*?)\n\}};", source, re.DOTALL)
    if table:
        literals = tuple(_list(name, line.strip().rstrip(",")) for line in table[1].splitlines())
        if len(literals) != rows or any(len(row) != columns for row in literals):
            raise _refusal(name, "c", f"its table is not {rows} x {columns}")
        values = np.array([[_value(name, text, real) for text in row] for row in literals])
        return _Kernel(values, None, (), literals)
    body = re.search(
        rf"^static void {name}_kernel\([^\n]*\)\n\{{\n(.*?)^\}}\n", source, re.DOTALL | re.MULTILINE
    )
    if not body:
        raise _refusal(name, "c", "there is neither a kernel of statements nor a table of gains")
    lines = tuple(line.strip(" ") for line in body[1].splitlines())
    statements = tuple(line for line in lines if not line.startswith("(void)"))
    return _interpreted(name, statements, sizes, real)


def _interpreted(name: str, statements: tuple[str, ...], sizes: Mapping[str, int], real: str) -> _Kernel:
    """Follow the statements and return the table they compute."""
    n = sizes["ORDER"]
    machine = _Machine(name, real, sizes)
    for statement in statements:
        machine.run(statement)
    targets = [("x_next", k) for k in range(n)] + [("u_next", k) for k in range(sizes["INPUTS"])]
    if missing := [f"{letter}[{k}]" for letter, k in targets if (letter, k) not in machine.written]:
        raise _refusal(name, "c", f"`{missing[0]}` is not written")
    columns = [("x", k) for k in range(n)] + [("r", k) for k in range(sizes["OUTPUTS"])]
    table = np.zeros((len(targets), len(columns)))
    roundings = np.zeros(table.shape, dtype=int)
    for row, target in enumerate(targets):
        for column, place in enumerate(columns):
            coefficient, count = machine.written[target].get(place, (Fraction(0), 0))
            table[row, column], roundings[row, column] = float(coefficient), count
    return _Kernel(table, roundings, statements, ())


class _Machine:
    """Interprets the statements of a kernel: every name is defined once, before it is used."""

    def __init__(self, name: str, real: str, sizes: Mapping[str, int]) -> None:
        self.name, self.real = name, real
        self.limits = {
            "x": sizes["ORDER"],
            "r": sizes["OUTPUTS"],
            "x_next": sizes["ORDER"],
            "u_next": sizes["INPUTS"],
        }
        self.known: dict[str, Form] = {}
        self.written: dict[tuple[str, int], Form] = {}
        c_real = "float" if real == "float32" else "double"
        self.definition = re.compile(rf"const {c_real} ([a-z]+[0-9]+) = (.+);")
        self.output = re.compile(rf"(x_next|u_next)\[{_INDEX}\] = (.+);")

    def run(self, statement: str) -> None:
        if found := self.definition.fullmatch(statement):
            if found[1] in self.known:
                raise self.refused(statement)
            self.known[found[1]] = self.expression(found[2], statement)
        elif found := self.output.fullmatch(statement):
            place = self.place(found[1], found[2], statement)
            if place in self.written:
                raise self.refused(statement)
            self.written[place] = self.expression(found[3], statement, constant=True)
        else:
            raise self.refused(statement)

    def expression(self, text: str, statement: str, *, constant: bool = False) -> Form:
        if found := re.fullmatch(rf"(x|r)\[{_INDEX}\]", text):
            return {self.place(found[1], found[2], statement): (Fraction(1), 0)}
        if text in self.known:
            return self.known[text]
        if text.startswith("-") and text[1:] in self.known:
            return {place: (-a, k) for place, (a, k) in self.known[text[1:]].items()}
        if constant and _LITERAL.fullmatch(text) and _value(self.name, text, self.real) == 0:
            return {}
        parts = text.split(" ")
        if len(parts) != 3:
            raise self.refused(statement)
        left, sign, right = parts
        if sign == "*" and right in self.known:
            return self.product(left, self.known[right], statement)
        if sign in "+-" and left in self.known and right in self.known:
            return self.sum(left, right, sign, statement)
        raise self.refused(statement)

    def product(self, literal: str, form: Form, statement: str) -> Form:
        """Multiply an input by a literal: one rounding. The product of two rounded things is no form of ours."""
        if not _LITERAL.fullmatch(literal) or len(form) != 1 or any(k for _, k in form.values()):
            raise self.refused(statement)
        ((place, (unit, _)),) = form.items()
        return {place: (unit * Fraction(_value(self.name, literal, self.real)), 1)}

    def sum(self, left: str, right: str, sign: str, statement: str) -> Form:
        """Add two forms: one rounding more for each coefficient. Doubling an input is exact."""
        a, b = self.known[left], self.known[right]
        if left == right and sign == "+" and not any(k for _, k in a.values()):
            return {place: (2 * value, k) for place, (value, k) in a.items()}
        if a.keys() & b.keys():
            raise self.refused(statement)
        factor = 1 if sign == "+" else -1
        return {place: (value, k + 1) for place, (value, k) in a.items()} | {
            place: (factor * value, k + 1) for place, (value, k) in b.items()
        }

    def place(self, letter: str, index: str, statement: str) -> tuple[str, int]:
        if int(index) >= self.limits[letter]:
            raise self.refused(statement)
        return letter, int(index)

    def refused(self, statement: str) -> NotCertified:
        return _refusal(self.name, "c", f"`{statement}` is no statement of a kernel")


def nearest(text: str, real: str) -> float:
    """Return the value of a decimal literal in the type, rounded once, as a C compiler does.

    >>> nearest("0.1f", "float32"), nearest("0.1", "float64")
    (0.10000000149011612, 0.1)
    """
    decimal = text.rstrip("f")
    if real == "float64":
        return float(decimal)
    exact = Fraction(decimal)
    with np.errstate(over="ignore", under="ignore"):
        first = np.float32(float(decimal))
    if not np.isfinite(first):
        return float(first)
    # Rounding to double first may land on the wrong side of a tie: the neighbours are compared exactly.
    near = [np.nextafter(first, np.float32(-np.inf)), first, np.nextafter(first, np.float32(np.inf))]
    near = [value for value in near if np.isfinite(value)]
    return float(min(near, key=lambda v: (abs(Fraction(float(v)) - exact), int(v.view(np.uint32)) & 1)))


def _value(name: str, text: str, real: str) -> float:
    if not _LITERAL.fullmatch(text) or text.endswith("f") != (real == "float32"):
        raise _refusal(name, "c", f"`{text}` is no {real} literal")
    value = nearest(text, real)
    if not np.isfinite(value):
        raise _refusal(name, "c", f"`{text}` is not finite in {real}")
    return value


def _list(name: str, text: str) -> tuple[str, ...]:
    if not (text.startswith("{") and text.endswith("}")):
        raise _refusal(name, "c", f"`{text}` is no row of a table")
    return tuple(text[1:-1].split(", "))


def _macro(name: str, header: str, key: str) -> str:
    found = re.findall(
        rf"^#define {name.upper()}_{key} ([0-9][0-9.e+-]*f?)$",
        _without_comments(name, header, "h"),
        re.MULTILINE,
    )
    if len(found) != 1 or (key != "PERIOD_S" and not re.fullmatch(_INDEX, found[0])):
        raise _refusal(name, "h", f"{name.upper()}_{key} is not defined once, as a number")
    if key == "PERIOD_S" and not (_LITERAL.fullmatch(found[0]) and float(found[0].rstrip("f")) > 0):
        raise _refusal(name, "h", f"the period is `{found[0]}`")
    return str(found[0])


def _sources(
    name: str, header: str, count: int, names: list[str], real: str
) -> tuple[tuple[int, ...], Float[np.ndarray, " nn"]]:
    found = _SOURCE.findall(header)
    if [index for index, _, _ in found] != [str(k) for k in range(count)]:
        raise _refusal(name, "h", f"it does not name its {count} neighbours in order")
    if unknown := [source for _, source, _ in found if source not in names]:
        raise _refusal(name, "h", f"the neighbour `{unknown[0]}` is no agent of this folder")
    suffix = "f" if real == "float32" else ""
    weights = np.array([_value(name, weight + suffix, real) for _, _, weight in found], dtype=float)
    return tuple(names.index(source) for _, source, _ in found), weights


def _weights(
    name: str, source: str, count: int, real: str
) -> tuple[Float[np.ndarray, " nn"], tuple[str, ...]]:
    c_real = "float" if real == "float32" else "double"
    found = re.findall(rf"static const {c_real} weight\[{count}\] = (\{{.*\}});", source)
    if not found:
        return np.ones(count), ()
    literals = _list(name, found[0])
    return np.array([_value(name, text, real) for text in literals]), literals


def _view(
    name: str,
    sizes: Mapping[str, int],
    kernel: _Kernel,
    weight_literals: tuple[str, ...],
    weights: Float[np.ndarray, " nn"],
) -> dict[str, Any]:
    """Return what the templates need to know of an agent, all of it read from the C."""
    n, q, m, nn = sizes["ORDER"], sizes["OUTPUTS"], sizes["INPUTS"], sizes["NEIGHBOURS"]
    M, mask_bits = kernel.table, 32 if nn <= 32 else 64
    parts = {"x": M[:, :n], "r": M[:, n:]}
    idle = [k for k in range(q) if not M[:, n + k].any()]
    return {
        "name": name,
        "NAME": name.upper(),
        "order": n,
        "q": q,
        "m": m,
        "nn": nn,
        "rows": n + m,
        "columns": n + q,
        "mask_bits": mask_bits,
        "all_received": f"0x{2**nn - 1:x}u" + ("ll" if mask_bits == 64 else ""),
        "weights": weight_literals,
        "unit_weights": bool((weights == 1).all()),
        "table": kernel.literals,
        "statements": kernel.statements,
        "unread": [letter for letter, part in parts.items() if part.shape[1] and not part.any()],
        "checked": [f"x_next[{k}]" for k in range(n)]
        + [f"u_next[{k}]" for k in range(m)]
        + [f"r[{k}]" for k in idle],
    }


def _check_form(
    name: str, header: str, source: str, view: dict[str, Any], real: str, period_literal: str
) -> None:
    context = {
        "period_literal": period_literal,
        "c_real": "float" if real == "float32" else "double",
        "zero": "0.0f" if real == "float32" else "0.0",
        "optimize": "size" if view["table"] else "speed",
    }
    for text, template, kind in ((header, "header.h.j2", "h"), (source, "source.c.j2", "c")):
        ours = _code(name, _CODE_ONLY.get_template(template).render(**context, a=view), kind)
        if difference := _first_difference(_code(name, text, kind), ours):
            raise _refusal(name, kind, difference)


def _code(name: str, text: str, kind: str) -> list[str]:
    """Return the lines that are left without comments and white space around them."""
    bare = _without_comments(name, text, kind)
    return [line for line in (raw.strip(" ") for raw in bare.split("\n")) if line]


def _without_comments(name: str, text: str, kind: str) -> str:
    """Replace each comment by a space, as a compiler does: what a string holds is none.

    A string that does not end on its line is refused: in code that is skipped compilers take it for anything, and a
    comment that begins in it may then be code.
    """

    def kept(found: re.Match[str]) -> str:
        if found[0] == '"':
            raise _refusal(name, kind, "a string does not end on its line")
        return " " if found[0].startswith("/*") else found[0]

    return _COMMENT_OR_STRING.sub(kept, text)


def _first_difference(found: list[str], expected: list[str]) -> str:
    for theirs, ours in zip(found, expected, strict=False):
        if theirs != ours:
            return f"it has `{theirs}` where `{ours}` is generated"
    if len(found) != len(expected):
        return f"it has {len(found)} lines of code where {len(expected)} are generated"
    return ""


def _refusal(name: str, kind: str, found: str) -> NotCertified:
    path = f"include/{name}.h" if kind == "h" else f"src/{name}.c"
    return NotCertified(
        f"{path} is not the C that is generated, so nothing is proved of it: {found}", file=path
    )


def _text(path: Path) -> str:
    try:
        # A line's end may be CR LF; a CR alone ends no line in C, so it is left for `read_controller` to refuse.
        return path.read_bytes().decode("utf-8").replace("\r\n", "\n")
    except FileNotFoundError:
        raise ProblemError(
            "there is no such file", where=str(path), remedy="generate the folder again"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ProblemError(f"it cannot be read ({error})", where=str(path)) from None
