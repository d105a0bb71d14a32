#include "axt_node.h"

#include <stddef.h>
#include <string.h>

#include "axt_contract.h"
#include "axt_crc32.h"
#include "axt_node_command.h"
#include "axt_node_frames.h"
#include "axt_node_shared.h"

enum {
    ESTIMATE_PERIOD_MS = 200,
    STATE_PERIOD_MS = 1000,
    BATCH_MS = 100, /* of the drift alarm, at least BATCH_MIN samples */
    BATCH_MIN = 100,
    LEARNING_BATCHES = 50,
    FRAMES_PER_CALL = 64, /* bounds of one call of the background */
    RECEIVED_PER_CALL = 16,
    CHECKED_PER_CALL = 32 /* samples of the trace added to its checksum */
};

bool axt_node_can_order(const axt_node *node) {
    return axt_node_other(&node->order_taken) == axt_node_own(&node->order_given);
}

void axt_node_order_tick(axt_node *node, axt_node_order order, uint32_t argument) {
    node->order = order;
    node->order_argument = argument;
    axt_node_publish(&node->order_given, axt_node_own(&node->order_given) + 1);
}

void axt_node_order_control(axt_node *node, uint16_t control_word, int16_t target_torque) {
    node->control = axt_node_pack_control(control_word, target_torque);
    node->control_ordered = true;
    axt_node_order_tick(node, AXT_NODE_ORDER_CONTROL, node->control);
}

void axt_node_hear_host(axt_node *node) {
    axt_node_publish(&node->heartbeats, axt_node_own(&node->heartbeats) + 1);
}

/* ---- What is due ------------------------------------------------------------------------------
 */

/* Has `time` come? Then it moves on by a period, and past what was missed. */
static bool due(uint32_t now, uint32_t period, uint32_t *time) {
    if (now - *time > UINT32_MAX / 2) {
        return false;
    }
    *time += period;
    if (now - *time <= UINT32_MAX / 2) {
        *time = now + period;
    }
    return true;
}

/* The copy that was ordered has come: read it, and send the pages of the snapshot before the next
 * one is ordered. */
static void estimate(axt_node *node, uint32_t now) {
    if (!axt_node_can_order(node) || (node->pages & AXT_NODE_PAGES_ESTIMATE) != 0) {
        return;
    }
    if (node->estimate_ordered) {
        node->estimate_ordered = false;
        (void)axt_ident_result(&node->ident_copy, &node->estimate); /* no data: zeros, not valid */
        node->ident_counters = node->ident_copy.counters;
        node->estimate_sequence++;
        node->pages |= AXT_NODE_PAGES_ESTIMATE;
    } else if (due(now, axt_node_periods(node, ESTIMATE_PERIOD_MS), &node->estimate_time)) {
        axt_node_order_tick(node, AXT_NODE_ORDER_ESTIMATE, 0);
        node->estimate_ordered = true;
    }
}

static void keep_time(axt_node *node) {
    const uint32_t now = axt_node_other(&node->now);
    estimate(node, now);
    if (due(now, axt_node_periods(node, AXT_CONTRACT_HEARTBEAT_CYCLE_TIME_MS),
            &node->heartbeat_time)) {
        node->heartbeat_due = true;
    }
    if (due(now, axt_node_periods(node, STATE_PERIOD_MS), &node->state_time)) {
        node->state_sequence++;
        node->pages |= AXT_NODE_PAGES_COUNTERS;
    }
}

bool axt_node_enabled(const axt_node *node) {
    return axt_node_state(axt_node_other(&node->status)) == AXT_CIA402_OPERATION_ENABLED;
}

/* What the tick has done with the drive: lets the bus know, and ends what needs operation enabled.
 */
static void follow_drive(axt_node *node) {
    const uint32_t status = axt_node_other(&node->status);
    const uint16_t error_code = axt_node_error_code(status);
    if (!axt_node_enabled(node)) {
        node->excitation_state = AXT_NODE_EXCITATION_OFF;
    }
    if (status == node->reported || node->emergency_due) {
        return;
    }
    if (error_code != axt_node_error_code(node->reported)) {
        const int32_t cause = (error_code != 0) ? node->error_cause : 0;
        axt_node_frame_emergency(node, error_code, cause, &node->emergency);
        node->emergency_due = true;
    }
    node->reported = status;
    node->pages |= AXT_NODE_PAGES_STATUS;
}

