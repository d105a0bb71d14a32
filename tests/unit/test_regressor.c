/* Regressors: samples of Newmark's method in extended precision have to obey the equations that are
 * made of them, with the entries that Eq. 3 gives. */
#include "axt_regressor.h"

#include "axt_encoder.h"

#include "check.h"
#include "reference.h"

enum { FORMS = 2 };

static const axt_ident_form forms[FORMS] = {AXT_IDENT_3X2, AXT_IDENT_5X4};

static axt_ident_config config_of(axt_ident_form form, double step, const axt_axis *expected) {
    return (axt_ident_config){.form = form,
                              .time_step = (axt_real)step,
                              .forgetting = 1,
                              .expected = *expected,
                              .torque = (axt_real)0.2};
}

static axt_regressor regressor_of(const axt_ident_config *config) {
    axt_regressor regressor;
    CHECK_EQUAL(axt_regressor_init(&regressor, config), AXT_OK);
    return regressor;
}

/* ---- An axis under test ---------------------------------------------------------------------- */

static textbook_axis axis_of(const axt_axis *axis, axt_real step) {
    return (textbook_axis){.I = {(wide)axis->I1, (wide)axis->I2},
                           .B = (wide)axis->B,
                           .K = (wide)axis->K,
                           .time_step = (wide)step,
                           .alpha = 0.25L,
                           .delta = 0.5L};
}

static axt_motion motion_of(const textbook_axis *axis) {
    const wide angle = axis->angle[0] / (2 * PI);
    const wide turns = roundl(angle);
    const axt_real fraction = (axt_real)(angle - turns);
    return (axt_motion){.twist = (axt_real)(axis->angle[0] - axis->angle[1]),
                        .twist_speed = (axt_real)(axis->speed[0] - axis->speed[1]),
                        .speed = (axt_real)axis->speed[0],
                        .turns = (int32_t)turns,
                        .fraction = fraction,
                        .fraction_low = (axt_real)(angle - turns - (wide)fraction)};
}

/* Entries of q, q', T in q'' and in r'' = theta1'' - share q''. */
static void rows_of(const textbook_axis *axis, wide share, wide rows[2][3]) {
    const wide per_motor = 1 / axis->I[0];
    const wide per_reduced = per_motor + 1 / axis->I[1];
    const wide shaft[3] = {-axis->K, -axis->B, 0};
    for (int i = 0; i < 3; i++) {
        const wide torque = (i == 2) ? per_motor : 0;
        rows[0][i] = shaft[i] * per_reduced + torque;
        rows[1][i] = shaft[i] * per_motor + torque - share * rows[0][i];
    }
}

/* What an equation misses by, relative to its largest term seen so far: a zero of the output shall
 * not blow it up. */
static void check_equation(const axt_regressor *regressor, const axt_equation *equation,
                           wide rows[2][3], wide largest[2], double tolerance) {
    const uint32_t *column = axt_regressor_columns(regressor);
    const uint32_t row = axt_regressor_row(regressor);
    for (uint32_t k = 0; k < 2; k++) {
        wide missing = (wide)equation->y[row + k];
        for (uint32_t i = 0; i < 3; i++) {
            const wide term = rows[k][i] / (wide)axt_regressor_unit(regressor, k, column[i]) *
                              (wide)equation->phi[column[i]];
            largest[k] = fmaxl(largest[k], fabsl(term));
            missing -= term;
        }
        CHECK_NEAR(missing / largest[k], 0, tolerance);
    }
}

static double natural_frequency(const axt_axis *axis) {
    return sqrt((double)axis->K * (1 / (double)axis->I1 + 1 / (double)axis->I2));
}

