/* axt_trace.h - samples at the control rate, or every so many of them, around a trigger.
 *
 * While the trigger is waited for the buffer is written in a circle, so that what came before it is
 * there when it comes.
 */
#ifndef AXT_TRACE_H
#define AXT_TRACE_H

#include <stdbool.h>
#include <stdint.h>

/* What happened at one control period. */
typedef struct {
    int32_t position[2]; /* motor and table encoder [counts] */
    int16_t torque;      /* [0.1 per mille of rated] */
    uint16_t status_word;
} axt_node_sample;

/* What to capture, as the commands of the wire contract say it. */
typedef struct {
    uint32_t length;     /* samples, 1 or more; 0: nothing */
    uint32_t pretrigger; /* of these before the trigger, less than `length` */
    uint32_t decimation; /* control periods between samples, 1 or more */
    uint32_t trigger;    /* TraceTrigger of the contract: now, edge, level, fault */
    uint32_t source;     /* TraceSource: what edges and levels look at */
    int32_t level;       /* raw */
} axt_trace_settings;

typedef struct {
    axt_trace_settings settings;
    axt_node_sample *buffer; /* room for settings.length samples */
    uint32_t until_next;     /* control periods until the next sample */
    uint32_t place;          /* where in the buffer it goes */
    bool triggered;
    uint32_t before;   /* samples before the trigger */
    uint32_t captured; /* samples there: `settings.length` when complete */
    uint32_t first;    /* place of sample 0, and ... */
    uint32_t start;    /* ... its control period modulo 2^32; both once triggered */
    bool has_last;
    axt_node_sample last; /* sample, to see edges */
} axt_trace;

/* Starts afresh; `buffer` has room for `settings->length` samples. */
void axt_trace_arm(axt_trace *trace, axt_node_sample *buffer, const axt_trace_settings *settings);

/* What happened at control period `n`. Once the trace is complete, nothing more is taken. Cost:
 * about 30 operations. */
void axt_trace_take(axt_trace *trace, const axt_node_sample *sample, uint32_t n);

/* Sample `index` (below `captured`) of a trace that has been triggered. */
const axt_node_sample *axt_trace_sample(const axt_trace *trace, uint32_t index);

#endif
