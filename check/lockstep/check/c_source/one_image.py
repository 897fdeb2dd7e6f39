"""The C of one image for all nodes, written down once more: r from a list given at run time, then a controller's step.

    r = (((y - y) + a_1 (y - y_1)) + a_2 (y - y_2)) + ...,    every product and every sum rounded once, y - y = 0

These are the roundings of `HeldController.row_by_row`, for as many neighbours as a node has; no number of the controller is
in this text, and those of its self-check can only keep from running what is proved.
"""

import re
from collections.abc import Sequence

from lockstep.check.c_source import expected as c
from lockstep.check.c_source.reader import DOUBLE, MAX_NEIGHBOURS, OF_REAL, SINGLE, ReadController, macro
from lockstep.check.c_source.tokens import CText

_COUNT = re.compile("[1-9][0-9]?u")

HEADER = """
#define AGENT_NUMBERS COUNTu
typedef MASK agent_mask_t; typedef enum { AGENT_OK = 0, AGENT_NOT_FINITE = 1, AGENT_OVERFLOW = 2,
    AGENT_NOT_READY = 3, AGENT_UNFIT = 4, AGENT_TOO_MANY = 5
[limited] , AGENT_CLIPPED = 8
    } agent_status_t;
typedef struct { uint32_t count; real weight[MOST]; } agent_list_t; typedef struct { CONTROLLER
    real u[INPUTS]; real held[MOST][OUTPUTS]; agent_mask_t heard; uint32_t age[MOST]; uint32_t misses[MOST];
    uint32_t ready; } agent_state_t;
agent_status_t agent_init(agent_state_t *state NUMBER);
void agent_reset(agent_state_t *state); void agent_forget(agent_state_t *state, uint32_t slot);
agent_status_t agent_step(agent_state_t *state, const agent_list_t *list, const real y[OUTPUTS], const real *neighbour_y,
    agent_mask_t received, real u[INPUTS]);
agent_status_t agent_step_relative(agent_state_t *state, const real r[OUTPUTS], real u[INPUTS]);
[limited] agent_status_t agent_applied(agent_state_t *state, const real u[INPUTS]);
#ifdef __cplusplus
}
#endif
#endif
"""

