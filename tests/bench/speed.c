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

/* One of everything that the catalogue has, all of a size that matters. */
static const axt_effects everything = {
    .friction = {{.coulomb = 0.01F,
                  .viscous = 1e-4F,
                  .asymmetry = 5e-5F,
                  .stribeck = 5e-3F,
                  .stribeck_speed = 2.0F,
                  .drift = 0.01F},
                 {.coulomb = 0.01F,
                  .viscous = 1e-4F,
                  .asymmetry = 5e-5F,
                  .stribeck = 5e-3F,
                  .stribeck_speed = 2.0F,
                  .drift = 0.01F}},
    .torque_offset = {0.01F, -0.01F},
    .disturbance = {{.amplitude = 0.01F, .frequency = 50.0F},
                    {.amplitude = 0.01F, .frequency = 90.0F}},
    .torque_ripple = {{.amplitude = 0.01F, .periods = 72.0F}},
    .backlash = 1e-3F,
    .stiffness_hardening = 1e5F,
    .stiffness_drift = 1e-3F,
    .load_change = {.ratio = 0.5F, .time = 3.0F},
    .extra_mode = {.frequency = 6000.0F, .damping_ratio = 0.02F, .mass_ratio = 0.2F},
    .torque_delay = 1e-4F,
    .torque_saturation = 1.0F,
    .lead_error = {{.amplitude = 1e-4F, .periods = 3.0F}},
    .encoder_eccentricity = {{.amplitude = 1e-4F}, {.amplitude = 1e-4F}},
    .encoder_delay = {1e-4F, 7e-5F},
    .quantisation = {65536.0F, 65536.0F},
};

/* The axis without effects or with every one of them, at 20 kHz, the encoders read after every
 * `decimation` steps. Returns as speed_plant(). */
int speed_machine(const float *torque, uint32_t length, uint32_t samples, int all,
                  uint32_t decimation) {
    static axt_machine machine;
    const axt_effects none = {0};
    axt_player player;
    if (axt_machine_init(&machine, &axt_axis_paper, 5e-5F, AXT_TORQUE_LINEAR,
                         all ? &everything : &none) != AXT_OK ||
        axt_player_init(&player, torque, length) != AXT_OK) {
        return -1;
    }
    for (uint32_t n = 0; n < samples; n++) {
        (void)axt_machine_step(&machine, axt_player_step(&player));
        if (n % decimation == 0) {
            axt_motion motion;
            axt_machine_measure(&machine, &motion);
        }
    }
    return (int)machine.rejected;
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
