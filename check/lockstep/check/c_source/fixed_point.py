"""The C of a controller in integers, written down once more, and its integers read out of it (`sampled/fixed_point`)."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from lockstep.check.c_source import expected as c
from lockstep.check.c_source.reader import COUNT, MAX_NEIGHBOURS, SIZES, in_microseconds, macro, sources
from lockstep.check.c_source.tokens import CText, tokens_of
from lockstep.check.sampled.fixed_point import SHIFTS, FixedController

STATUSES = """
typedef enum { AGENT_FIXED_OK = 0, AGENT_FIXED_NOT_READY = 3, AGENT_FIXED_CLIPPED = 8, AGENT_FIXED_SATURATED = 16
} agent_fixed_status_t; typedef struct {
"""

HEADER = """
[state] int32_t x[ORDER];
int16_t u[INPUTS];
[hears] int16_t held[NEIGHBOURS][OUTPUTS]; MASK heard; uint32_t age[NEIGHBOURS]; uint32_t misses[NEIGHBOURS];
uint32_t ready; } agent_fixed_state_t;
void agent_fixed_init(agent_fixed_state_t *state); void agent_fixed_reset(agent_fixed_state_t *state);
agent_fixed_status_t agent_fixed_step(agent_fixed_state_t *state, const int16_t y[OUTPUTS], const int16_t HEARD,
    MASK received, int16_t u[INPUTS]);
#ifdef __cplusplus
}
#endif
#endif
"""

SOURCE = """
#include "agent_fixed.h"
#if defined(__GNUC__) && !defined(__clang__) && defined(__OPTIMIZE__)
#pragma GCC optimize("Os")
#endif
static int32_t agent_fixed_scaled(int32_t value, uint32_t bits) {
    const uint32_t raised = (uint32_t)value + 0x80000000u + ((uint32_t)1u << (bits - 1u));
    const uint32_t shifted = raised >> bits; const uint32_t offset = 0x80000000u >> bits;
    return (int32_t)shifted - (int32_t)offset; }
[state] static int32_t agent_fixed_high(int32_t value) {
[state]     const uint32_t raised = (uint32_t)value + 0x80000000u; const uint32_t shifted = raised >> 14;
[state]     return (int32_t)shifted - 131072; }
[state] static int32_t agent_fixed_low(int32_t value) {
[state]     const uint32_t rest = (uint32_t)value & 0x3fffu; return (int32_t)rest; }
static int32_t agent_fixed_limited(int32_t value, int32_t lowest, int32_t highest, uint32_t *met) {
    int32_t found = value; if (value < lowest) { found = lowest; *met = 1u; }
    else if (value > highest) { found = highest; *met = 1u; } else { } return found; }
static agent_fixed_status_t agent_fixed_advance(agent_fixed_state_t *state, const int32_t sum[OUTPUTS]) {
    agent_fixed_status_t status = AGENT_FIXED_OK; uint32_t saturated = 0u; uint32_t clipped = 0u; INTO
"""

SOURCE_END = """
    if (saturated != 0u) { status = AGENT_FIXED_SATURATED; } else if (clipped != 0u) { status = AGENT_FIXED_CLIPPED; }
    else { } return status; } void agent_fixed_reset(agent_fixed_state_t *state) { uint32_t k;
[hears] uint32_t j;
[state] for (k = 0u; k < ORDERu; k++) { state->x[k] = 0; }
    for (k = 0u; k < INPUTSu; k++) { state->u[k] = 0; }
[hears] state->heard = 0u; for (j = 0u; j < NEIGHBOURSu; j++) {
[hears]     for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = 0; } state->age[j] = 0u; }
} void agent_fixed_init(agent_fixed_state_t *state) {
[hears] uint32_t j; for (j = 0u; j < NEIGHBOURSu; j++) { state->misses[j] = 0u; }
    agent_fixed_reset(state); state->ready = AGENT_FIXED_DESIGN_WORD; }
agent_fixed_status_t agent_fixed_step(agent_fixed_state_t *state, const int16_t y[OUTPUTS], const int16_t HEARD,
    MASK received, int16_t u[INPUTS]) { agent_fixed_status_t status = AGENT_FIXED_NOT_READY; uint32_t k;
    if (state->ready == AGENT_FIXED_DESIGN_WORD) { int32_t sum[OUTPUTS];
[hears] uint32_t j;
    for (k = 0u; k < OUTPUTSu; k++) { sum[k] = 0; }
[hears] for (j = 0u; j < NEIGHBOURSu; j++) { const MASK bit = (MASK)1u << j;
[hears]     if ((received & bit) != 0u) {
[hears]         for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = neighbour_y[(j * OUTPUTSu) + k]; }
[hears]         state->heard |= bit; state->age[j] = 0u; }
[hears]     else { state->misses[j] += (state->misses[j] < UINT32_MAX) ? 1u : 0u;
[hears]         state->age[j] += (state->age[j] < UINT32_MAX) ? 1u : 0u; }
[hears]     if ((state->heard & bit) != 0u) { for (k = 0u; k < OUTPUTSu; k++) {
[hears]         sum[k] += (int32_t)y[k] - (int32_t)state->held[j][k]; } } }
[alone] (void)y; (void)neighbour_y; (void)received;
    status = agent_fixed_advance(state, sum); } else { agent_fixed_reset(state); }
    for (k = 0u; k < INPUTSu; k++) { u[k] = state->u[k]; } return status; }
