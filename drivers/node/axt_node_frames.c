#include "axt_node_frames.h"

#include <string.h>

enum { ARGUMENT = 4, ARGUMENT_SIZE = 4 }; /* bytes of a command's argument and a report's value */

static void address(const axt_node *node, uint32_t base, uint8_t length, axt_can_frame *frame) {
    *frame = (axt_can_frame){.id = base + node->config.id, .length = length};
}

void axt_node_frame_motor(const axt_node *node, const axt_node_stream_sample *sample,
                          axt_can_frame *frame) {
    const struct axt_contract_motor_t motor = {
        .counter = sample->counter,
        .position = sample->sample.position[AXT_ENCODER_MOTOR],
        .torque = sample->sample.torque,
    };
    address(node, AXT_CONTRACT_MOTOR_FRAME_ID, AXT_CONTRACT_MOTOR_LENGTH, frame);
    (void)axt_contract_motor_pack(frame->data, &motor, sizeof frame->data);
}

void axt_node_frame_table(const axt_node *node, const axt_node_stream_sample *sample,
                          axt_can_frame *frame) {
    const struct axt_contract_table_t table = {
        .counter = sample->counter,
        .position = sample->sample.position[AXT_ENCODER_TABLE],
        .status_word = sample->sample.status_word,
    };
    address(node, AXT_CONTRACT_TABLE_FRAME_ID, AXT_CONTRACT_TABLE_LENGTH, frame);
    (void)axt_contract_table_pack(frame->data, &table, sizeof frame->data);
}

void axt_node_frame_trace(const axt_node *node, uint32_t number, axt_can_frame *frame) {
    const axt_node_sample *sample = &node->config.trace[number / 2];
    const struct axt_contract_trace_t trace = {
        .channel = (uint8_t)(number % 2),
        .index = (uint16_t)(number / 2),
        .motor_position = sample->position[AXT_ENCODER_MOTOR],
        .torque = sample->torque,
        .table_position = sample->position[AXT_ENCODER_TABLE],
        .status_word = sample->status_word,
    };
    address(node, AXT_CONTRACT_TRACE_FRAME_ID, AXT_CONTRACT_TRACE_LENGTH, frame);
    (void)axt_contract_trace_pack(frame->data, &trace, sizeof frame->data);
}

void axt_node_frame_heartbeat(const axt_node *node, uint8_t state, axt_can_frame *frame) {
    const struct axt_contract_heartbeat_t heartbeat = {.state = state};
    address(node, AXT_CONTRACT_HEARTBEAT_FRAME_ID, AXT_CONTRACT_HEARTBEAT_LENGTH, frame);
    (void)axt_contract_heartbeat_pack(frame->data, &heartbeat, sizeof frame->data);
}

static uint32_t counter(const _Atomic uint32_t *value) {
    return atomic_load_explicit(value, memory_order_relaxed);
}

/* Pages 0 to 18: what the node is, and what it has counted. */
static void state_page(const axt_node *node, struct axt_contract_report_t *report) {
    const axt_node_config *config = &node->config;
    report->sequence = node->state_sequence;
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_CONTRACT_CHOICE:
        report->contract = AXT_CONTRACT_VERSION;
        break;
    case AXT_CONTRACT_REPORT_PAGE_FIRMWARE_CHOICE:
        report->firmware = AXT_NODE_FIRMWARE;
        break;
    case AXT_CONTRACT_REPORT_PAGE_CONTROL_PERIOD_CHOICE:
        report->control_period = (float)config->control_period;
        break;
    case AXT_CONTRACT_REPORT_PAGE_RATED_TORQUE_CHOICE:
        report->rated_torque = config->rated_torque;
        break;
    case AXT_CONTRACT_REPORT_PAGE_MOTOR_RESOLUTION_CHOICE:
        report->motor_resolution = config->counts_per_turn[AXT_ENCODER_MOTOR];
        break;
    case AXT_CONTRACT_REPORT_PAGE_TABLE_RESOLUTION_CHOICE:
        report->table_resolution = config->counts_per_turn[AXT_ENCODER_TABLE];
        break;
    case AXT_CONTRACT_REPORT_PAGE_STREAM_DECIMATION_CHOICE:
        report->stream_decimation = node->stream_decimation;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CAPACITY_CHOICE:
        report->trace_capacity = config->trace_size;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CAPTURED_CHOICE:
        report->flags = (uint8_t)node->trace_state;
        report->trace_captured = axt_node_captured(node);
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CHECKSUM_CHOICE:
        report->trace_checksum = axt_node_trace_complete(node) ? node->trace_checksum : 0;
        break;
    case AXT_CONTRACT_REPORT_PAGE_OVERRUNS_CHOICE:
        report->overruns = counter(&node->overruns);
        break;
    case AXT_CONTRACT_REPORT_PAGE_LOST_SAMPLES_CHOICE:
        report->lost_samples = counter(&node->lost);
        break;
    case AXT_CONTRACT_REPORT_PAGE_REJECTED_SAMPLES_CHOICE:
        report->rejected_samples = counter(&node->rejected);
        break;
    default:
        break;
    }
}

