/* axt_clock.h - the time that never jumps (Linux). */
#ifndef AXT_CLOCK_H
#define AXT_CLOCK_H

#include <stdint.h>
#include <time.h>

/* CLOCK_MONOTONIC [ns]. */
static inline uint64_t axt_clock_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now); /* cannot fail: the clock is always there */
    return (uint64_t)now.tv_sec * UINT64_C(1000000000) + (uint64_t)now.tv_nsec;
}

#endif
