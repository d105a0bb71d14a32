#include "axt_node_frames.h"

#include <string.h>

#include "axt_node_shared.h"

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

void axt_node_frame_samples(const axt_node *node, uint32_t tail, axt_can_frame *frame) {
    const uint32_t mask = node->config.ring_size - 1;
    const axt_node_stream_sample *ring = node->config.ring;
    struct axt_contract_samples_t samples = {.counter = ring[tail & mask].counter};
#define PUT(i)                                                                                     \
    do {                                                                                           \
        const axt_node_sample *sample = &ring[(tail + (i)) & mask].sample;                         \
        samples.motor_position##i = sample->position[AXT_ENCODER_MOTOR];                           \
        samples.table_position##i = sample->position[AXT_ENCODER_TABLE];                           \
        samples.torque##i = sample->torque;                                                        \
        samples.status_word =                                                                      \
            (uint16_t)(sample->status_word | (samples.status_word & AXT_NODE_LIMITED));            \
    } while (0)
    PUT(0);
    PUT(1);
    PUT(2);
    PUT(3);
    PUT(4);
    PUT(5);
#undef PUT
    address(node, AXT_CONTRACT_SAMPLES_FRAME_ID, AXT_CONTRACT_SAMPLES_LENGTH, frame);
    frame->fd = true;
    (void)axt_contract_samples_pack(frame->data, &samples, sizeof frame->data);
}

void axt_node_frame_trace(const axt_node *node, uint32_t number, axt_can_frame *frame) {
    const axt_node_sample *sample = axt_trace_sample(&node->trace, number / 2);
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

/* CiA 301 0x1001. */
static uint8_t error_register(uint16_t error_code) {
    enum { GENERIC = 0x01, COMMUNICATION = 0x10, PROFILE = 0x20 };
    if (error_code == 0) {
        return 0;
    }
    return (uint8_t)(GENERIC | ((error_code >> 8 == 0x81) ? COMMUNICATION : PROFILE));
}

void axt_node_frame_emergency(const axt_node *node, uint16_t error_code, int32_t cause,
                              axt_can_frame *frame) {
    const struct axt_contract_emergency_t emergency = {
        .error_code = error_code,
        .error_register = error_register(axt_node_error_code(axt_node_other(&node->status))),
        .cause = cause,
    };
    address(node, AXT_CONTRACT_EMERGENCY_FRAME_ID, AXT_CONTRACT_EMERGENCY_LENGTH, frame);
    (void)axt_contract_emergency_pack(frame->data, &emergency, sizeof frame->data);
}

/* Pages 8 to 12. */
static void trace_page(const axt_node *node, struct axt_contract_report_t *report) {
    const bool complete = axt_node_trace_complete(node);
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CAPTURED_CHOICE:
        report->flags = (uint8_t)node->trace_state;
        report->trace_captured = axt_node_captured(node);
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CHECKSUM_CHOICE:
        report->trace_checksum = complete ? node->trace_checksum : 0;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_TRIGGERED_CHOICE:
        report->trace_triggered = complete ? node->trace.before : 0;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_DECIMATION_CHOICE:
        report->trace_decimation = node->trace_settings.decimation;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_START_CHOICE:
        report->trace_start = complete ? node->trace.start : 0;
        break;
    default:
        break;
    }
}

/* Pages 14 to 31: how it stands, and what has been counted. */
static void counter_page(const axt_node *node, struct axt_contract_report_t *report) {
    const axt_can_health *health = &node->port.can->health;
    const uint32_t status = axt_node_other(&node->status);
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_STATUS_CHOICE:
        report->status = axt_node_status_word(status);
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_CHOICE:
        report->error = axt_node_error_code(status);
        report->flags = error_register(report->error);
        break;
    case AXT_CONTRACT_REPORT_PAGE_OVERRUNS_CHOICE:
        report->overruns = axt_node_other(&node->overruns);
        break;
    case AXT_CONTRACT_REPORT_PAGE_LOST_SAMPLES_CHOICE:
        report->lost_samples = axt_node_other(&node->lost);
        break;
    case AXT_CONTRACT_REPORT_PAGE_REJECTED_SAMPLES_CHOICE:
        report->rejected_samples = axt_node_other(&node->rejected);
        break;
    case AXT_CONTRACT_REPORT_PAGE_PERIODS_CHOICE:
        report->periods = axt_node_other(&node->now);
        break;
    case AXT_CONTRACT_REPORT_PAGE_NOT_FINITE_SAMPLES_CHOICE:
        report->not_finite_samples = node->ident_counters.not_finite;
        break;
    case AXT_CONTRACT_REPORT_PAGE_OUT_OF_RANGE_SAMPLES_CHOICE:
        report->out_of_range_samples = node->ident_counters.range;
        break;
    case AXT_CONTRACT_REPORT_PAGE_JUMPED_SAMPLES_CHOICE:
        report->jumped_samples = node->ident_counters.jumped;
        break;
    case AXT_CONTRACT_REPORT_PAGE_REPEATED_SAMPLES_CHOICE:
        report->repeated_samples = node->ident_counters.repeated;
        break;
    case AXT_CONTRACT_REPORT_PAGE_SAMPLE_GAPS_CHOICE:
        report->sample_gaps = node->ident_counters.gaps;
        break;
    case AXT_CONTRACT_REPORT_PAGE_LIMITED_SAMPLES_CHOICE:
        report->limited_samples = axt_node_other(&node->limited);
        break;
    case AXT_CONTRACT_REPORT_PAGE_FAULTS_CHOICE:
        report->faults = axt_node_other(&node->faults);
        break;
    case AXT_CONTRACT_REPORT_PAGE_REFUSED_COMMANDS_CHOICE:
        report->refused_commands = node->refused;
        break;
    case AXT_CONTRACT_REPORT_PAGE_LOST_FRAMES_CHOICE:
        report->lost_frames = health->overflows;
        break;
    case AXT_CONTRACT_REPORT_PAGE_BUS_ERRORS_CHOICE:
        report->bus_errors = health->error_frames;
        break;
    case AXT_CONTRACT_REPORT_PAGE_BUS_OFFS_CHOICE:
        report->bus_offs = health->bus_off;
        break;
    case AXT_CONTRACT_REPORT_PAGE_BUS_OUTAGES_CHOICE:
        report->bus_outages = health->outages;
        break;
    default:
        break;
    }
}