"""

_INTEGER = re.compile("[1-9][0-9]{0,9}|0")
_PERIOD = re.compile(r"[0-9]{1,30}(\.[0-9]{1,30})?(e-?[0-9]{1,2})?")


class ReadFixed(NamedTuple):
    """One agent as its C has it: the integers, whom it hears, by their places among the names, and the period in s."""

    integers: FixedController
    sources: tuple[int, ...]
    period: float


def row_of(agent: str, a: Sequence[int], h: int, d: Sequence[int], g: int) -> str:
    """Return the C of one row of (x+, u).

    >>> row_of("a1", (3,), 2, (-4,), 5)
    'a1_fixed_scaled((3 * h0) + a1_fixed_scaled((3 * l0), 14u), 2u) + a1_fixed_scaled((-4 * r0), 5u)'
    """
    scaled = f"{agent}_fixed_scaled"
    high, low, seen = (
        " + ".join(f"({v} * {letter}{k})" for k, v in enumerate(row))
        for letter, row in (("h", a), ("l", a), ("r", d))
    )
    states = f"{scaled}({high} + {scaled}({low}, 14u), {h}u) + " if a else ""
    return f"{states}{scaled}({seen}, {g}u)"


def read_fixed(name: str, header: str, source: str, names: Sequence[str]) -> ReadFixed:
    """Read one agent from the text of its header and source.

    Args:
        name: prefix of the generated code.
        header: text of the header;  source: text of the source.
        names: of all agents, in the network's order: a source of another name is refused.

    Raises:
        NotCertified: the text is not of the form that `lockstep generate` writes.
    """
    top, code = CText(f"fixed/{name}_fixed.h", header), CText(f"fixed/{name}_fixed.c", source)
    words = {"agent": name, "AGENT": name.upper()}
    prefix = f"{name.upper()}_FIXED_"
    top.expect(c.expected(c.HEADER_TOP.replace("AGENT_H", "AGENT_FIXED_H"), set(), words))
    n, q, m, nn = (int(macro(top, prefix + key, COUNT)[:-1]) for key in SIZES)
    if not (q and m and nn <= MAX_NEIGHBOURS):
        raise top.refusal(f"no agent has {q} outputs, {m} inputs, {nn} neighbours")
    period = macro(top, f"{prefix}PERIOD_S", _PERIOD)
    top.expect(in_microseconds(prefix[:-1], period))
    macro(top, f"{prefix}DESIGN_WORD", re.compile("0x[0-9a-f]{8}u"))
    exponent = re.compile(r"\((?:0|-?[1-9][0-9]?)\)")
    formats = [
        tuple(int(macro(top, f"{prefix}{letter}{k}_EXPONENT", exponent)[1:-1]) for k in range(count))
        for letter, count in (("X", n), ("Y", q), ("U", m))
    ]
    top.expect(c.expected(STATUSES, set(), words))
    sizes = {"ORDER": n, "OUTPUTS": q, "INPUTS": m, "NEIGHBOURS": nn}
    words |= {key: str(size) for key, size in sizes.items()}
    words |= {"MASK": "uint64_t" if nn > 32 else "uint32_t"}
    words |= {"HEARD": f"neighbour_y[{nn * q}]" if nn else "*neighbour_y"}
    split = [f"const int32_t {p}{k} = {name}_fixed_{f}(state->x[{k}]);" for k in range(n) for p, f in _PARTS]
    limited = f"{name}_fixed_limited"
    held = [f"const int32_t r{k} = {limited}(sum[{k}], -32767, 32767, &saturated);" for k in range(q)]
    words["INTO"] = " ".join(held + split)
    kinds = {"hears" if nn else "alone"} | ({"state"} if n else set())
    top.expect(c.expected(HEADER, kinds, words))
    top.end()
    code.expect(c.expected(SOURCE, kinds, words))
    rows = [_row(code, name, i, n, q) for i in range(n + m)]
    for k in range(n):
        value = f"{limited}(state->x[{k}] + v{k}, -268435456, 268435456, &saturated);"
        code.expect(f"state->x[{k}] = {value}")
    sides = []
    for k in range(m):
        code.expect(f"state->u[{k}] = (int16_t){limited}(v{n + k}, -")
        low = _integer(code)
        code.expect(",")
        sides.append((-low, _integer(code)))
        code.expect(", &clipped);")
    code.expect(c.expected(SOURCE_END, kinds, words))
    code.end()
    heard, weights = sources(top, header, names, nn)
    if {*weights} - {"1.0"}:
        raise top.refusal("its weights are not 1.0")
    a, h, d, g = zip(*rows, strict=True)
    x, r, u = formats
    integers = FixedController(a, h, d, g, x, r, u, tuple(sides))
    return ReadFixed(integers, heard, float(period))


_PARTS = (("h", "high"), ("l", "low"))


def _integer(file: CText) -> int:
    token = file.take()
    if not _INTEGER.fullmatch(token):
        raise file.refusal(f"`{token}` is no integer")
    return int(token)


def _row(file: CText, name: str, i: int, n: int, q: int) -> tuple[tuple[int, ...], int, tuple[int, ...], int]:
    """Take a row: its numbers are read, and the row written with them must be the one that stands there."""
    tokens = file.take_to(";")
    found = [
        int(token.rstrip("u")) * (-1 if before == "-" else 1)
        for before, token in pairwise(tokens)
        if _INTEGER.fullmatch(token.rstrip("u"))
    ]
    if len(found) == (2 * n + 2 if n else 0) + q + 1:
        a, d, g = tuple(found[:n]), tuple(found[-q - 1 : -1]), found[-1]
        h = found[2 * n + 1] if n else SHIFTS[-1]  # without states there is none
        if list(tokens) == tokens_of(f"const int32_t v{i} = {row_of(name, a, h, d, g)}"):
            return a, h, d, g
    raise file.refusal(f"row {i} is none that is generated")
