#include "cortex_m.h"

#include "axt_board.h"
#include "axt_contract.h"
#include "axt_hardware.h"

int main(void);

/* Armv7-M and Armv8-M: the same registers at the same places. */
typedef struct {
    volatile uint32_t control;
    volatile uint32_t reload;
    volatile uint32_t current;
} systick_registers;

#define SYSTICK ((systick_registers *)0xE000E010)
#define ISER    ((volatile uint32_t *)0xE000E100)
#define ISPR    ((volatile uint32_t *)0xE000E200)
#define IPR     ((volatile uint8_t *)0xE000E400)
#define AIRCR   (*(volatile uint32_t *)0xE000ED0C)
#define CFSR    (*(volatile uint32_t *)0xE000ED28)
#define HFSR    (*(volatile uint32_t *)0xE000ED2C)
#define BFAR    (*(volatile uint32_t *)0xE000ED38)
#define CPACR   (*(volatile uint32_t *)0xE000ED88)

#define SYSTICK_ON   UINT32_C(0x7) /* with interrupt, from the processor's clock */
#define SYSTICK_DONE UINT32_C(0x10000)
#define RESTART      UINT32_C(0x05FA0004) /* with the key that AIRCR wants */

enum { BELOW_CONTROL = 0x80 }; /* priority; SysTick has 0, the highest */

/* From the linker script. */
extern uint32_t data_load[], data_start[], data_end[];
extern uint32_t bss_start[], bss_end[];
extern uint32_t stack_bottom[];
extern axt_record kept;
extern const axt_settings settings;

/* ---- Start-up ---------------------------------------------------------------------------------
 */

#define PAINT UINT32_C(0xA5C3965A)

#ifdef __ARM_FP
static void enable_fpu(void) {
    CPACR |= UINT32_C(0xF) << 20; /* full access to coprocessors 10 and 11 */
    __asm__ volatile("dsb\n isb");
}
#else
static void enable_fpu(void) {
}
#endif

/* Words from one place of the linker script's to another. */
static uint32_t words(const uint32_t *from, const uint32_t *until) {
    return (uint32_t)((uintptr_t)until - (uintptr_t)from) / (uint32_t)sizeof *from;
}

/* What is below the stack pointer is nobody's yet. */
static void paint_stack(void) {
    const uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    volatile uint32_t *stack = stack_bottom;
    const uint32_t free = words(stack_bottom, top);
    for (uint32_t i = 0; i < free; i++) {
        stack[i] = PAINT;
    }
}

static void set_memory(void) {
    for (uint32_t i = 0; i < words(data_start, data_end); i++) {
        data_start[i] = data_load[i];
    }
    for (uint32_t i = 0; i < words(bss_start, bss_end); i++) {
        bss_start[i] = 0;
    }
}

void cortex_m_reset(void) {
    enable_fpu();
    paint_stack();
    set_memory();
    (void)main();
    axt_board_restart();
}

uint32_t axt_board_stack_size(void) {
    return words(stack_bottom, stack_top) * (uint32_t)sizeof(uint32_t);
}

uint32_t axt_board_stack_used(void) {
    const volatile uint32_t *stack = stack_bottom;
    const uint32_t size = words(stack_bottom, stack_top);
    uint32_t free = 0;
    while (free < size && stack[free] == PAINT) {
        free++;
    }
    return (size - free) * (uint32_t)sizeof *stack;
}

axt_record *axt_board_record(void) {
    return &kept;
}

const axt_settings *axt_board_settings(void) {
    return &settings;
}

_Noreturn void axt_board_restart(void) {
    __asm__ volatile("dsb");
    AIRCR = RESTART;
    __asm__ volatile("dsb");
    for (;;) {
    }
}

/* ---- Faults -----------------------------------------------------------------------------------
 */

/* What the processor pushes when it takes an exception. */
typedef struct {
    uint32_t r0, r1, r2, r3, r12, lr, pc, psr;
} exception_frame;

