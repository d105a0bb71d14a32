/* node_rig.h - a node on a bench: an emulated axis that keeps a log, and a bus in memory.
 *
 * The bus is one more carrier behind the same interface as the others, so the node under test is
 * whole. What it sends is kept in order; what it is sent waits for it.
 */
#ifndef NODE_RIG_H
#define NODE_RIG_H

#include <stdlib.h>

#include "axt_contract.h"
#include "axt_emulated_axis.h"
#include "axt_node.h"
#include "check.h"

enum {
    RIG_ID = 5,
    RIG_BEAT = 1000, /* control periods between heartbeats of the host: 100 ms */
    RIG_TABLE = 512,
    RIG_TRACE = 600,
    RIG_RING = 64,
    RIG_HISTORY = 64,
    RIG_SENT = 200000,
    RIG_COMMANDS = 64,
    RIG_LOG = 100000
};

static const double rig_period = 1e-4; /* [s] */
static const uint32_t rig_rated = 640; /* [mN m] */

/* What the axis saw at each control period. */
typedef struct {
    axt_real torque;
    int32_t position[2];
} rig_period_log;

typedef struct {
    axt_can can; /* first: the bus */
    axt_can_frame sent[RIG_SENT];
    uint32_t sent_count;
    uint32_t room; /* frames that the bus takes before it blocks */
    bool closed;
    axt_can_status broken; /* what a broken bus answers, or AXT_CAN_OK */
    axt_can_frame commands[RIG_COMMANDS];
    uint32_t command_count;
    uint32_t command_next;
    bool host;      /* there is one, with a heartbeat */
    uint32_t beats; /* control periods since the last */

    axt_emulated_axis axis;
    int32_t glitch; /* counts that the motor encoder is wrong by, once */
    rig_period_log log[RIG_LOG];
    uint32_t log_count;

    axt_node node;
    axt_node_config config;
    axt_real table[RIG_TABLE];
    axt_node_sample trace[RIG_TRACE];
    axt_node_stream_sample ring[RIG_RING];
    axt_history_slot history[RIG_HISTORY];
} rig;

static inline axt_can_status rig_send(axt_can *can, const axt_can_frame *frame) {
    rig *r = (rig *)can;
    if (r->broken != AXT_CAN_OK) {
        return r->broken;
    }
    if (r->closed) {
        return AXT_CAN_CLOSED;
    }
    if (r->room == 0 || r->sent_count == RIG_SENT) {
        return AXT_CAN_WOULD_BLOCK;
    }
    r->room--;
    r->sent[r->sent_count] = *frame;
    r->sent_count++;
    return AXT_CAN_OK;
}

static inline axt_can_status rig_receive(axt_can *can, axt_can_frame *frame) {
    rig *r = (rig *)can;
    if (r->broken != AXT_CAN_OK) {
        return r->broken;
    }
    if (r->command_next == r->command_count) {
        return AXT_CAN_WOULD_BLOCK;
    }
    *frame = r->commands[r->command_next];
    r->command_next++;
    return AXT_CAN_OK;
}

static inline void rig_close(axt_can *can) {
    (void)can;
}

static inline void rig_apply_torque(void *axis, axt_real torque) {
    rig *r = axis;
    axt_emulated_axis_apply_torque(&r->axis, torque);
    if (r->log_count < RIG_LOG) {
        r->log[r->log_count].torque = torque;
    }
}

static inline void rig_read_encoders(void *axis, int32_t position[2]) {
    rig *r = axis;
    axt_emulated_axis_read_encoders(&r->axis, position);
    position[0] += r->glitch;
    r->glitch = 0;
    if (r->log_count < RIG_LOG) {
        r->log[r->log_count].position[0] = position[0];
        r->log[r->log_count].position[1] = position[1];
        r->log_count++;
    }
}

static inline axt_node_result rig_axis_command(void *axis,
                                               const struct axt_contract_command_t *command) {
    return axt_emulated_axis_command(&((rig *)axis)->axis, command);
}

static inline void rig_restart_axis(void *axis) {
    axt_emulated_axis_restart(&((rig *)axis)->axis);
}

/* A rig with the paper's axis and a sensible drive; change `config`, then rig_start(). */
static inline rig *rig_new(void) {
    rig *r = calloc(1, sizeof *r);
    if (r == NULL) {
        (void)fprintf(stderr, "no memory\n");
        exit(1);
    }
    r->can = (axt_can){.send = rig_send, .receive = rig_receive, .close = rig_close};
    r->room = UINT32_MAX;
    r->config = (axt_node_config){
        .id = RIG_ID,
        .control_period = (axt_real)rig_period,
        .stream_decimation = 10,
        .rated_torque = rig_rated,
        .counts_per_turn = {1048576, 1048576},
        .expected = {.I1 = (axt_real)5e-5, .I2 = (axt_real)5e-6, .B = (axt_real)1e-3, .K = 200},
        .forgetting = (axt_real)0.99995,
        .limits = {.torque = 32767,
                   .speed = 100000,
                   .travel_min = INT32_MIN,
                   .travel_max = INT32_MAX},
        .host_timeout = 400,
        .excitation = {.length = 256, .first = 1, .stride = 1, .lines = 40, .rms = (axt_real)0.2},
        .table = r->table,
        .table_size = RIG_TABLE,
        .trace = r->trace,
        .trace_size = RIG_TRACE,
        .ring = r->ring,
        .ring_size = RIG_RING,
        .history = r->history,
        .history_size = RIG_HISTORY,
    };
    return r;
}