/* A node that could say nothing says that it is back. */
static void follow_bus(axt_node *node) {
    const axt_can_health *health = &node->port.can->health;
    if (health->bus_off != node->bus_offs && health->state < AXT_CAN_STATE_BUS_OFF &&
        !node->emergency_due) {
        axt_node_frame_emergency(node, AXT_CONTRACT_EMERGENCY_ERROR_CODE_BUS_OFF_RECOVERED_CHOICE,
                                 (int32_t)health->bus_off, &node->emergency);
        node->emergency_due = true;
        node->bus_offs = health->bus_off;
    }
}

static void refuse_control(axt_node *node, uint32_t control, axt_node_result result) {
    node->refused++;
    axt_node_frame_refusal(node, control, result, &node->refusal);
    node->refusal_due = true;
}

/* The tick has taken a Control frame: was it refused? */
static void follow_control(axt_node *node) {
    if (!node->control_ordered || !axt_node_can_order(node)) {
        return;
    }
    node->control_ordered = false;
    if (node->order_result != AXT_NODE_DONE) {
        refuse_control(node, node->control, node->order_result);
    }
}

/* One line of the excitation; after the last one the tick may play it. */
static void fill_table(axt_node *node) {
    if (node->excitation_state != AXT_NODE_EXCITATION_FILLING || !axt_node_can_order(node)) {
        return;
    }
    axt_real *table = node->config.table;
    if (node->excitation_line == 0) {
        for (uint32_t i = 0; i < node->filling.length; i++) {
            table[i] = 0;
        }
    }
    (void)axt_schroeder_add_line(&node->filling, node->excitation_line, table); /* checked before */
    node->excitation_line++;
    if (node->excitation_line == node->filling.lines) {
        axt_node_order_tick(node, AXT_NODE_ORDER_TORQUE, node->filling.length);
        node->excitation_state = AXT_NODE_EXCITATION_ON;
    }
}

void axt_node_set_trace_state(axt_node *node, axt_node_trace_state state) {
    node->trace_state = state;
    node->pages |= AXT_NODE_PAGES_TRACE;
}

bool axt_node_trace_complete(const axt_node *node) {
    return node->trace_state == AXT_NODE_TRACE_READY ||
           node->trace_state == AXT_NODE_TRACE_UPLOADING;
}

/* What the tick has published about the trace; while capturing, it is about the one before until it
 * has taken the order. */
static uint32_t captured(const axt_node *node) {
    const bool begun = axt_node_other(&node->order_taken) - node->trace_order <= UINT32_MAX / 2;
    return begun ? axt_node_other(&node->captured) : 0;
}

uint32_t axt_node_captured(const axt_node *node) {
    const bool capturing =
        node->trace_state == AXT_NODE_TRACE_CAPTURING || node->trace_state == AXT_NODE_TRACE_ARMED;
    return capturing ? captured(node) & ~AXT_NODE_TRIGGERED : node->trace_settings.length;
}

/* Adds to the checksum once all samples are there. */
static void check_trace(axt_node *node) {
    if (node->trace_state == AXT_NODE_TRACE_ARMED && (captured(node) & AXT_NODE_TRIGGERED) != 0) {
        axt_node_set_trace_state(node, AXT_NODE_TRACE_CAPTURING);
    }
    const uint32_t length = node->trace_settings.length;
    if (node->trace_state != AXT_NODE_TRACE_CAPTURING || axt_node_captured(node) < length) {
        return;
    }
    for (uint32_t i = 0; i < CHECKED_PER_CALL && node->trace_checked < length; i++) {
        for (uint32_t channel = 0; channel < 2; channel++) {
            axt_can_frame frame;
            axt_node_frame_trace(node, 2 * node->trace_checked + channel, &frame);
            node->trace_checksum = axt_crc32(node->trace_checksum, frame.data, frame.length);
        }
        node->trace_checked++;
    }
    if (node->trace_checked == length) {
        axt_node_set_trace_state(node, AXT_NODE_TRACE_READY);
    }
}

