/* axt_history.h - the newest samples of the control loop, for a host that asks now and then.
 *
 * The stream is for a host that listens: a ring that somebody empties. This is for one that asks
 * (Modbus): a ring that is simply written over. One writer, the tick, which never waits; readers
 * may be interrupted by it, or run on another core, and find out when a sample was written over
 * while they copied it.
 */
#ifndef AXT_HISTORY_H
#define AXT_HISTORY_H

#include <stdatomic.h>
#include <stdint.h>

typedef struct {
    uint32_t n;          /* control period, modulo 2^32 */
    int32_t position[2]; /* motor and table encoder [counts] */
    int16_t torque;      /* [0.1 per mille of rated] */
    uint16_t status_word;
} axt_history_sample;

/* Room for one sample. */
typedef struct {
    _Atomic uint32_t word[4]; /* n, motor, table, torque and status word */
} axt_history_slot;

/* Its fields are its own business. */
typedef struct {
    axt_history_slot *slots;
    uint32_t size;
    _Atomic uint32_t head;       /* samples written so far */
    _Atomic uint32_t decimation; /* as asked for */
    uint32_t until_next;         /* control periods until the next sample */
} axt_history;

/* Empty, keeping a sample every `decimation` control periods, 1 or more, in slots[0 .. size - 1],
 * which belong to the caller. `size` is a power of two, or 0: nothing is kept. */
void axt_history_init(axt_history *history, axt_history_slot *slots, uint32_t size,
                      uint32_t decimation);

/* From now on another distance between samples; those that are there remain. Any context. */
void axt_history_set_decimation(axt_history *history, uint32_t decimation);

uint32_t axt_history_decimation(const axt_history *history);

/* The tick: one sample a control period, of which it keeps what is due. Cost: about 10 operations.
 */
void axt_history_take(axt_history *history, const axt_history_sample *sample);

/* The two ways to read, from any context: at most `most` samples, the oldest first, all as far
 * apart as the first two. Return how many; 0 when there are none, or when the tick wrote over them
 * four times in a row while they were copied. Cost: about 10 operations a sample. */

/* The newest there are. */
uint32_t axt_history_newest(const axt_history *history, axt_history_sample *samples, uint32_t most);

/* The first that are there from control period `from` on (within 2^31 of now). */
uint32_t axt_history_from(const axt_history *history, uint32_t from, axt_history_sample *samples,
                          uint32_t most);

#endif
