/* Any frames at all on the bus of a node, which takes them for commands, control words and
 * heartbeats of its host as far as they are.
 *
 * The input is a sequence of frames. First byte: bits 0 and 1 say whose identifier (Command,
 * Control, the host's heartbeat, or the two bytes that follow), bits 2 to 5 are the data length
 * code, bit 6 makes it an FD frame, bit 7 has the node run a while longer; the data come next. What
 * must hold: torque acts in operation enabled alone and within its limit, what the node sends can
 * be on a bus and is its own, and a frame for somebody else changes nothing. */
#include "node_rig.h"

enum { FRAMES_MAX = 200, A_WHILE = 50, PATIENCE = 100, STARTED = 5, FOLLOWED_UP = 3 /* periods */ };

/* What commands and control words change. */
typedef struct {
    axt_schroeder excitation;
    axt_limits limits;
    uint32_t decimation;
    bool streaming;
    uint16_t status;
} settings;

static settings settings_of(const axt_node *node) {
    return (settings){.excitation = node->excitation,
                      .limits = node->limits,
                      .decimation = node->stream_decimation,
                      .streaming = node->streaming,
                      .status = node->status};
}

static bool same_settings(const settings *a, const settings *b) {
    return a->status == b->status && a->streaming == b->streaming &&
           a->decimation == b->decimation &&
           memcmp(&a->excitation, &b->excitation, sizeof a->excitation) == 0 &&
           memcmp(&a->limits, &b->limits, sizeof a->limits) == 0;
}

static void expect(bool holds) {
    if (!holds) {
        abort();
    }
}

static void run_one_period(rig *r) {
    const bool enabled = rig_state(r) == AXT_CIA402_OPERATION_ENABLED;
    rig_run(r, 1);
    const axt_real torque = r->log[r->log_count - 1].torque;
    const axt_real most = (axt_real)r->config.limits.torque * r->node.torque_unit;
    expect(torque == 0 || enabled || rig_state(r) == AXT_CIA402_OPERATION_ENABLED);
    expect(torque >= -most && torque <= most);
}

static void expect_own_frames(rig *r) {
    for (uint32_t i = 0; i < r->sent_count; i++) {
        expect(axt_can_frame_valid(&r->sent[i], r->can.fd));
        expect((r->sent[i].id & 0x7F) == RIG_ID);
    }
    rig_forget_sent(r);
}

/* Takes a frame off the input; returns the bytes it took. */
static size_t next_frame(const uint8_t *data, size_t size, axt_can_frame *frame) {
    static const uint32_t ids[] = {AXT_CONTRACT_COMMAND_FRAME_ID + RIG_ID,
                                   AXT_CONTRACT_CONTROL_FRAME_ID + RIG_ID,
                                   AXT_CONTRACT_HEARTBEAT_FRAME_ID + AXT_CONTRACT_HOST_ID};
    const uint8_t what = data[0];
    const uint8_t code = (what >> 2) & 0xF;
    size_t taken = 1;
    *frame = (axt_can_frame){.fd = (what & 0x40) != 0};
    frame->length = frame->fd ? axt_can_fd_length(code) : code % 9;
    if ((what & 3) < 3) {
        frame->id = ids[what & 3];
    } else if (size >= 3) {
        frame->id = (uint32_t)(data[1] | data[2] << 8) & 0x7FF;
        taken = 3;
    }
    const size_t rest = size - taken;
    const size_t count = (rest < frame->length) ? rest : frame->length;
    memcpy(frame->data, data + taken, count);
    return taken + count;
}

/* As the carrier's filters would let through. */
static bool is_for_the_node(uint32_t id) {
    axt_can_filter filters[AXT_NODE_FILTERS];
    axt_node_filters(RIG_ID, filters);
    bool passes = false;
    for (uint32_t i = 0; i < AXT_NODE_FILTERS; i++) {
        passes = passes || ((id ^ filters[i].id) & filters[i].mask) == 0;
    }
    return passes;
}

static void try_frame(rig *r, const axt_can_frame *frame, bool longer) {
    for (int i = 0; i < FOLLOWED_UP; i++) {
        run_one_period(r);
    }
    const settings before = settings_of(&r->node);
    rig_offer(r, *frame);
    for (int i = 0; i < PATIENCE && r->command_next != r->command_count; i++) {
        run_one_period(r);
    }
    expect(r->command_next == r->command_count);
    if (!is_for_the_node(frame->id) && (before.status & AXT_NODE_REMOTE) == 0) {
        const settings after = settings_of(&r->node);
        expect(same_settings(&before, &after));
    }
    for (int i = 0; longer && i < A_WHILE; i++) {
        run_one_period(r);
    }
    expect_own_frames(r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    rig *r = rig_running();
    r->can.fd = true;
    rig_run(r, STARTED);
    for (int n = 0; n < FRAMES_MAX && size > 0; n++) {
        axt_can_frame frame;
        const bool longer = (data[0] & 0x80) != 0;
        const size_t taken = next_frame(data, size, &frame);
        try_frame(r, &frame, longer);
        data += taken;
        size -= taken;
    }
    free(r);
    return 0;
}
