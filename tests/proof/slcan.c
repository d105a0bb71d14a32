/* SLCAN, both ways: a byte from the host, a frame for the host.
 *
 * Precondition: a line is at most LINE_MAX + 1 bytes long (0 at the start, and again after the
 * call); the channel is one of its three values. Everything else, the line, the byte and the
 * frame: any bits. */
#include "any.h"
#include "axt_slcan.h"

static axt_slcan any_adapter(void) {
    axt_slcan slcan;
    ANY(slcan);
    slcan.channel = (axt_slcan_channel)any_size(AXT_SLCAN_CLOSED, AXT_SLCAN_LISTEN_ONLY);
    slcan.timestamps = any_size(0, 1) == 1;
    slcan.length = (uint8_t)any_size(0, AXT_SLCAN_LINE_MAX + 1);
    return slcan;
}

static void prove_input(void) {
    axt_slcan slcan = any_adapter();
    axt_slcan_reply reply;
    char byte;
    ANY(byte);
    const bool ended = axt_slcan_input(&slcan, byte, &reply);
    //@ assert line_length: 0 <= slcan.length <= AXT_SLCAN_LINE_MAX + 1;
    if (ended) {
        //@ assert answer_length: 1 <= reply.answer_length <= AXT_SLCAN_ANSWER_MAX;
        //@ assert frame_length: 0 <= reply.frame.length <= AXT_CAN_DATA_MAX;
    }
}

static void prove_output(void) {
    const axt_slcan slcan = any_adapter();
    axt_can_frame frame;
    char line[AXT_SLCAN_LINE_MAX];
    ANY(frame);
    frame.fd = any_size(0, 1) == 1;
    frame.length = (uint8_t)any_size(0, UINT8_MAX);
    uint32_t length = Frama_C_unsigned_int_interval(0, UINT32_MAX);
    //@ split frame.length;
    length = axt_slcan_output(&slcan, &frame, length, line);
    //@ assert output_length: 0 <= length <= AXT_SLCAN_LINE_MAX;
}

int main(void) {
    prove_input();
    prove_output();
    return 0;
}
