#include "axt_guard.h"

#define SECONDS_A_MINUTE ((axt_real)60)

/* Counts in the window at the speed limit, rounded up; 0 when that does not fit. */
static int32_t window_max(const axt_limits *limits, axt_real speed_per_count) {
    const axt_real counts = (axt_real)limits->speed / speed_per_count;
    return (counts < (axt_real)INT32_MAX) ? (int32_t)counts + 1 : 0;
}

axt_status axt_guard_set(axt_guard *guard, const axt_limits *limits) {
    const int32_t most = window_max(limits, guard->speed_per_count);
    if (limits->torque > INT16_MAX || limits->speed < 1 || most == 0 ||
        limits->travel_min > limits->travel_max) {
        return AXT_ERROR_RANGE;
    }
    guard->limits = *limits;
    guard->window_max = most;
    return AXT_OK;
}

axt_status axt_guard_init(axt_guard *guard, const axt_limits *limits, uint32_t counts_per_turn,
                          axt_real control_period) {
    const axt_real window = (axt_real)AXT_GUARD_WINDOW * control_period;
    if (counts_per_turn < 1 || !(window > 0)) {
        return AXT_ERROR_RANGE;
    }
    axt_guard fresh = {.speed_per_count = SECONDS_A_MINUTE / window / (axt_real)counts_per_turn};
    const axt_status status = axt_guard_set(&fresh, limits);
    if (status == AXT_OK) {
        *guard = fresh;
    }
    return status;
}

int16_t axt_guard_torque(const axt_guard *guard, int32_t torque, bool *limited) {
    const int32_t highest = guard->above ? 0 : (int32_t)guard->limits.torque;
    const int32_t lowest = guard->below ? 0 : -(int32_t)guard->limits.torque;
    if (torque > highest) {
        *limited = true;
        return (int16_t)highest;
    }
    if (torque < lowest) {
        *limited = true;
        return (int16_t)lowest;
    }
    return (int16_t)torque;
}

/* Positions wrap around at 32 bits, and so does their difference. */
static int32_t difference(int32_t a, int32_t b) {
    return (int32_t)((uint32_t)a - (uint32_t)b);
}

axt_guard_verdict axt_guard_watch(axt_guard *guard, int32_t position) {
    if (!guard->begun) {
        for (uint32_t i = 0; i < AXT_GUARD_WINDOW; i++) {
            guard->past[i] = position;
        }
    }
    guard->travelled = difference(position, guard->past[guard->oldest]);
    guard->past[guard->oldest] = position;
    guard->oldest = (guard->oldest + 1) % AXT_GUARD_WINDOW;
    guard->position = position;

    const bool was_inside = guard->begun && !guard->below && !guard->above;
    guard->begun = true;
    guard->below = position < guard->limits.travel_min;
    guard->above = position > guard->limits.travel_max;
    if (was_inside && (guard->below || guard->above)) {
        return AXT_GUARD_TOO_FAR;
    }
    const bool fast = guard->travelled > guard->window_max || guard->travelled < -guard->window_max;
    return fast ? AXT_GUARD_TOO_FAST : AXT_GUARD_FINE;
}

int32_t axt_guard_speed(const axt_guard *guard) {
    return (int32_t)((axt_real)guard->travelled * guard->speed_per_count);
}
