#include "axt_slcan_uart.h"

#include <stddef.h>

/* The UART's interrupt. */
static bool take_byte(void *context, uint8_t byte) {
    axt_slcan_uart *slcan = context;
    return axt_byte_ring_put(&slcan->input, byte);
}

/* How much a counter of the interrupt has grown since it was last told. */
static uint32_t news(const _Atomic uint32_t *counter, uint32_t *told) {
    const uint32_t now = atomic_load_explicit(counter, memory_order_acquire);
    const uint32_t more = now - *told;
    *told = now;
    return more;
}

static int32_t read_bytes(void *context, char *bytes, uint32_t size) {
    axt_slcan_uart *slcan = context;
    axt_can_health *health = &slcan->link.can.health;
    health->overflows += news(&slcan->uart->overruns, &slcan->overruns);
    health->error_frames += news(&slcan->uart->damaged, &slcan->damaged);
    uint8_t byte;
    uint32_t got = 0;
    while (got < size && axt_byte_ring_get(&slcan->input, &byte)) {
        bytes[got] = (char)byte;
        got++;
    }
    return (int32_t)got;
}

static int32_t write_bytes(void *context, const char *bytes, uint32_t size) {
    const axt_slcan_uart *slcan = context;
    return (int32_t)axt_uart_write(slcan->uart, bytes, size);
}

static uint32_t milliseconds(void *context) {
    const axt_slcan_uart *slcan = context;
    return slcan->clock();
}

/* A UART is never given back. */
static void stay_open(axt_can *can) {
    (void)can;
}

void axt_slcan_uart_open(axt_slcan_uart *slcan, axt_uart *uart, uint32_t (*clock)(void)) {
    const axt_slcan_carrier carrier = {
        .read = read_bytes, .write = write_bytes, .milliseconds = milliseconds, .context = slcan};
    axt_slcan_link_init(&slcan->link, &carrier);
    slcan->link.can.close = stay_open;
    slcan->uart = uart;
    slcan->clock = clock;
    slcan->input = (axt_byte_ring){.bytes = slcan->bytes, .size = AXT_SLCAN_UART_INPUT};
    slcan->overruns = 0;
    slcan->damaged = 0;
    uart->received = take_byte;
    uart->context = slcan;
}
