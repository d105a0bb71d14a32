#include "axt_node.h"

#include <stddef.h>
#include <string.h>

#include "axt_contract.h"
#include "axt_crc32.h"
#include "axt_node_command.h"
#include "axt_node_frames.h"

enum {
    ESTIMATE_PERIOD_MS = 200,
    STATE_PERIOD_MS = 1000,
    FRAMES_PER_CALL = 64, /* bounds of one call of the background */
    COMMANDS_PER_CALL = 4,
    CHECKED_PER_CALL = 32 /* samples of the trace added to its checksum */
};

/* ---- What tick and background share -----------------------------------------------------------
 */

/* Each of these has one writer, so plain loads and stores will do: no read-modify-write, which some
 * small cores do not have. */
static uint32_t read_own(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_relaxed);
}

static uint32_t read_other(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_acquire);
}

static void publish(_Atomic uint32_t *value, uint32_t number) {
    atomic_store_explicit(value, number, memory_order_release);
}

static void count(_Atomic uint32_t *counter, uint32_t events) {
    atomic_store_explicit(counter, read_own(counter) + events, memory_order_relaxed);
}

bool axt_node_can_order(const axt_node *node) {
    return read_other(&node->order_taken) == read_own(&node->order_given);
}

void axt_node_order_tick(axt_node *node, axt_node_order order, uint32_t argument) {
    node->order = order;
    node->order_argument = argument;
    publish(&node->order_given, read_own(&node->order_given) + 1);
}

/* ---- The tick ---------------------------------------------------------------------------------
 */

int16_t axt_node_quantise_torque(axt_real torque, axt_real unit, bool *limited) {
    const int16_t most = INT16_MAX;
    const axt_real half = (axt_real)0.5;
    const axt_real number = torque / unit;
    *limited = number >= (axt_real)most + half || number <= -((axt_real)most + half);
    if (*limited) {
        return (number > 0) ? most : (int16_t)-most;
    }
    if (number >= 0) {
        return (int16_t)(number + half);
    }
    return (number < 0) ? (int16_t)(number - half) : 0; /* neither: not a number */
}

/* The counter is that of a stream that has run with this decimation since the start. */
static void start_stream(axt_node *node, uint32_t decimation) {
    node->decimation = decimation;
    if (decimation > 0) {
        const uint64_t first = (node->n + decimation - 1) / decimation;
        node->counter = (uint16_t)first;
        node->until_next = (uint32_t)(first * decimation - node->n);
    }
}

static void play_table(axt_node *node, uint32_t length) {
    node->operating =
        axt_player_init(&node->player, node->config.table, length) == AXT_OK; /* 0: stop */
}

static void take_order(axt_node *node) {
    const uint32_t given = read_other(&node->order_given);
    if (given == read_own(&node->order_taken)) {
        return;
    }
    switch (node->order) {
    case AXT_NODE_ORDER_STREAM:
        start_stream(node, node->order_argument);
        break;
    case AXT_NODE_ORDER_TORQUE:
        play_table(node, node->order_argument);
        break;
    case AXT_NODE_ORDER_TRACE:
        node->trace_wanted = node->order_argument;
        publish(&node->trace_captured, 0);
        break;
    case AXT_NODE_ORDER_RESET:
        axt_ident_reset(&node->ident);
        break;
    case AXT_NODE_ORDER_ESTIMATE:
        node->ident_copy = node->ident;
        break;
    }
    publish(&node->order_taken, given);
}

static void next_torque(axt_node *node, axt_node_sample *sample) {
    bool limited = false;
    sample->torque = 0;
    sample->status_word = AXT_NODE_SWITCHED_ON;
    if (node->operating) {
        const axt_real wanted = axt_player_step(&node->player);
        sample->torque = axt_node_quantise_torque(wanted, node->torque_unit, &limited);
        sample->status_word = AXT_NODE_OPERATION_ENABLED;
    }
    if (limited) {
        sample->status_word |= AXT_NODE_LIMIT_ACTIVE;
    }
}

static void learn(axt_node *node, const axt_node_sample *sample, axt_real torque) {
    const int32_t *position = sample->position;
    const axt_status status =
        axt_ident_counts(&node->ident, (uint32_t)node->n, position[AXT_ENCODER_MOTOR],
                         position[AXT_ENCODER_TABLE], torque);
    if (status != AXT_OK && status != AXT_ERROR_NO_DATA) {
        count(&node->rejected, 1);
    }
}

bool axt_node_has_room(const axt_node *node) {
    return read_own(&node->ring_head) - read_other(&node->ring_tail) < node->config.ring_size;
}

static void stream(axt_node *node, const axt_node_sample *sample) {
    if (node->decimation == 0) {
        return;
    }
    if (node->until_next > 0) {
        node->until_next--;
        return;
    }
    node->until_next = node->decimation - 1;
    if (axt_node_has_room(node)) {
        const uint32_t head = read_own(&node->ring_head);
        axt_node_stream_sample *place = &node->config.ring[head & (node->config.ring_size - 1)];
        *place = (axt_node_stream_sample){.sample = *sample, .counter = node->counter};
        publish(&node->ring_head, head + 1);
    } else {
        count(&node->lost, 1);
    }
    node->counter++;
}

