#include "axt_trace.h"

#include "axt_contract.h"

enum { FAULT = 0x0008 }; /* bit 3 of the status word: fault, and the reaction to it */

void axt_trace_arm(axt_trace *trace, axt_node_sample *buffer, const axt_trace_settings *settings) {
    *trace = (axt_trace){.settings = *settings, .buffer = buffer};
}

static int32_t source_of(const axt_trace *trace, const axt_node_sample *sample) {
    switch (trace->settings.source) {
    case AXT_CONTRACT_COMMAND_TRACE_SOURCE_MOTOR_POSITION_CHOICE:
        return sample->position[0];
    case AXT_CONTRACT_COMMAND_TRACE_SOURCE_TABLE_POSITION_CHOICE:
        return sample->position[1];
    default:
        return sample->torque;
    }
}

/* Does the trigger come at this sample? Levels and edges are waited for once the samples before
 * them are there; a fault comes once and cannot wait. */
static bool fires(const axt_trace *trace, const axt_node_sample *sample) {
    const int32_t level = trace->settings.level;
    const int32_t now = source_of(trace, sample);
    const int32_t last = trace->has_last ? source_of(trace, &trace->last) : now;
    const bool ready = trace->before == trace->settings.pretrigger;
    switch (trace->settings.trigger) {
    case AXT_CONTRACT_COMMAND_TRACE_TRIGGER_RISING_CHOICE:
        return ready && last < level && now >= level;
    case AXT_CONTRACT_COMMAND_TRACE_TRIGGER_FALLING_CHOICE:
        return ready && last > level && now <= level;
    case AXT_CONTRACT_COMMAND_TRACE_TRIGGER_ABOVE_CHOICE:
        return ready && now > level;
    case AXT_CONTRACT_COMMAND_TRACE_TRIGGER_BELOW_CHOICE:
        return ready && now < level;
    case AXT_CONTRACT_COMMAND_TRACE_TRIGGER_FAULT_CHOICE:
        return trace->has_last && (sample->status_word & ~trace->last.status_word & FAULT) != 0;
    default:
        return true;
    }
}

void axt_trace_take(axt_trace *trace, const axt_node_sample *sample, uint32_t n) {
    const axt_trace_settings *settings = &trace->settings;
    if (trace->captured == settings->length) {
        return;
    }
    if (trace->until_next > 0) {
        trace->until_next--;
        return;
    }
    trace->until_next = settings->decimation - 1;
    if (!trace->triggered && fires(trace, sample)) {
        trace->triggered = true;
        trace->first = (trace->place + settings->length - trace->before) % settings->length;
        trace->start = n - trace->before * settings->decimation;
    }
    trace->buffer[trace->place] = *sample;
    trace->place = (trace->place + 1 < settings->length) ? trace->place + 1 : 0;
    if (!trace->triggered && trace->before < settings->pretrigger) {
        trace->before++;
    }
    if (trace->triggered || trace->captured < settings->pretrigger) {
        trace->captured++;
    }
    trace->last = *sample;
    trace->has_last = true;
}

const axt_node_sample *axt_trace_sample(const axt_trace *trace, uint32_t index) {
    const uint32_t place = trace->first + index;
    return &trace
                ->buffer[(place < trace->settings.length) ? place : place - trace->settings.length];
}
