#include "axt_can_pace.h"

#define NANO UINT64_C(1000000000)

enum {
    BURST_NANOSECONDS = 10000000,
    LONGEST_FRAME = 160 /* extended, 8 bytes: a slow bus must be able to save up for it [bit] */
};

/* ISO 11898-1: start, identifier and control fields, CRC, acknowledge, end and intermission are 47
 * bits (67 with an extended identifier); from start to CRC every fourth bit may bring a stuff bit
 * after the first. */
uint32_t axt_can_frame_bits(const axt_can_frame *frame) {
    const uint32_t extended = ((frame->id & AXT_CAN_EXTENDED) != 0) ? 20 : 0;
    const uint32_t data = ((frame->id & AXT_CAN_REMOTE) != 0) ? 0 : 8 * (uint32_t)frame->length;
    const uint32_t stuffed = 34 + extended + data;
    return 47 + extended + data + (stuffed - 1) / 4;
}

static void spend(axt_can_pace *pace, uint64_t cost) {
    pace->credit = (pace->credit > cost) ? pace->credit - cost : 0;
}

static axt_can_status pace_send(axt_can *can, const axt_can_frame *frame) {
    axt_can_pace *pace = (axt_can_pace *)can;
    const uint64_t cost = axt_can_frame_bits(frame) * NANO;
    if (pace->credit < cost) {
        return AXT_CAN_WOULD_BLOCK;
    }
    const axt_can_status status = pace->bus->send(pace->bus, frame);
    pace->can.health = pace->bus->health;
    if (status == AXT_CAN_OK) {
        spend(pace, cost);
    }
    return status;
}

static axt_can_status pace_receive(axt_can *can, axt_can_frame *frame) {
    axt_can_pace *pace = (axt_can_pace *)can;
    const axt_can_status status = pace->bus->receive(pace->bus, frame);
    pace->can.health = pace->bus->health;
    if (status == AXT_CAN_OK) {
        spend(pace, axt_can_frame_bits(frame) * NANO);
    }
    return status;
}

static void pace_close(axt_can *can) {
    axt_can_pace *pace = (axt_can_pace *)can;
    pace->bus->close(pace->bus);
}

void axt_can_pace_init(axt_can_pace *pace, axt_can *bus, uint32_t bit_rate) {
    *pace = (axt_can_pace){
        .can = {.fd = bus->fd, .send = pace_send, .receive = pace_receive, .close = pace_close},
        .bus = bus,
        .bit_rate = bit_rate,
    };
}

void axt_can_pace_elapse(axt_can_pace *pace, uint64_t nanoseconds) {
    const uint64_t passed = (nanoseconds < BURST_NANOSECONDS) ? nanoseconds : BURST_NANOSECONDS;
    const uint64_t burst = (uint64_t)pace->bit_rate * BURST_NANOSECONDS;
    const uint64_t most = (burst > LONGEST_FRAME * NANO) ? burst : LONGEST_FRAME * NANO;
    const uint64_t credit = pace->credit + passed * pace->bit_rate;
    pace->credit = (credit < most) ? credit : most;
}
