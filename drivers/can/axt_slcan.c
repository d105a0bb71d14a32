#include "axt_slcan.h"

enum {
    STANDARD_DIGITS = 3,
    EXTENDED_DIGITS = 8,
    MINUTE = 60000, /* the timestamp's range [ms] */
    OVERLONG = AXT_SLCAN_LINE_MAX + 1
};

#define STANDARD_MAX UINT32_C(0x7FF)
#define EXTENDED_MAX UINT32_C(0x1FFFFFFF)

static const char ok = '\r';
static const char bell = '\a';

void axt_slcan_init(axt_slcan *slcan) {
    *slcan = (axt_slcan){.acceptance_mask = UINT32_MAX};
}

/* The value of a hexadecimal digit, or -1. */
static int digit_value(char c) {
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    if (c >= 'A' && c <= 'F') {
        return c - 'A' + 10;
    }
    if (c >= 'a' && c <= 'f') {
        return c - 'a' + 10;
    }
    return -1;
}

/* Reads `digits` hexadecimal digits (8 at most). False when one is none. */
static bool read_number(const char *text, uint32_t digits, uint32_t *number) {
    uint32_t sum = 0;
    for (uint32_t i = 0; i < digits; i++) {
        const int value = digit_value(text[i]);
        if (value < 0) {
            return false;
        }
        sum = (sum << 4) | (uint32_t)value;
    }
    *number = sum;
    return true;
}

static char *write_number(char *text, uint32_t digits, uint32_t number) {
    for (uint32_t i = 0; i < digits; i++) {
        text[i] = "0123456789ABCDEF"[(number >> (4 * (digits - 1 - i))) & 0xF];
    }
    return text + digits;
}

/* What the first letter of a frame's line says. */
typedef struct {
    bool extended;
    bool remote;
    bool fd;
} frame_kind;

static frame_kind kind_of(char letter) {
    return (frame_kind){
        .extended = letter == 'T' || letter == 'R' || letter == 'D' || letter == 'B',
        .remote = letter == 'r' || letter == 'R',
        .fd = letter == 'd' || letter == 'D' || letter == 'b' || letter == 'B',
    };
}

/* A line t, r, d, b or one of the capital letters as a frame. False when it is malformed. */
static bool read_frame(const char *line, uint32_t length, axt_can_frame *frame) {
    const frame_kind kind = kind_of(line[0]);
    const uint32_t digits = kind.extended ? EXTENDED_DIGITS : STANDARD_DIGITS;
    axt_can_frame found = {.fd = kind.fd};
    uint32_t code;
    if (length < 2 + digits || !read_number(line + 1, digits, &found.id) ||
        !read_number(line + 1 + digits, 1, &code) ||
        found.id > (kind.extended ? EXTENDED_MAX : STANDARD_MAX)) {
        return false;
    }
    found.id |= (kind.extended ? AXT_CAN_EXTENDED : 0) | (kind.remote ? AXT_CAN_REMOTE : 0);
    found.length = kind.fd ? axt_can_fd_length((uint8_t)code) : (uint8_t)code;
    const uint32_t data_digits = kind.remote ? 0 : 2 * (uint32_t)found.length;
    if (!axt_can_frame_valid(&found, true) || length != 2 + digits + data_digits) {
        return false;
    }
    const char *next = line + 2 + digits;
    for (uint32_t i = 0; i < data_digits / 2; i++) {
        uint32_t byte;
        if (!read_number(next, 2, &byte)) {
            return false;
        }
        found.data[i] = (uint8_t)byte;
        next += 2;
    }
    *frame = found;
    return true;
}

/* Does either half of the SJA1000's dual filter match? A filter sees the identifier's bits from the
 * top, then the remote bit and, in filter 1 only, the first data byte; a mask bit of 1 says "do not
 * care". Extended identifiers are compared in their upper 16 bits. */
