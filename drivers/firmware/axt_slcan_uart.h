/* axt_slcan_uart.h - a CAN bus as SLCAN lines on a microcontroller's UART.
 *
 * What the UART lost counts as frames lost (health.overflows), what came damaged as error frames,
 * as with lines that make no sense.
 */
#ifndef AXT_SLCAN_UART_H
#define AXT_SLCAN_UART_H

#include "axt_slcan_link.h"
#include "axt_uart.h"

enum { AXT_SLCAN_UART_INPUT = 1024 }; /* bytes between interrupt and background */

typedef struct {
    axt_slcan_link link;
    axt_uart *uart;
    uint32_t (*clock)(void); /* any, for timestamps [ms] */
    axt_byte_ring input;
    uint8_t bytes[AXT_SLCAN_UART_INPUT];
    uint32_t overruns; /* of the UART, as far as told to the bus */
    uint32_t damaged;  /* likewise */
} axt_slcan_uart;

/* The bus is `&slcan->link.can`. Takes over what `uart` receives, so do this before its interrupts
 * are on. A UART does not tell that the host has gone: the channel stays as that host left it. */
void axt_slcan_uart_open(axt_slcan_uart *slcan, axt_uart *uart, uint32_t (*clock)(void));

#endif