/* The stack may be what is broken, so this is called on another one. A frame that is not on the
 * stack is not read. */
__attribute__((used)) static void stop(const exception_frame *frame, uint32_t error_code) {
    const uintptr_t place = (uintptr_t)frame;
    axt_fault fault = {
        .error_code = (uint16_t)error_code, .cfsr = CFSR, .hfsr = HFSR, .bfar = BFAR};
    axt_hardware_here.shut_off(axt_hardware_here.axis);
    if (place >= (uintptr_t)stack_bottom && place + sizeof *frame <= (uintptr_t)stack_top) {
        fault.pc = frame->pc;
        fault.lr = frame->lr;
        fault.psr = frame->psr;
    }
    axt_record_keep_fault(&kept, &fault);
    axt_board_restart();
}

enum { FAULT_STACK_WORDS = 96 };
__attribute__((used)) static uint64_t fault_stack[FAULT_STACK_WORDS / 2];

#define STOP_WITH(error_code)                                                                      \
    __asm__ volatile("mrs r0, msp\n"                                                               \
                     "ldr r1, =fault_stack\n"                                                      \
                     "add r1, %1\n"                                                                \
                     "mov sp, r1\n"                                                                \
                     "movw r1, %0\n"                                                               \
                     "b stop\n"                                                                    \
                     :                                                                             \
                     : "i"(error_code), "i"(sizeof fault_stack))

/* All faults end here: none of the others is enabled. */
__attribute__((naked)) void cortex_m_hard_fault(void) {
    STOP_WITH(AXT_CONTRACT_EMERGENCY_ERROR_CODE_INTERNAL_SOFTWARE_CHOICE);
}

/* The watchdog's first word; it would restart the board by itself when it came to a second. */
__attribute__((naked)) void cortex_m_nmi(void) {
    STOP_WITH(AXT_CONTRACT_EMERGENCY_ERROR_CODE_WATCHDOG_RESET_CHOICE);
}

/* ---- The control interrupt --------------------------------------------------------------------
 */

static uint32_t period_us;
static uint32_t ticks_per_period;
static volatile uint32_t periods; /* begun */
static volatile uint32_t longest; /* control interrupt [ticks] */
static volatile uint32_t late;

void cortex_m_systick(void) {
    const uint32_t begun = SYSTICK->current; /* it counts down */
    (void)SYSTICK->control;                  /* reading ends what it says of the past */
    periods++;
    axt_control_interrupt();
    const uint32_t now = SYSTICK->current;
    const bool again = (SYSTICK->control & SYSTICK_DONE) != 0;
    uint32_t taken = begun - now + ((begun < now) ? ticks_per_period : 0);
    taken += (again && taken < begun) ? ticks_per_period : 0;
    longest = (taken > longest) ? taken : longest;
    late += again ? 1 : 0;
}

void cortex_m_start_control(uint32_t frequency, uint32_t period) {
    period_us = period;
    ticks_per_period = frequency / 1000000 * period;
    SYSTICK->reload = ticks_per_period - 1;
    SYSTICK->current = 0;
    SYSTICK->control = SYSTICK_ON;
}

uint32_t axt_board_late(void) {
    return late;
}

uint32_t axt_board_load(void) {
    return (longest * 1000 + ticks_per_period - 1) / ticks_per_period;
}

/* A period that begins between the two readings makes them disagree: read again. */
uint32_t axt_board_microseconds(void) {
    uint32_t begun;
    uint32_t left;
    do {
        begun = periods;
        left = SYSTICK->current;
    } while (begun != periods);
    return begun * period_us + (ticks_per_period - left) * period_us / ticks_per_period;
}

/* ---- Interrupts of the board ------------------------------------------------------------------
 */

void cortex_m_enable_interrupt(uint32_t number) {
    IPR[number] = BELOW_CONTROL;
    ISER[number / 32] = UINT32_C(1) << (number % 32);
}

void cortex_m_pend_interrupt(uint32_t number) {
    ISPR[number / 32] = UINT32_C(1) << (number % 32);
}
