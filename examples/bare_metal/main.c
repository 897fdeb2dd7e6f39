/* The controller of one arm in the timer's interrupt; the main loop sleeps. */
#include "arm1.h"
#include "board.h"

void SysTick_Handler(void);
int main(void);

#define MOST_FAULTS 3u /* in a row stop the motor until the board is reset */
#define OLDEST 20u     /* periods: a step on an older message of the neighbour is counted as a fault */

static arm1_state_t controller;
static uint32_t taken; /* `sequence` of the last message that was taken */
static uint32_t faults; /* in a row; MOST_FAULTS of them stay */
static int checked;     /* 1 once it is known how this interrupt computes, whose FPSCR is not that of main */

/* Copy the radio's message. Whole and new: 1. Half of it may be another one's: 0, and it is taken next time. */
static arm1_mask_t receive(float message[2])
{
    const uint32_t before = BOARD->sequence;
    arm1_mask_t received = 0u;

    message[0] = BOARD->radio[0];
    message[1] = BOARD->radio[1];
    if (((before & 1u) == 0u) && (before != taken) && (BOARD->sequence == before)) {
        taken = before;
        received = 1u;
    }
    return received;
}

/* At rest, and nothing counted. After a stop only this goes on; here only a reset of the board calls it. */
static int start(void)
{
    faults = 0u;
    return arm1_init(&controller) == ARM1_OK;
}

/*
 * Every period: sample, step, actuate. The neighbour is taken to have measured at this board's ticks; a radio that cannot
 * say so needs the nodes of `lockstep generate --messages`.
 */
void SysTick_Handler(void)
{
    const uint32_t began = SYST_CSR; /* reading it clears COUNTFLAG */
    const float y[ARM1_OUTPUTS] = {BOARD->angle, BOARD->rate};
    float neighbour_y[ARM1_NEIGHBOURS * ARM1_OUTPUTS];
    const arm1_mask_t received = receive(neighbour_y);
    float u[ARM1_INPUTS];
    const arm1_status_t status = arm1_step(&controller, y, neighbour_y, received, u);
    const int stepped = (status == ARM1_OK) || (status == ARM1_CLIPPED);
    const int heard = (controller.heard & 1u) != 0u; /* boards start one after the other: one not heard yet is no fault */
    const int good = stepped && (!heard || (controller.age[0] <= OLDEST));

    (void)began;
    if (!checked) {
        checked = 1;
        if (arm1_self_check() != ARM1_OK) {
            faults = MOST_FAULTS;
        }
    }
    if (!good) {
        BOARD->faults = BOARD->faults + 1u;
    }
    if (faults < MOST_FAULTS) {
        faults = good ? 0u : (faults + 1u);
    }
    if (faults < MOST_FAULTS) {
        BOARD->command = u[0]; /* in a fault the last good one, which is held for a few periods */
    } else {
        BOARD->command = 0.0f; /* what is safe is the plant's business: here the motor is let go */
    }
    if ((SYST_CSR & COUNTFLAG) != 0u) {
        BOARD->faults = BOARD->faults + 1u;
        faults = MOST_FAULTS; /* all this took longer than a period: nothing is proved of that */
    } else if (faults == 0u) {
        BOARD->watchdog = FEED; /* after a good step in time, and nowhere else */
    } else {
        /* not fed */
    }
}

int main(void)
{
    if (!start()) {
        BOARD->faults = BOARD->faults + 1u; /* this build is unfit: every step will be refused, and let the motor go */
    }
    SYST_RVR = ((CORE_HZ / 1000000u) * ARM1_PERIOD_US) - 1u;
    SYST_CVR = 0u;
    SYST_CSR = 7u; /* core clock, interrupt, go */
    for (;;) {
        __asm__ volatile("wfi");
    }
}
