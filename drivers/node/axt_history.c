#include "axt_history.h"

#include <stdbool.h>

enum { TRIES = 4 };

void axt_history_init(axt_history *history, axt_history_slot *slots, uint32_t size,
                      uint32_t decimation) {
    for (uint32_t i = 0; i < size; i++) {
        for (uint32_t k = 0; k < 4; k++) {
            atomic_init(&slots[i].word[k], 0);
        }
    }
    history->slots = slots;
    history->size = size;
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

static uint32_t head_of(const axt_history *history) {
    return atomic_load_explicit(&history->head, memory_order_acquire);
}

static axt_history_slot *slot(const axt_history *history, uint32_t number) {
    return &history->slots[number & (history->size - 1)];
}

/* Words are stored with release after the head that precedes them, and loaded with acquire before
 * the head is looked at again: who has seen a word of the next lap sees that lap's head, too. */
static void store(axt_history *history, const axt_history_sample *sample) {
    const uint32_t head = atomic_load_explicit(&history->head, memory_order_relaxed);
    _Atomic uint32_t *word = slot(history, head)->word;
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
    if (history->size > 0) {
        store(history, sample);
    }
}

static uint32_t load_n(const axt_history *history, uint32_t number) {
    return atomic_load_explicit(&slot(history, number)->word[0], memory_order_acquire);
}

static axt_history_sample load(const axt_history *history, uint32_t number) {
    const _Atomic uint32_t *word = slot(history, number)->word;
    const uint32_t rest = atomic_load_explicit(&word[3], memory_order_acquire);
    return (axt_history_sample){
        .n = load_n(history, number),
        .position = {(int32_t)atomic_load_explicit(&word[1], memory_order_acquire),
                     (int32_t)atomic_load_explicit(&word[2], memory_order_acquire)},
        .torque = (int16_t)(uint16_t)(rest >> 16),
        .status_word = (uint16_t)rest,
    };
}

/* The oldest sample that is there: the slot that the tick writes next may be half written. */
static uint32_t oldest(const axt_history *history, uint32_t head) {
    return (head < history->size) ? 0 : head - history->size + 1;
}

/* Copies samples first .. head - 1, as far as there is room and they are evenly spaced. False when
 * the tick has written over one of them meanwhile. */
static bool copy(const axt_history *history, uint32_t first, uint32_t head,
                 axt_history_sample *samples, uint32_t most, uint32_t *count) {
    uint32_t copied = 0;
    while (copied < most && first + copied < head) {
        samples[copied] = load(history, first + copied);
        if (copied > 1 &&
            samples[copied].n - samples[copied - 1].n != samples[1].n - samples[0].n) {
            break;
        }
        copied++;
    }
    *count = copied;
    return head_of(history) - first < history->size;
}

/* The first of the newest samples that are evenly spaced, at most `most`. */
static uint32_t even_tail(const axt_history *history, uint32_t head, uint32_t most) {
    uint32_t first = head;
    const uint32_t last = oldest(history, head);
    while (first > last && head - first < most) {
        const bool spaced =
            head - first < 2 || load_n(history, first) - load_n(history, first - 1) ==
                                    load_n(history, first + 1) - load_n(history, first);
        if (!spaced) {
            break;
        }
        first--;
    }
    return first;
}

/* The first sample from control period `from` on; `head` when there is none yet. */
static uint32_t find(const axt_history *history, uint32_t head, uint32_t from) {
    uint32_t low = oldest(history, head);
    uint32_t high = head;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (load_n(history, middle) - from > UINT32_MAX / 2) { /* before it */
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

uint32_t axt_history_newest(const axt_history *history, axt_history_sample *samples,
                            uint32_t most) {
    uint32_t count = 0;
    for (uint32_t attempt = 0; attempt < TRIES && history->size > 0; attempt++) {
        const uint32_t head = head_of(history);
        const uint32_t first = even_tail(history, head, most);
        if (copy(history, first, head, samples, most, &count)) {
            return count;
        }
    }
    return 0;
}

uint32_t axt_history_from(const axt_history *history, uint32_t from, axt_history_sample *samples,
                          uint32_t most) {
    uint32_t count = 0;
    for (uint32_t attempt = 0; attempt < TRIES && history->size > 0; attempt++) {
        const uint32_t head = head_of(history);
        if (copy(history, find(history, head, from), head, samples, most, &count)) {
            return count;
        }
    }
    return 0;
}
