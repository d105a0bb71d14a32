#include "axt_registers_node.h"

#include <string.h>

#include "axt_contract.h"
#include "axt_node_command.h"
#include "axt_node_shared.h"

enum { SURPLUS = 1 << 4 }; /* of EstimateValid: friction and spring are looked for */

static void show_identity(const axt_node *node, uint16_t *registers) {
    const axt_node_config *config = &node->config;
    registers[AXT_REGISTER_NODE_ID] = config->id;
    axt_registers_put_uint32(registers, AXT_REGISTER_FIRMWARE, AXT_NODE_FIRMWARE);
    axt_registers_put_float(registers, AXT_REGISTER_CONTROL_PERIOD, (float)config->control_period);
    axt_registers_put_uint32(registers, AXT_REGISTER_RATED_TORQUE, config->rated_torque);
    axt_registers_put_uint32(registers, AXT_REGISTER_MOTOR_RESOLUTION,
                             config->counts_per_turn[AXT_ENCODER_MOTOR]);
    axt_registers_put_uint32(registers, AXT_REGISTER_TABLE_RESOLUTION,
                             config->counts_per_turn[AXT_ENCODER_TABLE]);
}

static void show_counters(const axt_node *node, uint16_t *registers) {
    const axt_can_health *health = &node->port.can->health;
    const struct {
        uint16_t address;
        uint32_t count;
    } counters[] = {
        {AXT_REGISTER_OVERRUNS, axt_node_other(&node->overruns)},
        {AXT_REGISTER_LOST_SAMPLES, axt_node_other(&node->lost)},
        {AXT_REGISTER_REJECTED_SAMPLES, axt_node_other(&node->rejected)},
        {AXT_REGISTER_LIMITED_SAMPLES, axt_node_other(&node->limited)},
        {AXT_REGISTER_FAULTS, axt_node_other(&node->faults)},
        {AXT_REGISTER_REFUSED_COMMANDS, node->refused},
        {AXT_REGISTER_LOST_FRAMES, health->overflows},
        {AXT_REGISTER_BUS_ERRORS, health->error_frames},
        {AXT_REGISTER_BUS_OFFS, health->bus_off},
        {AXT_REGISTER_BUS_OUTAGES, health->outages},
        {AXT_REGISTER_NOT_FINITE_SAMPLES, node->ident_counters.not_finite},
        {AXT_REGISTER_OUT_OF_RANGE_SAMPLES, node->ident_counters.range},
        {AXT_REGISTER_JUMPED_SAMPLES, node->ident_counters.jumped},
        {AXT_REGISTER_REPEATED_SAMPLES, node->ident_counters.repeated},
        {AXT_REGISTER_SAMPLE_GAPS, node->ident_counters.gaps},
    };
    for (uint32_t i = 0; i < sizeof counters / sizeof counters[0]; i++) {
        axt_registers_put_uint32(registers, counters[i].address, counters[i].count);
    }
}

static void show_drive(const axt_node *node, uint16_t *registers) {
    const uint32_t status = axt_node_other(&node->status);
    registers[AXT_REGISTER_STATUS_WORD] = axt_node_status_word(status);
    registers[AXT_REGISTER_ERROR_CODE] = axt_node_error_code(status);
    registers[AXT_REGISTER_TORQUE_LIMIT] = node->limits.torque;
    axt_registers_put_uint32(registers, AXT_REGISTER_SPEED_LIMIT, node->limits.speed);
    axt_registers_put_int32(registers, AXT_REGISTER_TRAVEL_MIN, node->limits.travel_min);
    axt_registers_put_int32(registers, AXT_REGISTER_TRAVEL_MAX, node->limits.travel_max);
    registers[AXT_REGISTER_HOST_TIMEOUT] = node->host_timeout;
}

static void show_axis(uint16_t *registers, uint32_t first, const axt_axis *axis,
                      const axt_modal *modal) {
    const axt_real values[] = {axis->I1,  axis->I2,  axis->B,    axis->K,
                               modal->wn, modal->wd, modal->zeta};
    for (uint32_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        axt_registers_put_float(registers, first + 2 * i, (float)values[i]);
    }
}

static void show_estimate(const axt_node *node, uint16_t *registers) {
    const axt_estimate *found = &node->estimate;
    const bool looked_for = node->config.form == AXT_IDENT_5X4 && found->samples > 0;
    const uint32_t surplus = looked_for ? SURPLUS : 0;
    registers[AXT_REGISTER_ESTIMATE_SEQUENCE] = node->estimate_sequence;
    registers[AXT_REGISTER_ESTIMATE_VALID] = (uint16_t)(found->valid | surplus);
    axt_registers_put_uint32(registers, AXT_REGISTER_ESTIMATE_SAMPLES, found->samples);
    show_axis(registers, AXT_REGISTER_ESTIMATE_I1, &found->axis, &found->modal);
    show_axis(registers, AXT_REGISTER_ERROR_I1, &found->axis_error, &found->modal_error);
    axt_registers_put_float(registers, AXT_REGISTER_ESTIMATE_FRICTION,
                            (float)found->friction.value);
    axt_registers_put_float(registers, AXT_REGISTER_ERROR_FRICTION, (float)found->friction.error);
    axt_registers_put_float(registers, AXT_REGISTER_ESTIMATE_SPRING, (float)found->spring.value);
    axt_registers_put_float(registers, AXT_REGISTER_ERROR_SPRING, (float)found->spring.error);
}

