#include "axt_can_pace.h"

#define NANO UINT64_C(1000000000)

enum { BURST_NANOSECONDS = 10000000 };

/* Bits of a frame by the rate they are sent at. */
typedef struct {
    uint32_t nominal;
    uint32_t data;
} frame_bits;

/* At most one stuff bit after every four bits but the first. */
static uint32_t stuff_bits(uint32_t stuffed) {
    return (stuffed - 1) / 4;
}

/* ISO 11898-1: start, identifier and control fields, CRC, acknowledge, end and intermission are 47
 * bits (67 with an extended identifier), of which all up to the CRC are stuffed. */
static frame_bits classical_bits(const axt_can_frame *frame) {
    const uint32_t extended = ((frame->id & AXT_CAN_EXTENDED) != 0) ? 20 : 0;
    const uint32_t data = ((frame->id & AXT_CAN_REMOTE) != 0) ? 0 : 8 * (uint32_t)frame->length;
    const uint32_t stuffed = 34 + extended + data;
    return (frame_bits){.nominal = stuffed + 13 + stuff_bits(stuffed)};
}

/* ISO 11898-1 (2015): up to the bit rate switch 17 bits (36 with an extended identifier), then at
 * the data rate ESI, data length code and data, all of which are stuffed; stuff count and CRC of 17
 * or 21 bits with a fixed stuff bit before every four; the CRC's delimiter. Acknowledge, end and
 * intermission are 12 bits at the nominal rate. */
static frame_bits fd_bits(const axt_can_frame *frame) {
    const uint32_t before = ((frame->id & AXT_CAN_EXTENDED) != 0) ? 36 : 17;
    const uint32_t data = 1 + 4 + 8 * (uint32_t)frame->length;
    const uint32_t checked = 4 + ((frame->length > 16) ? 21 : 17);
    const uint32_t stuffed_before = stuff_bits(before);
    return (frame_bits){
        .nominal = before + stuffed_before + 12,
        .data = data + stuff_bits(before + data) - stuffed_before + checked + (checked + 3) / 4 + 1,
    };
}

uint64_t axt_can_frame_time(const axt_can_frame *frame, const axt_can_bit_rates *rates) {
    const frame_bits bits = frame->fd ? fd_bits(frame) : classical_bits(frame);
    return bits.nominal * NANO / rates->nominal + bits.data * NANO / rates->data;
}

static void spend(axt_can_pace *pace, uint64_t time) {
    pace->credit = (pace->credit > time) ? pace->credit - time : 0;
}

static axt_can_status pace_send(axt_can *can, const axt_can_frame *frame) {
    axt_can_pace *pace = (axt_can_pace *)can;
    const uint64_t time = axt_can_frame_time(frame, &pace->rates);
    if (pace->credit < time) {
        return AXT_CAN_WOULD_BLOCK;
    }
    const axt_can_status status = pace->bus->send(pace->bus, frame);
    pace->can.health = pace->bus->health;
    if (status == AXT_CAN_OK) {
        spend(pace, time);
    }
    return status;
}

static axt_can_status pace_receive(axt_can *can, axt_can_frame *frame) {
    axt_can_pace *pace = (axt_can_pace *)can;
    const axt_can_status status = pace->bus->receive(pace->bus, frame);
    pace->can.health = pace->bus->health;
    pace->can.fd = pace->bus->fd;
    if (status == AXT_CAN_OK) {
        spend(pace, axt_can_frame_time(frame, &pace->rates));
    }
    return status;
}

static void pace_close(axt_can *can) {
    axt_can_pace *pace = (axt_can_pace *)can;
    pace->bus->close(pace->bus);
}

void axt_can_pace_init(axt_can_pace *pace, axt_can *bus, const axt_can_bit_rates *rates) {
    *pace = (axt_can_pace){
        .can = {.fd = bus->fd, .send = pace_send, .receive = pace_receive, .close = pace_close},
        .bus = bus,
        .rates = *rates,
    };
}

/* A slow bus must be able to save up for any frame. */
static uint64_t most_credit(const axt_can_pace *pace) {
    const axt_can_frame longest = {
        .id = AXT_CAN_EXTENDED,
        .length = pace->can.fd ? AXT_CAN_DATA_MAX : AXT_CAN_CLASSICAL_MAX,
        .fd = pace->can.fd,
    };
    const uint64_t time = axt_can_frame_time(&longest, &pace->rates);
    return (time > BURST_NANOSECONDS) ? time : BURST_NANOSECONDS;
}

void axt_can_pace_elapse(axt_can_pace *pace, uint64_t nanoseconds) {
    const uint64_t most = most_credit(pace);
    pace->credit = (nanoseconds < most - pace->credit) ? pace->credit + nanoseconds : most;
}