SOURCE = """
static agent_status_t agent_advance(agent_state_t *state, const real r[OUTPUTS], real u[INPUTS]) { ADVANCE }
static real agent_check(const real *values, uint32_t count) { real check = ZERO; uint32_t k;
    for (k = 0u; k < count; k++) { check = check + (values[k] - values[k]); } return check; }
static agent_mask_t agent_usable(uint32_t count, const real *neighbour_y, agent_mask_t received) {
    agent_mask_t usable = 0u; uint32_t j; for (j = 0u; j < count; j++) {
        const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j);
        if (((received & bit) != 0u) && (agent_check(&neighbour_y[j * OUTPUTSu], OUTPUTSu) == ZERO)) {
            usable |= bit; } } return usable; }
LOCKSTEP_ONE_COPY static void agent_relative(const agent_state_t *state, const agent_list_t *list,
    const real y[OUTPUTS], const real *neighbour_y, agent_mask_t received, real r[OUTPUTS]) { uint32_t j; uint32_t k;
    for (k = 0u; k < OUTPUTSu; k++) { r[k] = y[k] - y[k]; } for (j = 0u; j < list->count; j++) {
        const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j); const real *source = y;
        if ((received & bit) != 0u) { source = &neighbour_y[j * OUTPUTSu]; }
        else if ((state->heard & bit) != 0u) { source = state->held[j]; } else { }
        for (k = 0u; k < OUTPUTSu; k++) { const real difference = y[k] - source[k];
            const real term = list->weight[j] * difference; r[k] = r[k] + term; } } }
static void agent_remember(agent_state_t *state, uint32_t count, const real *neighbour_y, agent_mask_t received,
    agent_status_t status) { uint32_t j; uint32_t k; for (j = 0u; j < count; j++) {
        const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j);
        if ((received & bit) == 0u) { state->misses[j] += (state->misses[j] < UINT32_MAX) ? 1u : 0u; }
        if (((received & bit) != 0u) && (status == AGENT_OK)) {
            for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = neighbour_y[(j * OUTPUTSu) + k]; }
            state->heard |= bit; state->age[j] = 0u; }
        else { state->age[j] += (state->age[j] < UINT32_MAX) ? 1u : 0u; } } }
static void agent_output(const agent_state_t *state, real u[INPUTS]) {
    uint32_t k; for (k = 0u; k < INPUTSu; k++) { u[k] = state->u[k]; } }
void agent_reset(agent_state_t *state) { uint32_t j; uint32_t k; RESET
    for (k = 0u; k < INPUTSu; k++) { state->u[k] = ZERO; } state->heard = 0u; for (j = 0u; j < MOSTu; j++) {
        for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = ZERO; } state->age[j] = 0u; } }
void agent_forget(agent_state_t *state, uint32_t slot) { if (slot < MOSTu) { uint32_t k;
    state->heard &= (agent_mask_t)~(agent_mask_t)((agent_mask_t)1u << slot);
    for (k = 0u; k < OUTPUTSu; k++) { state->held[slot][k] = ZERO; } state->age[slot] = 0u; state->misses[slot] = 0u; } }
LOCKSTEP_ONE_COPY agent_status_t agent_step_relative(agent_state_t *state, const real r[OUTPUTS], real u[INPUTS]) {
    agent_status_t status = AGENT_NOT_READY;
    if (state->ready == READY) { status = agent_advance(state, r, state->u); } else { agent_reset(state); }
    agent_output(state, u); return status; }
LOCKSTEP_ONE_COPY agent_status_t agent_step(agent_state_t *state, const agent_list_t *list, const real y[OUTPUTS],
    const real *neighbour_y, agent_mask_t received, real u[INPUTS]) { agent_status_t status = AGENT_NOT_READY;
    if (state->ready != READY) { agent_reset(state); }
    else if (list->count > MOSTu) { status = AGENT_TOO_MANY; } else { real r[OUTPUTS];
        const agent_mask_t usable = agent_usable(list->count, neighbour_y, received);
        agent_relative(state, list, y, neighbour_y, usable, r); status = agent_advance(state, r, state->u);
        if ((status == AGENT_NOT_FINITE) || (status == AGENT_OVERFLOW)) {
            status = (agent_check(y, OUTPUTSu) == ZERO) ? AGENT_OVERFLOW : AGENT_NOT_FINITE; }
        agent_remember(state, list->count, neighbour_y, usable, KEPT); }
    agent_output(state, u); return status; }
[limited] agent_status_t agent_applied(agent_state_t *state, const real u[INPUTS]) { agent_status_t status = AGENT_NOT_READY;
[limited]     if (state->ready == READY) { uint32_t k; APPLY } return status; }
static uint32_t agent_differs(agent_state_t *state) { static const agent_list_t list = { KNOWNu,
"""

SOURCE_END = """
    volatile uint32_t first = 0u; uint32_t differs = 0u; uint32_t j; uint32_t k;
    for (k = first; k < 2u; k++) { real r[OUTPUTS];
        agent_relative(state, &list, &given[k * OUTPUTSu], &given[(k + 1u) * OUTPUTSu], ARRIVED, r);
        for (j = 0u; j < OUTPUTSu; j++) { differs |= (r[j] == answer[(k * OUTPUTSu) + j]) ? 0u : 1u; } }
    return differs; }
agent_status_t agent_init(agent_state_t *state NUMBER) { agent_status_t status = AGENT_UNFIT; uint32_t j; INIT
    for (j = 0u; j < MOSTu; j++) { state->misses[j] = 0u; } agent_reset(state);
    if (agent_differs(state) != 0u) { status = AGENT_UNFIT; }
    state->ready = (status == AGENT_OK) ? READY : 0u; return status; }
"""


