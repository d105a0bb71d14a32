/* Start-up of a Cortex-M: vectors, memory, floating point unit, main(), and back to the host. */
#include <stdint.h>

#include "semihosting.h"

extern uint32_t stack_top[];
extern uint32_t data_load[], data_start[], data_end[];
extern uint32_t bss_start[], bss_end[];

int main(void);
void reset(void);

static void fault(void) {
    semihosting_write("the processor took an exception\n");
    semihosting_exit(1);
}

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = stack_top},
    {.handler = reset},
    {.handler = fault}, /* NMI */
    {.handler = fault}, /* HardFault; without priorities the others end here */
};

#ifdef __ARM_FP
static void enable_fpu(void) {
    volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88;
    *cpacr |= UINT32_C(0xF) << 20; /* full access to coprocessors 10 and 11 */
    __asm__ volatile("dsb\n isb");
}
#else
static void enable_fpu(void) {
}
#endif

void reset(void) {
    enable_fpu();
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
    semihosting_exit(main());
}
