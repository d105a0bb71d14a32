/* The excitation identified back (Eq. 18), against the torque that went in. */
#include "axt_torque.h"

#include "axt_excitation.h"

#include "check.h"
#include "reference.h"

static axt_torque torque_of(const axt_axis *axis, axt_real step) {
    axt_torque torque;
    CHECK_EQUAL(axt_torque_init(&torque, axis, step), AXT_OK);
    return torque;
}

static axt_motion motion_of(const textbook_axis *axis) {
    return (axt_motion){.twist = (axt_real)(axis->angle[0] - axis->angle[1]),
                        .twist_speed = (axt_real)(axis->speed[0] - axis->speed[1]),
                        .speed = (axt_real)axis->speed[0]};
}

/* Newmark's method by the textbook in extended precision: all that is left is the rounding of what
 * goes in, of which the speed, divided by the step, weighs most. */
CASE(the_mean_torque_of_each_step_of_any_axis_comes_back) {
    uint64_t seed = 1;
    for (int n = 0; n < 200; n++) {
        const axt_axis axis = {.I1 = log_uniform(&seed, 1e-6, 1),
                               .I2 = log_uniform(&seed, 1e-6, 1),
                               .B = log_uniform(&seed, 1e-5, 1),
                               .K = log_uniform(&seed, 1, 1e4)};
        const double wn = sqrt((double)axis.K * (1 / (double)axis.I1 + 1 / (double)axis.I2));
        const axt_real step = (axt_real)((double)log_uniform(&seed, 0.02, 1.5) / wn);
        textbook_axis reference = {.I = {(wide)axis.I1, (wide)axis.I2},
                                   .B = (wide)axis.B,
                                   .K = (wide)axis.K,
                                   .time_step = (wide)step,
                                   .alpha = 0.25L,
                                   .delta = 0.5L};
        axt_torque torque = torque_of(&axis, step);
        axt_motion motion = motion_of(&reference);
        axt_real mean = 0;
        CHECK_EQUAL(axt_torque_step(&torque, &motion, &mean), AXT_ERROR_NO_DATA);
        wide last = 0;
        for (int i = 0; i < 200; i++) {
            const wide now = (wide)uniform(&seed, -1, 1);
            textbook_step(&reference, now, 0);
            motion = motion_of(&reference);
            CHECK_EQUAL(axt_torque_step(&torque, &motion, &mean), AXT_OK);
            const wide rounding = (wide)REAL_EPSILON *
                                  (4 + 2 * (wide)axis.I1 / (wide)step * fabsl((wide)motion.speed) +
                                   4 * (wide)axis.K * fabsl((wide)motion.twist));
            CHECK_NEAR((wide)mean, (now + last) / 2, rounding);
            last = now;
        }
    }
}

/* What issue and paper ask for: Schroeder's signal, both settings, through the plant. */
CASE(the_paper_s_excitation_comes_back_to_1e_5) {
    static const struct {
        uint32_t length;
        uint32_t lines;
        double step;
    } settings[] = {{512, 20, 2.9480912e-5}, {2048, 292, 1.0760687e-4}};
    for (size_t s = 0; s < COUNT_OF(settings); s++) {
        static axt_real table[2048];
        const axt_schroeder signal = {.length = settings[s].length,
                                      .first = 1,
                                      .stride = 1,
                                      .lines = settings[s].lines,
                                      .rms = (axt_real)0.2};
        CHECK_EQUAL(axt_schroeder_fill(&signal, table, COUNT_OF(table)), AXT_OK);
        const axt_real step = (axt_real)settings[s].step;
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step, &axt_newmark_trapezoidal),
                    AXT_OK);
        axt_torque torque = torque_of(&axt_axis_paper, step);
        wide missed = 0;
        wide power = 0;
        for (uint32_t n = 0; n < 10 * signal.length; n++) {
            const axt_real now = table[n % signal.length];
            const axt_real before = table[(n + signal.length - 1) % signal.length];
            CHECK_EQUAL(axt_plant_step(&plant, now), AXT_OK);
            axt_motion motion;
            axt_plant_read(&plant, &motion);
            axt_real mean = 0;
            if (axt_torque_step(&torque, &motion, &mean) == AXT_OK) {
                const wide expected = ((wide)now + (wide)before) / 2;
                missed += ((wide)mean - expected) * ((wide)mean - expected);
                power += expected * expected;
            }
        }
        CHECK(power > 0);
        CHECK_NEAR(sqrtl(missed / power), 0, BY_TYPE(1e-5, 1e-13));
    }
}

