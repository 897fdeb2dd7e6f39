/* From reset to main: the vector table, the floating-point unit, .data and .bss. */
#include "board.h"

extern uint32_t _stack_top, _data_load, _data_start, _data_end, _bss_start, _bss_end;
extern int main(void);
extern void SysTick_Handler(void);

void Reset_Handler(void);
void Stop_Handler(void);

typedef void (*handler_t)(void);

typedef struct {
    const void *stack;
    handler_t handler[15];
} vectors_t;

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {&_stack_top,
    {Reset_Handler, Stop_Handler, Stop_Handler, Stop_Handler, Stop_Handler, Stop_Handler, 0, 0, 0, 0, Stop_Handler,
        Stop_Handler, 0, Stop_Handler, SysTick_Handler}};

void Reset_Handler(void)
{
    volatile uint32_t *to = &_data_start;
    const volatile uint32_t *from = &_data_load;

    CPACR |= 0xFu << 20; /* before the first floating-point instruction */
    __asm__ volatile("dsb\n\tisb");
    while (to < &_data_end) {
        *to++ = *from++;
    }
    for (to = &_bss_start; to < &_bss_end; to++) {
        *to = 0u;
    }
    (void)main();
}

void Stop_Handler(void)
{
    BOARD->command = 0.0f; /* the motor is let go; the watchdog is not fed and resets */
    for (;;) {
    }
}
