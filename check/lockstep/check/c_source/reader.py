"""The controllers' numbers, read from the generated C itself.

Nothing here believes a manifest: orders, the period, the sources and every coefficient come from the header and the
source, and all tokens between the numbers must be those of `expected`, from the first to the last: C of any other form
is refused, since nobody knows what it computes. The agents that are listened to are named in the header's comment, the
one thing that no code says.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Annotated

import numpy as np

from lockstep.check.c_source import expected as c
from lockstep.check.c_source.kernel import Shape, read_statements
from lockstep.check.c_source.tokens import LITERAL, CText
from lockstep.check.errors import demand
from lockstep.check.sampled.controller import PRECISIONS, HeldController
from lockstep.check.sampled.discretise import Real

AGENT = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")
COUNT = re.compile("(?:0|[1-9][0-9]{0,2})u")
_SOURCE = re.compile(
    r"^ \* +neighbour ([0-9]+) +([A-Za-z][A-Za-z0-9_]*), weight a = ([^ ,]{1,99}), bit 0x[0-9a-f]+ of `received`$",
    re.MULTILINE,
)
_FORMS = {"PERIOD_S": LITERAL, "DESIGN_ID": re.compile('"[0-9a-f]{64}"')}
OF_REAL = ("real", "ZERO", "DIGITS", "FORMAT", "SCALE")
SINGLE = ("float", "0.0f", "FLT_MANT_DIG != 24", "binary32", "1.2676506e+30f : 1.0f")
DOUBLE = ("double", "0.0", "DBL_MANT_DIG != 53", "binary64", "1.2676506002282294e+30 : 1.0")
SIZES = ("ORDER", "OUTPUTS", "INPUTS", "NEIGHBOURS")
MAX_NEIGHBOURS = 64
"""One bit of the `received` mask each, and no C99 integer is wider than 64 bits. No controller has a higher order either."""

ANSWERS = 3
"""Steps of the self-check."""

_LOOPS_FROM = 9
"""Products: below, a loop takes more bytes than its unrolled body, and is left to the compiler."""


@dataclass(frozen=True, eq=False)
class ReadController:
    """One agent as its C has it: its controller, the period in s of its header, as its arithmetic has it, this arithmetic,
    where u is clipped, and what is taken from its own output and from its neighbours'.

    The numbers of its self-check are read and not judged: they can only keep from running what is proved.
    """

    controller: HeldController
    period: float
    real: Real
    limits: Annotated[np.ndarray, "m 2"] | None = None
    offsets: Annotated[np.ndarray, "nn+1 q"] | None = None


def read_controller(name: str, header: str, source: str, names: Sequence[str]) -> ReadController:
    """Read one agent from the text of its header and source.

    Args:
        name: prefix of the generated code.
        header: text of the header;  source: text of the source.
        names: of all agents, in the network's order: a source of another name is refused.

    Raises:
        NotCertified: the text is not of the form that `lockstep generate` writes.
        ProblemError: the name is no C identifier.
    """
    demand(AGENT.fullmatch(name), f"`{name}` is no C identifier", "agent")
    top, code = CText(f"include/{name}.h", header), CText(f"src/{name}.c", source)
    words = {"agent": name, "AGENT": name.upper()}
    top.expect(c.expected(c.HEADER_TOP, set(), words))
    shape = Shape(*(int(_macro(top, words, key)[:-1]) for key in SIZES))
    # Statements are read as rows over all products: of 999 states they took 22 s and 1.3 GB.
    fits = max(shape.order, shape.outputs, shape.inputs, shape.neighbours) <= MAX_NEIGHBOURS
    if not (shape.outputs and shape.inputs and fits):
        raise top.refusal(
            f"no agent has {shape.outputs} outputs, {shape.inputs} inputs, {shape.neighbours} neighbours, order {shape.order}"
        )
    period = _macro(top, words, "PERIOD_S")
    top.expect(in_microseconds(words["AGENT"], period))
    words["IDENTITY"] = f"0x{int(_macro(top, words, 'DESIGN_ID')[1:9], 16) | 1:08x}u"
    real: Real = "float32" if period.endswith("f") else "float64"
    agent = _Agent(code, shape, real, words)
    agent.kinds |= {"limited"} if f"{words['AGENT']}_CLIPPED" in top.tokens else set()
    top.expect(agent.expected(c.HEADER))
    top.end()
    table, roundings, weights = agent.read()
    heard, stated = sources(top, header, names, shape.neighbours)
    suffix = "f" if real == "float32" else ""
    if weights.tolist() != [top.value("", weight + suffix, real) for weight in stated]:
        raise top.refusal("its weights are not those of the source")
    controller = HeldController.row_by_row(table, shape.order, heard, weights, PRECISIONS[real])
    if roundings is not None:
        controller = replace(controller, roundings=roundings)
    return ReadController(controller, top.value("", period, real), real, agent.limits, agent.offsets)


class _Agent:
    """Reads a source, the header being known."""

    def __init__(self, file: CText, shape: Shape, real: Real, words: dict[str, str]) -> None:
        n, q, m, nn = shape
        self.file, self.shape, self.real = file, shape, real
        self.words = words | dict(zip(OF_REAL, SINGLE if real == "float32" else DOUBLE, strict=True))
        kind, zero = self.words["real"], self.words["ZERO"]
        bits = 32 if nn <= 32 else 64
        self.words |= {"NOTHING": ", ".join([zero] * q), "READY": c.expected(c.READY, set(), words)}
        self.words |= {"MASK": f"uint{bits}_t", "RECEIVED": f"0x{2**nn - 1:x}u" + "ll" * (bits > 32)}
        self.words |= {"ORDER": str(n), "OUTPUTS": str(q), "INPUTS": str(m), "NEIGHBOURS": str(nn)}
        sizes = {"MESSAGES": nn * q, "NUMBERS": nn * q or q, "ROWS": n + m, "COLUMNS": n + q}
        self.words |= {key: str(size) for key, size in sizes.items()}
        self.words["HEARD"] = f"const {kind} neighbour_y[{nn * q}]" if nn else f"const {kind} *neighbour_y"
        states = (f"const {kind} x[{n}],", f"{kind} x_next[{n}],", "state->x, r, x_next,", f"{n}u +")
        self.words |= dict(
            zip(("XGIVEN", "XNEXT", "XPASSED", "AFTER"), states if n else ("", "", "r,", ""), strict=True)
        )
        kept = c.KEPT if shape.terms >= _LOOPS_FROM else ""
        self.words |= {"KEPT": kept, "LOOP": c.KEPT, "ANSWERS": str(ANSWERS)}
        self.kinds = {"hears" if nn else "alone"} | ({"state"} if n else set())
        name, shifted = words["agent"], f"{words['agent']}_exchange" in file.tokens
        self.kinds |= {"shifted"} if shifted else set()
        self.words["STEPS"] = f"{name}_{'exchange' if shifted else 'step'}"
        self.words["EXCHANGE"] = f"{'static ' * shifted}{name}_status_t {self.words['STEPS']}"
        self.limits: Annotated[np.ndarray, "m 2"] | None = None
        self.offsets: Annotated[np.ndarray, "nn+1 q"] | None = None

    def expected(self, code: str) -> str:
        return c.expected(code, self.kinds, self.words)

    def read(self) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Return [A B; C D], the roundings behind each product where they were counted, and the weights a_j."""
        file, roundings = self.file, None
        file.expect(self.expected(c.SOURCE_TOP))
        if file.sees(self.expected(c.TABLE)):
            self.kinds.add("size")
            table = self.table()
        else:
            self.kinds.add("speed")
            table, roundings = self.unrolled()
        file.expect(self.expected(c.SOURCE))
        if "limited" in self.kinds:
            sides = [self.array(c.SIDE.format(name), self.shape.inputs) for name in ("lower", "upper")]
            self.limits = np.array(sides).T
        file.expect(self.expected(c.SOURCE_MIDDLE))
        weights = np.ones(self.shape.neighbours)
        if self.shape.neighbours and file.sees(self.expected(c.WEIGHTS)):
            weights = np.array(self.array(c.WEIGHTS, len(weights)))
            self.kinds.add("weighted")
            if (weights == 1).all():
                raise file.refusal("weights that are all 1 are not generated")
        else:
            self.kinds.add("unit")
        n, q, m, nn = self.shape
        file.expect(self.expected(c.SOURCE_STEP))
        if "shifted" in self.kinds:
            count = (1 + nn) * q
            self.offsets = np.array(self.array(c.OFFSETS.format(count), count)).reshape(1 + nn, q)
        file.expect(self.expected(c.SOURCE_END))
        for name, count in (("given", (ANSWERS + nn) * q), ("answer", ANSWERS * (n + m))):
            self.array(c.KNOWN.format(name, count), count)
        file.expect(self.expected(c.SELF_CHECK_END))
        file.end()
        return table, roundings, weights

    def array(self, code: str, count: int) -> list[float]:
        """Take the definition of an array, and return its numbers."""
        self.file.expect(self.expected(code))
        values = self.file.row(count, self.real)
        self.file.expect(";")
        return values

    def table(self) -> Annotated[np.ndarray, "k l"]:
        n, q, m, _ = self.shape
        self.file.expect(self.expected(c.TABLE))
        rows = []
        for k in range(n + m):
            self.file.expect("," * (k > 0))
            rows.append(self.file.row(n + q, self.real))
        return np.array(rows).reshape(n + m, n + q)

    def unrolled(self) -> tuple[Annotated[np.ndarray, "k l"], Annotated[np.ndarray, "k l"]]:
        n, q, m, _ = self.shape
        self.file.expect(self.expected(c.KERNEL))
        table, roundings = read_statements(self.file, self.shape, self.real)
        parts = {"x": table[:, :n], "r": table[:, n:]}
        # An r_k that is read and not finite makes its row so; one that no row reads is checked by itself.
        checked = [f"x_next[{k}]" for k in range(n)] + [f"u_next[{k}]" for k in range(m)]
        checked += [f"r[{k}]" for k in range(q) if not parts["r"][:, k].any()]
        checks = [
            f"check = check + ({v} - {v});" if k else f"check = {v} - {v};" for k, v in enumerate(checked)
        ]
        both = [*(("x", k) for k in range(n)), *(("u", k) for k in range(m))]
        writes = [f"state->{v}[{k}] = {v}_next[{k}];" for v, k in both]
        unread = [f"(void){letter};" for letter, part in parts.items() if part.size and not part.any()]
        self.words |= {"CHECKS": " ".join(checks), "WRITES": " ".join(writes), "UNREAD": " ".join(unread)}
        return table, roundings