static void show_drift(const axt_node *node, uint16_t *registers) {
    const uint32_t drift = axt_node_other(&node->drift);
    registers[AXT_REGISTER_DRIFT] = (uint16_t)drift; /* state and reasons, as the tick has them */
    registers[AXT_REGISTER_DRIFT_ALARMS] = (uint16_t)(drift >> 16);
}

/* Mean speed [rad/s] of an encoder between two samples; its counts may wrap around. */
static float speed(const axt_node *node, const axt_history_sample *samples, uint32_t encoder) {
    const int32_t counts =
        (int32_t)((uint32_t)samples[1].position[encoder] - (uint32_t)samples[0].position[encoder]);
    const axt_real turns = (axt_real)counts / (axt_real)node->config.counts_per_turn[encoder];
    const axt_real time = (axt_real)(samples[1].n - samples[0].n) * node->config.control_period;
    return (float)(turns * (axt_real)6.28318530717958648 / time);
}

/* The newest sample, and the speed between it and the one before. */
static void show_sample(const axt_node *node, uint16_t *registers) {
    axt_history_sample samples[2];
    const uint32_t count = axt_history_newest(&node->history, samples, 2);
    if (count == 0) {
        return;
    }
    const axt_history_sample *newest = &samples[count - 1];
    axt_registers_put_uint32(registers, AXT_REGISTER_SAMPLE_COUNTER, newest->n);
    axt_registers_put_int32(registers, AXT_REGISTER_MOTOR_POSITION,
                            newest->position[AXT_ENCODER_MOTOR]);
    axt_registers_put_int32(registers, AXT_REGISTER_TABLE_POSITION,
                            newest->position[AXT_ENCODER_TABLE]);
    registers[AXT_REGISTER_TORQUE] = (uint16_t)newest->torque;
    if (count > 1) {
        axt_registers_put_float(registers, AXT_REGISTER_MOTOR_SPEED,
                                speed(node, samples, AXT_ENCODER_MOTOR));
        axt_registers_put_float(registers, AXT_REGISTER_TABLE_SPEED,
                                speed(node, samples, AXT_ENCODER_TABLE));
    }
}

static void snapshot(void *context, uint16_t registers[AXT_REGISTER_END]) {
    axt_registers_node *view = context;
    memcpy(registers, axt_register_constants, sizeof axt_register_constants);
    show_identity(view->node, registers);
    show_sample(view->node, registers);
    show_counters(view->node, registers);
    show_drive(view->node, registers);
    show_estimate(view->node, registers);
    show_drift(view->node, registers);
    view->sequence++;
    registers[AXT_REGISTER_SEQUENCE] = view->sequence;
    registers[AXT_REGISTER_SEQUENCE_END] = view->sequence;
}

static void hear_host(void *context) {
    axt_node_hear_host(((axt_registers_node *)context)->node);
}

static axt_node_result set_history(axt_node *node, uint32_t decimation) {
    if (decimation < 1) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    axt_history_set_decimation(&node->history, decimation);
    return AXT_NODE_DONE;
}

/* A command of the CAN contract, as the frame that would have brought it. */
static axt_node_result execute(axt_node *node, uint32_t code, uint32_t argument) {
    axt_can_frame frame = {.id = AXT_CONTRACT_COMMAND_FRAME_ID + node->config.id,
                           .length = AXT_CONTRACT_COMMAND_LENGTH};
    if (code > UINT8_MAX) {
        return AXT_NODE_UNKNOWN_COMMAND;
    }
    frame.data[0] = (uint8_t)code;
    for (uint32_t i = 0; i < 4; i++) {
        frame.data[4 + i] = (uint8_t)(argument >> (8 * i));
    }
    return axt_node_execute(node, &frame);
}

/* Any of them. Whether a control word was followed is for the status word to say, as on CAN. */
static axt_node_result carry_out(axt_node *node, uint32_t code, uint32_t argument) {
    switch (code) {
    case AXT_REGISTERS_CONTROL:
        axt_node_order_control(node, (uint16_t)(argument >> 16), (int16_t)(uint16_t)argument);
        return AXT_NODE_DONE;
    case AXT_REGISTERS_HISTORY_COMMAND:
        return set_history(node, argument);
    default:
        return execute(node, code, argument);
    }
}

static axt_modbus_exception command(void *context, uint32_t code, uint32_t argument,
                                    uint16_t *result) {
    axt_node *node = ((axt_registers_node *)context)->node;
    if (node->control_ordered || !axt_node_can_order(node)) {
        *result = AXT_REGISTERS_NOT_NOW;
        return AXT_MODBUS_BUSY;
    }
    const axt_node_result done = carry_out(node, code, argument);
    node->refused += (done == AXT_NODE_DONE) ? 0 : 1;
    *result = (uint16_t)done;
    switch (done) {
    case AXT_NODE_DONE:
        return AXT_MODBUS_OK;
    case AXT_NODE_UNKNOWN_COMMAND:
    case AXT_NODE_OUT_OF_RANGE:
        return AXT_MODBUS_ILLEGAL_VALUE;
    default:
        return AXT_MODBUS_REFUSED;
    }
}

axt_registers_port axt_registers_node_port(axt_registers_node *view, axt_node *node) {
    *view = (axt_registers_node){.node = node};
    return (axt_registers_port){.history = &node->history,
                                .context = view,
                                .snapshot = snapshot,
                                .hear_host = hear_host,
                                .command = command};
}
