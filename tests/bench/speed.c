/* The core in loops of its own, to be timed by speed.py: loaded into its process, so that both
 * sides of a comparison run in the same one. */
#include <stddef.h>

#include "drive.h"

/* Feeds samples of phi[inputs] and y[outputs], one after the other, to an estimator that starts
 * anew; theta[outputs][inputs] is its answer. Returns the number of samples refused, or -1. */
int speed_rls(uint32_t inputs, uint32_t outputs, float forgetting, const float *phi, const float *y,
              uint32_t samples, float *theta) {
    axt_rls rls;
    if (axt_rls_init(&rls, inputs, outputs, forgetting, 1e6F) != AXT_OK) {
        return -1;
    }
    for (uint32_t n = 0; n < samples; n++) {
        (void)axt_rls_update(&rls, &phi[(size_t)n * inputs], &y[(size_t)n * outputs]);
    }
    for (uint32_t row = 0; row < outputs; row++) {
        for (uint32_t i = 0; i < inputs; i++) {
            theta[(size_t)row * inputs + i] = rls.theta[row][i];
        }
    }
    return (int)rls.rejected;
}

/* The plant alone. Returns the number of samples refused, or -1. */
int speed_plant(const float *torque, uint32_t length, uint32_t samples) {
    axt_plant plant;
    axt_player player;
    if (axt_plant_init(&plant, &axt_axis_paper, drive_time_step(), &axt_newmark_trapezoidal) !=
            AXT_OK ||
        axt_player_init(&player, torque, length) != AXT_OK) {
        return -1;
    }
    for (uint32_t n = 0; n < samples; n++) {
        (void)axt_plant_step(&plant, axt_player_step(&player));
    }
    return (int)plant.rejected;
}

/* The control interrupt. `torque` has DRIVE_PERIOD samples. Returns as speed_plant(). */
int speed_tick(const float *torque, uint32_t samples) {
    drive d;
    if (drive_init(&d, torque, 200.0F) != AXT_OK) {
        return -1;
    }
    for (uint32_t n = 0; n < samples; n++) {
        drive_control_tick(&d);
    }
    return (int)d.faults;
}
