#include "axt_torque.h"

#include "axt_math.h"

axt_status axt_torque_init(axt_torque *torque, const axt_axis *axis, axt_real time_step) {
    const axt_status status = axt_axis_check(axis);
    if (status != AXT_OK) {
        return status;
    }
    if (!(time_step >= AXT_R(1e-7) && time_step <= AXT_R(1))) {
        return AXT_ERROR_RANGE;
    }
    *torque = (axt_torque){.inertia_rate = axis->I1 / time_step,
                           .half_damping = AXT_R(0.5) * axis->B,
                           .half_stiffness = AXT_R(0.5) * axis->K};
    return AXT_OK;
}

axt_status axt_torque_step(axt_torque *torque, const axt_motion *motion, axt_real *mean) {
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed)) {
        torque->started = false;
        return AXT_ERROR_NOT_FINITE;
    }
    const bool started = torque->started;
    if (started) {
        *mean = torque->inertia_rate * (motion->speed - torque->speed) +
                torque->half_damping * (motion->twist_speed + torque->twist_speed) +
                torque->half_stiffness * (motion->twist + torque->twist);
    }
    torque->twist = motion->twist;
    torque->twist_speed = motion->twist_speed;
    torque->speed = motion->speed;
    torque->started = true;
    return started ? AXT_OK : AXT_ERROR_NO_DATA;
}