def _macro(file: CText, words: dict[str, str], key: str) -> str:
    """Take a definition: the period, a literal above 0; the design's hash; or a dimension."""
    number = macro(file, f"{words['AGENT']}_{key}", _FORMS.get(key, COUNT))
    if key == "PERIOD_S" and not 0 < float(number.rstrip("f")) < np.inf:
        raise file.refusal(f"the period is `{number}`")
    return number


def macro(file: CText, name: str, form: re.Pattern[str]) -> str:
    """Take `#define name value` and return its value."""
    found, _, value = file.take().removeprefix("#define ").partition(" ")
    if found != name or not form.fullmatch(value):
        raise file.refusal(f"{name} is not defined in its place, in its form")
    return value


def in_microseconds(name: str, period: str) -> str:
    """Return the definition of a period that is whole microseconds, of any other "".

    >>> in_microseconds("A1", "0.005f"), in_microseconds("A1", "0.0000005f")
    ('#define A1_PERIOD_US 5000u', '')
    """
    whole = Fraction(period.rstrip("f")) * 10**6
    return f"#define {name}_PERIOD_US {whole}u" if whole.denominator == 1 and whole < 2**32 else ""


def sources(
    file: CText, header: str, names: Sequence[str], count: int
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return whom an agent hears, by their places among the names, and the weights, as the header's comment says them."""
    found = _SOURCE.findall(header)
    if [index for index, _, _ in found] != [str(k) for k in range(count)]:
        raise file.refusal(f"it does not name its {count} neighbours in order")
    if unknown := [source for _, source, _ in found if source not in names]:
        raise file.refusal(f"the neighbour `{unknown[0]}` is no agent of this folder")
    return tuple(list(names).index(source) for _, source, _ in found), tuple(weight for _, _, weight in found)