/* ---- Sending ----------------------------------------------------------------------------------
 */

/* What is to be sent next, the most urgent first. */
typedef enum { NOTHING, EMERGENCY, ANSWER, REFUSAL, HEARTBEAT, STREAM, REPORT, TRACE } source;

static const axt_node_stream_sample *oldest(const axt_node *node) {
    const uint32_t tail = axt_node_own(&node->ring_tail);
    return (tail == axt_node_other(&node->ring_head))
               ? NULL
               : &node->config.ring[tail & (node->config.ring_size - 1)];
}

static uint8_t lowest_page(uint64_t pages) {
    uint8_t page = 0;
    while ((pages & 1) == 0) {
        pages >>= 1;
        page++;
    }
    return page;
}

static void frame_heartbeat(const axt_node *node, axt_can_frame *frame) {
    const uint8_t state = node->streaming ? AXT_CONTRACT_HEARTBEAT_STATE_OPERATIONAL_CHOICE
                                          : AXT_CONTRACT_HEARTBEAT_STATE_PRE_OPERATIONAL_CHOICE;
    axt_node_frame_heartbeat(
        node, node->announced ? state : AXT_CONTRACT_HEARTBEAT_STATE_BOOT_UP_CHOICE, frame);
}

static source pick(const axt_node *node, axt_can_frame *frame) {
    if (node->emergency_due) {
        *frame = node->emergency;
        return EMERGENCY;
    }
    if (node->answer_due) {
        *frame = node->answer;
        return ANSWER;
    }
    if (node->refusal_due) {
        *frame = node->refusal;
        return REFUSAL;
    }
    if (node->heartbeat_due) {
        frame_heartbeat(node, frame);
        return HEARTBEAT;
    }
    const axt_node_stream_sample *sample = oldest(node);
    if (sample != NULL) {
        if (sample->group > 1) {
            axt_node_frame_samples(node, axt_node_own(&node->ring_tail), frame);
        } else if (node->half_sent) {
            axt_node_frame_table(node, sample, frame);
        } else {
            axt_node_frame_motor(node, sample, frame);
        }
        return STREAM;
    }
    if (node->pages != 0) {
        axt_node_frame_report(node, lowest_page(node->pages), frame);
        return REPORT;
    }
    if (node->trace_state == AXT_NODE_TRACE_UPLOADING) {
        axt_node_frame_trace(node, node->upload_frame, frame);
        return TRACE;
    }
    return NOTHING;
}

/* A frame with six samples has gone, or half of one sample. */
static void sample_sent(axt_node *node) {
    const uint32_t group = oldest(node)->group;
    const bool whole = group > 1 || node->half_sent;
    if (whole) {
        axt_node_publish(&node->ring_tail, axt_node_own(&node->ring_tail) + group);
    }
    node->half_sent = !whole;
}

/* The frame has gone, to the bus or to nobody. */
static void tick_off(axt_node *node, source sent) {
    switch (sent) {
    case NOTHING:
        break;
    case EMERGENCY:
        node->emergency_due = false;
        break;
    case ANSWER:
        node->answer_due = false;
        break;
    case REFUSAL:
        node->refusal_due = false;
        break;
    case HEARTBEAT:
        node->heartbeat_due = false;
        node->announced = true;
        break;
    case STREAM:
        sample_sent(node);
        break;
    case REPORT:
        node->pages &= node->pages - 1;
        break;
    case TRACE:
        node->upload_frame++;
        if (node->upload_frame == 2 * node->trace_settings.length) {
            axt_node_set_trace_state(node, AXT_NODE_TRACE_READY);
        }
        break;
    }
}

/* Is that more than a passing state of the bus, or a frame that is none of ours? */
static bool failed(axt_can_status status) {
    return status < AXT_CAN_ERROR_FRAME;
}

