"""The C that is generated for one agent, written down once more, without comments and for an agent called `agent`.

`expected` leaves out the lines marked for other kinds of agents: `[state]` is for those of an order above 0, `[hears]`
and `[alone]` for those with neighbours and without, `[speed]` for unrolled statements, `[size]` for a loop over a table,
`[unit]` and `[weighted]` for weights that are all 1 or not, `[limited]` for inputs that are clipped, `[shifted]` for outputs
less their offsets. The words in capitals,
`agent` and `real` are put in by `reader`; some are parts of argument lists that only such agents have.
"""

import re
from collections.abc import Mapping

_KIND = re.compile(r"((?:\[[a-z]+\])*)(.*)")
_WORD = re.compile(r"\b(?:(agent|AGENT)(?=[_.])|(real|[A-Z]{4,})(?=u?\b))")


def expected(code: str, kinds: set[str], words: Mapping[str, str]) -> str:
    """Return C for the kinds of agent, with an agent's own words.

    >>> words = {"agent": "a1", "real": "float", "INPUTS": "1"}
    >>> expected("real agent_f(real u[INPUTS]);\\n[hears]x\\n[state]g(INPUTSu);", {"state"}, words)
    'float a1_f(float u[1]);\\ng(1u);'
    """
    lines = [_KIND.match(line) for line in code.split("\n")]
    kept = [found[2] for found in lines if found and set(re.findall("[a-z]+", found[1])) <= kinds]
    return _WORD.sub(lambda found: words.get(found[1] or found[2], found[0]), "\n".join(kept))


KEPT = """
#if defined(__clang__)
#pragma clang loop unroll(disable)
#endif
"""

HEADER_TOP = """
#ifndef AGENT_H
#define AGENT_H
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif
"""

HEADER = """
#define AGENT_DESIGN_WORD IDENTITY
#define AGENT_ALL_RECEIVED RECEIVED
typedef MASK agent_mask_t; typedef enum { AGENT_OK = 0, AGENT_NOT_FINITE = 1, AGENT_OVERFLOW = 2,
    AGENT_NOT_READY = 3, AGENT_UNFIT = 4
[limited]  , AGENT_CLIPPED = 8
           } agent_status_t; typedef struct {
[state]    real x[ORDER];
           real u[INPUTS];
[hears]    real held[NEIGHBOURS][OUTPUTS]; agent_mask_t heard; uint32_t age[NEIGHBOURS]; uint32_t misses[NEIGHBOURS];
    uint32_t ready; } agent_state_t;
agent_status_t agent_self_check(void); agent_status_t agent_init(agent_state_t *state);
void agent_reset(agent_state_t *state);
agent_status_t agent_step(agent_state_t *state, const real y[OUTPUTS], HEARD, agent_mask_t received, real u[INPUTS]);
agent_status_t agent_step_relative(agent_state_t *state, const real r[OUTPUTS], real u[INPUTS]);
[limited] agent_status_t agent_applied(agent_state_t *state, const real u[INPUTS]);
#ifdef __cplusplus
}
#endif
#endif
"""

SOURCE_TOP = """
#include "agent.h"
#include <float.h>
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "Floating-point shortcuts change the results: compile without -ffast-math and its parts."
#endif
#if defined(__FINITE_MATH_ONLY__)
#if __FINITE_MATH_ONLY__ > 0
#error "NaN and infinity must be honoured: compile without -ffinite-math-only."
#endif
#endif
#if !defined(FLT_EVAL_METHOD)
#error "This compiler's float.h has no FLT_EVAL_METHOD (C99): how it rounds is not known."
#elif (FLT_EVAL_METHOD != 0) && (FLT_EVAL_METHOD != 16)
#error "Each operation must round to its own type (FLT_EVAL_METHOD 0); x87 arithmetic does not."
#endif
#if (FLT_RADIX != 2) || (DIGITS)
#error "IEEE 754 FORMAT is needed."
#endif
#if defined(__clang__)
#define LOCKSTEP_ONE_COPY __attribute__((noinline))
#pragma STDC FP_CONTRACT OFF
#if __clang_major__ >= 14
#pragma clang fp reassociate(off)
#endif
#elif defined(__GNUC__)
#define LOCKSTEP_ONE_COPY __attribute__((noinline, noclone))
#pragma GCC optimize("fp-contract=off", "no-tree-vectorize")
#else
#define LOCKSTEP_ONE_COPY
#pragma STDC FP_CONTRACT OFF
#endif
"""

