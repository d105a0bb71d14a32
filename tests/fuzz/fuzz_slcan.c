/* Anything at all from the host of an SLCAN adapter, in lumps as they come from a serial line.
 *
 * The input is a sequence of lumps: a byte with the length, and so many bytes. What must hold:
 * every frame that comes out is one that can be on a bus, and is itself when it goes the other way;
 * what the host gets back is whole lines; and after a carriage return the next line is understood.
 */
#include <stdlib.h>
#include <string.h>

#include "axt_slcan_link.h"

static void expect(bool holds) {
    if (!holds) {
        abort();
    }
}

/* A host that sends the input and takes everything. */
typedef struct {
    const char *bytes;
    uint32_t left;
    char last; /* byte sent to the host */
} host;

static int32_t host_read(void *context, char *bytes, uint32_t size) {
    host *h = context;
    const uint32_t count = (h->left < size) ? h->left : size;
    memcpy(bytes, h->bytes, count);
    h->bytes += count;
    h->left -= count;
    return (int32_t)count;
}

static int32_t host_write(void *context, const char *bytes, uint32_t size) {
    host *h = context;
    h->last = (size > 0) ? bytes[size - 1] : h->last;
    return (int32_t)size;
}

static uint32_t host_milliseconds(void *context) {
    (void)context;
    return 12345;
}

static axt_slcan_reply say(axt_slcan *slcan, const char *line, uint32_t length) {
    axt_slcan_reply reply = {0};
    for (uint32_t i = 0; i < length; i++) {
        (void)axt_slcan_input(slcan, line[i], &reply);
    }
    return reply;
}

static bool same(const axt_can_frame *a, const axt_can_frame *b) {
    return a->id == b->id && a->length == b->length && a->fd == b->fd &&
           memcmp(a->data, b->data, a->length) == 0;
}

static void expect_there_and_back(const axt_can_frame *frame) {
    axt_slcan slcan;
    char line[AXT_SLCAN_LINE_MAX];
    axt_slcan_init(&slcan);
    (void)say(&slcan, "O\r", 2);
    const uint32_t length = axt_slcan_output(&slcan, frame, 0, line);
    const axt_slcan_reply reply = say(&slcan, line, length);
    expect(reply.has_frame && same(&reply.frame, frame));
}

static void serve(axt_slcan_link *link, host *h) {
    axt_can *can = &link->can;
    axt_can_frame frame;
    axt_can_status status = AXT_CAN_OK;
    while (status == AXT_CAN_OK) {
        status = can->receive(can, &frame);
        if (status == AXT_CAN_OK) {
            expect(axt_can_frame_valid(&frame, true));
            expect_there_and_back(&frame);
            (void)can->send(can, &frame);
        }
    }
    expect(status == AXT_CAN_WOULD_BLOCK && h->left == 0);
    expect(h->last == '\r' || h->last == '\a');
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    host h = {.last = '\r'};
    const axt_slcan_carrier carrier = {
        .read = host_read, .write = host_write, .milliseconds = host_milliseconds, .context = &h};
    axt_slcan_link link;
    axt_slcan_link_init(&link, &carrier);
    while (size > 0) {
        const size_t wanted = data[0];
        const size_t length = (wanted < size - 1) ? wanted : size - 1;
        h.bytes = (const char *)data + 1;
        h.left = (uint32_t)length;
        serve(&link, &h);
        data += 1 + length;
        size -= 1 + length;
    }
    (void)say(&link.slcan, "\r", 1);
    expect(say(&link.slcan, "V\r", 2).answer_length == AXT_SLCAN_ANSWER_MAX);
    return 0;
}
