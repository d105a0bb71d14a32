#include "axt_effects.h"

#include "axt_encoder.h"
#include "axt_math.h"

/* One by one the ranges of a whole set are looked at; the worst answer so far is kept. */
static void expect(axt_status *status, axt_real value, axt_real least, axt_real most) {
    if (!axt_finite(value)) {
        *status = AXT_ERROR_NOT_FINITE;
    } else if (*status == AXT_OK && !(value >= least && value <= most)) {
        *status = AXT_ERROR_RANGE;
    }
}

static void expect_friction(axt_status *status, const axt_friction *friction) {
    const bool stribeck = axt_abs(friction->stribeck) > AXT_R(0);
    expect(status, friction->coulomb, AXT_R(0), AXT_R(1e6));
    expect(status, friction->viscous, AXT_R(0), AXT_R(1e6));
    expect(status, friction->stribeck, -friction->coulomb, AXT_R(1e6));
    expect(status, friction->asymmetry, -friction->viscous, friction->viscous);
    expect(status, friction->stribeck_speed, stribeck ? AXT_R(1e-6) : AXT_R(0), AXT_R(1e6));
    expect(status, friction->drift, AXT_R(-1e3), AXT_R(1e3));
}

static void expect_phase(axt_status *status, axt_real phase) {
    expect(status, phase, AXT_R(-1e3), AXT_R(1e3));
}

static void expect_wave(axt_status *status, const axt_wave *wave) {
    expect(status, wave->amplitude, AXT_R(-1e6), AXT_R(1e6));
    expect(status, wave->periods, AXT_R(0), AXT_R(1e5));
    expect_phase(status, wave->phase);
}

static void expect_counts(axt_status *status, axt_real counts) {
    expect(status, counts, AXT_R(0), AXT_R(AXT_ENCODER_COUNTS_MAX));
    if (*status == AXT_OK && axt_abs(counts - (axt_real)(int32_t)counts) > AXT_R(0)) {
        *status = AXT_ERROR_RANGE;
    }
}

axt_status axt_effects_check(const axt_effects *effects, axt_real time_step) {
    const axt_real delay_max = AXT_R(AXT_DELAY_STEPS - 2) * time_step;
    const axt_real frequency_max = AXT_PI / time_step;
    axt_status status = AXT_OK;
    for (uint32_t i = 0; i < 2; i++) {
        expect_friction(&status, &effects->friction[i]);
        expect(&status, effects->torque_offset[i], AXT_R(-1e6), AXT_R(1e6));
        expect(&status, effects->disturbance[i].amplitude, AXT_R(-1e6), AXT_R(1e6));
        expect(&status, effects->disturbance[i].frequency, AXT_R(0), frequency_max);
        expect_phase(&status, effects->disturbance[i].phase);
        expect(&status, effects->encoder_eccentricity[i].amplitude, AXT_R(-1), AXT_R(1));
        expect_phase(&status, effects->encoder_eccentricity[i].phase);
        expect(&status, effects->encoder_delay[i], AXT_R(0), delay_max);
        expect_counts(&status, effects->quantisation[i]);
    }
    for (uint32_t i = 0; i < AXT_EFFECTS_WAVES; i++) {
        expect_wave(&status, &effects->torque_ripple[i]);
        expect_wave(&status, &effects->lead_error[i]);
    }
    expect(&status, effects->backlash, AXT_R(0), AXT_R(1e3));
    expect(&status, effects->stiffness_hardening, AXT_R(-1e15), AXT_R(1e15));
    expect(&status, effects->stiffness_drift, AXT_R(-1e3), AXT_R(1e3));
    expect(&status, effects->load_change.ratio, AXT_R(-0.999), AXT_R(1e3));
    expect(&status, effects->load_change.time, AXT_R(0), AXT_R(1e9));
    const bool mode = axt_abs(effects->extra_mode.mass_ratio) > AXT_R(0);
    expect(&status, effects->extra_mode.frequency, mode ? AXT_R(1e-3) : AXT_R(0),
           AXT_R(1e3) / time_step);
    expect(&status, effects->extra_mode.damping_ratio, AXT_R(0), AXT_R(1e3));
    expect(&status, effects->extra_mode.mass_ratio, AXT_R(0), AXT_R(1e3));
    expect(&status, effects->torque_delay, AXT_R(0), delay_max);
    expect(&status, effects->torque_saturation, AXT_R(0), AXT_R(1e6));
    return status;
}