static bool accepts(const axt_slcan *slcan, const axt_can_frame *frame) {
    const uint32_t differs = ~slcan->acceptance_mask;
    uint32_t first;
    uint32_t second;
    uint32_t first_bits = UINT32_C(0xFFFF0000);
    uint32_t second_bits = UINT32_C(0x0000FFFF);
    if ((frame->id & AXT_CAN_EXTENDED) != 0) {
        const uint32_t top = (frame->id & EXTENDED_MAX) >> 13;
        first = top << 16;
        second = top;
    } else {
        const uint32_t remote = ((frame->id & AXT_CAN_REMOTE) != 0) ? UINT32_C(0x10) : 0;
        const uint32_t top = ((frame->id & STANDARD_MAX) << 5) | remote;
        const uint32_t data = frame->data[0];
        first = (top << 16) | ((data & 0xF0) << 12) | (data & 0x0F);
        second = top;
        first_bits =
            (frame->length > 0 && remote == 0) ? UINT32_C(0xFFFF000F) : UINT32_C(0xFFF00000);
        second_bits = UINT32_C(0x0000FFF0);
    }
    return ((first ^ slcan->acceptance_code) & differs & first_bits) == 0 ||
           ((second ^ slcan->acceptance_code) & differs & second_bits) == 0;
}

static void answer_end(axt_slcan_reply *reply, char end) {
    reply->answer[reply->answer_length] = end;
    reply->answer_length++;
}

static void answer_done(bool done, axt_slcan_reply *reply) {
    answer_end(reply, done ? ok : bell);
}

static void answer_garbled(axt_slcan_reply *reply) {
    answer_done(false, reply);
    reply->garbled = true;
}

static void answer_text(axt_slcan_reply *reply, const char *text) {
    while (*text != '\0') {
        answer_end(reply, *text);
        text++;
    }
    answer_end(reply, ok);
}

/* C, O and L: opening needs a closed channel, closing an open one. */
static bool set_channel(axt_slcan *slcan, uint32_t length, axt_slcan_channel channel) {
    const bool closing = channel == AXT_SLCAN_CLOSED;
    const bool closed = slcan->channel == AXT_SLCAN_CLOSED;
    if (length != 1 || closing == closed) {
        return false;
    }
    slcan->channel = channel;
    return true;
}

/* S, s, Y, Z, M and m: a setting of `digits` digits up to `limit`, for a closed channel only. */
static bool read_setting(const axt_slcan *slcan, uint32_t length, uint32_t digits, uint32_t limit,
                         uint32_t *setting) {
    uint32_t number;
    if (slcan->channel != AXT_SLCAN_CLOSED || length != 1 + digits ||
        !read_number(slcan->line + 1, digits, &number) || number > limit) {
        return false;
    }
    *setting = number;
    return true;
}

static bool set_timing(axt_slcan *slcan, uint32_t length, uint32_t digits, uint32_t limit) {
    uint32_t timing = 0;
    const bool fine = read_setting(slcan, length, digits, limit, &timing);
    slcan->timing = fine ? (uint16_t)timing : slcan->timing;
    return fine;
}

static bool set_data_rate(axt_slcan *slcan, uint32_t length) {
    uint32_t rate = 0;
    const bool fine = read_setting(slcan, length, 1, 8, &rate);
    slcan->data_rate = fine ? (uint8_t)rate : slcan->data_rate;
    return fine;
}

static bool set_timestamps(axt_slcan *slcan, uint32_t length) {
    uint32_t on = 0;
    const bool fine = read_setting(slcan, length, 1, 1, &on);
    slcan->timestamps = fine ? on == 1 : slcan->timestamps;
    return fine;
}

static void answer_frame(const axt_slcan *slcan, uint32_t length, axt_slcan_reply *reply) {
    if (slcan->channel != AXT_SLCAN_OPEN) {
        answer_done(false, reply);
        return;
    }
    if (!read_frame(slcan->line, length, &reply->frame)) {
        answer_garbled(reply);
        return;
    }
    reply->has_frame = true;
    answer_text(reply, kind_of(slcan->line[0]).extended ? "Z" : "z");
}

static void answer_flags(axt_slcan *slcan, uint32_t length, axt_slcan_reply *reply) {
    if (slcan->channel == AXT_SLCAN_CLOSED || length != 1) {
        answer_done(false, reply);
        return;
    }
    char text[] = "F00";
    (void)write_number(text + 1, 2, slcan->flags);
    slcan->flags = 0;
    answer_text(reply, text);
}

