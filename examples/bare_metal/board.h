/* An imaginary Cortex-M4F board: what a real one has, at addresses that a test can watch. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* System control space of every Cortex-M (ARMv7-M reference manual, B3). */
#define SYST_CSR (*(volatile uint32_t *)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)

typedef struct {
    float angle;       /* motor, rad */
    float rate;        /* motor, rad/s */
    float command;     /* to the motor, V */
    uint32_t faults;   /* periods without a good step */
    float radio[2];    /* the neighbour's last message: its angle and rate */
    uint32_t sequence; /* raised by 1 before the radio writes a message, and by 1 after: odd while it does */
    uint32_t watchdog; /* unless FEED is written here in time, the board resets with the motor let go */
} board_t;

#define BOARD ((volatile board_t *)0x40000000u)

#define CORE_HZ 48000000u
#define COUNTFLAG (1u << 16) /* of SYST_CSR: the timer ran out since it was last read */
#define FEED 0xB0A7u

#endif
