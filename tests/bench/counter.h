/* counter.h - instructions from one place of a program to another. Each target has its own way:
 * SysTick under QEMU (target/counter.c), callgrind on the host (counter_callgrind.c).
 *
 * What was counted goes out as text for instructions.py: a name and a number.
 */
#ifndef COUNTER_H
#define COUNTER_H

void counter_init(void);

/* Names what the counts that follow belong to. */
void counter_section(const char *name);

/* Counting starts ... */
void counter_begin(void);

/* ... and ends. */
void counter_end(const char *name);

/* Counts a call, with what it takes to pass its arguments. */
#define COUNTED(name, call)                                                                        \
    do {                                                                                           \
        counter_begin();                                                                           \
        (void)(call);                                                                              \
        counter_end(name);                                                                         \
    } while (0)

/* Runs run() and puts out how many bytes of stack it used; nothing where that cannot be seen. */
void counter_stack(const char *name, void (*run)(void));

/* Ends the program: something is wrong. */
_Noreturn void counter_fail(const char *why);

#endif