CASE(where_the_motor_stands_does_not_matter) {
    axt_torque here = torque_of(&axt_axis_paper, (axt_real)1e-4);
    axt_torque there = here;
    uint64_t seed = 2;
    for (int n = 0; n < 100; n++) {
        axt_motion motion = {.twist = uniform(&seed, -1e-3, 1e-3),
                             .twist_speed = uniform(&seed, -5, 5),
                             .speed = uniform(&seed, -100, 100)};
        axt_real mean[2] = {0, 0};
        (void)axt_torque_step(&here, &motion, &mean[0]);
        motion.turns = 1000000;
        motion.fraction = (axt_real)0.25;
        (void)axt_torque_step(&there, &motion, &mean[1]);
        CHECK(same_bytes(&mean[0], &mean[1], sizeof mean[0]));
    }
}

CASE(a_refused_sample_changes_no_answer_and_the_next_is_a_first_one) {
    const axt_motion still = {.twist = 0};
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        const axt_motion bad[] = {
            {.twist = not_finite[i]}, {.twist_speed = not_finite[i]}, {.speed = not_finite[i]}};
        for (size_t j = 0; j < COUNT_OF(bad); j++) {
            axt_torque torque = torque_of(&axt_axis_paper, (axt_real)1e-4);
            axt_real mean = 7;
            CHECK_EQUAL(axt_torque_step(&torque, &still, &mean), AXT_ERROR_NO_DATA);
            CHECK_NEAR(mean, 7, 0);
            CHECK_EQUAL(axt_torque_step(&torque, &bad[j], &mean), AXT_ERROR_NOT_FINITE);
            CHECK_NEAR(mean, 7, 0);
            CHECK_EQUAL(axt_torque_step(&torque, &still, &mean), AXT_ERROR_NO_DATA);
            CHECK_NEAR(mean, 7, 0);
            CHECK_EQUAL(axt_torque_step(&torque, &still, &mean), AXT_OK);
            CHECK_NEAR(mean, 0, 0);
        }
    }
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_torque torque = torque_of(&axt_axis_paper, (axt_real)1e-7);
    torque = torque_of(&axt_axis_paper, 1);
    const axt_torque before = torque;
    const axt_real steps[] = {
        0, (axt_real)-1e-4, (axt_real)0.9e-7, (axt_real)1.01, not_finite[0], not_finite[1]};
    for (size_t i = 0; i < COUNT_OF(steps); i++) {
        CHECK_EQUAL(axt_torque_init(&torque, &axt_axis_paper, steps[i]), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(torque, before));
    }
    axt_axis negative = axt_axis_paper;
    negative.B = -negative.B;
    CHECK_EQUAL(axt_torque_init(&torque, &negative, (axt_real)1e-4), AXT_ERROR_RANGE);
    axt_axis unknown = axt_axis_paper;
    unknown.K = not_finite[0];
    CHECK_EQUAL(axt_torque_init(&torque, &unknown, (axt_real)1e-4), AXT_ERROR_NOT_FINITE);
    CHECK(UNCHANGED(torque, before));
}

int main(void) {
    RUN(the_mean_torque_of_each_step_of_any_axis_comes_back);
    RUN(the_paper_s_excitation_comes_back_to_1e_5);
    RUN(where_the_motor_stands_does_not_matter);
    RUN(a_refused_sample_changes_no_answer_and_the_next_is_a_first_one);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
