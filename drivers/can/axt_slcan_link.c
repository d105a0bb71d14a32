#include "axt_slcan_link.h"

#include <string.h>

static uint32_t room(const axt_slcan_link *link) {
    return AXT_SLCAN_LINK_OUTPUT - link->output_length;
}

static void put(axt_slcan_link *link, const char *bytes, uint32_t size) {
    memcpy(link->output + link->output_length, bytes, size);
    link->output_length += size;
}

/* The host has gone: nothing of what was meant for it is left to the next one. */
static void unplug(axt_slcan_link *link) {
    axt_slcan_init(&link->slcan);
    link->input_from = 0;
    link->input_until = 0;
    link->output_length = 0;
}

static axt_can_status flush(axt_slcan_link *link) {
    if (link->output_length == 0) {
        return AXT_CAN_OK;
    }
    const int32_t taken =
        link->carrier.write(link->carrier.context, link->output, link->output_length);
    if (taken < 0) {
        unplug(link);
        return (axt_can_status)taken;
    }
    link->output_length -= (uint32_t)taken;
    memmove(link->output, link->output + taken, link->output_length);
    return AXT_CAN_OK;
}

static axt_can_status link_send(axt_can *can, const axt_can_frame *frame) {
    axt_slcan_link *link = (axt_slcan_link *)can;
    if (link->slcan.channel == AXT_SLCAN_CLOSED) {
        return AXT_CAN_CLOSED;
    }
    if (!axt_can_frame_valid(frame, can->fd)) {
        return AXT_CAN_ERROR_FRAME;
    }
    if (room(link) < AXT_SLCAN_LINE_MAX) {
        const axt_can_status status = flush(link);
        if (status != AXT_CAN_OK) {
            return status;
        }
        if (room(link) < AXT_SLCAN_LINE_MAX) {
            link->slcan.flags |= AXT_SLCAN_QUEUE_FULL;
            return AXT_CAN_WOULD_BLOCK;
        }
    }
    char line[AXT_SLCAN_LINE_MAX];
    const uint32_t now = link->carrier.milliseconds(link->carrier.context);
    const uint32_t length = axt_slcan_output(&link->slcan, frame, now, line);
    put(link, line, length);
    return AXT_CAN_OK;
}

/* Fetches more bytes from the host. */
static axt_can_status fetch(axt_slcan_link *link) {
    const int32_t got =
        link->carrier.read(link->carrier.context, link->input, AXT_SLCAN_LINK_INPUT);
    if (got < 0) {
        unplug(link);
        return (axt_can_status)got;
    }
    link->input_from = 0;
    link->input_until = (uint32_t)got;
    return (got > 0) ? AXT_CAN_OK : AXT_CAN_WOULD_BLOCK;
}

static axt_can_status link_receive(axt_can *can, axt_can_frame *frame) {
    axt_slcan_link *link = (axt_slcan_link *)can;
    axt_can_status status = flush(link);
    while (status == AXT_CAN_OK) {
        if (room(link) < AXT_SLCAN_ANSWER_MAX) {
            return AXT_CAN_WOULD_BLOCK; /* a host that does not read its answers has to wait */
        }
        if (link->input_from == link->input_until) {
            status = fetch(link);
            continue;
        }
        axt_slcan_reply reply;
        const char byte = link->input[link->input_from];
        link->input_from++;
        if (axt_slcan_input(&link->slcan, byte, &reply)) {
            put(link, reply.answer, reply.answer_length);
            can->health.error_frames += reply.garbled ? 1 : 0;
            if (reply.has_frame) {
                *frame = reply.frame;
                return AXT_CAN_OK;
            }
        }
    }
    return status;
}

void axt_slcan_link_init(axt_slcan_link *link, const axt_slcan_carrier *carrier) {
    *link = (axt_slcan_link){
        .can = {.fd = true, .send = link_send, .receive = link_receive},
        .carrier = *carrier,
    };
    axt_slcan_init(&link->slcan);
}
