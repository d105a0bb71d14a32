#include "axt_uart.h"

static uint32_t own(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_relaxed);
}

static uint32_t other(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_acquire);
}

static void publish(_Atomic uint32_t *value, uint32_t number) {
    atomic_store_explicit(value, number, memory_order_release);
}

bool axt_byte_ring_put(axt_byte_ring *ring, uint8_t byte) {
    const uint32_t head = own(&ring->head);
    if (head - other(&ring->tail) == ring->size) {
        return false;
    }
    ring->bytes[head & (ring->size - 1)] = byte;
    publish(&ring->head, head + 1);
    return true;
}

bool axt_byte_ring_get(axt_byte_ring *ring, uint8_t *byte) {
    const uint32_t tail = own(&ring->tail);
    if (tail == other(&ring->head)) {
        return false;
    }
    *byte = ring->bytes[tail & (ring->size - 1)];
    publish(&ring->tail, tail + 1);
    return true;
}

static void count(_Atomic uint32_t *counter) {
    publish(counter, own(counter) + 1);
}

void axt_uart_take(axt_uart *uart, uint8_t byte, uint32_t errors) {
    if ((errors & AXT_UART_OVERRUN) != 0) {
        count(&uart->overruns);
    }
    if ((errors & AXT_UART_DAMAGED) != 0) {
        count(&uart->damaged);
    } else if (!uart->received(uart->context, byte)) {
        count(&uart->overruns);
    }
}

bool axt_uart_next(axt_uart *uart, uint8_t *byte) {
    return axt_byte_ring_get(&uart->output, byte);
}

uint32_t axt_uart_write(axt_uart *uart, const void *bytes, uint32_t size) {
    const uint8_t *next = bytes;
    uint32_t taken = 0;
    while (taken < size && axt_byte_ring_put(&uart->output, next[taken])) {
        taken++;
    }
    if (taken > 0) {
        uart->begin_to_send(uart);
    }
    return taken;
}