static axt_can_status send_frames(axt_node *node) {
    axt_can *can = node->port.can;
    for (uint32_t i = 0; i < FRAMES_PER_CALL; i++) {
        axt_can_frame frame;
        const source next = pick(node, &frame);
        if (next == NOTHING) {
            return AXT_CAN_OK;
        }
        const axt_can_status status = can->send(can, &frame);
        if (status == AXT_CAN_WOULD_BLOCK) {
            return AXT_CAN_OK;
        }
        tick_off(node, next);
        if (failed(status)) {
            return status;
        }
    }
    return AXT_CAN_OK;
}

/* ---- Receiving --------------------------------------------------------------------------------
 */

static void take_command(axt_node *node, const axt_can_frame *frame) {
    const axt_node_result result = axt_node_execute(node, frame);
    node->refused += (result == AXT_NODE_DONE) ? 0 : 1;
    axt_node_frame_answer(node, frame, result, &node->answer);
    node->answer_due = true;
}

static void take_control(axt_node *node, const axt_can_frame *frame) {
    struct axt_contract_control_t control = {0};
    if (axt_contract_control_unpack(&control, frame->data, frame->length) != 0) {
        refuse_control(node, 0, AXT_NODE_OUT_OF_RANGE);
        return;
    }
    axt_node_order_control(node, control.control_word, control.target_torque);
}

static void take_frame(axt_node *node, const axt_can_frame *frame) {
    if (frame->fd || frame->length == 0) {
        return;
    }
    if (frame->id == AXT_CONTRACT_COMMAND_FRAME_ID + node->config.id) {
        take_command(node, frame);
    } else if (frame->id == AXT_CONTRACT_CONTROL_FRAME_ID + node->config.id) {
        take_control(node, frame);
    } else if (frame->id == (uint32_t)AXT_CONTRACT_HEARTBEAT_FRAME_ID + node->host_id) {
        axt_node_hear_host(node);
    }
}

/* Frames are taken from the bus only while whatever they are can be carried out and answered at
 * once. */
static axt_can_status receive_frames(axt_node *node) {
    axt_can *can = node->port.can;
    for (uint32_t i = 0; i < RECEIVED_PER_CALL; i++) {
        if (node->answer_due || node->refusal_due || node->control_ordered ||
            !axt_node_can_order(node)) {
            return AXT_CAN_OK;
        }
        axt_can_frame frame = {0};
        const axt_can_status status = can->receive(can, &frame);
        if (status != AXT_CAN_OK) {
            return failed(status) ? status : AXT_CAN_OK;
        }
        take_frame(node, &frame);
    }
    return AXT_CAN_OK;
}

axt_can_status axt_node_background(axt_node *node) {
    follow_control(node); /* before anything gives the tick another order */
    follow_drive(node);
    follow_bus(node);
    keep_time(node);
    fill_table(node);
    check_trace(node);
    const axt_can_status sent = send_frames(node);
    const axt_can_status received = receive_frames(node);
    return failed(sent) ? sent : received;
}

/* ---- Start and end ----------------------------------------------------------------------------
 */

/* Command and Control differ in one bit; the host whose heartbeat counts can be any node. */
void axt_node_filters(uint8_t id, axt_can_filter filters[AXT_NODE_FILTERS]) {
    const uint32_t either = AXT_CONTRACT_COMMAND_FRAME_ID ^ AXT_CONTRACT_CONTROL_FRAME_ID;
    const uint32_t all = UINT32_C(0x7FF) | AXT_CAN_EXTENDED | AXT_CAN_REMOTE;
    filters[0] = (axt_can_filter){AXT_CONTRACT_COMMAND_FRAME_ID + id, all & ~either};
    filters[1] = (axt_can_filter){AXT_CONTRACT_HEARTBEAT_FRAME_ID, all & ~UINT32_C(0x7F)};
}

