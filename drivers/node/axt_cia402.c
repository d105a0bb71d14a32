#include "axt_cia402.h"

/* Bits of the control word; quick stop is asked for by a 0. */
enum { SWITCH_ON = 1, ENABLE_VOLTAGE = 2, NO_QUICK_STOP = 4, ENABLE_OPERATION = 8, RESET = 128 };

typedef struct {
    axt_cia402_state from;
    axt_cia402_state to;
} transition;

static bool find(const transition *transitions, uint32_t count, axt_cia402_state from,
                 axt_cia402_state *to) {
    for (uint32_t i = 0; i < count; i++) {
        if (transitions[i].from == from) {
            *to = transitions[i].to;
            return true;
        }
    }
    return false;
}

#define FIND(transitions, from, to)                                                                \
    find((transitions), sizeof(transitions) / sizeof((transitions)[0]), (from), (to))

static bool disable_voltage(axt_cia402_state state, axt_cia402_state *next) {
    static const transition transitions[] = {
        {AXT_CIA402_READY, AXT_CIA402_SWITCH_ON_DISABLED},             /* 7 */
        {AXT_CIA402_OPERATION_ENABLED, AXT_CIA402_SWITCH_ON_DISABLED}, /* 9 */
        {AXT_CIA402_SWITCHED_ON, AXT_CIA402_SWITCH_ON_DISABLED},       /* 10 */
        {AXT_CIA402_QUICK_STOP_ACTIVE, AXT_CIA402_SWITCH_ON_DISABLED}, /* 12 */
    };
    if (!FIND(transitions, state, next)) {
        *next = state; /* there is none already */
    }
    return true;
}

static bool quick_stop(axt_cia402_state state, axt_cia402_state *next) {
    static const transition transitions[] = {
        {AXT_CIA402_SWITCH_ON_DISABLED, AXT_CIA402_SWITCH_ON_DISABLED},
        {AXT_CIA402_READY, AXT_CIA402_SWITCH_ON_DISABLED},            /* 7 */
        {AXT_CIA402_SWITCHED_ON, AXT_CIA402_SWITCH_ON_DISABLED},      /* 10 */
        {AXT_CIA402_OPERATION_ENABLED, AXT_CIA402_QUICK_STOP_ACTIVE}, /* 11 */
        {AXT_CIA402_QUICK_STOP_ACTIVE, AXT_CIA402_QUICK_STOP_ACTIVE},
    };
    return FIND(transitions, state, next);
}

static bool shut_down(axt_cia402_state state, axt_cia402_state *next) {
    static const transition transitions[] = {
        {AXT_CIA402_SWITCH_ON_DISABLED, AXT_CIA402_READY}, /* 2 */
        {AXT_CIA402_READY, AXT_CIA402_READY},
        {AXT_CIA402_SWITCHED_ON, AXT_CIA402_READY},       /* 6 */
        {AXT_CIA402_OPERATION_ENABLED, AXT_CIA402_READY}, /* 8 */
    };
    return FIND(transitions, state, next);
}

static bool switch_on(axt_cia402_state state, axt_cia402_state *next) {
    static const transition transitions[] = {
        {AXT_CIA402_READY, AXT_CIA402_SWITCHED_ON}, /* 3 */
        {AXT_CIA402_SWITCHED_ON, AXT_CIA402_SWITCHED_ON},
        {AXT_CIA402_OPERATION_ENABLED, AXT_CIA402_SWITCHED_ON}, /* 5 */
    };
    return FIND(transitions, state, next);
}

static bool enable_operation(axt_cia402_state state, axt_cia402_state *next) {
    static const transition transitions[] = {
        {AXT_CIA402_READY, AXT_CIA402_OPERATION_ENABLED},       /* 3 and 4 */
        {AXT_CIA402_SWITCHED_ON, AXT_CIA402_OPERATION_ENABLED}, /* 4 */
        {AXT_CIA402_OPERATION_ENABLED, AXT_CIA402_OPERATION_ENABLED},
        {AXT_CIA402_QUICK_STOP_ACTIVE, AXT_CIA402_OPERATION_ENABLED}, /* 16 */
    };
    return FIND(transitions, state, next);
}

bool axt_cia402_next(axt_cia402_state state, uint16_t before, uint16_t word,
                     axt_cia402_state *next) {
    const bool reset = (word & ~before & RESET) != 0;
    if (state == AXT_CIA402_FAULT && reset) {
        *next = AXT_CIA402_SWITCH_ON_DISABLED; /* 15 */
        return true;
    }
    if ((word & ENABLE_VOLTAGE) == 0) {
        return disable_voltage(state, next);
    }
    if ((word & NO_QUICK_STOP) == 0) {
        return quick_stop(state, next);
    }
    if ((word & SWITCH_ON) == 0) {
        return shut_down(state, next);
    }
    return ((word & ENABLE_OPERATION) == 0) ? switch_on(state, next)
                                            : enable_operation(state, next);
}