/* Pages 32 to 45: the estimate of the last snapshot. */
static void estimate_page(const axt_node *node, struct axt_contract_report_t *report) {
    const axt_estimate *found = &node->estimate;
    uint32_t needed = AXT_VALID_ALL; /* by the modal values */
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_I1_CHOICE:
        report->estimate_i1 = (float)found->axis.I1;
        needed = AXT_VALID_I1;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_I1_CHOICE:
        report->error_i1 = (float)found->axis_error.I1;
        needed = AXT_VALID_I1;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_I2_CHOICE:
        report->estimate_i2 = (float)found->axis.I2;
        needed = AXT_VALID_I2;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_I2_CHOICE:
        report->error_i2 = (float)found->axis_error.I2;
        needed = AXT_VALID_I2;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_B_CHOICE:
        report->estimate_b = (float)found->axis.B;
        needed = AXT_VALID_B;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_B_CHOICE:
        report->error_b = (float)found->axis_error.B;
        needed = AXT_VALID_B;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_K_CHOICE:
        report->estimate_k = (float)found->axis.K;
        needed = AXT_VALID_K;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_K_CHOICE:
        report->error_k = (float)found->axis_error.K;
        needed = AXT_VALID_K;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_WN_CHOICE:
        report->estimate_wn = (float)found->modal.wn;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_WN_CHOICE:
        report->error_wn = (float)found->modal_error.wn;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_WD_CHOICE:
        report->estimate_wd = (float)found->modal.wd;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_WD_CHOICE:
        report->error_wd = (float)found->modal_error.wd;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_ZETA_CHOICE:
        report->estimate_zeta = (float)found->modal.zeta;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_ZETA_CHOICE:
        report->error_zeta = (float)found->modal_error.zeta;
        break;
    default:
        break;
    }
    report->sequence = node->estimate_sequence;
    report->flags = ((found->valid & needed) == needed) ? 1 : 0;
}

void axt_node_frame_report(const axt_node *node, uint8_t page, axt_can_frame *frame) {
    struct axt_contract_report_t report = {.page = page};
    if ((AXT_NODE_PAGE(page) & AXT_NODE_PAGES_ESTIMATE) != 0) {
        estimate_page(node, &report);
    } else {
        state_page(node, &report);
    }
    address(node, AXT_CONTRACT_REPORT_FRAME_ID, AXT_CONTRACT_REPORT_LENGTH, frame);
    (void)axt_contract_report_pack(frame->data, &report, sizeof frame->data);
}

void axt_node_frame_answer(const axt_node *node, const axt_can_frame *command,
                           axt_node_result result, axt_can_frame *frame) {
    const struct axt_contract_report_t report = {
        .page = AXT_CONTRACT_REPORT_PAGE_ANSWER_CHOICE,
        .flags = command->data[0],
        .sequence = (uint16_t)result,
    };
    address(node, AXT_CONTRACT_REPORT_FRAME_ID, AXT_CONTRACT_REPORT_LENGTH, frame);
    (void)axt_contract_report_pack(frame->data, &report, sizeof frame->data);
    /* the argument goes back as it came, whatever its type */
    memcpy(frame->data + ARGUMENT, command->data + ARGUMENT, ARGUMENT_SIZE);
}