READY = "agent_status_t status = AGENT_NOT_READY; if (state->ready == AGENT_DESIGN_WORD) {"

TABLE = "static const real agent_gain[ROWS][COLUMNS] = {"

KERNEL = "static void agent_kernel(XGIVEN const real r[OUTPUTS], XNEXT real u_next[INPUTS]) {"

SOURCE = """
[speed] UNREAD } static agent_status_t agent_advance(agent_state_t *state, const real r[OUTPUTS]) {
[speed]    agent_status_t status = AGENT_OVERFLOW;
[speed][state] real x_next[ORDER];
[speed]    real u_next[INPUTS]; real check; agent_kernel(XPASSED u_next);
[speed]    CHECKS if (check == ZERO) { WRITES status = AGENT_OK; } return status; }
[size] }; static agent_status_t agent_advance(agent_state_t *state, const real r[OUTPUTS], real inputs) {
[size]    agent_status_t status = (inputs == ZERO) ? AGENT_OVERFLOW : AGENT_NOT_FINITE;
[size]    real next[ROWS]; real check = inputs; uint32_t i; uint32_t j;
[size]KEPT
[size]    for (i = 0u; i < ROWSu; i++) { real sum = ZERO;
[size][state]KEPT
[size][state] for (j = 0u; j < ORDERu; j++) { const real product = agent_gain[i][j] * state->x[j]; sum = sum + product; }
[size]KEPT
[size]       for (j = 0u; j < OUTPUTSu; j++) { const real product = agent_gain[i][AFTER j] * r[j]; sum = sum + product; }
[size]       next[i] = sum; check = check + (sum - sum); } if (check == ZERO) {
[size][state] for (i = 0u; i < ORDERu; i++) { state->x[i] = next[i]; }
[size]       for (i = 0u; i < INPUTSu; i++) { state->u[i] = next[AFTER i]; } status = AGENT_OK; } return status; }
static real agent_check(const real *values, uint32_t count) { real check = ZERO; uint32_t k;
    for (k = 0u; k < count; k++) { check = check + (values[k] - values[k]); } return check; }
static void agent_output(const agent_state_t *state, real u[INPUTS]) {
    uint32_t k; for (k = 0u; k < INPUTSu; k++) { u[k] = state->u[k]; } }
[limited] static agent_status_t agent_clip(agent_state_t *state, agent_status_t status) {
"""

SIDE = "static const real {}[INPUTS] ="

