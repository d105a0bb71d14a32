/* axt_node_shared.h - how tick and background hand over. Private to the node.
 *
 * Each shared value has one writer, so plain loads and stores will do: no read-modify-write, which
 * some small cores do not have.
 */
#ifndef AXT_NODE_SHARED_H
#define AXT_NODE_SHARED_H

#include "axt_node.h"

/* A value that this side writes. */
static inline uint32_t axt_node_own(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_relaxed);
}

/* A value that the other side writes: what was written before it can be read, too. */
static inline uint32_t axt_node_other(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_acquire);
}

/* Lets the other side see `number`, and what was written before. */
static inline void axt_node_publish(_Atomic uint32_t *value, uint32_t number) {
    atomic_store_explicit(value, number, memory_order_release);
}

static inline void axt_node_count(_Atomic uint32_t *counter, uint32_t events) {
    atomic_store_explicit(counter, axt_node_own(counter) + events, memory_order_relaxed);
}

/* The status as the tick publishes it: status word and error code. */
static inline uint16_t axt_node_status_word(uint32_t status) {
    return (uint16_t)(status & UINT32_C(0xFFFF));
}

static inline uint16_t axt_node_error_code(uint32_t status) {
    return (uint16_t)(status >> 16);
}

static inline axt_cia402_state axt_node_state(uint32_t status) {
    return (axt_cia402_state)(status & AXT_CIA402_STATE_MASK);
}

/* Top bit of `captured`: the trace has been triggered. */
#define AXT_NODE_TRIGGERED UINT32_C(0x80000000)

/* A Control frame as the argument of an order: control word and target torque. */
static inline uint32_t axt_node_pack_control(uint16_t word, int16_t torque) {
    return word | (uint32_t)(uint16_t)torque << 16;
}

/* Control periods in a time [ms], 1 or more. */
static inline uint32_t axt_node_periods(const axt_node *node, uint32_t milliseconds) {
    const axt_real number =
        (axt_real)milliseconds * (axt_real)1e-3 / node->config.control_period + (axt_real)0.5;
    return (number >= 1) ? (uint32_t)number : 1;
}

#endif