static axt_axis near_paper(uint64_t *seed, double factor) {
    return (axt_axis){.I1 = axt_axis_paper.I1 * log_uniform(seed, 1 / factor, factor),
                      .I2 = axt_axis_paper.I2 * log_uniform(seed, 1 / factor, factor),
                      .B = axt_axis_paper.B * log_uniform(seed, 1 / factor, factor),
                      .K = axt_axis_paper.K * log_uniform(seed, 1 / factor, factor)};
}

CASE(samples_of_any_axis_obey_the_equations_whatever_was_expected) {
    uint64_t seed = 1;
    for (int n = 0; n < 100; n++) {
        const axt_axis axis = near_paper(&seed, 3);
        const axt_axis expected = near_paper(&seed, 10);
        const double x = (double)log_uniform(&seed, 0.05, 1);
        const axt_real step = (axt_real)(x / natural_frequency(&axis));
        const wide share = (wide)(axt_real)(expected.I2 / (expected.I1 + expected.I2));
        for (size_t f = 0; f < FORMS; f++) {
            const axt_ident_config config = config_of(forms[f], (double)step, &expected);
            axt_regressor regressor = regressor_of(&config);
            textbook_axis reference = axis_of(&axis, step);
            wide rows[2][3];
            rows_of(&reference, share, rows);
            wide largest[2] = {0, 0};
            for (int i = 0; i < 300; i++) {
                const axt_real torque = uniform(&seed, -0.5, 0.5);
                textbook_step(&reference, (wide)torque, 0);
                const axt_motion motion = motion_of(&reference);
                axt_equation equation;
                const axt_status status =
                    axt_regressor_motion(&regressor, &motion, torque, &equation);
                CHECK_EQUAL(status, (i == 0) ? AXT_ERROR_NO_DATA : AXT_OK);
                /* speeds are rounded before their difference is divided by the step; a wrong share
                 * and the speed of the body make that worse */
                if (status == AXT_OK && i > 20) {
                    check_equation(&regressor, &equation, rows, largest, 2000 * REAL_EPSILON / x);
                }
            }
        }
    }
}

CASE(in_the_full_form_the_rates_of_the_angles_are_the_speeds) {
    uint64_t seed = 2;
    const axt_ident_config config = config_of(AXT_IDENT_5X4, 1e-4, &axt_axis_paper);
    axt_regressor regressor = regressor_of(&config);
    textbook_axis reference = axis_of(&axt_axis_paper, (axt_real)1e-4);
    reference.speed[0] = 300; /* passes a turn every 200 samples */
    reference.speed[1] = 300;
    wide largest[2] = {0, 0};
    for (int i = 0; i < 5000; i++) {
        const axt_real torque = uniform(&seed, -0.5, 0.5);
        textbook_step(&reference, (wide)torque, 0);
        const axt_motion motion = motion_of(&reference);
        axt_equation equation;
        if (axt_regressor_motion(&regressor, &motion, torque, &equation) == AXT_OK) {
            for (int k = 0; k < 2; k++) {
                largest[k] = fmaxl(largest[k], fabsl((wide)equation.phi[2 + k]));
                CHECK_NEAR(((wide)equation.y[k] - (wide)equation.phi[2 + k]) / largest[k], 0,
                           BY_TYPE(1e-4, 1e-12));
            }
            /* reckoned from near by, however far the axis has come */
            CHECK(fabsl((wide)equation.phi[1] / (wide)regressor.scale[1]) < 4 * 2 * PI);
        }
    }
}

CASE(turns_and_both_parts_of_the_fraction_make_the_angle) {
    const axt_ident_config config = config_of(AXT_IDENT_5X4, 1e-4, &axt_axis_paper);
    axt_regressor regressor = regressor_of(&config);
    const axt_motion start = {.turns = 7};
    const axt_motion end = {
        .turns = 8, .fraction = (axt_real)-0.5, .fraction_low = (axt_real)0.125};
    axt_equation equation;
    CHECK_EQUAL(axt_regressor_motion(&regressor, &start, 0, &equation), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_regressor_motion(&regressor, &end, 0, &equation), AXT_OK);
    const wide turned = 2 * PI * 0.625L; /* and the mean of start and end is half of that */
    CHECK_NEAR((wide)equation.phi[1] / (wide)regressor.scale[1] / (turned / 2), 1,
               4 * REAL_EPSILON);
    CHECK_NEAR((wide)equation.y[1] / (wide)regressor.output_scale[1] / (turned / 1e-4L), 1,
               8 * REAL_EPSILON);
}

