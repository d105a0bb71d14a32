/* An axis that is computed in the place of one that turns: the paper's Table 1, ideal, at 10 kHz.
 */
#include "axt_emulated_axis.h"
#include "axt_hardware.h"

static const axt_hardware_traits traits = {
    .control_period = (axt_real)1e-4,
    .rated_torque = 640,
    .counts_per_turn = {1048576, 1048576},
    .hold = AXT_HOLD_LINEAR, /* Newmark's method takes the torque in straight lines */
    .expected = {(axt_real)5e-5, (axt_real)5e-6, (axt_real)1e-3, (axt_real)200.0},
};

static axt_emulated_axis emulated;

static axt_status start(void *axis) {
    return axt_emulated_axis_init(axis, &axt_axis_paper, traits.control_period,
                                  traits.counts_per_turn);
}

/* The axis moves only when it is computed, and the firmware that would do so has stopped. */
static void shut_off(void *axis) {
    (void)axis;
}

const axt_hardware axt_hardware_here = {
    .traits = &traits,
    .axis = &emulated,
    .start = start,
    .apply_torque = axt_emulated_axis_apply_torque,
    .read_encoders = axt_emulated_axis_read_encoders,
    .shut_off = shut_off,
    .axis_command = axt_emulated_axis_command,
    .restart_axis = axt_emulated_axis_restart,
};