static inline axt_status rig_start(rig *r) {
    const axt_node_port port = {
        .can = &r->can,
        .axis = r,
        .apply_torque = rig_apply_torque,
        .read_encoders = rig_read_encoders,
        .axis_command = rig_axis_command,
        .restart_axis = rig_restart_axis,
    };
    const axt_status status = axt_emulated_axis_init(
        &r->axis, &axt_axis_paper, r->config.control_period,
        (const uint32_t[2]){r->config.counts_per_turn[0], r->config.counts_per_turn[1]});
    return (status == AXT_OK) ? axt_node_init(&r->node, &r->config, &port) : status;
}

/* A rig that runs. */
static inline rig *rig_running(void) {
    rig *r = rig_new();
    CHECK_EQUAL(rig_start(r), AXT_OK);
    return r;
}

static inline void rig_offer(rig *r, axt_can_frame frame) {
    if (r->command_next == r->command_count) {
        r->command_next = 0;
        r->command_count = 0;
    }
    r->commands[r->command_count] = frame;
    r->command_count++;
}

static inline void rig_beat(rig *r, uint8_t host) {
    rig_offer(r, (axt_can_frame){.id = AXT_CONTRACT_HEARTBEAT_FRAME_ID + (uint32_t)host,
                                 .length = 1,
                                 .data = {AXT_CONTRACT_HEARTBEAT_STATE_OPERATIONAL_CHOICE}});
    r->beats = 0;
}

/* Control periods, each followed by the background, as on a drive with time to spare. */
static inline void rig_run(rig *r, uint32_t periods) {
    for (uint32_t i = 0; i < periods; i++) {
        if (r->host && r->beats >= RIG_BEAT) {
            rig_beat(r, AXT_CONTRACT_HOST_ID);
        }
        r->beats++;
        axt_node_tick(&r->node);
        (void)axt_node_background(&r->node);
    }
}

static inline void rig_forget_sent(rig *r) {
    r->sent_count = 0;
}

/* The next sent frame with identifier base + id from `from` on; NULL when there is none. */
static inline const axt_can_frame *rig_find(const rig *r, uint32_t base, uint32_t from) {
    for (uint32_t i = from; i < r->sent_count; i++) {
        if (r->sent[i].id == base + RIG_ID) {
            return &r->sent[i];
        }
    }
    return NULL;
}

static inline uint32_t rig_count(const rig *r, uint32_t base) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        count += (r->sent[i].id == base + RIG_ID) ? 1 : 0;
    }
    return count;
}

/* The last report of a page that was sent; page 253 (none such) when there is none. */
static inline struct axt_contract_report_t rig_report(const rig *r, uint8_t page) {
    struct axt_contract_report_t report = {.page = 253};
    for (uint32_t i = r->sent_count; i > 0; i--) {
        const axt_can_frame *frame = &r->sent[i - 1];
        if (frame->id == AXT_CONTRACT_REPORT_FRAME_ID + RIG_ID && frame->data[0] == page) {
            (void)axt_contract_report_unpack(&report, frame->data, frame->length);
            break;
        }
    }
    return report;
}

/* A Control frame, and three periods: it is received, carried out, and followed up. */
static inline void rig_control(rig *r, uint16_t word, int16_t torque) {
    const struct axt_contract_control_t control = {.control_word = word, .target_torque = torque};
    axt_can_frame frame = {.id = AXT_CONTRACT_CONTROL_FRAME_ID + RIG_ID, .length = 4};
    (void)axt_contract_control_pack(frame.data, &control, sizeof frame.data);
    rig_offer(r, frame);
    rig_run(r, 3);
}

/* The state that the node reports. */
static inline axt_cia402_state rig_state(const rig *r) {
    return (axt_cia402_state)(r->node.status & AXT_CIA402_STATE_MASK);
}

/* A host comes, with a heartbeat, and enables operation. */
static inline void rig_enable(rig *r) {
    r->host = true;
    rig_beat(r, AXT_CONTRACT_HOST_ID);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_SHUTDOWN_CHOICE, 0);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_SWITCH_ON_CHOICE, 0);
    rig_control(r, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, 0);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_OPERATION_ENABLED);
}

static inline axt_can_frame rig_command(uint8_t code, uint32_t argument) {
    axt_can_frame frame = {.id = AXT_CONTRACT_COMMAND_FRAME_ID + RIG_ID, .length = 8};
    frame.data[0] = code;
    for (uint32_t i = 0; i < 4; i++) {
        frame.data[4 + i] = (uint8_t)(argument >> (8 * i));
    }
    return frame;
}

/* Sends a frame and runs until it is answered: the result, or -1 when there is no answer. */
static inline int rig_ask(rig *r, axt_can_frame command) {
    const uint32_t from = r->sent_count;
    rig_offer(r, command);
    for (int i = 0; i < 10; i++) {
        rig_run(r, 1);
        for (uint32_t k = from; k < r->sent_count; k++) {
            const axt_can_frame *frame = &r->sent[k];
            if (frame->id == AXT_CONTRACT_REPORT_FRAME_ID + RIG_ID && frame->data[0] == 255) {
                const bool echoed = frame->data[1] == command.data[0] &&
                                    memcmp(frame->data + 4, command.data + 4, 4) == 0;
                return echoed ? frame->data[2] | frame->data[3] << 8 : -1;
            }
        }
    }
    return -1;
}

static inline int rig_tell(rig *r, uint8_t code, uint32_t argument) {
    return rig_ask(r, rig_command(code, argument));
}

static inline uint32_t bits_of(float number) {
    uint32_t bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}

#endif
