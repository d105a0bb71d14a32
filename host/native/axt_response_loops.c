#include "axt_response_loops.h"

#include <math.h>

#include "axt_math.h"

axt_status axt_loop_respond(axt_real damping, axt_real stiffness, axt_real time_step,
                            const axt_real *first, const axt_real *last, const axt_real *start,
                            size_t windows, size_t length, axt_real *position, axt_real *speed) {
    axt_exact_map map;
    const axt_status status = axt_exact_map_init(&map, damping, stiffness, time_step);
    for (size_t w = 0; w < windows && status == AXT_OK; w++) {
        axt_real x = start[2 * w];
        axt_real v = start[2 * w + 1];
        for (size_t i = w * length; i < (w + 1) * length; i++) {
            position[i] = x;
            speed[i] = v;
            const axt_real ramp = last[i] - first[i];
            const axt_real moved =
                map.a[0][0] * x + map.a[0][1] * v + map.held[0] * first[i] + map.ramp[0] * ramp;
            v += map.a[1][0] * x + map.a[1][1] * v + map.held[1] * first[i] + map.ramp[1] * ramp;
            x += moved;
        }
    }
    return status;
}

/* By how much what drifts at this rate has grown: never below nothing. */
static axt_real grown(axt_real *rate, axt_real time) {
    const axt_real factor = AXT_R(1) + *rate * time;
    *rate = (factor > AXT_R(0)) ? *rate / factor : AXT_R(0);
    return (factor > AXT_R(0)) ? factor : AXT_R(0);
}

/* The same axis for a machine that starts `time` later. */
static void start_later(axt_axis *axis, axt_effects *effects, axt_real time) {
    axis->K *= grown(&effects->stiffness_drift, time);
    for (size_t i = 0; i < 2; i++) {
        axt_friction *friction = &effects->friction[i];
        const axt_real factor = grown(&friction->drift, time);
        friction->coulomb *= factor;
        friction->viscous *= factor;
        friction->stribeck *= factor;
        friction->asymmetry *= factor;
        axt_disturbance *disturbance = &effects->disturbance[i];
        const axt_real phase = disturbance->phase + disturbance->frequency * time;
        disturbance->phase = (axt_real)remainder((double)phase, (double)AXT_TWO_PI);
    }
    if (effects->load_change.time > time) {
        effects->load_change.time -= time;
    } else {
        axis->I2 *= AXT_R(1) + effects->load_change.ratio;
        effects->load_change.ratio = AXT_R(0);
    }
}

axt_status axt_loop_windows(const axt_axis *axis, const axt_effects *effects, axt_real time_step,
                            uint32_t substeps, const axt_real *times, const axt_motion *starts,
                            const axt_real *modes, const axt_real *torque, size_t windows,
                            size_t length, axt_real *angles, axt_real *speeds) {
    axt_status status = AXT_OK;
    for (size_t w = 0; w < windows && status == AXT_OK; w++) {
        axt_axis own_axis = *axis;
        axt_effects own = *effects;
        start_later(&own_axis, &own, times[w]);
        axt_machine machine;
        status = axt_machine_init(&machine, &own_axis, time_step / (axt_real)substeps,
                                  AXT_TORQUE_HELD, &own);
        if (status == AXT_OK) {
            status = axt_machine_make_exact(&machine);
        }
        if (status == AXT_OK) {
            status = axt_machine_set(&machine, &starts[w], torque[w * length]);
        }
        if (status == AXT_OK) {
            status = axt_machine_set_mode(&machine, modes[2 * w], modes[2 * w + 1]);
        }
        for (size_t i = w * length; i < (w + 1) * length && status == AXT_OK; i++) {
            axt_motion motion;
            axt_machine_read(&machine, &motion);
            const axt_real turned =
                (axt_real)(motion.turns - starts[w].turns) + (motion.fraction - starts[w].fraction);
            angles[i] = AXT_TWO_PI * turned;
            angles[windows * length + i] = angles[i] - motion.twist;
            speeds[i] = motion.speed;
            speeds[windows * length + i] = motion.speed - motion.twist_speed;
            const bool last = i + 1 == (w + 1) * length;
            for (uint32_t k = 1; k <= substeps && status == AXT_OK && !last; k++) {
                status = axt_machine_step(&machine, torque[(k < substeps) ? i : i + 1]);
            }
        }
    }
    return status;
}