CASE(a_count_of_turns_that_wraps_around_changes_nothing) {
    axt_regressor here = {.wait = 0};
    const axt_ident_config config = config_of(AXT_IDENT_5X4, 1e-4, &axt_axis_paper);
    here = regressor_of(&config);
    axt_regressor there = here;
    uint64_t seed = 3;
    for (int i = 0; i < 40; i++) {
        axt_motion motion = {.twist = uniform(&seed, -1e-3, 1e-3),
                             .speed = uniform(&seed, -10, 10),
                             .turns = i - 20,
                             .fraction = uniform(&seed, -0.5, 0.5)};
        axt_equation equations[2] = {{{0}, {0}}, {{0}, {0}}};
        const axt_status status = axt_regressor_motion(&here, &motion, 0, &equations[0]);
        motion.turns = (int32_t)((uint32_t)INT32_MAX + (uint32_t)motion.turns);
        CHECK_EQUAL(axt_regressor_motion(&there, &motion, 0, &equations[1]), status);
        CHECK(same_bytes(&equations[0], &equations[1], sizeof equations[0]));
    }
}

/* ---- Encoders alone -------------------------------------------------------------------------- */

static int32_t count_of(const textbook_axis *axis, int encoder, uint32_t counts_per_turn) {
    return (int32_t)llroundl(axis->angle[encoder] / (2 * PI) * counts_per_turn);
}

/* Two encoders of 2^24 and 2^22 counts: what the equations miss by is their rounding, filtered. */
CASE(counts_obey_the_equations_one_derivative_up) {
    const double step = 2e-5;
    uint64_t seed = 4;
    for (size_t f = 0; f < FORMS; f++) {
        axt_ident_config config = config_of(forms[f], step, &axt_axis_paper);
        config.counts_per_turn[0] = 1U << 24;
        config.counts_per_turn[1] = 1U << 22;
        axt_regressor regressor = regressor_of(&config);
        textbook_axis reference = axis_of(&axt_axis_paper, (axt_real)step);
        const wide inertia = (wide)axt_axis_paper.I1 + (wide)axt_axis_paper.I2;
        wide rows[2][3];
        rows_of(&reference, (wide)axt_axis_paper.I2 / inertia, rows);
        wide largest[2] = {0, 0};
        uint32_t silent = 0;
        for (int i = 0; i < 3000; i++) {
            const axt_real torque = uniform(&seed, -2, 2);
            textbook_step(&reference, (wide)torque, 0);
            axt_equation equation;
            const axt_status status =
                axt_regressor_counts(&regressor, count_of(&reference, 0, 1U << 24),
                                     count_of(&reference, 1, 1U << 22), torque, &equation);
            CHECK(status == AXT_OK || status == AXT_ERROR_NO_DATA);
            silent += (status == AXT_OK) ? 0U : 1U;
            if (i > 1000) {
                CHECK_EQUAL(status, AXT_OK);
                check_equation(&regressor, &equation, rows, largest, (i > 1200) ? 0.01 : 1);
            }
        }
        /* e^-16 of its start is left after 32 corner periods, less than two of which are idle */
        const double settling = 32 / (natural_frequency(&axt_axis_paper) * step);
        CHECK_NEAR(silent, settling, 0.05 * settling);
    }
}

