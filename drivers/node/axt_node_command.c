#include "axt_node_command.h"

#include <stddef.h>

#include "axt_node_frames.h"
#include "axt_node_shared.h"

enum { LENGTH_MIN = 4 };

static axt_node_result identify(axt_node *node) {
    node->pages |= AXT_NODE_PAGES_IDENTITY | AXT_NODE_PAGES_COUNTERS | AXT_NODE_PAGES_LIMITS;
    node->state_sequence++;
    return AXT_NODE_DONE;
}

static axt_node_result stream(axt_node *node, uint32_t decimation, uint16_t group) {
    node->stream_group = group;
    axt_node_order_tick(node, AXT_NODE_ORDER_STREAM, decimation);
    node->stream_decimation = decimation;
    node->streaming = true;
    node->heartbeat_due = true;
    node->pages |= AXT_NODE_PAGE_DECIMATION;
    return AXT_NODE_DONE;
}

static axt_node_result start_stream(axt_node *node, uint32_t periods) {
    return stream(node, (periods > 0) ? periods : node->config.stream_decimation, 1);
}

static axt_node_result start_stream_fd(axt_node *node, uint32_t periods) {
    if (!node->port.can->fd) {
        return AXT_NODE_NO_FD;
    }
    if (node->config.ring_size < AXT_NODE_GROUP_FD) {
        return AXT_NODE_NO_ROOM;
    }
    return stream(node, (periods > 0) ? periods : 1, AXT_NODE_GROUP_FD);
}

static axt_node_result stop_stream(axt_node *node) {
    axt_node_order_tick(node, AXT_NODE_ORDER_STREAM, 0);
    node->streaming = false;
    node->heartbeat_due = true;
    return AXT_NODE_DONE;
}

static axt_node_result reset_estimator(axt_node *node) {
    axt_node_order_tick(node, AXT_NODE_ORDER_RESET, 0);
    return AXT_NODE_DONE;
}

/* The model is that of the estimator's last copy, which the tick is not writing to: a command comes
 * only once the tick has taken the last order. */
static axt_node_result watch_drift(axt_node *node, uint32_t on) {
    if (on > 1) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    axt_monitor wanted = node->new_monitor;
    wanted.state = AXT_MONITOR_OFF;
    if (on == 1 && axt_monitor_start(&wanted, &node->ident_copy) != AXT_OK) {
        return AXT_NODE_NOT_NOW;
    }
    node->new_monitor = wanted;
    axt_node_order_tick(node, AXT_NODE_ORDER_WATCH, 0);
    return AXT_NODE_DONE;
}

static axt_node_result set_length(axt_node *node, uint32_t length) {
    if (length < LENGTH_MIN) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    if (length > node->config.table_size) {
        return AXT_NODE_NO_ROOM;
    }
    node->excitation.length = length;
    return AXT_NODE_DONE;
}

/* First harmonic, stride and number of lines: they are checked against the length when it starts.
 */
static axt_node_result set_positive(uint32_t *setting, uint32_t number) {
    if (number < 1) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    *setting = number;
    return AXT_NODE_DONE;
}

/* Up to the largest torque that can be applied; not-a-number is out of range, too. */
static axt_node_result set_rms(axt_node *node, float rms) {
    const axt_real most = (axt_real)INT16_MAX * node->torque_unit;
    if (!((axt_real)rms >= 0 && (axt_real)rms <= most)) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    node->excitation.rms = (axt_real)rms;
    return AXT_NODE_DONE;
}

/* The tick lets go of the table before a line is written to it: filling waits for the order. */
static axt_node_result start_excitation(axt_node *node) {
    const uint32_t status = axt_node_other(&node->status);
    if (!axt_node_enabled(node) || (status & AXT_NODE_REMOTE) == 0) {
        return AXT_NODE_NOT_ENABLED;
    }
    if (axt_schroeder_check(&node->excitation) != AXT_OK) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    axt_node_order_tick(node, AXT_NODE_ORDER_TORQUE, 0);
    node->filling = node->excitation;
    node->excitation_line = 0;
    node->excitation_state = AXT_NODE_EXCITATION_FILLING;
    return AXT_NODE_DONE;
}

static axt_node_result stop_excitation(axt_node *node) {
    axt_node_order_tick(node, AXT_NODE_ORDER_TORQUE, 0);
    node->excitation_state = AXT_NODE_EXCITATION_OFF;
    return AXT_NODE_DONE;
}

/* A new trace may begin at any time: a host that died in the middle of the last must not be in the
 * way of the next. */