static axt_status check_config(const axt_node_config *config) {
    if (config->id < 1 || config->id > AXT_NODE_ID_MAX || config->stream_decimation < 1 ||
        config->rated_torque < 1 || config->host_timeout < 1) {
        return AXT_ERROR_RANGE;
    }
    const bool ring = config->ring_size >= 2 && (config->ring_size & (config->ring_size - 1)) == 0;
    const bool trace = config->trace_size >= 1 && config->trace_size <= AXT_NODE_TRACE_MAX;
    const bool history = (config->history_size & (config->history_size - 1)) == 0;
    if (!ring || !trace || !history || config->table_size < config->excitation.length) {
        return AXT_ERROR_SIZE;
    }
    return axt_schroeder_check(&config->excitation);
}

/* Batches of 100 ms, and a false alarm in 11 days of motion. */
static axt_status init_monitor(axt_node *node) {
    const uint32_t batch = axt_node_periods(node, BATCH_MS);
    const axt_monitor_config config = {.batch = (batch > BATCH_MIN) ? batch : BATCH_MIN,
                                       .learning = LEARNING_BATCHES,
                                       .false_alarm = (axt_real)1e7};
    const axt_status status = axt_monitor_init(&node->monitor, &config);
    node->new_monitor = node->monitor;
    return status;
}

axt_status axt_node_init(axt_node *node, const axt_node_config *config, const axt_node_port *port) {
    const axt_status status = check_config(config);
    if (status != AXT_OK) {
        return status;
    }
    memset(node, 0, sizeof *node);
    node->config = *config;
    node->port = *port;
    node->limits = config->limits;
    node->host_timeout = config->host_timeout;
    node->host_id = AXT_CONTRACT_HOST_ID;
    node->patience_max = axt_node_periods(node, config->host_timeout);
    node->stream_decimation = config->stream_decimation;
    node->excitation = config->excitation;
    node->trigger = (axt_trace_settings){.decimation = 1};
    node->heartbeat_due = true;
    axt_history_init(&node->history, config->history, config->history_size,
                     config->stream_decimation);
    node->group = 1;
    node->stream_group = 1;

    const axt_real rated = (axt_real)config->rated_torque * (axt_real)1e-3;
    node->torque_unit = rated * (axt_real)AXT_CONTRACT_MOTOR_TORQUE_SCALE * (axt_real)1e-3;
    const bool faulty = config->error_code != 0;
    const bool excited = config->excited && !faulty;
    node->state = excited ? AXT_CIA402_OPERATION_ENABLED : AXT_CIA402_NOT_READY;
    if (faulty) {
        node->state = AXT_CIA402_FAULT_REACTION_ACTIVE;
        node->error_code = config->error_code;
        node->error_cause = config->error_cause;
        axt_node_count(&node->faults, 1);
    }
    node->reported = (uint32_t)node->state | AXT_NODE_VOLTAGE_ENABLED;
    axt_node_publish(&node->status, node->reported);
    if (excited) {
        node->filling = node->excitation;
        node->excitation_state = AXT_NODE_EXCITATION_FILLING;
    }
    if (config->streaming) {
        node->streaming = true;
        axt_node_order_tick(node, AXT_NODE_ORDER_STREAM, config->stream_decimation);
    }
    const axt_status limits =
        axt_guard_init(&node->guard, &config->limits, config->counts_per_turn[AXT_ENCODER_MOTOR],
                       config->control_period);
    if (limits != AXT_OK) {
        return limits;
    }
    const axt_ident_config ident = {
        .form = config->form,
        .hold = config->hold,
        .time_step = config->control_period,
        .forgetting = config->forgetting,
        .expected = config->expected,
        .torque = rated,
        .counts_per_turn = {config->counts_per_turn[0], config->counts_per_turn[1]},
    };
    const axt_status identifies = axt_ident_init(&node->ident, &ident);
    if (identifies != AXT_OK) {
        return identifies;
    }
    node->ident_copy = node->ident;
    return init_monitor(node);
}

void axt_node_stop(axt_node *node) {
    axt_can_frame frame;
    node->port.apply_torque(node->port.axis, 0);
    axt_node_frame_heartbeat(node, AXT_CONTRACT_HEARTBEAT_STATE_STOPPED_CHOICE, &frame);
    (void)node->port.can->send(node->port.can, &frame);
    (void)node->port.can->receive(node->port.can, &frame); /* lets the carrier send it off */
}