CASE(a_twist_that_flickers_by_a_count_yields_no_equation) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, 1e-4, &axt_axis_paper);
    config.counts_per_turn[0] = 10000;
    config.counts_per_turn[1] = 10000;
    uint64_t seed = 5;
    for (int size = 1; size <= 100; size *= 100) {
        axt_regressor regressor = regressor_of(&config);
        uint32_t equations = 0;
        for (int i = 0; i < 20000; i++) {
            const int32_t flicker = (random_bits(&seed) & 1) ? size : 0;
            axt_equation equation;
            const axt_status status =
                axt_regressor_counts(&regressor, 70 + flicker, 70, 0, &equation);
            equations += (status == AXT_OK) ? 1U : 0U;
        }
        if (size == 1) {
            CHECK_EQUAL(equations, 0);
        } else {
            CHECK(equations > 19000);
        }
    }
}

/* ---- Scaling --------------------------------------------------------------------------------- */

static bool power_of_two(axt_real x) {
    int exponent = 0;
    return frexp((double)x, &exponent) == 0.5;
}

CASE(with_speeds_every_unit_is_a_power_of_two) {
    uint64_t seed = 6;
    for (int n = 0; n < 1000; n++) {
        const axt_axis expected = near_paper(&seed, 1000);
        const axt_ident_config config =
            config_of(forms[n % FORMS], 1 / natural_frequency(&expected), &expected);
        const axt_regressor regressor = regressor_of(&config);
        for (uint32_t k = 0; k < 2; k++) {
            for (uint32_t i = 0; i < 3; i++) {
                CHECK(power_of_two(
                    axt_regressor_unit(&regressor, k, axt_regressor_columns(&regressor)[i])));
            }
        }
    }
}

CASE(regressors_and_outputs_are_of_size_one) {
    for (int encoders = 0; encoders < 2; encoders++) {
        const double step = 1e-4;
        axt_ident_config config = config_of(AXT_IDENT_5X4, step, &axt_axis_paper);
        for (int i = 0; encoders && i < 2; i++) {
            config.counts_per_turn[i] = 1U << 24;
        }
        axt_regressor regressor = regressor_of(&config);
        textbook_axis reference = axis_of(&axt_axis_paper, (axt_real)step);
        uint64_t seed = 7;
        wide phi[5] = {0};
        wide y[4] = {0};
        uint32_t taken = 0;
        for (int i = 0; i < 20000; i++) {
            const axt_real torque = (axt_real)0.2 * gaussian(&seed);
            textbook_step(&reference, (wide)torque, 0);
            const axt_motion motion = motion_of(&reference);
            axt_equation equation;
            const axt_status status =
                encoders
                    ? axt_regressor_counts(&regressor, count_of(&reference, 0, 1U << 24),
                                           count_of(&reference, 1, 1U << 24), torque, &equation)
                    : axt_regressor_motion(&regressor, &motion, torque, &equation);
            if (status == AXT_OK) {
                taken++;
                for (int j = 0; j < 5; j++) {
                    phi[j] += (wide)equation.phi[j] * (wide)equation.phi[j];
                }
                for (int j = 0; j < 4; j++) {
                    y[j] += (wide)equation.y[j] * (wide)equation.y[j];
                }
            }
        }
        CHECK(taken > 15000);
        for (int j = 0; j < 5; j++) {
            /* of the square: 0.1 .. 10, but for angle and speed of the body, which wander */
            static const double decades[5] = {2, 7, 2, 3, 2};
            CHECK_NEAR(log10l(phi[j] / taken), 0, decades[j]);
        }
        for (int j = 2; j < 4; j++) {
            CHECK_NEAR(log10l(y[j] / taken), 0, 2);
        }
    }
}

/* ---- What it refuses, and gaps ----------------------------------------------------------------
 */

