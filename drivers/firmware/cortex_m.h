/* cortex_m.h - what all Cortex-M processors have, and what is the same on all boards with one:
 * start-up, exceptions, SysTick as the control timer, interrupts of the board.
 */
#ifndef CORTEX_M_H
#define CORTEX_M_H

#include <stdint.h>

/* An entry of a vector table. */
typedef union {
    uint32_t *stack;
    void (*handler)(void);
} cortex_m_vector;

/* Top of the stack, from the linker script. */
extern uint32_t stack_top[];

/* The processor's own exceptions, as the first 16 entries of a board's vector table. */
void cortex_m_reset(void);
void cortex_m_nmi(void);
void cortex_m_hard_fault(void);
void cortex_m_systick(void);

#define CORTEX_M_VECTORS                                                                           \
    {.stack = stack_top}, {.handler = cortex_m_reset}, {.handler = cortex_m_nmi},                  \
        {.handler = cortex_m_hard_fault}, [15] = {.handler = cortex_m_systick}

/* The control interrupt every `period` [us] of a clock of `frequency` [Hz]. */
void cortex_m_start_control(uint32_t frequency, uint32_t period);

/* Lets interrupt `number` of the board come, below the control interrupt. */
void cortex_m_enable_interrupt(uint32_t number);

/* Lets it come now. */
void cortex_m_pend_interrupt(uint32_t number);

#endif
