#include "axt_emulated_axis.h"

axt_status axt_emulated_axis_init(axt_emulated_axis *emulated, const axt_axis *axis,
                                  axt_real time_step, const uint32_t counts_per_turn[2]) {
    axt_emulated_axis fresh = {.counts_per_turn = {counts_per_turn[0], counts_per_turn[1]}};
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
    return axt_machine_init(&emulated->machine, &axis, emulated->machine.time_step,
                            AXT_TORQUE_LINEAR, effects);
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