static void answer_about(uint32_t length, const char *text, axt_slcan_reply *reply) {
    if (length == 1) {
        answer_text(reply, text);
    } else {
        answer_done(false, reply);
    }
}

/* Carries out the line. An empty one is what hosts send to end whatever stood there before. */
static void run_line(axt_slcan *slcan, uint32_t length, axt_slcan_reply *reply) {
    if (length == 0) {
        answer_done(true, reply);
        return;
    }
    switch (slcan->line[0]) {
    case 'O':
        answer_done(set_channel(slcan, length, AXT_SLCAN_OPEN), reply);
        break;
    case 'L':
        answer_done(set_channel(slcan, length, AXT_SLCAN_LISTEN_ONLY), reply);
        break;
    case 'C':
        answer_done(set_channel(slcan, length, AXT_SLCAN_CLOSED), reply);
        break;
    case 'S':
        answer_done(set_timing(slcan, length, 1, 8), reply);
        break;
    case 's':
        answer_done(set_timing(slcan, length, 4, UINT16_MAX), reply);
        break;
    case 'Y':
        answer_done(set_data_rate(slcan, length), reply);
        break;
    case 'Z':
        answer_done(set_timestamps(slcan, length), reply);
        break;
    case 'M':
        answer_done(read_setting(slcan, length, 8, UINT32_MAX, &slcan->acceptance_code), reply);
        break;
    case 'm':
        answer_done(read_setting(slcan, length, 8, UINT32_MAX, &slcan->acceptance_mask), reply);
        break;
    case 't':
    case 'T':
    case 'r':
    case 'R':
    case 'd':
    case 'D':
    case 'b':
    case 'B':
        answer_frame(slcan, length, reply);
        break;
    case 'F':
        answer_flags(slcan, length, reply);
        break;
    case 'V': /* hardware and software version */
        answer_about(length, "V1010", reply);
        break;
    case 'v':
        answer_about(length, "v1010", reply);
        break;
    case 'N':
        answer_about(length, "NAXTW", reply);
        break;
    default:
        answer_garbled(reply);
        break;
    }
}

bool axt_slcan_input(axt_slcan *slcan, char byte, axt_slcan_reply *reply) {
    if (byte != '\r') {
        if (slcan->length < AXT_SLCAN_LINE_MAX) {
            slcan->line[slcan->length] = byte;
            slcan->length++;
        } else {
            slcan->length = OVERLONG;
        }
        return false;
    }
    const uint32_t length = slcan->length;
    slcan->length = 0;
    *reply = (axt_slcan_reply){0};
    if (length > AXT_SLCAN_LINE_MAX) {
        answer_garbled(reply);
    } else {
        run_line(slcan, length, reply);
    }
    return true;
}

static char frame_letter(const axt_can_frame *frame) {
    const bool extended = (frame->id & AXT_CAN_EXTENDED) != 0;
    if (frame->fd) {
        return extended ? 'B' : 'b';
    }
    if ((frame->id & AXT_CAN_REMOTE) != 0) {
        return extended ? 'R' : 'r';
    }
    return extended ? 'T' : 't';
}

uint32_t axt_slcan_output(const axt_slcan *slcan, const axt_can_frame *frame, uint32_t milliseconds,
                          char line[AXT_SLCAN_LINE_MAX]) {
    const frame_kind kind = kind_of(frame_letter(frame));
    if (slcan->channel == AXT_SLCAN_CLOSED || !axt_can_frame_valid(frame, true) ||
        !accepts(slcan, frame)) {
        return 0;
    }
    char *end = line;
    *end++ = frame_letter(frame);
    end = write_number(end, kind.extended ? EXTENDED_DIGITS : STANDARD_DIGITS,
                       frame->id & EXTENDED_MAX);
    end = write_number(end, 1, axt_can_fd_code(frame->length));
    for (uint32_t i = 0; !kind.remote && i < frame->length; i++) {
        end = write_number(end, 2, frame->data[i]);
    }
    if (slcan->timestamps) {
        end = write_number(end, 4, milliseconds % MINUTE);
    }
    *end++ = ok;
    return (uint32_t)(end - line);
}
