/* axt_slcan.h - SLCAN, the line protocol of LAWICEL's CAN adapters, seen from the adapter.
 *
 * A host writes lines ended by a carriage return; each is answered by a carriage return, or by BEL
 * when it cannot be carried out. Received frames travel as lines of the same form. Portable: bytes
 * in, bytes out, no operating system. axt_slcan_link.h makes a bus of it.
 *
 *     O L C            open, open listen-only, close the channel
 *     S0 .. S8, sXXYY  bit rate, bit timing registers (stored: an emulated bus has no bits)
 *     tIIILDD.. rIIIL  send a frame, a remote frame; T and R with eight digits of identifier
 *     dIIICDD.. bIIICDD..  send an FD frame, with another bit rate for its data; D and B likewise.
 *                      C is the data length code, 0 to F. This and Y are those of CANable adapters
 *     Y0 .. Y8         bit rate of FD data [Mbit/s] (stored)
 *     V v N F          versions, serial number, status flags
 *     Z0 Z1            timestamps off, on
 *     Mcccccccc mmmmmmmmm   acceptance code and mask, as in the SJA1000's dual filter
 */
#ifndef AXT_SLCAN_H
#define AXT_SLCAN_H

#include <stdbool.h>

#include "axt_can.h"

enum {
    AXT_SLCAN_LINE_MAX = 143, /* B, 8 digits, code, 128 digits, timestamp, carriage return */
    AXT_SLCAN_ANSWER_MAX = 6, /* V1013 and a carriage return */
    AXT_SLCAN_QUEUE_FULL = 1  /* flag reported by F: a frame found no room on its way to the host */
};

typedef enum { AXT_SLCAN_CLOSED = 0, AXT_SLCAN_OPEN, AXT_SLCAN_LISTEN_ONLY } axt_slcan_channel;

/* The adapter. Zero (axt_slcan_init()) is an adapter just plugged in. */
typedef struct {
    axt_slcan_channel channel;
    bool timestamps;
    uint8_t flags;            /* AXT_SLCAN_QUEUE_FULL; cleared when the host has read them */
    uint16_t timing;          /* BTR0 and BTR1, or 0 to 8: the digit of the last S */
    uint8_t data_rate;        /* the digit of the last Y */
    uint32_t acceptance_code; /* bits that an identifier must have ... */
    uint32_t acceptance_mask; /* ... where this mask is 0 */
    uint8_t length;           /* of the line so far; LINE_MAX + 1: too long, being skipped */
    char line[AXT_SLCAN_LINE_MAX];
} axt_slcan;

/* What a line of the host led to. */
typedef struct {
    char answer[AXT_SLCAN_ANSWER_MAX];
    uint8_t answer_length;
    bool garbled;   /* no such command, or a frame that is none */
    bool has_frame; /* the host sends `frame` */
    axt_can_frame frame;
} axt_slcan_reply;

/* An adapter just plugged in: channel closed, all frames accepted, no timestamps. */
void axt_slcan_init(axt_slcan *slcan);

/* One byte from the host. True when it ended a line: `reply` then says what to send back and which
 * frame came. Any sequence of bytes is fine: the line after the next carriage return is understood
 * again. */
bool axt_slcan_input(axt_slcan *slcan, char byte, axt_slcan_reply *reply);

/* A frame on the bus, for the host: writes its line and returns the length, or 0 when the channel
 * is closed, the filter does not let it pass, or it is not a valid frame. FD frames are sent with a
 * bit rate of their own for the data (b and B). `milliseconds` is the
 * time of any clock, sent modulo 60000 when timestamps are on. */
uint32_t axt_slcan_output(const axt_slcan *slcan, const axt_can_frame *frame, uint32_t milliseconds,
                          char line[AXT_SLCAN_LINE_MAX]);

#endif
