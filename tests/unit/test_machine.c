/* Each effect inside the axis acts by itself: it is enough to leave the ideal plant. The physics of
 * the effects is tested in test_effects.c. */
#include "axt_machine.h"

#include "check.h"
#include "reference.h"

static const axt_real step = (axt_real)5e-5;

static axt_machine machine_with(const axt_effects *effects) {
    axt_machine machine;
    CHECK_EQUAL(axt_machine_init(&machine, &axt_axis_paper, step, AXT_TORQUE_LINEAR, effects),
                AXT_OK);
    return machine;
}

/* How far the machine with these effects comes from the one without. */
static double departure(const axt_effects *effects) {
    const axt_effects none = {.backlash = 0};
    axt_machine ideal = machine_with(&none);
    axt_machine machine = machine_with(effects);
    uint64_t seed = 1;
    double furthest = 0;
    for (int n = 0; n < 400; n++) {
        const axt_real torque = (axt_real)0.3 + uniform(&seed, -0.3, 0.3);
        axt_motion motions[2];
        CHECK_EQUAL(axt_machine_step(&ideal, torque), AXT_OK);
        CHECK_EQUAL(axt_machine_step(&machine, torque), AXT_OK);
        axt_machine_read(&ideal, &motions[0]);
        axt_machine_read(&machine, &motions[1]);
        furthest = fmax(furthest, fabs((double)(motions[1].speed - motions[0].speed)));
        furthest = fmax(furthest, fabs((double)(motions[1].twist_speed - motions[0].twist_speed)));
    }
    return furthest;
}

CASE(each_effect_alone_changes_the_motion) {
    const axt_effects alone[] = {
        {.friction = {{.coulomb = (axt_real)0.01}}},
        {.friction = {[1] = {.coulomb = (axt_real)0.01}}},
        {.friction = {{.viscous = (axt_real)1e-3}}},
        {.friction = {[1] = {.viscous = (axt_real)1e-3}}},
        {.friction = {{.stribeck = (axt_real)0.02, .stribeck_speed = 50}}},
        {.torque_offset = {(axt_real)0.01}},
        {.torque_offset = {[1] = (axt_real)0.01}},
        {.disturbance = {{.amplitude = (axt_real)0.01, .frequency = 300}}},
        {.disturbance = {[1] = {.amplitude = (axt_real)0.01, .frequency = 300}}},
        {.torque_ripple = {{.amplitude = (axt_real)0.01, .periods = 7}}},
        {.torque_ripple = {[3] = {.amplitude = (axt_real)0.01, .periods = 7}}},
        {.backlash = (axt_real)1e-4},
        {.stiffness_hardening = (axt_real)1e9},
        {.stiffness_drift = 20},
        {.load_change = {.ratio = (axt_real)0.5, .time = (axt_real)1e-3}},
        {.extra_mode = {.frequency = 2000,
                        .damping_ratio = (axt_real)0.02,
                        .mass_ratio = (axt_real)0.3}},
    };
    for (size_t i = 0; i < COUNT_OF(alone); i++) {
        const double far = departure(&alone[i]);
        CHECK(far > 0.1);
    }
}

CASE(a_state_that_the_plant_refuses_is_refused_and_nothing_changes) {
    const axt_effects effects = {.backlash = (axt_real)1e-4};
    axt_machine machine = machine_with(&effects);
    const axt_machine before = machine;
    const axt_motion far = {.twist = 2000};
    const axt_motion still = {.twist = 0};
    CHECK_EQUAL(axt_machine_set(&machine, &far, 0), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_machine_set(&machine, &still, not_finite[0]), AXT_ERROR_NOT_FINITE);
    CHECK(UNCHANGED(machine, before));
}

CASE(a_refused_torque_is_counted) {
    const axt_effects effects = {.backlash = (axt_real)1e-4};
    axt_machine machine = machine_with(&effects);
    CHECK_EQUAL(axt_machine_step(&machine, (axt_real)0.1), AXT_OK);
    CHECK_EQUAL(machine.rejected, 0);
    CHECK_EQUAL(axt_machine_step(&machine, not_finite[0]), AXT_ERROR_NOT_FINITE);
    CHECK_EQUAL(machine.rejected, 1);
}

CASE(measured_speeds_are_those_of_the_axis) {
    const axt_effects effects = {.encoder_eccentricity = {{.amplitude = (axt_real)0.01}}};
    axt_machine machine = machine_with(&effects);
    uint64_t seed = 2;
    for (int n = 0; n < 200; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, uniform(&seed, -0.5, 0.5)), AXT_OK);
        axt_motion real;
        axt_motion measured;
        axt_machine_read(&machine, &real);
        axt_machine_measure(&machine, &measured);
        const double rounding = 100 * REAL_EPSILON * (1 + fabs((double)real.speed));
        CHECK_NEAR(measured.speed, real.speed, rounding);
        CHECK_NEAR(measured.twist_speed, real.twist_speed, rounding);
    }
}

CASE(the_count_of_steps_stops_at_its_end) {
    const axt_effects effects = {.stiffness_drift = (axt_real)1e-6};
    axt_machine machine = machine_with(&effects);
    machine.steps = UINT32_MAX - 1;
    for (int n = 0; n < 3; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        CHECK_EQUAL(machine.steps, UINT32_MAX);
    }
}

int main(void) {
    RUN(each_effect_alone_changes_the_motion);
    RUN(a_state_that_the_plant_refuses_is_refused_and_nothing_changes);
    RUN(a_refused_torque_is_counted);
    RUN(measured_speeds_are_those_of_the_axis);
    RUN(the_count_of_steps_stops_at_its_end);
    return REPORT();
}
