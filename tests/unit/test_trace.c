/* The trace: what it keeps of a signal around its trigger, against a search through the whole
 * signal. */
#include "axt_trace.h"

#include "axt_contract.h"
#include "check.h"
#include "reference.h"

enum { SIGNAL = 400, ROOM = 64 };

#define FIRST_PERIOD UINT32_C(4294967000) /* periods wrap around on the way */

enum {
    NOW = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_NOW_CHOICE,
    RISING = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_RISING_CHOICE,
    FALLING = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_FALLING_CHOICE,
    ABOVE = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_ABOVE_CHOICE,
    BELOW = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_BELOW_CHOICE,
    ON_FAULT = AXT_CONTRACT_COMMAND_TRACE_TRIGGER_FAULT_CHOICE
};

/* Small numbers, so that levels are met exactly and crossed often; a fault now and then. */
static void make_signal(axt_node_sample *signal, uint64_t *seed) {
    for (uint32_t i = 0; i < SIGNAL; i++) {
        signal[i] = (axt_node_sample){
            .position = {(int32_t)(random_bits(seed) % 9) - 4,
                         (int32_t)(random_bits(seed) % 9) - 4},
            .torque = (int16_t)((int32_t)(random_bits(seed) % 9) - 4),
            .status_word = (random_bits(seed) % 50 == 0) ? 0x0218 : 0x0237,
        };
    }
}

static int32_t value(const axt_trace_settings *settings, const axt_node_sample *sample) {
    const int32_t sources[] = {sample->torque, sample->position[0], sample->position[1]};
    return sources[settings->source];
}

/* Sample k of those kept, the k-th of every so many periods. */
static const axt_node_sample *kept(const axt_trace_settings *settings,
                                   const axt_node_sample *signal, uint32_t k) {
    return &signal[(size_t)k * settings->decimation];
}

static bool condition(const axt_trace_settings *s, const axt_node_sample *signal, uint32_t k) {
    const int32_t now = value(s, kept(s, signal, k));
    const int32_t last = (k > 0) ? value(s, kept(s, signal, k - 1)) : now;
    const bool fault = (kept(s, signal, k)->status_word & 8) != 0;
    switch (s->trigger) {
    case RISING:
        return last < s->level && now >= s->level;
    case FALLING:
        return last > s->level && now <= s->level;
    case ABOVE:
        return now > s->level;
    case BELOW:
        return now < s->level;
    case ON_FAULT:
        return k > 0 && fault && (kept(s, signal, k - 1)->status_word & 8) == 0;
    default:
        return true;
    }
}

/* Where the trigger comes among the samples kept, looking through all of them; -1: never. */
static int32_t find_trigger(const axt_trace_settings *s, const axt_node_sample *signal) {
    const bool waits = s->trigger != NOW && s->trigger != ON_FAULT;
    for (uint32_t k = waits ? s->pretrigger : 0; k * s->decimation < SIGNAL; k++) {
        if (condition(s, signal, k)) {
            return (int32_t)k;
        }
    }
    return -1;
}

static void check_one(const axt_trace_settings *s, const axt_node_sample *signal) {
    axt_node_sample buffer[ROOM + 1] = {0};
    const axt_node_sample beyond = buffer[s->length];
    axt_trace trace;
    axt_trace_arm(&trace, buffer, s);
    for (uint32_t n = 0; n < SIGNAL; n++) {
        axt_trace_take(&trace, &signal[n], FIRST_PERIOD + n);
        CHECK(trace.captured <= s->length);
    }
    const int32_t trigger = find_trigger(s, signal);
    CHECK_EQUAL(trace.triggered, trigger >= 0);
    CHECK(UNCHANGED(buffer[s->length], beyond));
    if (trigger < 0) {
        return;
    }
    const uint32_t at = (uint32_t)trigger;
    const uint32_t before = (s->trigger == NOW) ? 0 : (at < s->pretrigger) ? at : s->pretrigger;
    const uint32_t all = (SIGNAL + s->decimation - 1) / s->decimation; /* samples kept at most */
    const uint32_t first = at - before;
    const uint32_t there = (all - first < s->length) ? all - first : s->length;
    CHECK_EQUAL(trace.before, before);
    CHECK_EQUAL(trace.captured, there);
    CHECK_EQUAL(trace.start, FIRST_PERIOD + first * s->decimation);
    for (uint32_t i = 0; i < there; i++) {
        CHECK(UNCHANGED(*axt_trace_sample(&trace, i), *kept(s, signal, first + i)));
    }
}

CASE(a_trace_is_the_signal_around_the_first_trigger) {
    uint64_t seed = 11;
    uint32_t fired[6] = {0};
    for (int i = 0; i < 20000; i++) {
        axt_node_sample signal[SIGNAL];
        make_signal(signal, &seed);
        axt_trace_settings settings = {
            .length = 1 + (uint32_t)(random_bits(&seed) % ROOM),
            .decimation = 1 + (uint32_t)(random_bits(&seed) % 7),
            .trigger = (uint32_t)(random_bits(&seed) % 6),
            .source = (uint32_t)(random_bits(&seed) % 3),
            .level = (int32_t)(random_bits(&seed) % 11) - 5,
        };
        settings.pretrigger = (uint32_t)(random_bits(&seed) % settings.length);
        check_one(&settings, signal);
        fired[settings.trigger] += (find_trigger(&settings, signal) >= 0) ? 1 : 0;
    }
    for (size_t i = 0; i < COUNT_OF(fired); i++) {
        CHECK(fired[i] > 1000);
    }
}

CASE(nothing_is_taken_before_it_is_armed) {
    static const axt_trace_settings none = {0};
    axt_trace trace;
    axt_trace_arm(&trace, NULL, &none);
    const axt_trace before = trace;
    const axt_node_sample sample = {.torque = 1};
    axt_trace_take(&trace, &sample, 0);
    CHECK(UNCHANGED(trace, before));
}

int main(void) {
    RUN(a_trace_is_the_signal_around_the_first_trigger);
    RUN(nothing_is_taken_before_it_is_armed);
    return REPORT();
}
