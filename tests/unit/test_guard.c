/* Torque, speed and travel limits. */
#include "axt_guard.h"

#include <math.h>

#include "check.h"
#include "reference.h"

static const axt_limits open_limits = {
    .torque = 32767, .speed = 6000, .travel_min = INT32_MIN, .travel_max = INT32_MAX};

enum { TURN = 1048576 };
static const double period = 1e-4; /* [s] */

static axt_guard guard_of(const axt_limits *limits) {
    axt_guard guard;
    CHECK_EQUAL(axt_guard_init(&guard, limits, TURN, (axt_real)period), AXT_OK);
    return guard;
}

CASE(limits_that_contradict_themselves_are_refused_and_change_nothing) {
    axt_guard guard = guard_of(&open_limits);
    const axt_guard before = guard;
    axt_limits limits = open_limits;
    limits.torque = 32768;
    CHECK_EQUAL(axt_guard_set(&guard, &limits), AXT_ERROR_RANGE);
    limits = open_limits;
    limits.speed = 0;
    CHECK_EQUAL(axt_guard_set(&guard, &limits), AXT_ERROR_RANGE);
    limits = open_limits;
    limits.travel_min = 1;
    limits.travel_max = 0;
    CHECK_EQUAL(axt_guard_set(&guard, &limits), AXT_ERROR_RANGE);
    limits = open_limits;
    limits.speed = UINT32_MAX; /* more than 31 bits of counts in a window */
    CHECK_EQUAL(axt_guard_set(&guard, &limits), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(guard, before));
    CHECK_EQUAL(axt_guard_init(&guard, &open_limits, 0, (axt_real)period), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_guard_init(&guard, &open_limits, TURN, 0), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_guard_init(&guard, &open_limits, TURN, (axt_real)NAN), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(guard, before));
}

CASE(torque_is_cut_off_at_the_limit_and_said_to_be) {
    static const uint16_t limits[] = {0, 1, 1000, 32767};
    for (size_t i = 0; i < COUNT_OF(limits); i++) {
        axt_limits wanted = open_limits;
        wanted.torque = limits[i];
        const axt_guard guard = guard_of(&wanted);
        const int32_t most = limits[i];
        for (int32_t torque = -70000; torque <= 70000; torque++) {
            bool limited = false;
            const int32_t got = axt_guard_torque(&guard, torque, &limited);
            const int32_t expected = (torque > most) ? most : (torque < -most) ? -most : torque;
            CHECK_EQUAL(got, expected);
            CHECK_EQUAL(limited, got != torque);
        }
        bool limited = true;
        (void)axt_guard_torque(&guard, 0, &limited);
        CHECK(limited); /* what was limited before stays so */
    }
}

/* At constant speeds just below and above the limit, both ways, wherever the counts wrap. */
CASE(speed_is_judged_against_its_limit) {
    static const uint32_t turns[] = {1000, TURN, 16777216};
    static const uint32_t limits[] = {60, 3000, 6000};
    for (size_t t = 0; t < COUNT_OF(turns); t++) {
        for (size_t i = 0; i < COUNT_OF(limits); i++) {
            const double per_count = 60.0 / (AXT_GUARD_WINDOW * period * turns[t]); /* [1/min] */
            const double margin = 2.0 * per_count / limits[i] + 1e-6;
            for (int k = 0; k < 4; k++) {
                const bool fast = k % 2 == 1;
                const double sign = (k < 2) ? 1.0 : -1.0;
                const double speed = sign * limits[i] * (fast ? 1.0 + margin : 1.0 - margin);
                axt_limits wanted = open_limits;
                wanted.speed = limits[i];
                axt_guard guard;
                CHECK_EQUAL(axt_guard_init(&guard, &wanted, turns[t], (axt_real)period), AXT_OK);
                uint32_t said = 0;
                for (int n = 0; n < 1000; n++) {
                    const double counts =
                        2147483000.0 + floor(speed / 60.0 * turns[t] * period * n);
                    const int32_t position = (int32_t)(uint32_t)(int64_t)counts;
                    said += (axt_guard_watch(&guard, position) == AXT_GUARD_TOO_FAST) ? 1 : 0;
                }
                CHECK_EQUAL(said > 0, fast);
                CHECK(!fast || said >= 1000 - 2 * AXT_GUARD_WINDOW);
                CHECK_NEAR(axt_guard_speed(&guard), speed, per_count + 1.0);
            }
        }
    }
}

/* A coarse encoder on its way from one count to the next is not fast. */
CASE(a_single_count_is_no_speed) {
    axt_limits wanted = open_limits;
    wanted.speed = 100;
    axt_guard guard;
    CHECK_EQUAL(axt_guard_init(&guard, &wanted, 1000, (axt_real)period), AXT_OK);
    for (int n = 0; n < 200; n++) {
        CHECK_EQUAL(axt_guard_watch(&guard, (n / 50) % 2), AXT_GUARD_FINE);
    }
}

CASE(leaving_the_range_is_said_once_and_only_torque_back_inside_acts) {
    axt_limits wanted = open_limits;
    wanted.travel_min = -1000;
    wanted.travel_max = 2000;
    static const struct {
        int32_t position;
        axt_guard_verdict verdict;
        int32_t lowest; /* torque that may act, of -5 .. 5 */
        int32_t highest;
    } way[] = {{0, AXT_GUARD_FINE, -5, 5},       {2000, AXT_GUARD_FINE, -5, 5},
               {2001, AXT_GUARD_TOO_FAR, -5, 0}, {2002, AXT_GUARD_FINE, -5, 0},
               {2000, AXT_GUARD_FINE, -5, 5},    {2001, AXT_GUARD_TOO_FAR, -5, 0},
               {1999, AXT_GUARD_FINE, -5, 5},    {-1000, AXT_GUARD_FINE, -5, 5},
               {-1001, AXT_GUARD_TOO_FAR, 0, 5}, {-5000, AXT_GUARD_FINE, 0, 5},
               {-999, AXT_GUARD_FINE, -5, 5}};
    axt_guard guard = guard_of(&wanted);
    for (size_t i = 0; i < COUNT_OF(way); i++) {
        CHECK_EQUAL(axt_guard_watch(&guard, way[i].position), way[i].verdict);
        for (int32_t torque = -5; torque <= 5; torque++) {
            bool limited = false;
            const int32_t expected = (torque > way[i].highest)  ? way[i].highest
                                     : (torque < way[i].lowest) ? way[i].lowest
                                                                : torque;
            CHECK_EQUAL(axt_guard_torque(&guard, torque, &limited), expected);
            CHECK_EQUAL(limited, expected != torque);
        }
    }
}

/* An axis that is found outside has not left. */
CASE(a_start_outside_is_no_fault) {
    axt_limits wanted = open_limits;
    wanted.travel_max = 100;
    axt_guard guard = guard_of(&wanted);
    CHECK_EQUAL(axt_guard_watch(&guard, 5000), AXT_GUARD_FINE);
    bool limited = false;
    CHECK_EQUAL(axt_guard_torque(&guard, 7, &limited), 0);
    CHECK(limited);
    CHECK_EQUAL(axt_guard_torque(&guard, -7, &limited), -7);
}

int main(void) {
    RUN(limits_that_contradict_themselves_are_refused_and_change_nothing);
    RUN(torque_is_cut_off_at_the_limit_and_said_to_be);
    RUN(speed_is_judged_against_its_limit);
    RUN(a_single_count_is_no_speed);
    RUN(leaving_the_range_is_said_once_and_only_torque_back_inside_acts);
    RUN(a_start_outside_is_no_fault);
    return REPORT();
}
