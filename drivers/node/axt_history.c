#include "axt_history.h"

#include <stdbool.h>

enum { TRIES = 4 };

void axt_history_init(axt_history *history, uint32_t decimation) {
    for (uint32_t i = 0; i < AXT_HISTORY_SIZE; i++) {
        for (uint32_t k = 0; k < 4; k++) {
            atomic_init(&history->word[i][k], 0);
        }
    }
    atomic_init(&history->head, 0);
    atomic_init(&history->decimation, decimation);
    history->until_next = 0;
}

void axt_history_set_decimation(axt_history *history, uint32_t decimation) {
    atomic_store_explicit(&history->decimation, decimation, memory_order_relaxed);
}

uint32_t axt_history_decimation(const axt_history *history) {
    return atomic_load_explicit(&history->decimation, memory_order_relaxed);
}

/* Words are stored with release after the head that precedes them, and loaded with acquire before
 * the head is looked at again: who has seen a word of the next lap sees that lap's head, too. */
static void store(axt_history *history, const axt_history_sample *sample) {
    const uint32_t head = atomic_load_explicit(&history->head, memory_order_relaxed);
    _Atomic uint32_t *word = history->word[head % AXT_HISTORY_SIZE];
    const uint32_t rest = (uint32_t)(uint16_t)sample->torque << 16 | sample->status_word;
    atomic_store_explicit(&word[0], sample->n, memory_order_release);
    atomic_store_explicit(&word[1], (uint32_t)sample->position[0], memory_order_release);
    atomic_store_explicit(&word[2], (uint32_t)sample->position[1], memory_order_release);
    atomic_store_explicit(&word[3], rest, memory_order_release);
    atomic_store_explicit(&history->head, head + 1, memory_order_release);
}

void axt_history_take(axt_history *history, const axt_history_sample *sample) {
    const uint32_t decimation = axt_history_decimation(history);
    if (history->until_next >= decimation) { /* it has become smaller */
        history->until_next = 0;
    }
    if (history->until_next > 0) {
        history->until_next--;
        return;
    }
    history->until_next = decimation - 1;
    store(history, sample);
}

static axt_history_sample load(const axt_history *history, uint32_t number) {
    const _Atomic uint32_t *word = history->word[number % AXT_HISTORY_SIZE];
    const uint32_t rest = atomic_load_explicit(&word[3], memory_order_acquire);
    return (axt_history_sample){
        .n = atomic_load_explicit(&word[0], memory_order_acquire),
        .position = {(int32_t)atomic_load_explicit(&word[1], memory_order_acquire),
                     (int32_t)atomic_load_explicit(&word[2], memory_order_acquire)},
        .torque = (int16_t)(uint16_t)(rest >> 16),
        .status_word = (uint16_t)rest,
    };
}

/* How many of these, newest first, are as far apart as the first two? */
static uint32_t even(const axt_history_sample *samples, uint32_t count) {
    for (uint32_t i = 2; i < count; i++) {
        if (samples[i - 1].n - samples[i].n != samples[0].n - samples[1].n) {
            return i;
        }
    }
    return count;
}

uint32_t axt_history_read(const axt_history *history, axt_history_sample *samples, uint32_t most) {
    for (uint32_t attempt = 0; attempt < TRIES; attempt++) {
        const uint32_t head = atomic_load_explicit(&history->head, memory_order_acquire);
        const uint32_t count = (head < most) ? head : most;
        for (uint32_t i = 0; i < count; i++) {
            samples[i] = load(history, head - 1 - i);
        }
        /* the sample that is being written now may be half there */
        const uint32_t now = atomic_load_explicit(&history->head, memory_order_relaxed);
        if (now - head < AXT_HISTORY_SIZE - count) {
            return even(samples, count);
        }
    }
    return 0;
}
