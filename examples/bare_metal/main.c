/* The controller of one arm in the timer's interrupt; the main loop sleeps. */
#include "arm1.h"
#include "board.h"

void SysTick_Handler(void);
int main(void);

static arm1_state_t controller;

/* Every period: sample, step, actuate. */
void SysTick_Handler(void)
{
    const float y[ARM1_OUTPUTS] = {BOARD->angle, BOARD->rate};
    const float neighbour_y[ARM1_NEIGHBOURS * ARM1_OUTPUTS] = {BOARD->radio[0], BOARD->radio[1]};
    const arm1_mask_t received = (arm1_mask_t)BOARD->received;
    float u[ARM1_INPUTS];

    BOARD->received = 0u;
    if (arm1_step(&controller, y, neighbour_y, received, u) == ARM1_OK) {
        BOARD->command = u[0];
    } else {
        BOARD->command = 0.0f; /* what is safe is the plant's business: here the motor is let go */
        BOARD->faults = BOARD->faults + 1u;
    }
}

int main(void)
{
    arm1_init(&controller);
    SYST_RVR = (uint32_t)((float)CORE_HZ * ARM1_PERIOD_S + 0.5f) - 1u;
    SYST_CVR = 0u;
    SYST_CSR = 7u; /* core clock, interrupt, go */
    for (;;) {
        __asm__ volatile("wfi");
    }
}
