/* axt_modbus_line.h - frames of Modbus RTU on a serial line: silence in between, a CRC at the end.
 *
 * Two callers. axt_modbus_line_receive() is the UART's interrupt: one byte and the time. The other
 * function is the main loop's; the interrupt may come in anywhere, and they share a ring with one
 * writer and one reader. Time is that of any clock in microseconds modulo 2^32; look for frames
 * more often than it comes round.
 */
#ifndef AXT_MODBUS_LINE_H
#define AXT_MODBUS_LINE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "axt_modbus.h"

enum {
    AXT_MODBUS_LINE_FRAME_MAX = AXT_MODBUS_PDU_MAX + 3, /* unit id before, CRC behind */
    AXT_MODBUS_LINE_RING = 512 /* bytes between interrupt and main loop, a power of two */
};

/* Its fields are its own business. */
typedef struct {
    uint32_t silence; /* that ends a frame [us] */
    bool eager;

    /* written by the interrupt */
    uint16_t ring[AXT_MODBUS_LINE_RING]; /* bytes, and whether silence was before them */
    _Atomic uint32_t head;
    _Atomic uint32_t heard; /* when the last byte came [us] */
    bool begins;            /* the next byte to be stored begins a frame */

    /* written by the main loop */
    _Atomic uint32_t tail;
    uint32_t length; /* of the frame so far; FRAME_MAX + 1: too long, being skipped */
    uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX];
} axt_modbus_line;

/* A silent line. `bit_rate` [bit/s], 1 or more, says how long 3.5 characters are: 1750 us above
 * 19200 bit/s (serial line specification V1.02, 2.5.1.1). An `eager` line takes a request as soon
 * as it is complete and its CRC is right, and waits longer for the rest of one: for systems whose
 * serial ports hand over bytes in lumps (USB, pseudo-terminals). */
void axt_modbus_line_init(axt_modbus_line *line, uint32_t bit_rate, bool eager);

/* A byte has come. One that finds the ring full is lost, and with it its frame. Cost: about 20
 * operations. */
void axt_modbus_line_receive(axt_modbus_line *line, uint8_t byte, uint32_t now);

/* The next frame that has come whole, CRC checked and taken off, into
 * frame[0 .. FRAME_MAX - 3]: unit id and PDU. Returns its length, 2 or more; 0 when there is none.
 * Whatever else was on the line is left out. */
uint32_t axt_modbus_line_frame(axt_modbus_line *line, uint32_t now,
                               uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX]);

/* Appends the CRC to frame[0 .. length - 1], length at most FRAME_MAX - 2, and returns the new
 * length. */
uint32_t axt_modbus_line_seal(uint8_t *frame, uint32_t length);

#endif