/* Pages 56 to 60. */
static void limits_page(const axt_node *node, struct axt_contract_report_t *report) {
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_TORQUE_LIMIT_CHOICE:
        report->torque_limit = node->limits.torque;
        break;
    case AXT_CONTRACT_REPORT_PAGE_SPEED_LIMIT_CHOICE:
        report->speed_limit = node->limits.speed;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRAVEL_MIN_CHOICE:
        report->travel_min = node->limits.travel_min;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRAVEL_MAX_CHOICE:
        report->travel_max = node->limits.travel_max;
        break;
    case AXT_CONTRACT_REPORT_PAGE_HOST_HEARTBEAT_CHOICE:
        report->host_heartbeat = (uint32_t)node->host_id << 16 | node->host_timeout;
        break;
    default:
        break;
    }
}

/* Pages 0 to 7 and 13: what the node is. */
static void identity_page(const axt_node *node, struct axt_contract_report_t *report) {
    const axt_node_config *config = &node->config;
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
    case AXT_CONTRACT_REPORT_PAGE_FEATURES_CHOICE:
        report->features = node->port.can->fd ? 1 : 0;
        break;
    default:
        break;
    }
}

/* Pages 50 and 51. */
static void drift_page(const axt_node *node, struct axt_contract_report_t *report) {
    const uint32_t drift = axt_node_other(&node->drift);
    report->sequence = node->estimate_sequence;
    if (report->page == AXT_CONTRACT_REPORT_PAGE_DRIFT_CHOICE) {
        report->flags = (uint8_t)(drift & 0xFF);
        report->drift = drift >> 8 & 0xFF;
    } else {
        report->drift_alarms = drift >> 16;
    }
}

/* Pages 46 to 49: what the ideal axis has not. */
static void surplus_page(const axt_node *node, struct axt_contract_report_t *report) {
    const axt_estimate *found = &node->estimate;
    switch (report->page) {
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_FRICTION_CHOICE:
        report->estimate_friction = (float)found->friction.value;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_FRICTION_CHOICE:
        report->error_friction = (float)found->friction.error;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ESTIMATE_SPRING_CHOICE:
        report->estimate_spring = (float)found->spring.value;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ERROR_SPRING_CHOICE:
        report->error_spring = (float)found->spring.error;
        break;
    default:
        break;
    }
    const bool looked_for = node->config.form == AXT_IDENT_5X4 && found->samples > 0;
    report->sequence = node->estimate_sequence;
    report->flags = looked_for ? 1 : 0;
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
    const uint64_t set = AXT_NODE_PAGE(page);
    struct axt_contract_report_t report = {.page = page, .sequence = node->state_sequence};
    if ((set & AXT_NODE_PAGES_DRIFT) != 0) {
        drift_page(node, &report);
    } else if ((set & AXT_NODE_PAGES_SURPLUS) != 0) {
        surplus_page(node, &report);
    } else if ((set & AXT_NODE_PAGES_ESTIMATE) != 0) {
        estimate_page(node, &report);
    } else if ((set & AXT_NODE_PAGES_TRACE) != 0) {
        trace_page(node, &report);
    } else if ((set & AXT_NODE_PAGES_COUNTERS) != 0) {
        counter_page(node, &report);
    } else if ((set & AXT_NODE_PAGES_LIMITS) != 0) {
        limits_page(node, &report);
    } else {
        identity_page(node, &report);
    }
    address(node, AXT_CONTRACT_REPORT_FRAME_ID, AXT_CONTRACT_REPORT_LENGTH, frame);
    (void)axt_contract_report_pack(frame->data, &report, sizeof frame->data);
}

void axt_node_frame_refusal(const axt_node *node, uint32_t control, axt_node_result result,
                            axt_can_frame *frame) {
    const struct axt_contract_report_t report = {
        .page = AXT_CONTRACT_REPORT_PAGE_CONTROL_REFUSED_CHOICE,
        .sequence = (uint16_t)result,
        .control_refused = control,
    };
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