static void capture(axt_node *node, const axt_node_sample *sample) {
    const uint32_t captured = read_own(&node->trace_captured);
    if (captured < node->trace_wanted) {
        node->config.trace[captured] = *sample;
        publish(&node->trace_captured, captured + 1);
    }
}

static void remember(axt_node *node, const axt_node_sample *sample) {
    const axt_history_sample kept = {
        .n = (uint32_t)node->n,
        .position = {sample->position[AXT_ENCODER_MOTOR], sample->position[AXT_ENCODER_TABLE]},
        .torque = sample->torque,
        .status_word = sample->status_word,
    };
    axt_history_take(&node->history, &kept);
}

void axt_node_tick(axt_node *node) {
    axt_node_sample sample = {0};
    take_order(node);
    next_torque(node, &sample);
    const axt_real torque = (axt_real)sample.torque * node->torque_unit;
    node->port.apply_torque(node->port.axis, torque);
    node->port.read_encoders(node->port.axis, sample.position);
    learn(node, &sample, torque);
    stream(node, &sample);
    capture(node, &sample);
    remember(node, &sample);
    node->n++;
    publish(&node->now, (uint32_t)node->n);
}

void axt_node_overrun(axt_node *node, uint32_t periods) {
    count(&node->overruns, periods);
}

/* ---- The background ---------------------------------------------------------------------------
 */

static uint32_t periods(const axt_node *node, uint32_t milliseconds) {
    const axt_real number =
        (axt_real)milliseconds * (axt_real)1e-3 / node->config.control_period + (axt_real)0.5;
    return (number >= 1) ? (uint32_t)number : 1;
}

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
        node->estimate_sequence++;
        node->pages |= AXT_NODE_PAGES_ESTIMATE;
    } else if (due(now, periods(node, ESTIMATE_PERIOD_MS), &node->estimate_time)) {
        axt_node_order_tick(node, AXT_NODE_ORDER_ESTIMATE, 0);
        node->estimate_ordered = true;
    }
}

