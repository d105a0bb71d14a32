#include "axt_emulated_axis.h"

#include <stddef.h>

#include "axt_catalogue.h"
#include "axt_contract.h"

axt_status axt_emulated_axis_init(axt_emulated_axis *emulated, const axt_axis *axis,
                                  axt_real time_step, const uint32_t counts_per_turn[2]) {
    axt_emulated_axis fresh = {.counts_per_turn = {counts_per_turn[0], counts_per_turn[1]},
                               .next_axis = *axis};
    for (uint32_t i = 0; i < 2; i++) {
        if (counts_per_turn[i] < 1 || counts_per_turn[i] > AXT_ENCODER_COUNTS_MAX) {
            return AXT_ERROR_RANGE;
        }
    }
    const axt_effects none = {0};
    const axt_status status =
        axt_machine_init(&fresh.machine, axis, time_step, AXT_TORQUE_LINEAR, &none);
    if (status == AXT_OK) {
        *emulated = fresh;
    }
    return status;
}

axt_status axt_emulated_axis_set_effects(axt_emulated_axis *emulated, const axt_effects *effects) {
    const axt_axis axis = emulated->machine.axis;
    const axt_status status = axt_machine_init(
        &emulated->machine, &axis, emulated->machine.time_step, AXT_TORQUE_LINEAR, effects);
    if (status == AXT_OK) {
        emulated->next_effects = *effects;
    }
    return status;
}

/* Bits 0 to 7 parameter, 8 to 15 instance. */
static axt_node_result select_parameter(axt_emulated_axis *emulated, uint32_t selected) {
    const axt_catalogue_entry *entry = axt_catalogue(selected & UINT8_MAX);
    if (entry == NULL || selected >> 8 >= entry->instances) {
        return AXT_NODE_OUT_OF_RANGE;
    }
    emulated->selected = selected;
    return AXT_NODE_DONE;
}

/* Whether the value is one of this parameter depends on the others: see check_next(). */
static axt_node_result set_parameter(axt_emulated_axis *emulated, float value) {
    const uint32_t selected = emulated->selected; /* the catalogue has it */
    (void)axt_catalogue_set(axt_catalogue(selected & UINT8_MAX), selected >> 8, (axt_real)value,
                            &emulated->next_effects);
    return AXT_NODE_DONE;
}

/* What axt_machine_init() asks for, without a machine to spare. */
static axt_node_result check_next(const axt_emulated_axis *emulated) {
    axt_plant plant;
    const axt_real time_step = emulated->machine.time_step;
    const bool fine = axt_plant_init(&plant, &emulated->next_axis, time_step,
                                     &axt_newmark_trapezoidal) == AXT_OK &&
                      axt_effects_check(&emulated->next_effects, time_step) == AXT_OK;
    return fine ? AXT_NODE_DONE : AXT_NODE_OUT_OF_RANGE;
}

axt_node_result axt_emulated_axis_command(void *axis,
                                          const struct axt_contract_command_t *command) {
    static const axt_effects none = {0};
    axt_emulated_axis *emulated = axis;
    axt_axis *next = &emulated->next_axis;
    switch (command->code) {
    case AXT_CONTRACT_COMMAND_CODE_EFFECT_SELECT_CHOICE:
        return select_parameter(emulated, command->effect_select);
    case AXT_CONTRACT_COMMAND_CODE_EFFECT_VALUE_CHOICE:
        return set_parameter(emulated, command->effect_value);
    case AXT_CONTRACT_COMMAND_CODE_EFFECTS_CLEAR_CHOICE:
        emulated->next_effects = none;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_AXIS_I1_CHOICE:
        next->I1 = (axt_real)command->axis_i1;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_AXIS_I2_CHOICE:
        next->I2 = (axt_real)command->axis_i2;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_AXIS_B_CHOICE:
        next->B = (axt_real)command->axis_b;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_AXIS_K_CHOICE:
        next->K = (axt_real)command->axis_k;
        return AXT_NODE_DONE;
    case AXT_CONTRACT_COMMAND_CODE_AXIS_RESTART_CHOICE:
        return check_next(emulated);
    default:
        return AXT_NODE_UNKNOWN_COMMAND;
    }
}

void axt_emulated_axis_restart(void *axis) {
    axt_emulated_axis *emulated = axis;
    (void)axt_machine_init(&emulated->machine, &emulated->next_axis, emulated->machine.time_step,
                           AXT_TORQUE_LINEAR, &emulated->next_effects);
}

void axt_emulated_axis_apply_torque(void *axis, axt_real torque) {
    axt_emulated_axis *emulated = axis;
    (void)axt_machine_step(&emulated->machine, torque); /* a refused sample is counted there */
}

void axt_emulated_axis_read_encoders(void *axis, int32_t position[2]) {
    const axt_emulated_axis *emulated = axis;
    axt_motion motion;
    axt_machine_measure(&emulated->machine, &motion);
    (void)axt_encoder_read(emulated->counts_per_turn[0], &motion, AXT_ENCODER_MOTOR, &position[0]);
    (void)axt_encoder_read(emulated->counts_per_turn[1], &motion, AXT_ENCODER_TABLE, &position[1]);
}
