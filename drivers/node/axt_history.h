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

enum {
    AXT_HISTORY_SIZE = 32,    /* samples in the ring, a power of two */
    AXT_HISTORY_READ_MAX = 24 /* samples that can be read at once: the tick must not catch up */
};

typedef struct {
    uint32_t n;          /* control period, modulo 2^32 */
    int32_t position[2]; /* motor and table encoder [counts] */
    int16_t torque;      /* [0.1 per mille of rated] */
    uint16_t status_word;
} axt_history_sample;

/* Its fields are its own business. */
typedef struct {
    _Atomic uint32_t word[AXT_HISTORY_SIZE][4]; /* n, motor, table, torque and status word */
    _Atomic uint32_t head;                      /* samples written so far */
    _Atomic uint32_t decimation;                /* as asked for */
    uint32_t until_next;                        /* control periods until the next sample */
} axt_history;

/* Empty, keeping a sample every `decimation` control periods, 1 or more. */
void axt_history_init(axt_history *history, uint32_t decimation);

/* From now on another distance between samples; those that are there remain. Any context. */
void axt_history_set_decimation(axt_history *history, uint32_t decimation);

uint32_t axt_history_decimation(const axt_history *history);

/* The tick: one sample a control period, of which it keeps what is due. Cost: about 10 operations.
 */
void axt_history_take(axt_history *history, const axt_history_sample *sample);

/* Copies the newest samples, newest first, as far as they are evenly spaced: at most `most`, itself
 * at most AXT_HISTORY_READ_MAX. Returns how many; 0 before the first, or when the tick was faster
 * four times in a row, which takes a reader that is interrupted for many samples each time. */
uint32_t axt_history_read(const axt_history *history, axt_history_sample *samples, uint32_t most);

#endif
