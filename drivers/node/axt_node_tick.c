#include <stddef.h>

#include "axt_node.h"
#include "axt_node_shared.h"

/* ---- The drive --------------------------------------------------------------------------------
 */

static bool enabled(const axt_node *node) {
    return node->state == AXT_CIA402_OPERATION_ENABLED;
}

static uint16_t status_word(const axt_node *node) {
    return (uint16_t)((uint32_t)node->state | AXT_NODE_VOLTAGE_ENABLED |
                      (node->remote ? AXT_NODE_REMOTE : 0) |
                      (node->excited ? AXT_NODE_EXCITED : 0) |
                      ((node->monitor.state == AXT_MONITOR_ALARM) ? AXT_NODE_WARNING : 0));
}

static void publish_status(axt_node *node) {
    axt_node_publish(&node->status, status_word(node) | (uint32_t)node->error_code << 16);
}

/* Torque ends with operation enabled, however that ends. */
static void enter(axt_node *node, axt_cia402_state state) {
    node->state = state;
    if (!enabled(node)) {
        node->target_torque = 0;
        node->excited = false;
    }
}

static void fail(axt_node *node, uint16_t error_code, int32_t cause) {
    node->error_code = error_code;
    node->error_cause = cause;
    axt_node_count(&node->faults, 1);
    enter(node, AXT_CIA402_FAULT_REACTION_ACTIVE);
}

/* Transitions 1 and 14. */
static void go_on(axt_node *node) {
    if (node->state == AXT_CIA402_NOT_READY) {
        enter(node, AXT_CIA402_SWITCH_ON_DISABLED);
    } else if (node->state == AXT_CIA402_FAULT_REACTION_ACTIVE) {
        enter(node, AXT_CIA402_FAULT);
    }
}

/* A Control frame: its control word first, so that the set-point may come with the word that
 * enables. */
static axt_node_result control(axt_node *node, uint32_t frame) {
    const uint16_t word = (uint16_t)(frame & UINT32_C(0xFFFF));
    const int16_t torque = (int16_t)(uint16_t)(frame >> 16);
    const uint16_t before = node->control_word;
    axt_cia402_state next;
    node->remote = true;
    node->control_word = word;
    if (!axt_cia402_next(node->state, before, word, &next)) {
        return AXT_NODE_NO_TRANSITION;
    }
    if (next == AXT_CIA402_OPERATION_ENABLED && !enabled(node) && node->patience == 0) {
        return AXT_NODE_NO_HOST_HEARTBEAT;
    }
    if (node->state == AXT_CIA402_FAULT && next != AXT_CIA402_FAULT) {
        node->error_code = 0;
    }
    enter(node, next);
    if (enabled(node)) {
        node->target_torque = torque;
        return AXT_NODE_DONE;
    }
    return (torque == 0) ? AXT_NODE_DONE : AXT_NODE_NOT_ENABLED;
}

/* A host that has the drive under its control must be heard; patience is counted here, so that a
 * background that hangs is noticed, too. */
static void watch_host(axt_node *node) {
    const uint32_t heard = axt_node_other(&node->heartbeats);
    if (heard != node->heartbeats_seen) {
        node->heartbeats_seen = heard;
        node->patience = node->patience_max;
    } else if (node->patience > 0) {
        node->patience--;
    }
    if (enabled(node) && node->remote && node->patience == 0) {
        const axt_real milliseconds =
            (axt_real)node->patience_max * node->config.control_period * (axt_real)1e3;
        fail(node, AXT_CONTRACT_EMERGENCY_ERROR_CODE_HOST_HEARTBEAT_LOST_CHOICE,
             (int32_t)(milliseconds + (axt_real)0.5));
    }
}

static void watch_motion(axt_node *node, int32_t position) {
    const axt_guard_verdict verdict = axt_guard_watch(&node->guard, position);
    if (!enabled(node)) {
        return;
    }
    if (verdict == AXT_GUARD_TOO_FAST) {
        fail(node, AXT_CONTRACT_EMERGENCY_ERROR_CODE_SPEED_LIMIT_EXCEEDED_CHOICE,
             axt_guard_speed(&node->guard));
    } else if (verdict == AXT_GUARD_TOO_FAR) {
        fail(node, AXT_CONTRACT_EMERGENCY_ERROR_CODE_TRAVEL_LIMIT_EXCEEDED_CHOICE, position);
    }
}

/* ---- Orders of the background -----------------------------------------------------------------
 */

/* The counter is that of a stream that has run with this decimation since the start. */
static void start_stream(axt_node *node, uint32_t decimation) {
    if (decimation > 0) { /* started again, in the middle of a frame */
        axt_node_count(&node->lost, node->grouped);
    }
    node->decimation = decimation;
    node->group = node->stream_group;
    node->grouped = 0;
    node->skipped = 0;
    if (decimation > 0) {
        const uint64_t first = (node->n + decimation - 1) / decimation;
        node->counter = (uint16_t)first;
        node->until_next = (uint32_t)(first * decimation - node->n);
    }
}

static void play_table(axt_node *node, uint32_t length) {
    node->excited =
        enabled(node) && axt_player_init(&node->player, node->config.table, length) == AXT_OK;
}

static void arm_trace(axt_node *node, uint32_t wanted) {
    static const axt_trace_settings none = {0};
    axt_trace_arm(&node->trace, node->config.trace, (wanted > 0) ? &node->trace_settings : &none);
    axt_node_publish(&node->captured, 0);
}