CASE(no_equation_spans_a_gap_and_a_refused_sample_changes_nothing) {
    const axt_ident_config config = config_of(AXT_IDENT_3X2, 1e-4, &axt_axis_paper);
    axt_regressor regressor = regressor_of(&config);
    const axt_motion motion = {.twist = (axt_real)1e-3};
    axt_equation equation;
    CHECK_EQUAL(axt_regressor_motion(&regressor, &motion, 0, &equation), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_regressor_motion(&regressor, &motion, 0, &equation), AXT_OK);
    axt_regressor_gap(&regressor);
    CHECK_EQUAL(axt_regressor_motion(&regressor, &motion, 0, &equation), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_regressor_motion(&regressor, &motion, 0, &equation), AXT_OK);
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        const axt_motion bad[] = {{.twist = not_finite[i]},        {.twist_speed = not_finite[i]},
                                  {.speed = not_finite[i]},        {.fraction = not_finite[i]},
                                  {.fraction_low = not_finite[i]}, motion};
        for (size_t j = 0; j < COUNT_OF(bad); j++) {
            const axt_real torque = (j + 1 == COUNT_OF(bad)) ? not_finite[i] : 0;
            const axt_regressor before = regressor;
            CHECK_EQUAL(axt_regressor_motion(&regressor, &bad[j], torque, &equation),
                        AXT_ERROR_NOT_FINITE);
            CHECK(UNCHANGED(regressor, before));
        }
    }
}

CASE(a_torque_beyond_all_expectation_is_refused_with_counts) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, 1e-4, &axt_axis_paper);
    config.counts_per_turn[0] = 10000;
    config.counts_per_turn[1] = 10000;
    axt_regressor regressor = regressor_of(&config);
    axt_equation equation;
    CHECK_EQUAL(axt_regressor_counts(&regressor, 0, 0, (axt_real)199, &equation),
                AXT_ERROR_NO_DATA);
    const axt_regressor before = regressor;
    CHECK_EQUAL(axt_regressor_counts(&regressor, 0, 0, (axt_real)201, &equation), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_regressor_counts(&regressor, 0, 0, (axt_real)-201, &equation), AXT_ERROR_RANGE);
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        CHECK_EQUAL(axt_regressor_counts(&regressor, 0, 0, not_finite[i], &equation),
                    AXT_ERROR_NOT_FINITE);
    }
    CHECK(UNCHANGED(regressor, before));
}

CASE(the_wrong_kind_of_sample_is_refused_and_changes_nothing) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, 1e-4, &axt_axis_paper);
    axt_regressor speeds = regressor_of(&config);
    config.counts_per_turn[0] = 10000;
    config.counts_per_turn[1] = 5000;
    axt_regressor encoders = regressor_of(&config);
    const axt_regressor before[2] = {speeds, encoders};
    const axt_motion motion = {.twist = 0};
    axt_equation equation;
    CHECK_EQUAL(axt_regressor_counts(&speeds, 0, 0, 0, &equation), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_regressor_motion(&encoders, &motion, 0, &equation), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(speeds, before[0]));
    CHECK(UNCHANGED(encoders, before[1]));
}

/* An axis that vibrates faster than is sampled: the filter stays below the Nyquist frequency. */
CASE(a_filter_can_be_made_for_any_axis) {
    static const double stiffnesses[] = {1e-6, 1, 110, 1e6, 1e12};
    for (size_t i = 0; i < COUNT_OF(stiffnesses); i++) {
        axt_axis axis = axt_axis_paper;
        axis.K = (axt_real)stiffnesses[i];
        axt_ident_config config = config_of(AXT_IDENT_3X2, 1e-4, &axis);
        config.counts_per_turn[0] = config.counts_per_turn[1] = 10000;
        axt_regressor regressor;
        CHECK_EQUAL(axt_regressor_init(&regressor, &config), AXT_OK);
        const double wn = natural_frequency(&axis);
        const double corner = (double)(regressor.filter.half_dt) * 2; /* times Dt */
        CHECK_NEAR(corner / fmin(wn * 1e-4, 2), 1, 1e-5);
    }
}

