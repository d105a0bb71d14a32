#include "axt_modbus_line.h"

#include <string.h>

enum {
    BEGINS = 0x100, /* in the ring: silence was before this byte */
    CRC_SIZE = 2,
    FRAME_MIN = 4, /* unit id, function, CRC */
    TOO_LONG = AXT_MODBUS_LINE_FRAME_MAX + 1,
    SILENCE_MIN = 1750,   /* 3.5 characters above 19200 bit/s [us] */
    EAGER_SILENCE = 50000 /* longer than serial ports of computers hold back a byte [us] */
};

/* CRC-16 with the polynomial x^16 + x^15 + x^2 + 1, reflected (V1.02, 6.2.2), four bits a step. */
static uint16_t crc16(const uint8_t *bytes, uint32_t length) {
    static const uint16_t of_nibble[16] = {
        0x0000, 0xCC01, 0xD801, 0x1400, 0xF001, 0x3C00, 0x2800, 0xE401,
        0xA001, 0x6C00, 0x7800, 0xB401, 0x5000, 0x9C01, 0x8801, 0x4400,
    };
    uint16_t crc = 0xFFFF;
    for (uint32_t i = 0; i < length; i++) {
        crc = (uint16_t)(crc >> 4 ^ of_nibble[(crc ^ bytes[i]) & 0xF]);
        crc = (uint16_t)(crc >> 4 ^ of_nibble[(crc ^ bytes[i] >> 4) & 0xF]);
    }
    return crc;
}

uint32_t axt_modbus_line_seal(uint8_t *frame, uint32_t length) {
    const uint16_t crc = crc16(frame, length);
    frame[length] = (uint8_t)crc;
    frame[length + 1] = (uint8_t)(crc >> 8);
    return length + CRC_SIZE;
}

void axt_modbus_line_init(axt_modbus_line *line, uint32_t bit_rate, bool eager) {
    memset(line, 0, sizeof *line);
    /* a character has 11 bits: start, 8, parity or a second stop, stop */
    const uint32_t silence = (bit_rate > 19200) ? SILENCE_MIN : UINT32_C(38500000) / bit_rate;
    line->silence = (eager && silence < EAGER_SILENCE) ? EAGER_SILENCE : silence;
    line->eager = eager;
}

static bool is_silence(const axt_modbus_line *line, uint32_t since, uint32_t now) {
    const uint32_t passed = now - since;
    return passed > line->silence && passed <= UINT32_MAX / 2; /* else `now` is the older one */
}

void axt_modbus_line_receive(axt_modbus_line *line, uint8_t byte, uint32_t now) {
    const uint32_t head = atomic_load_explicit(&line->head, memory_order_relaxed);
    const uint32_t heard = atomic_load_explicit(&line->heard, memory_order_relaxed);
    line->begins = line->begins || is_silence(line, heard, now);
    if (head - atomic_load_explicit(&line->tail, memory_order_acquire) < AXT_MODBUS_LINE_RING) {
        const uint32_t entry = line->begins ? byte | (uint32_t)BEGINS : byte;
        line->ring[head % AXT_MODBUS_LINE_RING] = (uint16_t)entry;
        line->begins = false;
        atomic_store_explicit(&line->head, head + 1, memory_order_release);
    }
    atomic_store_explicit(&line->heard, now, memory_order_release);
}

static bool is_sealed(const axt_modbus_line *line) {
    if (line->length < FRAME_MIN || line->length > AXT_MODBUS_LINE_FRAME_MAX) {
        return false;
    }
    const uint8_t *crc = line->frame + line->length - CRC_SIZE;
    return crc16(line->frame, line->length - CRC_SIZE) == (crc[0] | crc[1] << 8);
}

/* The frame has come to its end: hands it over if it is whole. */
static uint32_t end_frame(axt_modbus_line *line, uint8_t *frame) {
    const uint32_t length = is_sealed(line) ? line->length - CRC_SIZE : 0;
    memcpy(frame, line->frame, length);
    line->length = 0;
    return length;
}

/* Is this a whole request already? */
static bool is_request(const axt_modbus_line *line) {
    const uint32_t before = 1 + CRC_SIZE;
    return line->length > before && line->length <= AXT_MODBUS_LINE_FRAME_MAX &&
           axt_modbus_expected_length(line->frame + 1, line->length - 1) + before == line->length &&
           is_sealed(line);
}

static void append(axt_modbus_line *line, uint8_t byte) {
    if (line->length < AXT_MODBUS_LINE_FRAME_MAX) {
        line->frame[line->length] = byte;
        line->length++;
    } else {
        line->length = TOO_LONG;
    }
}

uint32_t axt_modbus_line_frame(axt_modbus_line *line, uint32_t now,
                               uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX]) {
    uint32_t found = 0;
    while (found == 0) {
        /* first the time, then the ring: a byte that comes in between is seen in the ring */
        const uint32_t heard = atomic_load_explicit(&line->heard, memory_order_acquire);
        const uint32_t tail = atomic_load_explicit(&line->tail, memory_order_relaxed);
        if (tail == atomic_load_explicit(&line->head, memory_order_acquire)) {
            return (line->length > 0 && is_silence(line, heard, now)) ? end_frame(line, frame) : 0;
        }
        const uint16_t entry = line->ring[tail % AXT_MODBUS_LINE_RING];
        if ((entry & BEGINS) != 0 && line->length > 0) {
            found = end_frame(line, frame);
            continue; /* the byte stays for the next frame */
        }
        append(line, (uint8_t)entry);
        atomic_store_explicit(&line->tail, tail + 1, memory_order_release);
        if (line->eager && is_request(line)) {
            found = end_frame(line, frame);
        }
    }
    return found;
}