def read_node(name: str, cores: Sequence[str], one: ReadController, header: str, source: str) -> int:
    """Read the C of the nodes of one image; return how many neighbours a list may hold.

    Args:
        name: prefix of the code.
        cores: names of the controllers, by the node's number;  one: any of them, as it was read.
        header: text of the header;  source: text of the source.

    Raises:
        NotCertified: the text is not of the form that `lockstep generate` writes.
    """
    top, code = CText(f"include/{name}.h", header), CText(f"src/{name}.c", source)
    words, q = _words(name, cores, one), one.controller.outputs
    kinds = set() if one.limits is None else {"limited"}
    top.expect(c.expected("#ifndef AGENT_H\n#define AGENT_H", set(), words))
    top.expect("".join(f'#include "{core}.h"\n' for core in cores))
    top.expect(c.expected(c.HEADER_TOP.split("#define AGENT_H\n")[1], set(), words))
    most = macro(top, f"{name.upper()}_MAX_NEIGHBOURS", _COUNT)[:-1]
    if int(most) > MAX_NEIGHBOURS:
        raise top.refusal(f"a list of at most `{most}` neighbours")
    known = min(2, int(most))
    words |= {"MOST": most, "MASK": f"uint{32 if int(most) <= 32 else 64}_t"}
    words |= {"KNOWN": str(known), "ARRIVED": f"0x{2**known - 1:x}u"}
    top.expect(c.expected(HEADER, kinds, words))
    top.end()
    code.expect(c.expected(c.SOURCE_TOP + SOURCE, kinds, words))
    code.row(int(most), one.real)
    code.expect("};")
    for array, count in (("given", (2 + known) * q), ("answer", 2 * q)):
        code.expect(c.expected(c.KNOWN.format(array, count), set(), words))
        code.row(count, one.real)
        code.expect(";")
    code.expect(c.expected(SOURCE_END, set(), words))
    code.end()
    return int(most)


def _words(name: str, cores: Sequence[str], one: ReadController) -> dict[str, str]:
    words = {"agent": name, "AGENT": name.upper(), "COUNT": str(len(cores))}
    words |= dict(zip(OF_REAL, SINGLE if one.real == "float32" else DOUBLE, strict=True))
    words |= {"OUTPUTS": str(one.controller.outputs), "INPUTS": str(one.controller.inputs)}
    words["READY"] = f"{cores[0].upper()}_DESIGN_WORD"
    OK, CLIPPED, clips = f"{name.upper()}_OK", f"{name.upper()}_CLIPPED", one.limits is not None
    words["KEPT"] = f"(status == {CLIPPED}) ? {OK} : status" if clips else "status"
    keep = f"for (k = 0u; k < {words['INPUTS']}u; k++) {{ state->u[k] = state->controller.u[k]; }}"
    if len(cores) == 1:
        (core,) = cores
        return words | {
            "CONTROLLER": f"{core}_state_t controller;",
            "NUMBER": "",
            "ADVANCE": f"return ({name}_status_t){core}_step_relative(&state->controller, r, u);",
            "RESET": f"{core}_reset(&state->controller);",
            "INIT": f"status = ({name}_status_t){core}_init(&state->controller);",
            "APPLY": f"status = ({name}_status_t){core}_applied(&state->controller, u); {keep}",
        }

    def by_number(of: str, form: str) -> str:
        cases = (f"case {i}u: {form.replace('{0}', core)} break;" for i, core in enumerate(cores))
        return f"switch ({of}) {{ {' '.join(cases)} default: break; }}"

    states = " ".join(f"{core}_state_t {core};" for core in cores)
    advance = f"status = ({name}_status_t){{0}}_step_relative(&state->controller.{{0}}, r, u);"
    init = f"status = ({name}_status_t){{0}}_init(&state->controller.{{0}});"
    apply = f"status = ({name}_status_t){{0}}_applied(&state->controller.{{0}}, u); "
    apply += keep.replace("controller", "controller.{0}")
    start = f"{name}_status_t status = {name.upper()}_NOT_READY;"
    return words | {
        "CONTROLLER": f"union {{ {states} }} controller; uint32_t number;",
        "NUMBER": ", uint32_t number",
        "ADVANCE": f"{start} {by_number('state->number', advance)} return status;",
        "RESET": by_number("state->number", "{0}_reset(&state->controller.{0});"),
        "APPLY": by_number("state->number", apply),
        "INIT": f"state->number = number; {by_number('number', init)}",
    }