CASE(shapes_are_those_of_form_and_hold) {
    axt_ident_config config = config_of(AXT_IDENT_5X4, 1e-4, &axt_axis_paper);
    axt_regressor regressor = regressor_of(&config);
    CHECK_EQUAL(axt_regressor_inputs(&regressor), 5);
    CHECK_EQUAL(axt_regressor_outputs(&regressor), 4);
    config.form = AXT_IDENT_3X2;
    config.hold = AXT_HOLD_ZERO;
    regressor = regressor_of(&config);
    CHECK_EQUAL(axt_regressor_inputs(&regressor), 3);
    CHECK_EQUAL(axt_regressor_outputs(&regressor), 2);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 10000;
    regressor = regressor_of(&config);
    CHECK_EQUAL(axt_regressor_inputs(&regressor), 4);
    config.hold = AXT_HOLD_LINEAR;
    regressor = regressor_of(&config);
    CHECK_EQUAL(axt_regressor_inputs(&regressor), 3);
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    const axt_ident_config good = config_of(AXT_IDENT_3X2, 1e-4, &axt_axis_paper);
    axt_regressor regressor = regressor_of(&good);
    const axt_regressor before = regressor;
    axt_ident_config bad[15];
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        bad[i] = good;
    }
    bad[0].form = (axt_ident_form)2;
    bad[1].time_step = 0;
    bad[2].time_step = (axt_real)0.9e-7;
    bad[3].time_step = (axt_real)1.1;
    bad[4].torque = 0;
    bad[5].torque = (axt_real)1.1e9;
    bad[6].torque = (axt_real)-0.2;
    bad[7].counts_per_turn[0] = 10000; /* and none at the table */
    bad[8].counts_per_turn[1] = 10000;
    bad[9].counts_per_turn[0] = bad[9].counts_per_turn[1] = AXT_ENCODER_COUNTS_MAX + 1;
    bad[10].expected.I1 = 0;
    bad[11].torque = not_finite[0];
    bad[12].hold = (axt_hold)2;
    bad[13].form = AXT_IDENT_5X4; /* six regressors */
    bad[13].hold = AXT_HOLD_ZERO;
    bad[13].counts_per_turn[0] = bad[13].counts_per_turn[1] = 10000;
    bad[14].time_step = (axt_real)1e-7; /* the filter would take a day to settle */
    bad[14].expected = (axt_axis){.I1 = 1e5, .I2 = 1e5, .B = 0, .K = (axt_real)1e-6};
    bad[14].counts_per_turn[0] = bad[14].counts_per_turn[1] = 10000;
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_regressor_init(&regressor, &bad[i]), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(regressor, before));
    }
    axt_ident_config unknown = good;
    unknown.expected.K = not_finite[0];
    CHECK_EQUAL(axt_regressor_init(&regressor, &unknown), AXT_ERROR_NOT_FINITE);
    CHECK(UNCHANGED(regressor, before));
}

int main(void) {
    RUN(samples_of_any_axis_obey_the_equations_whatever_was_expected);
    RUN(in_the_full_form_the_rates_of_the_angles_are_the_speeds);
    RUN(turns_and_both_parts_of_the_fraction_make_the_angle);
    RUN(a_count_of_turns_that_wraps_around_changes_nothing);
    RUN(counts_obey_the_equations_one_derivative_up);
    RUN(a_twist_that_flickers_by_a_count_yields_no_equation);
    RUN(with_speeds_every_unit_is_a_power_of_two);
    RUN(regressors_and_outputs_are_of_size_one);
    RUN(no_equation_spans_a_gap_and_a_refused_sample_changes_nothing);
    RUN(a_torque_beyond_all_expectation_is_refused_with_counts);
    RUN(the_wrong_kind_of_sample_is_refused_and_changes_nothing);
    RUN(a_filter_can_be_made_for_any_axis);
    RUN(shapes_are_those_of_form_and_hold);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
