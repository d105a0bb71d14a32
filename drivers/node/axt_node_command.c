#include "axt_node_command.h"

#include "axt_node_frames.h"

enum { LENGTH_MIN = 4 };

static axt_node_result identify(axt_node *node) {
    node->pages |= AXT_NODE_PAGES_IDENTITY | AXT_NODE_PAGES_COUNTERS;
    node->state_sequence++;
    return AXT_NODE_DONE;
}

static axt_node_result start_stream(axt_node *node, uint32_t periods) {
    const uint32_t decimation = (periods > 0) ? periods : node->config.stream_decimation;
    axt_node_order_tick(node, AXT_NODE_ORDER_STREAM, decimation);
    node->stream_decimation = decimation;
    node->streaming = true;
    node->heartbeat_due = true;
    node->pages |= AXT_NODE_PAGE_DECIMATION;
    return AXT_NODE_DONE;
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
    if (samples < 1) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    if (samples > node->config.trace_size) {
        return AXT_NODE_NO_ROOM;
    }
    axt_node_order_tick(node, AXT_NODE_ORDER_TRACE, samples);
    node->trace_order = atomic_load_explicit(&node->order_given, memory_order_relaxed);
    node->trace_length = samples;
    node->trace_checked = 0;
    node->trace_checksum = 0;
    axt_node_set_trace_state(node, AXT_NODE_TRACE_CAPTURING);
    return AXT_NODE_DONE;
}

static axt_node_result upload_trace(axt_node *node, uint32_t index) {
    if (!axt_node_trace_complete(node)) {
        return AXT_NODE_NOT_NOW;
    }
    if (index >= node->trace_length) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    node->upload_frame = 2 * index;
    axt_node_set_trace_state(node, AXT_NODE_TRACE_UPLOADING);
    return AXT_NODE_DONE;
}

/* What is captured completely stays and can be sent again. */
static axt_node_result abort_trace(axt_node *node) {
    if (node->trace_state == AXT_NODE_TRACE_CAPTURING) {
        axt_node_order_tick(node, AXT_NODE_ORDER_TRACE, 0);
        node->trace_length = 0;
        axt_node_set_trace_state(node, AXT_NODE_TRACE_IDLE);
    } else if (node->trace_state == AXT_NODE_TRACE_UPLOADING) {
        axt_node_set_trace_state(node, AXT_NODE_TRACE_READY);
    }
    return AXT_NODE_DONE;
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
    case AXT_CONTRACT_COMMAND_CODE_STREAM_STOP_CHOICE:
        return stop_stream(node);
    case AXT_CONTRACT_COMMAND_CODE_ESTIMATOR_RESET_CHOICE:
        return reset_estimator(node);
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
    default:
        return AXT_NODE_UNKNOWN_COMMAND;
    }
}