static void set_limits(axt_node *node) {
    (void)axt_guard_set(&node->guard, &node->limits); /* the background has checked them */
    node->patience_max = axt_node_periods(node, node->host_timeout);
    if (node->patience > node->patience_max) {
        node->patience = node->patience_max;
    }
}

static void watch_drift(axt_node *node) {
    const uint32_t alarms = node->monitor.alarms;
    node->monitor = node->new_monitor;
    node->monitor.alarms = alarms;
}

static void take_order(axt_node *node) {
    const uint32_t given = axt_node_other(&node->order_given);
    if (given == axt_node_own(&node->order_taken)) {
        return;
    }
    switch (node->order) {
    case AXT_NODE_ORDER_CONTROL:
        node->order_result = control(node, node->order_argument);
        publish_status(node);
        break;
    case AXT_NODE_ORDER_STREAM:
        start_stream(node, node->order_argument);
        break;
    case AXT_NODE_ORDER_TORQUE:
        play_table(node, node->order_argument);
        break;
    case AXT_NODE_ORDER_TRACE:
        arm_trace(node, node->order_argument);
        break;
    case AXT_NODE_ORDER_LIMITS:
        set_limits(node);
        break;
    case AXT_NODE_ORDER_WATCH:
        watch_drift(node);
        break;
    case AXT_NODE_ORDER_RESET:
        axt_ident_reset(&node->ident);
        break;
    case AXT_NODE_ORDER_RESTART:
        node->port.restart_axis(node->port.axis);
        break;
    case AXT_NODE_ORDER_ESTIMATE:
        node->ident_copy = node->ident;
        break;
    }
    axt_node_publish(&node->order_taken, given);
}

/* ---- The sample -------------------------------------------------------------------------------
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

static void next_torque(axt_node *node, axt_node_sample *sample) {
    bool limited = false;
    sample->torque = 0;
    sample->status_word = status_word(node);
    if (!enabled(node)) {
        return;
    }
    int32_t torque = node->target_torque;
    if (node->excited) {
        const axt_real wanted = axt_player_step(&node->player);
        torque += axt_node_quantise_torque(wanted, node->torque_unit, &limited);
    }
    sample->torque = axt_guard_torque(&node->guard, torque, &limited);
    if (limited) {
        sample->status_word |= AXT_NODE_LIMITED;
        axt_node_count(&node->limited, 1);
    }
}

static void learn(axt_node *node, const axt_node_sample *sample, axt_real torque) {
    const int32_t *position = sample->position;
    const axt_status status =
        axt_ident_counts(&node->ident, (uint32_t)node->n, position[AXT_ENCODER_MOTOR],
                         position[AXT_ENCODER_TABLE], torque);
    const axt_monitor *monitor = &node->monitor;
    if (status == AXT_OK) {
        (void)axt_monitor_step(&node->monitor, &node->ident.equation);
    } else if (status != AXT_ERROR_NO_DATA) {
        axt_node_count(&node->rejected, 1);
    }
    const uint32_t alarms = (monitor->alarms < UINT16_MAX) ? monitor->alarms : UINT16_MAX;
    axt_node_publish(&node->drift, (uint32_t)monitor->state | monitor->reasons << 8 | alarms << 16);
}

static uint32_t ring_room(const axt_node *node) {
    return node->config.ring_size -
           (axt_node_own(&node->ring_head) - axt_node_other(&node->ring_tail));
}

bool axt_node_has_room(const axt_node *node) {
    return node->grouped > 0 || ring_room(node) >= node->group;
}

/* Samples of one frame become visible together, or not at all. */
static void put_in_ring(axt_node *node, const axt_node_sample *sample) {
    const uint32_t head = axt_node_own(&node->ring_head);
    const uint32_t place = (head + node->grouped) & (node->config.ring_size - 1);
    node->config.ring[place] =
        (axt_node_stream_sample){.sample = *sample, .counter = node->counter, .group = node->group};
    node->grouped++;
    if (node->grouped == node->group) {
        axt_node_publish(&node->ring_head, head + node->group);
        node->grouped = 0;
    }
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
    if (node->skipped == 0 && !axt_node_has_room(node)) {
        node->skipped = node->group;
    }
    if (node->skipped > 0) {
        node->skipped--;
        axt_node_count(&node->lost, 1);
    } else {
        put_in_ring(node, sample);
    }
    node->counter++;
}

static void capture(axt_node *node, const axt_node_sample *sample) {
    axt_trace_take(&node->trace, sample, (uint32_t)node->n);
    axt_node_publish(&node->captured,
                     node->trace.captured | (node->trace.triggered ? AXT_NODE_TRIGGERED : 0));
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
    go_on(node);
    watch_host(node);
    take_order(node);
    next_torque(node, &sample);
    const axt_real torque = (axt_real)sample.torque * node->torque_unit;
    node->port.apply_torque(node->port.axis, torque);
    node->port.read_encoders(node->port.axis, sample.position);
    watch_motion(node, sample.position[AXT_ENCODER_MOTOR]);
    learn(node, &sample, torque);
    stream(node, &sample);
    capture(node, &sample);
    remember(node, &sample);
    publish_status(node);
    node->n++;
    axt_node_publish(&node->now, (uint32_t)node->n);
}

void axt_node_overrun(axt_node *node, uint32_t periods) {
    axt_node_count(&node->overruns, periods);
}