static void keep_time(axt_node *node) {
    const uint32_t now = read_other(&node->now);
    estimate(node, now);
    if (due(now, periods(node, AXT_CONTRACT_HEARTBEAT_CYCLE_TIME_MS), &node->heartbeat_time)) {
        node->heartbeat_due = true;
    }
    if (due(now, periods(node, STATE_PERIOD_MS), &node->state_time)) {
        node->state_sequence++;
        node->pages |= AXT_NODE_PAGES_COUNTERS;
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
    node->pages |= AXT_NODE_PAGE_CAPTURED;
    if (state == AXT_NODE_TRACE_READY) {
        node->pages |= AXT_NODE_PAGE_CHECKSUM;
    }
}

bool axt_node_trace_complete(const axt_node *node) {
    return node->trace_state == AXT_NODE_TRACE_READY ||
           node->trace_state == AXT_NODE_TRACE_UPLOADING;
}

/* While capturing, the tick's count is that of the trace before until it has taken the order. */
uint32_t axt_node_captured(const axt_node *node) {
    if (node->trace_state != AXT_NODE_TRACE_CAPTURING) {
        return node->trace_length;
    }
    const bool begun = read_other(&node->order_taken) - node->trace_order <= UINT32_MAX / 2;
    return begun ? read_other(&node->trace_captured) : 0;
}

/* Adds to the checksum once all samples are there. */
static void check_trace(axt_node *node) {
    if (node->trace_state != AXT_NODE_TRACE_CAPTURING ||
        axt_node_captured(node) < node->trace_length) {
        return;
    }
    for (uint32_t i = 0; i < CHECKED_PER_CALL && node->trace_checked < node->trace_length; i++) {
        for (uint32_t channel = 0; channel < 2; channel++) {
            axt_can_frame frame;
            axt_node_frame_trace(node, 2 * node->trace_checked + channel, &frame);
            node->trace_checksum = axt_crc32(node->trace_checksum, frame.data, frame.length);
        }
        node->trace_checked++;
    }
    if (node->trace_checked == node->trace_length) {
        axt_node_set_trace_state(node, AXT_NODE_TRACE_READY);
    }
}

/* What is to be sent next, the most urgent first. */
typedef enum { NOTHING, ANSWER, HEARTBEAT, STREAM, REPORT, TRACE } source;

static const axt_node_stream_sample *oldest(const axt_node *node) {
    const uint32_t tail = read_own(&node->ring_tail);
    return (tail == read_other(&node->ring_head))
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
    if (node->answer_due) {
        *frame = node->answer;
        return ANSWER;
    }
    if (node->heartbeat_due) {
        frame_heartbeat(node, frame);
        return HEARTBEAT;
    }
    const axt_node_stream_sample *sample = oldest(node);
    if (sample != NULL) {
        if (node->half_sent) {
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

/* The frame has gone, to the bus or to nobody. */
static void tick_off(axt_node *node, source sent) {
    switch (sent) {
    case NOTHING:
        break;
    case ANSWER:
        node->answer_due = false;
        break;
    case HEARTBEAT:
        node->heartbeat_due = false;
        node->announced = true;
        break;
    case STREAM:
        if (node->half_sent) {
            publish(&node->ring_tail, read_own(&node->ring_tail) + 1);
        }
        node->half_sent = !node->half_sent;
        break;
    case REPORT:
        node->pages &= node->pages - 1;
        break;
    case TRACE:
        node->upload_frame++;
        if (node->upload_frame == 2 * node->trace_length) {
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

/* A command is taken from the bus only when it can be carried out and answered at once. */
static axt_can_status receive_commands(axt_node *node) {
    axt_can *can = node->port.can;
    for (uint32_t i = 0; i < COMMANDS_PER_CALL; i++) {
        if (node->answer_due || !axt_node_can_order(node)) {
            return AXT_CAN_OK;
        }
        axt_can_frame frame = {0};
        const axt_can_status status = can->receive(can, &frame);
        if (status != AXT_CAN_OK) {
            return failed(status) ? status : AXT_CAN_OK;
        }
        if (frame.id == AXT_CONTRACT_COMMAND_FRAME_ID + node->config.id && frame.length > 0) {
            const axt_node_result result = axt_node_execute(node, &frame);
            axt_node_frame_answer(node, &frame, result, &node->answer);
            node->answer_due = true;
        }
    }
    return AXT_CAN_OK;
}

axt_can_status axt_node_background(axt_node *node) {
    keep_time(node);
    fill_table(node);
    check_trace(node);
    const axt_can_status sent = send_frames(node);
    const axt_can_status received = receive_commands(node);
    return failed(sent) ? sent : received;
}

/* Command and Control differ in one bit; the host whose heartbeat counts can be any node. */
void axt_node_filters(uint8_t id, axt_can_filter filters[AXT_NODE_FILTERS]) {
    const uint32_t either = AXT_CONTRACT_COMMAND_FRAME_ID ^ AXT_CONTRACT_CONTROL_FRAME_ID;
    const uint32_t all = UINT32_C(0x7FF) | AXT_CAN_EXTENDED | AXT_CAN_REMOTE;
    filters[0] = (axt_can_filter){AXT_CONTRACT_COMMAND_FRAME_ID + id, all & ~either};
    filters[1] = (axt_can_filter){AXT_CONTRACT_HEARTBEAT_FRAME_ID, all & ~UINT32_C(0x7F)};
}

/* ---- Start and end ----------------------------------------------------------------------------
 */

static axt_status check_config(const axt_node_config *config) {
    if (config->id < 1 || config->id > AXT_NODE_ID_MAX || config->stream_decimation < 1 ||
        config->rated_torque < 1) {
        return AXT_ERROR_RANGE;
    }
    const bool ring = config->ring_size >= 2 && (config->ring_size & (config->ring_size - 1)) == 0;
    const bool trace = config->trace_size >= 1 && config->trace_size <= AXT_NODE_TRACE_MAX;
    if (!ring || !trace || config->table_size < config->excitation.length) {
        return AXT_ERROR_SIZE;
    }
    return axt_schroeder_check(&config->excitation);
}

axt_status axt_node_init(axt_node *node, const axt_node_config *config, const axt_node_port *port) {
    const axt_status status = check_config(config);
    if (status != AXT_OK) {
        return status;
    }
    memset(node, 0, sizeof *node);
    node->config = *config;
    node->port = *port;
    node->stream_decimation = config->stream_decimation;
    node->excitation = config->excitation;
    node->heartbeat_due = true;
    axt_history_init(&node->history, config->stream_decimation);

    const axt_real rated = (axt_real)config->rated_torque * (axt_real)1e-3;
    node->torque_unit = rated * (axt_real)AXT_CONTRACT_MOTOR_TORQUE_SCALE * (axt_real)1e-3;
    if (config->excited) {
        node->filling = node->excitation;
        node->excitation_state = AXT_NODE_EXCITATION_FILLING;
    }
    if (config->streaming) {
        node->streaming = true;
        axt_node_order_tick(node, AXT_NODE_ORDER_STREAM, config->stream_decimation);
    }
    const axt_ident_config ident = {
        .form = AXT_IDENT_3X2,
        .time_step = config->control_period,
        .forgetting = config->forgetting,
        .expected = config->expected,
        .torque = rated,
        .counts_per_turn = {config->counts_per_turn[0], config->counts_per_turn[1]},
    };
    return axt_ident_init(&node->ident, &ident);
}

void axt_node_stop(axt_node *node) {
    axt_can_frame frame;
    node->port.apply_torque(node->port.axis, 0);
    axt_node_frame_heartbeat(node, AXT_CONTRACT_HEARTBEAT_STATE_STOPPED_CHOICE, &frame);
    (void)node->port.can->send(node->port.can, &frame);
    (void)node->port.can->receive(node->port.can, &frame); /* lets the carrier send it off */
}
