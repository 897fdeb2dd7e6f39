/* The controller of one arm in the timer's interrupt; the main loop sleeps. */
#include "arm1.h"
#include "board.h"

void SysTick_Handler(void);
int main(void);

static arm1_state_t controller;
static uint32_t taken; /* `sequence` of the last message that was taken */

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

/* Every period: sample, step, actuate. */
void SysTick_Handler(void)
{
    const float y[ARM1_OUTPUTS] = {BOARD->angle, BOARD->rate};
    float neighbour_y[ARM1_NEIGHBOURS * ARM1_OUTPUTS];
    const arm1_mask_t received = receive(neighbour_y);
    float u[ARM1_INPUTS];
    arm1_status_t status;

    status = arm1_step(&controller, y, neighbour_y, received, u);
    if ((status == ARM1_OK) || (status == ARM1_CLIPPED)) {
        BOARD->command = u[0];
    } else {
        BOARD->command = 0.0f; /* what is safe is the plant's business: here the motor is let go */
        BOARD->faults = BOARD->faults + 1u;
    }
}

int main(void)
{
    if (arm1_init(&controller) != ARM1_OK) {
        BOARD->faults = BOARD->faults + 1u; /* this build is unfit: every step will be refused, and let the motor go */
    }
    SYST_RVR = (uint32_t)((float)CORE_HZ * ARM1_PERIOD_S + 0.5f) - 1u;
    SYST_CVR = 0u;
    SYST_CSR = 7u; /* core clock, interrupt, go */
    for (;;) {
        __asm__ volatile("wfi");
    }
}
