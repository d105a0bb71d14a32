/* axt_slcan_link.h - a bus whose frames travel as SLCAN lines over any carrier of bytes.
 *
 * The carrier is three functions: a pseudo-terminal, a socket, an MCU's UART with its two buffers.
 */
#ifndef AXT_SLCAN_LINK_H
#define AXT_SLCAN_LINK_H

#include "axt_can.h"
#include "axt_slcan.h"

enum { AXT_SLCAN_LINK_INPUT = 128, AXT_SLCAN_LINK_OUTPUT = 1024 };

/* Carries bytes without ever waiting. */
typedef struct {
    /* Up to `size` bytes from the host; returns how many, 0 when there are none, AXT_CAN_CLOSED
     * when there is no host (any more), another negative status when the carrier has failed. */
    int32_t (*read)(void *context, char *bytes, uint32_t size);
    /* Bytes for the host; returns how many were taken, else as read(). */
    int32_t (*write)(void *context, const char *bytes, uint32_t size);
    uint32_t (*milliseconds)(void *context); /* any clock, for timestamps */
    void *context;
} axt_slcan_carrier;

typedef struct {
    axt_can can;
    axt_slcan slcan;
    axt_slcan_carrier carrier;
    char input[AXT_SLCAN_LINK_INPUT]; /* received and not yet looked at: from .. until */
    uint32_t input_from;
    uint32_t input_until;
    char output[AXT_SLCAN_LINK_OUTPUT]; /* not yet taken by the carrier */
    uint32_t output_length;
} axt_slcan_link;

/* Sets up send and receive; `close` stays for the owner of the carrier to set. Sent lines are
 * gathered and go out with the next receive(), or when there are many. A line that is garbled
 * counts as an error frame. When the carrier says AXT_CAN_CLOSED the adapter is as just plugged in:
 * the next host finds its channel closed. */
void axt_slcan_link_init(axt_slcan_link *link, const axt_slcan_carrier *carrier);

#endif