SOURCE_MIDDLE = """
[limited]     agent_status_t found = status;
[limited]     if (status == AGENT_OK) { uint32_t k; for (k = 0u; k < INPUTSu; k++) {
[limited]         if (state->u[k] < lower[k]) { state->u[k] = lower[k]; found = AGENT_CLIPPED; }
[limited]         else if (state->u[k] > upper[k]) { state->u[k] = upper[k]; found = AGENT_CLIPPED; } else { } } }
[limited]     return found; }
void agent_reset(agent_state_t *state) { uint32_t k;
[hears] uint32_t j;
[state] for (k = 0u; k < ORDERu; k++) { state->x[k] = ZERO; }
    for (k = 0u; k < INPUTSu; k++) { state->u[k] = ZERO; }
[hears] state->heard = 0u; for (j = 0u; j < NEIGHBOURSu; j++) {
[hears]     for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = ZERO; } state->age[j] = 0u; }
} static void agent_start(agent_state_t *state) {
[hears] uint32_t j; for (j = 0u; j < NEIGHBOURSu; j++) { state->misses[j] = 0u; }
    agent_reset(state); state->ready = AGENT_DESIGN_WORD; }
LOCKSTEP_ONE_COPY agent_status_t agent_step_relative(agent_state_t *state, const real r[OUTPUTS], real u[INPUTS]) { READY
[speed] status = agent_advance(state, r);
[speed] if ((status != AGENT_OK) && (agent_check(r, OUTPUTSu) != ZERO)) { status = AGENT_NOT_FINITE; }
[size]  status = agent_advance(state, r, agent_check(r, OUTPUTSu));
[limited] status = agent_clip(state, status);
    } else { agent_reset(state); } agent_output(state, u); return status; }
[hears] static agent_mask_t agent_usable(const real neighbour_y[MESSAGES], agent_mask_t received) {
[hears]     agent_mask_t usable = 0u; uint32_t j;
[hears]LOOP
[hears]     for (j = 0u; j < NEIGHBOURSu; j++) {
[hears]         const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j);
[hears]         if (((received & bit) != 0u) && (agent_check(&neighbour_y[j * OUTPUTSu], OUTPUTSu) == ZERO)) {
[hears]             usable |= bit; } } return usable; }
[hears] static void agent_relative(const agent_state_t *state, const real y[OUTPUTS], const real neighbour_y[MESSAGES],
[hears]     agent_mask_t received, real r[OUTPUTS]) {
"""

WEIGHTS = "static const real weight[NEIGHBOURS] ="

SOURCE_STEP = """
[hears]     uint32_t j; uint32_t k; for (k = 0u; k < OUTPUTSu; k++) { r[k] = ZERO; } for (j = 0u; j < NEIGHBOURSu; j++) {
[hears]         const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j); const real *source = y;
[hears]         if ((received & bit) != 0u) { source = &neighbour_y[j * OUTPUTSu]; }
[hears]         else if ((state->heard & bit) != 0u) { source = state->held[j]; } else { }
[hears]         for (k = 0u; k < OUTPUTSu; k++) { const real difference = y[k] - source[k];
[hears][unit]       r[k] = r[k] + difference;
[hears][weighted]   const real term = weight[j] * difference; r[k] = r[k] + term;
[hears] } } } static void agent_remember(agent_state_t *state, const real neighbour_y[MESSAGES], agent_mask_t received,
[hears]     agent_status_t status) { uint32_t j; uint32_t k; for (j = 0u; j < NEIGHBOURSu; j++) {
[hears]         const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j);
[hears]         if ((received & bit) == 0u) { state->misses[j] += (state->misses[j] < UINT32_MAX) ? 1u : 0u; }
[hears]         if (((received & bit) != 0u) && (status == AGENT_OK)) {
[hears]             for (k = 0u; k < OUTPUTSu; k++) { state->held[j][k] = neighbour_y[(j * OUTPUTSu) + k]; }
[hears]             state->heard |= bit; state->age[j] = 0u; }
[hears]         else { state->age[j] += (state->age[j] < UINT32_MAX) ? 1u : 0u; } } }
LOCKSTEP_ONE_COPY EXCHANGE(
    agent_state_t *state, const real y[OUTPUTS], HEARD, agent_mask_t received, real u[INPUTS]) {
[hears]        READY real r[OUTPUTS]; const agent_mask_t usable = agent_usable(neighbour_y, received);
[hears]        agent_relative(state, y, neighbour_y, usable, r);
[hears][speed] status = agent_advance(state, r);
[hears][speed] if ((status != AGENT_OK) && (agent_check(y, OUTPUTSu) != ZERO)) { status = AGENT_NOT_FINITE; }
[hears][size]  status = agent_advance(state, r, agent_check(y, OUTPUTSu));
[hears]        agent_remember(state, neighbour_y, usable, status);
[alone]        const real r[OUTPUTS] = { NOTHING }; agent_status_t status = AGENT_NOT_READY;
[alone]        (void)neighbour_y; (void)received; if (state->ready == AGENT_DESIGN_WORD) {
[alone][speed] status = AGENT_NOT_FINITE; if (agent_check(y, OUTPUTSu) == ZERO) { status = agent_advance(state, r); }
[alone][size]  status = agent_advance(state, r, agent_check(y, OUTPUTSu));
[limited]      status = agent_clip(state, status);
    } else { agent_reset(state); } agent_output(state, u); return status; }
[shifted] agent_status_t agent_step(
[shifted]     agent_state_t *state, const real y[OUTPUTS], HEARD, agent_mask_t received, real u[INPUTS]) {
"""