static axt_node_result arm_trace(axt_node *node, uint32_t samples) {
    if (samples < 1 || node->trigger.pretrigger >= samples) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    if (samples > node->config.trace_size) {
        return AXT_NODE_NO_ROOM;
    }
    node->trace_settings = node->trigger;
    node->trace_settings.length = samples;
    axt_node_order_tick(node, AXT_NODE_ORDER_TRACE, samples);
    node->trace_order = axt_node_own(&node->order_given);
    node->trace_checked = 0;
    node->trace_checksum = 0;
    const bool now = node->trigger.trigger == AXT_CONTRACT_COMMAND_TRACE_TRIGGER_NOW_CHOICE;
    axt_node_set_trace_state(node, now ? AXT_NODE_TRACE_CAPTURING : AXT_NODE_TRACE_ARMED);
    return AXT_NODE_DONE;
}

static axt_node_result set_choice(uint32_t *setting, uint32_t number, uint32_t last) {
    if (number > last) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    *setting = number;
    return AXT_NODE_DONE;
}

/* Before the longest trace's trigger there is room for one sample less than the trace has. */
static axt_node_result set_pretrigger(axt_node *node, uint32_t samples) {
    if (samples >= node->config.trace_size) {
        return AXT_NODE_NO_ROOM;
    }
    node->trigger.pretrigger = samples;
    return AXT_NODE_DONE;
}

static axt_node_result upload_trace(axt_node *node, uint32_t index) {
    if (!axt_node_trace_complete(node)) {
        return AXT_NODE_NOT_NOW;
    }
    if (index >= node->trace_settings.length) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    node->upload_frame = 2 * index;
    axt_node_set_trace_state(node, AXT_NODE_TRACE_UPLOADING);
    return AXT_NODE_DONE;
}

/* What is captured completely stays and can be sent again. */
static axt_node_result abort_trace(axt_node *node) {
    if (node->trace_state == AXT_NODE_TRACE_CAPTURING ||
        node->trace_state == AXT_NODE_TRACE_ARMED) {
        axt_node_order_tick(node, AXT_NODE_ORDER_TRACE, 0);
        node->trace_settings.length = 0;
        axt_node_set_trace_state(node, AXT_NODE_TRACE_IDLE);
    } else if (node->trace_state == AXT_NODE_TRACE_UPLOADING) {
        axt_node_set_trace_state(node, AXT_NODE_TRACE_READY);
    }
    return AXT_NODE_DONE;
}

/* Limits are those that the drive was built with, or closer ones, and nothing that changes under a
 * torque that acts. */
static axt_node_result limit(axt_node *node, const axt_limits *wanted) {
    const axt_limits *built = &node->config.limits;
    if (axt_node_enabled(node)) {
        return AXT_NODE_NOT_WHILE_ENABLED;
    }
    if (wanted->torque > built->torque || wanted->speed < 1 || wanted->speed > built->speed ||
        wanted->travel_min < built->travel_min || wanted->travel_max > built->travel_max ||
        wanted->travel_min > wanted->travel_max) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    node->limits = *wanted;
    axt_node_order_tick(node, AXT_NODE_ORDER_LIMITS, 0);
    node->pages |= AXT_NODE_PAGES_LIMITS;
    return AXT_NODE_DONE;
}

static axt_node_result limit_torque(axt_node *node, uint16_t torque) {
    axt_limits wanted = node->limits;
    wanted.torque = torque;
    return limit(node, &wanted);
}

static axt_node_result limit_speed(axt_node *node, uint32_t speed) {
    axt_limits wanted = node->limits;
    wanted.speed = speed;
    return limit(node, &wanted);
}

static axt_node_result limit_travel_below(axt_node *node, int32_t position) {
    axt_limits wanted = node->limits;
    wanted.travel_min = position;
    return limit(node, &wanted);
}

static axt_node_result limit_travel_above(axt_node *node, int32_t position) {
    axt_limits wanted = node->limits;
    wanted.travel_max = position;
    return limit(node, &wanted);
}

/* As object 0x1016 of CiA 301: bits 16 to 22 id, bits 0 to 15 ms. A drive that listened to itself
 * would always hear somebody. */
static axt_node_result set_host(axt_node *node, uint32_t consumer) {
    const uint32_t id = consumer >> 16;
    const uint32_t milliseconds = consumer & UINT32_C(0xFFFF);
    if (axt_node_enabled(node)) {
        return AXT_NODE_NOT_WHILE_ENABLED;
    }
    if (id < 1 || id > AXT_CONTRACT_HOST_ID || id == node->config.id || milliseconds < 1 ||
        milliseconds > node->config.host_timeout) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    node->host_id = (uint8_t)id;
    node->host_timeout = (uint16_t)milliseconds;
    axt_node_order_tick(node, AXT_NODE_ORDER_LIMITS, 0);
    node->pages |= AXT_NODE_PAGES_LIMITS;
    return AXT_NODE_DONE;
}

