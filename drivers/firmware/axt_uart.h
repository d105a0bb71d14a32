/* axt_uart.h - what is between a UART's interrupts and the background: bytes out of a ring, bytes
 * in to whoever wants them, and a count of what went wrong on the line.
 *
 * Portable. A port's interrupts call the two functions of the interrupt and touch the UART's
 * registers; the background calls the others. Each shared value has one writer, so neither has to
 * lock the other out.
 */
#ifndef AXT_UART_H
#define AXT_UART_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/* A ring of bytes with one writer and one reader. */
typedef struct {
    uint8_t *bytes;
    uint32_t size; /* a power of two */
    _Atomic uint32_t head;
    _Atomic uint32_t tail;
} axt_byte_ring;

/* The writer: false, and nothing is put, when the ring is full. */
bool axt_byte_ring_put(axt_byte_ring *ring, uint8_t byte);

/* The reader: false when there is none. */
bool axt_byte_ring_get(axt_byte_ring *ring, uint8_t *byte);

/* What a UART says of a byte that has come; bits. */
enum {
    AXT_UART_OVERRUN = 1, /* the one before was lost: nobody fetched it in time */
    AXT_UART_DAMAGED = 2  /* framing, parity or noise error: this is not what was sent */
};

typedef struct axt_uart axt_uart;
struct axt_uart {
    /* Called from the interrupt with each byte that is sound; false when it found no room. */
    bool (*received)(void *context, uint8_t byte);
    void *context;
    void (*begin_to_send)(axt_uart *uart); /* the port's: there is something in `output` */
    void *port;                            /* the port's own */
    axt_byte_ring output;

    /* written by the interrupt, only growing */
    _Atomic uint32_t overruns; /* bytes lost in the UART or for want of room */
    _Atomic uint32_t damaged;  /* bytes left out */
};

/* The interrupt: a byte has come, with these errors. */
void axt_uart_take(axt_uart *uart, uint8_t byte, uint32_t errors);

/* The interrupt: the next byte to send; false when there is none. */
bool axt_uart_next(axt_uart *uart, uint8_t *byte);

/* The background: puts bytes on their way, as many as there is room for, and returns how many. */
uint32_t axt_uart_write(axt_uart *uart, const void *bytes, uint32_t size);

#endif
