/* Instructions counted with SysTick under QEMU's -icount: every instruction takes the same virtual
 * time, and with shift=8 (256 ns) that is several ticks of the timer, so that a reading tells
 * single instructions apart. How many ticks an instruction takes comes from a loop of known length.
 */
#include "../counter.h"

#include <stdint.h>

#include "semihosting.h"

#define SYST_CSR (*(volatile uint32_t *)0xE000E010)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018)

enum { TICKS_MASK = 0xFFFFFF, LOOPS = 200000, LOOP_INSTRUCTIONS = 2 };

/* Words below the stack pointer that are marked to see how deep a call goes. */
enum { STACK_WORDS = 384 };
#define STACK_MARK UINT32_C(0xA5C3965A)

static uint32_t ticks_of_loops;
static uint32_t started;

static void write_number(uint32_t number) {
    char digits[11];
    char *first = &digits[10];
    *first = '\0';
    do {
        *--first = (char)('0' + number % 10);
        number /= 10;
    } while (number > 0);
    semihosting_write(first);
}

static void write_line(const char *name, uint32_t number) {
    semihosting_write(name);
    semihosting_write(" ");
    write_number(number);
    semihosting_write("\n");
}

void counter_begin(void) {
    started = SYST_CVR;
}

static uint32_t ticks_since_begin(void) {
    return (started - SYST_CVR) & TICKS_MASK; /* it counts down */
}

static uint32_t instructions_of(uint32_t ticks) {
    const uint64_t instructions = (uint64_t)LOOPS * LOOP_INSTRUCTIONS;
    return (uint32_t)((ticks * instructions + ticks_of_loops / 2) / ticks_of_loops);
}

void counter_end(const char *name) {
    write_line(name, instructions_of(ticks_since_begin()));
}

__attribute__((noinline)) static uint32_t ticks_of(uint32_t loops) {
    counter_begin();
    __asm__ volatile(".syntax unified\n1: subs %0, #1\n bne 1b" : "+l"(loops) : : "cc");
    return ticks_since_begin();
}

void counter_init(void) {
    SYST_RVR = TICKS_MASK;
    SYST_CVR = 0;
    SYST_CSR = 5;      /* on, from the processor's clock */
    (void)ticks_of(1); /* the first reading after the start comes late */
    ticks_of_loops = ticks_of(LOOPS + 1) - ticks_of(1);
    const uint32_t known = LOOPS / 16;
    if (instructions_of(ticks_of(known + 1) - ticks_of(1)) != known * LOOP_INSTRUCTIONS) {
        counter_fail("the emulator's timer does not tell single instructions apart");
    }
}

void counter_section(const char *name) {
    semihosting_write("section ");
    semihosting_write(name);
    semihosting_write("\n");
}

__attribute__((noinline)) void counter_stack(const char *name, void (*run)(void)) {
    uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    for (uint32_t i = 1; i <= STACK_WORDS; i++) {
        ((volatile uint32_t *)top)[-(int32_t)i] = STACK_MARK;
    }
    run();
    uint32_t used = STACK_WORDS;
    while (used > 0 && ((volatile uint32_t *)top)[-(int32_t)used] == STACK_MARK) {
        used--;
    }
    semihosting_write("stack ");
    write_line(name, used * (uint32_t)sizeof *top);
}

_Noreturn void counter_fail(const char *why) {
    semihosting_write(why);
    semihosting_write("\n");
    semihosting_exit(1);
}
