#include "axt_loops.h"

axt_status axt_loop_simulate(const axt_axis *axis, axt_real time_step, const axt_newmark *newmark,
                             const axt_motion *start, const axt_real *torque, size_t n,
                             axt_motion *motion, size_t *done) {
    axt_plant plant;
    *done = 0;
    axt_status status = axt_plant_init(&plant, axis, time_step, newmark);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status =
            (i == 0) ? axt_plant_set(&plant, start, torque[0]) : axt_plant_step(&plant, torque[i]);
        if (status == AXT_OK) {
            axt_plant_read(&plant, &motion[i]);
            *done = i + 1;
        }
    }
    return status;
}

/* From one sample of the torque to the next in equal steps. */
static axt_status step_between(axt_machine *machine, axt_torque_course course, uint32_t substeps,
                               axt_real from, axt_real to) {
    const axt_real rise = (to - from) / (axt_real)substeps;
    axt_status status = AXT_OK;
    for (uint32_t i = 1; i < substeps && status == AXT_OK; i++) {
        const bool held = course == AXT_TORQUE_HELD;
        status = axt_machine_step(machine, held ? from : from + (axt_real)i * rise);
    }
    return (status == AXT_OK) ? axt_machine_step(machine, to) : status;
}

axt_status axt_loop_simulate_effects(const axt_axis *axis, axt_real time_step,
                                     axt_torque_course course, const axt_effects *effects,
                                     uint32_t substeps, const axt_motion *start,
                                     const axt_real *torque, size_t n, axt_motion *motion,
                                     size_t *done) {
    axt_machine machine;
    *done = 0;
    axt_status status =
        axt_machine_init(&machine, axis, time_step / (axt_real)substeps, course, effects);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status = (i == 0) ? axt_machine_set(&machine, start, torque[0])
                          : step_between(&machine, course, substeps, torque[i - 1], torque[i]);
        if (status == AXT_OK) {
            axt_machine_measure(&machine, &motion[i]);
            *done = i + 1;
        }
    }
    return status;
}

axt_status axt_loop_integrate(axt_method method, const axt_axis *axis, axt_real time_step,
                              const axt_motion *start, const axt_real *torque, size_t n,
                              axt_motion *motion, size_t *done) {
    axt_integrator integrator;
    *done = 0;
    axt_status status = axt_integrator_init(&integrator, method, axis, time_step);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status = (i == 0) ? axt_integrator_set(&integrator, start, torque[0])
                          : axt_integrator_step(&integrator, torque[i]);
        if (status == AXT_OK) {
            axt_integrator_read(&integrator, &motion[i]);
            *done = i + 1;
        }
    }
    return status;
}

axt_status axt_loop_read_encoder(uint32_t counts_per_turn, axt_encoder_place place,
                                 const axt_motion *motion, size_t n, int32_t *counts,
                                 size_t *done) {
    axt_status status = AXT_OK;
    *done = 0;
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status = axt_encoder_read(counts_per_turn, &motion[i], place, &counts[i]);
        *done += (status == AXT_OK);
    }
    return status;
}

static bool due(size_t i, size_t n, size_t every) {
    return (i + 1) % every == 0 || i + 1 == n;
}

static uint32_t refused(const axt_ident_counters *counters) {
    return counters->not_finite + counters->range + counters->repeated + counters->jumped;
}

axt_status axt_loop_ident_motion(const axt_ident_config *config, const axt_motion *motion,
                                 const axt_real *torque, const uint8_t *gap, size_t n, size_t every,
                                 axt_estimate *estimates, uint32_t *rejected) {
    axt_ident ident;
    const axt_status status = axt_ident_init(&ident, config);
    if (status != AXT_OK) {
        return status;
    }
    uint32_t number = 0;
    for (size_t i = 0; i < n; i++) {
        number += 1U + gap[i];
        (void)axt_ident_motion(&ident, number, &motion[i],
                               torque[i]); /* what it refuses, it counts */
        if (due(i, n, every)) {
            (void)axt_ident_result(&ident, estimates++); /* no answer yet: zeros, not valid */
        }
    }
    *rejected = refused(&ident.counters);
    return AXT_OK;
}

axt_status axt_loop_ident_counts(const axt_ident_config *config, const int32_t *motor,
                                 const int32_t *table, const axt_real *torque, const uint8_t *gap,
                                 size_t n, size_t every, axt_estimate *estimates,
                                 uint32_t *rejected) {
    axt_ident ident;
    const axt_status status = axt_ident_init(&ident, config);
    if (status != AXT_OK) {
        return status;
    }
    uint32_t number = 0;
    for (size_t i = 0; i < n; i++) {
        number += 1U + gap[i];
        (void)axt_ident_counts(&ident, number, motor[i], table[i],
                               torque[i]); /* what it refuses, it counts */
        if (due(i, n, every)) {
            (void)axt_ident_result(&ident, estimates++);
        }
    }
    *rejected = refused(&ident.counters);
    return AXT_OK;
}
