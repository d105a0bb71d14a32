/* axt_guard.h - what an axis must not do, whatever it is told: torque, speed and travel limits. */
#ifndef AXT_GUARD_H
#define AXT_GUARD_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_real.h"
#include "axt_status.h"

typedef struct {
    uint16_t torque;    /* either way [0.1 per mille of rated], up to 32767 (CiA 402 0x6072) */
    uint32_t speed;     /* of the motor, either way [1/min], 1 or more (0x6080) */
    int32_t travel_min; /* of the motor [counts] (0x607D) */
    int32_t travel_max; /* not below travel_min */
} axt_limits;

/* Speed is measured over so many control periods: one count more or less, which is all that a
 * coarse encoder can say of a single period, then weighs so much less. */
enum { AXT_GUARD_WINDOW = 16 };

typedef enum { AXT_GUARD_FINE, AXT_GUARD_TOO_FAST, AXT_GUARD_TOO_FAR } axt_guard_verdict;

typedef struct {
    axt_limits limits;
    axt_real speed_per_count; /* of a count in the window [1/min] */
    int32_t window_max;       /* counts in the window at the speed limit */
    int32_t past[AXT_GUARD_WINDOW];
    uint32_t oldest;   /* place in `past` */
    bool begun;        /* a position is known */
    int32_t travelled; /* counts in the window */
    int32_t position;  /* the last one */
    bool below;        /* outside the travel range */
    bool above;
} axt_guard;

/* AXT_ERROR_RANGE for limits that contradict themselves, or a speed limit at which the counts of a
 * window do not fit into 31 bits; `guard` is then unchanged. */
axt_status axt_guard_init(axt_guard *guard, const axt_limits *limits, uint32_t counts_per_turn,
                          axt_real control_period);

/* Changes the limits and nothing else. Fails as axt_guard_init(). Cost: about 10 operations. */
axt_status axt_guard_set(axt_guard *guard, const axt_limits *limits);

/* `torque` [0.1 per mille] as it may be applied: within the limit, and not further outwards from
 * outside the travel range. `limited` is set when that is something else, and never cleared. */
int16_t axt_guard_torque(const axt_guard *guard, int32_t torque, bool *limited);

/* The next motor position [counts], once a control period. Too far is said once, on leaving the
 * range; too fast as long as it is so. Cost: about 15 operations. */
axt_guard_verdict axt_guard_watch(axt_guard *guard, int32_t position);

/* Mean speed over the window [1/min], rounded towards 0. */
int32_t axt_guard_speed(const axt_guard *guard);

#endif