OFFSETS = "static const real offset[{}] ="

SOURCE_END = """
[shifted]     real own[OUTPUTS]; real others[MESSAGES]; uint32_t j; uint32_t k;
[shifted]     for (k = 0u; k < OUTPUTSu; k++) { own[k] = y[k] - offset[k]; }
[shifted]     for (j = 0u; j < NEIGHBOURSu; j++) { const agent_mask_t bit = (agent_mask_t)((agent_mask_t)1u << j);
[shifted]         for (k = 0u; k < OUTPUTSu; k++) { others[(j * OUTPUTSu) + k] = ((received & bit) != 0u)
[shifted]             ? (neighbour_y[(j * OUTPUTSu) + k] - offset[((j + 1u) * OUTPUTSu) + k]) : ZERO; } }
[shifted]     return agent_exchange(state, own, others, received, u); }
[limited] agent_status_t agent_applied(agent_state_t *state, const real u[INPUTS]) {
[limited]     agent_status_t status = AGENT_NOT_READY; if (state->ready == AGENT_DESIGN_WORD) {
[limited]     status = AGENT_NOT_FINITE; if (agent_check(u, INPUTSu) == ZERO) { uint32_t k;
[limited]     for (k = 0u; k < INPUTSu; k++) { state->u[k] = u[k]; } status = agent_clip(state, AGENT_OK); } }
[limited]     return status; }
agent_status_t agent_self_check(void) {
"""

KNOWN = "static const real {}[{}] ="

SELF_CHECK_END = """
    static const real zeros[2] = { -ZERO, ZERO }; volatile uint32_t first = 0u;
    const real plus = ZERO + zeros[first & 1u];
    const uint8_t *bytes = (const uint8_t *)&plus; real bad[NUMBERS]; real none; uint8_t *bits = (uint8_t *)&none;
    agent_state_t state; real u[INPUTS]; uint32_t differs = 0u; uint32_t j; uint32_t k;
    agent_start(&state); for (k = first; k < sizeof(plus); k++) { differs |= bytes[k]; }
    for (k = 0u; k < sizeof(none); k++) { bits[k] = (uint8_t)~first; } for (k = 0u; k < NUMBERSu; k++) { bad[k] = none; }
    differs |= (agent_step_relative(&state, bad, u) == AGENT_NOT_FINITE) ? 0u : 1u;
[hears] differs |= (STEPS(&state, &given[OUTPUTSu], bad, 1u, u) == AGENT_OK) ? 0u : 1u;
[hears] differs |= (state.age[0] == 1u) ? 0u : 1u;
LOOP for (k = first; k < ANSWERSu; k++) { const real scale = (k == 0u) ? SCALE;
[hears] if (k == 0u) { (void)agent_step_relative(&state, given, u); } else { (void)STEPS(&state,
[hears]     &given[k * OUTPUTSu], &given[(k + 1u) * OUTPUTSu], AGENT_ALL_RECEIVED, u); }
[alone] (void)agent_step_relative(&state, &given[k * OUTPUTSu], u);
[state] for (j = 0u; j < ORDERu; j++) { differs |= ((state.x[j] * scale) == answer[(k * ROWSu) + j]) ? 0u : 1u; }
        for (j = 0u; j < INPUTSu; j++) { differs |= ((u[j] * scale) == answer[(k * ROWSu) + AFTER j]) ? 0u : 1u; } }
    return (differs == 0u) ? AGENT_OK : AGENT_UNFIT; }
agent_status_t agent_init(agent_state_t *state) { const agent_status_t status = agent_self_check();
    agent_start(state); if (status != AGENT_OK) { state->ready = 0u; } return status; }
"""