/* An emulated axis knows commands of its own. */
static axt_node_result command_axis(const axt_node *node,
                                    const struct axt_contract_command_t *command) {
    const axt_node_port *port = &node->port;
    return (port->axis_command != NULL) ? port->axis_command(port->axis, command)
                                        : AXT_NODE_UNKNOWN_COMMAND;
}

static axt_node_result restart_axis(axt_node *node, const struct axt_contract_command_t *command) {
    const axt_node_result result = command_axis(node, command);
    if (result == AXT_NODE_DONE && axt_node_enabled(node)) {
        return AXT_NODE_NOT_WHILE_ENABLED;
    }
    if (result == AXT_NODE_DONE) {
        axt_node_order_tick(node, AXT_NODE_ORDER_RESTART, 0);
    }
    return result;
}

axt_node_result axt_node_execute(axt_node *node, const axt_can_frame *frame) {
    struct axt_contract_command_t command = {0};
    if (axt_contract_command_unpack(&command, frame->data, frame->length) != 0) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    switch (command.code) {
    case AXT_CONTRACT_COMMAND_CODE_IDENTIFY_CHOICE:
        return identify(node);
    case AXT_CONTRACT_COMMAND_CODE_STREAM_START_CHOICE:
        return start_stream(node, command.stream_start);
    case AXT_CONTRACT_COMMAND_CODE_STREAM_START_FD_CHOICE:
        return start_stream_fd(node, command.stream_start_fd);
    case AXT_CONTRACT_COMMAND_CODE_STREAM_STOP_CHOICE:
        return stop_stream(node);
    case AXT_CONTRACT_COMMAND_CODE_ESTIMATOR_RESET_CHOICE:
        return reset_estimator(node);
    case AXT_CONTRACT_COMMAND_CODE_DRIFT_WATCH_CHOICE:
        return watch_drift(node, command.drift_watch);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_LENGTH_CHOICE:
        return set_length(node, command.excitation_length);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_FIRST_CHOICE:
        return set_positive(&node->excitation.first, command.excitation_first);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_STRIDE_CHOICE:
        return set_positive(&node->excitation.stride, command.excitation_stride);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_LINES_CHOICE:
        return set_positive(&node->excitation.lines, command.excitation_lines);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_SEED_CHOICE:
        node->excitation.seed = command.excitation_seed;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_RMS_CHOICE:
        return set_rms(node, command.excitation_rms);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_ON_CHOICE:
        return start_excitation(node);
    case AXT_CONTRACT_COMMAND_CODE_EXCITATION_OFF_CHOICE:
        return stop_excitation(node);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_ARM_CHOICE:
        return arm_trace(node, command.trace_arm);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_UPLOAD_CHOICE:
        return upload_trace(node, command.trace_upload);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_ABORT_CHOICE:
        return abort_trace(node);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_TRIGGER_CHOICE:
        return set_choice(&node->trigger.trigger, command.trace_trigger,
                          AXT_CONTRACT_COMMAND_TRACE_TRIGGER_FAULT_CHOICE);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_SOURCE_CHOICE:
        return set_choice(&node->trigger.source, command.trace_source,
                          AXT_CONTRACT_COMMAND_TRACE_SOURCE_TABLE_POSITION_CHOICE);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_LEVEL_CHOICE:
        node->trigger.level = command.trace_level;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_TRACE_PRETRIGGER_CHOICE:
        return set_pretrigger(node, command.trace_pretrigger);
    case AXT_CONTRACT_COMMAND_CODE_TRACE_DECIMATION_CHOICE:
        return set_positive(&node->trigger.decimation, command.trace_decimation);
    case AXT_CONTRACT_COMMAND_CODE_TORQUE_LIMIT_CHOICE:
        return limit_torque(node, command.torque_limit);
    case AXT_CONTRACT_COMMAND_CODE_SPEED_LIMIT_CHOICE:
        return limit_speed(node, command.speed_limit);
    case AXT_CONTRACT_COMMAND_CODE_TRAVEL_MIN_CHOICE:
        return limit_travel_below(node, command.travel_min);
    case AXT_CONTRACT_COMMAND_CODE_TRAVEL_MAX_CHOICE:
        return limit_travel_above(node, command.travel_max);
    case AXT_CONTRACT_COMMAND_CODE_HOST_HEARTBEAT_CHOICE:
        return set_host(node, command.host_heartbeat);
    case AXT_CONTRACT_COMMAND_CODE_AXIS_RESTART_CHOICE:
        return restart_axis(node, &command);
    default:
        return command_axis(node, &command);
    }
}
