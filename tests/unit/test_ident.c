/* Identification, of samples made by Newmark's method in extended precision: the parameters that
 * went in must come out, and nothing else must matter. */
#include "axt_ident.h"

#include "axt_encoder.h"
#include "axt_excitation.h"
#include "check.h"
#include "reference.h"

enum { PERIOD_MAX = 2048, FORMS = 2 };

static const axt_ident_form forms[FORMS] = {AXT_IDENT_3X2, AXT_IDENT_5X4};

/* The paper's two settings, excited at 2 k lines. */
typedef enum { SETTING_A, SETTING_B, SETTINGS } setting;

static const struct {
    uint32_t N;
    uint32_t k;
} settings[SETTINGS] = {{512, 10}, {2048, 146}};

/* ---- An axis under test --------------------------------------------------------------------- */

typedef struct {
    textbook_axis axis;
    axt_real table[PERIOD_MAX]; /* one period of torque */
    uint32_t period;
    uint32_t sample; /* the next */
    axt_real torque; /* of the last */
} bench;

static axt_real time_step_of(setting which) {
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axt_axis_paper, &modal), AXT_OK);
    return axt_time_step(settings[which].N, settings[which].k, modal.wn);
}

/* An axis at rest in the twist, moving at `speed`. Seed 0: Schroeder's phases. */
static void bench_start_axis(bench *b, const axt_axis *axis, setting which, uint32_t seed,
                             wide speed) {
    *b = (bench){.axis = {.I = {(wide)axis->I1, (wide)axis->I2},
                          .B = (wide)axis->B,
                          .K = (wide)axis->K,
                          .time_step = (wide)time_step_of(which),
                          .alpha = 0.25L,
                          .delta = 0.5L,
                          .speed = {speed, speed}},
                 .period = settings[which].N};
    const axt_schroeder signal = {.length = settings[which].N,
                                  .first = 1,
                                  .stride = 1,
                                  .lines = 2 * settings[which].k,
                                  .seed = seed,
                                  .rms = (axt_real)0.2};
    CHECK_EQUAL(axt_schroeder_fill(&signal, b->table, PERIOD_MAX), AXT_OK);
}

static void bench_start(bench *b, setting which, uint32_t seed, wide speed) {
    bench_start_axis(b, &axt_axis_paper, which, seed, speed);
}

/* One sample on, with more torque on motor and table than the estimator is told. */
static void bench_step_disturbed(bench *b, wide on_motor, wide on_table) {
    b->torque = b->table[b->sample % b->period];
    if (b->sample == 0) {
        textbook_start(&b->axis, (wide)b->torque + on_motor, on_table);
    } else {
        textbook_step(&b->axis, (wide)b->torque + on_motor, on_table);
    }
    b->sample++;
}

static void bench_step(bench *b) {
    bench_step_disturbed(b, 0, 0);
}

static axt_motion bench_motion(const bench *b) {
    const wide angle = b->axis.angle[0] / (2 * PI);
    const wide turns = roundl(angle);
    const axt_real fraction = (axt_real)(angle - turns);
    return (axt_motion){.twist = (axt_real)(b->axis.angle[0] - b->axis.angle[1]),
                        .twist_speed = (axt_real)(b->axis.speed[0] - b->axis.speed[1]),
                        .speed = (axt_real)b->axis.speed[0],
                        .turns = (int32_t)turns,
                        .fraction = fraction,
                        .fraction_low = (axt_real)(angle - turns - (wide)fraction)};
}

static int32_t bench_count(const bench *b, int encoder, uint32_t counts_per_turn) {
    const long long count = llroundl(b->axis.angle[encoder] / (2 * PI) * counts_per_turn);
    return (int32_t)(uint32_t)(unsigned long long)count;
}

/* ---- The estimators ------------------------------------------------------------------------- */

static axt_ident_config config_of(axt_ident_form form, setting which) {
    return (axt_ident_config){.form = form,
                              .time_step = time_step_of(which),
                              .forgetting = 1,
                              .expected = axt_axis_paper,
                              .torque = (axt_real)0.2};
}

static axt_ident ident_of(const axt_ident_config *config) {
    axt_ident ident;
    CHECK_EQUAL(axt_ident_init(&ident, config), AXT_OK);
    return ident;
}

static bool taken(axt_status status) {
    return status == AXT_OK || status == AXT_ERROR_NO_DATA;
}

static void take_motion(axt_ident *ident, const bench *b) {
    const axt_motion motion = bench_motion(b);
    CHECK(taken(axt_ident_motion(ident, b->sample, &motion, b->torque)));
}

static void take_counts(axt_ident *ident, const bench *b) {
    const uint32_t *counts_per_turn = ident->regressor.config.counts_per_turn;
    CHECK(taken(axt_ident_counts(ident, b->sample, bench_count(b, 0, counts_per_turn[0]),
                                 bench_count(b, 1, counts_per_turn[1]), b->torque)));
}

static axt_estimate estimate_of(const axt_ident *ident) {
    axt_estimate estimate;
    CHECK_EQUAL(axt_ident_result(ident, &estimate), AXT_OK);
    return estimate;
}

/* Relative errors of I1, I2, B, K. */
static void check_axis(const axt_axis *found, double inertia, double damping) {
    CHECK_NEAR((wide)found->I1 / (wide)axt_axis_paper.I1, 1, inertia);
    CHECK_NEAR((wide)found->I2 / (wide)axt_axis_paper.I2, 1, inertia);
    CHECK_NEAR((wide)found->K / (wide)axt_axis_paper.K, 1, inertia);
    CHECK_NEAR((wide)found->B / (wide)axt_axis_paper.B, 1, damping);
}

static void check_estimate(const axt_ident *ident, double inertia, double damping) {
    const axt_estimate estimate = estimate_of(ident);
    check_axis(&estimate.axis, inertia, damping);
    CHECK_EQUAL(estimate.valid, AXT_VALID_ALL);
}

/* ---- Noise-free motion: to 1e-4 % in float, 1e-9 % in double -------------------------------- */

static const double exact = BY_TYPE(1e-6, 1e-11);

/* From a poor start, be it the scaling or the first samples, rounding leaves float twice as much.
 */
static const double nearly_exact = BY_TYPE(2e-6, 1e-11);

/* Both forms on the same samples, checked after 1 period and at the end. */
static void check_motion(setting which, uint32_t seed, double speed, const axt_axis *expected,
                         uint32_t periods, double tolerance) {
    static bench b;
    bench_start(&b, which, seed, (wide)speed);
    axt_ident ident[FORMS];
    for (size_t i = 0; i < FORMS; i++) {
        axt_ident_config config = config_of(forms[i], which);
        config.expected = *expected;
        ident[i] = ident_of(&config);
    }
    while (b.sample < periods * b.period) {
        bench_step(&b);
        for (size_t i = 0; i < FORMS; i++) {
            take_motion(&ident[i], &b);
            if (b.sample == b.period || b.sample == periods * b.period) {
                const double within = (forms[i] == AXT_IDENT_3X2) ? tolerance : nearly_exact;
                check_estimate(&ident[i], within, within);
            }
        }
    }
}

CASE(noise_free_motion_gives_the_parameters_back) {
    for (uint32_t seed = 0; seed < 5; seed++) {
        check_motion(SETTING_A, seed, 0, &axt_axis_paper, 10, exact);
        check_motion(SETTING_B, seed, 0, &axt_axis_paper, 10, exact);
        check_motion(SETTING_A, seed, 100, &axt_axis_paper, 10, exact);
        check_motion(SETTING_B, seed, -100, &axt_axis_paper, 10, exact);
    }
}

CASE(a_thousand_periods_are_as_good_as_one) {
    check_motion(SETTING_A, 0, 0, &axt_axis_paper, 1000 / SHORTENED, exact);
    check_motion(SETTING_B, 0, 0, &axt_axis_paper, 1000 / SHORTENED, exact);
    check_motion(SETTING_A, 0, 100, &axt_axis_paper, 1000 / SHORTENED, exact);
    check_motion(SETTING_B, 0, 100, &axt_axis_paper, 1000 / SHORTENED, exact);
}

CASE(what_was_expected_may_be_wrong_by_a_factor_of_ten) {
    uint64_t seed = 1;
    for (uint32_t n = 0; n < 20; n++) {
        const axt_axis expected = {.I1 = axt_axis_paper.I1 * log_uniform(&seed, 0.1, 10),
                                   .I2 = axt_axis_paper.I2 * log_uniform(&seed, 0.1, 10),
                                   .B = axt_axis_paper.B * log_uniform(&seed, 0.1, 10),
                                   .K = axt_axis_paper.K * log_uniform(&seed, 0.1, 10)};
        check_motion((n % 2 == 0) ? SETTING_A : SETTING_B, n, (n % 4 < 2) ? 0 : 100, &expected, 10,
                     nearly_exact);
    }
}

CASE(modal_properties_are_those_of_the_axis_found) {
    static bench b;
    bench_start(&b, SETTING_B, 1, 0);
    const axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_B);
    axt_ident ident = ident_of(&config);
    while (b.sample < b.period) {
        bench_step(&b);
        take_motion(&ident, &b);
    }
    const axt_estimate estimate = estimate_of(&ident);
    const wide sum = 1 / b.axis.I[0] + 1 / b.axis.I[1];
    const wide wn = sqrtl(b.axis.K * sum);
    const wide zeta = b.axis.B * sum / (2 * wn);
    CHECK_NEAR((wide)estimate.modal.wn / wn, 1, exact);
    CHECK_NEAR((wide)estimate.modal.zeta / zeta, 1, exact);
    CHECK_NEAR((wide)estimate.modal.wd / (wn * sqrtl(1 - zeta * zeta)), 1, exact);
    CHECK_EQUAL(estimate.samples, b.period - 1);
}

/* ---- Held torque ------------------------------------------------------------------------------
 */

static held_map held_map_of_axis(const textbook_axis *axis) {
    const wide sum = 1 / axis->I[0] + 1 / axis->I[1];
    return held_map_of(axis->B * sum, axis->K * sum, axis->time_step);
}

/* One sample on: the torque of the last one has acted until now. */
static void bench_step_held(bench *b, const held_map *map) {
    if (b->sample > 0) {
        held_step(&b->axis, map, (wide)b->torque);
    }
    b->torque = b->table[b->sample % b->period];
    b->sample++;
}

CASE(motion_under_held_torque_gives_the_parameters_back) {
    for (uint32_t n = 0; n < 8; n++) {
        static bench b;
        const setting which = (n % 2 == 0) ? SETTING_A : SETTING_B;
        bench_start(&b, which, n / 4, (n % 4 < 2) ? 0 : 100);
        const held_map map = held_map_of_axis(&b.axis);
        axt_ident ident[FORMS];
        for (size_t i = 0; i < FORMS; i++) {
            axt_ident_config config = config_of(forms[i], which);
            config.hold = AXT_HOLD_ZERO;
            ident[i] = ident_of(&config);
        }
        while (b.sample < 10 * b.period) {
            bench_step_held(&b, &map);
            for (size_t i = 0; i < FORMS; i++) {
                take_motion(&ident[i], &b);
                if (b.sample == b.period || b.sample == 10 * b.period) {
                    const double within = (forms[i] == AXT_IDENT_3X2) ? exact : nearly_exact;
                    check_estimate(&ident[i], within, within);
                }
            }
        }
    }
}

/* Taken for linear, a held torque biases the stiffness by (wn Dt)^2 / 12 or so: the test above
 * would see it. */
CASE(the_wrong_hold_shows) {
    static bench b;
    bench_start(&b, SETTING_B, 1, 0);
    const held_map map = held_map_of_axis(&b.axis);
    const axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_B);
    axt_ident ident = ident_of(&config);
    while (b.sample < 4 * b.period) {
        bench_step_held(&b, &map);
        take_motion(&ident, &b);
    }
    const axt_estimate estimate = estimate_of(&ident);
    const double x = 2 * (double)PI * 146 / 2048;
    CHECK(fabs((double)(estimate.axis.K / axt_axis_paper.K) - 1) > x * x / 24);
}

CASE(counts_under_held_torque_give_the_parameters) {
    static const uint32_t resolutions[][2] = {
        {1048576, 1048576}, {1048576, 262144}, {AXT_ENCODER_COUNTS_MAX, 1000003}};
    for (uint32_t n = 0; n < 12; n++) {
        static bench b;
        const setting which = (n % 2 == 0) ? SETTING_A : SETTING_B;
        bench_start(&b, which, n / 4, (n % 4 < 2) ? 0 : 100);
        const held_map map = held_map_of_axis(&b.axis);
        axt_ident_config config = config_of(AXT_IDENT_3X2, which);
        config.hold = AXT_HOLD_ZERO;
        memcpy(config.counts_per_turn, resolutions[n % COUNT_OF(resolutions)],
               sizeof config.counts_per_turn);
        axt_ident ident = ident_of(&config);
        while (b.sample < 6 * b.period) {
            bench_step_held(&b, &map);
            take_counts(&ident, &b);
        }
        check_estimate(&ident, 2e-3, 2e-2);
    }
}

CASE(the_full_form_from_counts_under_held_torque_is_refused) {
    axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 1048576;
    axt_ident ident = ident_of(&config);
    const axt_ident before = ident;
    config.hold = AXT_HOLD_ZERO;
    CHECK_EQUAL(axt_ident_init(&ident, &config), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(ident, before));
    config.counts_per_turn[0] = config.counts_per_turn[1] = 0;
    CHECK_EQUAL(axt_ident_init(&ident, &config), AXT_OK);
}

/* ---- Encoders alone ------------------------------------------------------------------------- */

CASE(counts_alone_give_the_parameters) {
    static const uint32_t resolutions[][2] = {
        {1048576, 1048576}, {1048576, 262144}, {AXT_ENCODER_COUNTS_MAX, 1000003}};
    for (uint32_t n = 0; n < 24; n++) {
        static bench b;
        const setting which = (n % 2 == 0) ? SETTING_A : SETTING_B;
        bench_start(&b, which, n / 4, (n % 4 < 2) ? 0 : 100);
        axt_ident ident[FORMS];
        for (size_t i = 0; i < FORMS; i++) {
            axt_ident_config config = config_of(forms[i], which);
            memcpy(config.counts_per_turn, resolutions[n % COUNT_OF(resolutions)],
                   sizeof config.counts_per_turn);
            ident[i] = ident_of(&config);
        }
        while (b.sample < 4 * b.period) {
            bench_step(&b);
            for (size_t i = 0; i < FORMS; i++) {
                take_counts(&ident[i], &b);
            }
        }
        for (size_t i = 0; i < FORMS; i++) {
            check_estimate(&ident[i], 2e-3, 2e-2);
        }
    }
}

/* The registers wrap around, and each encoder has a zero of its own. */
CASE(neither_the_zero_of_an_encoder_nor_its_wrap_changes_a_bit) {
    for (size_t i = 0; i < FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_B, 1, 300);
        axt_ident_config config = config_of(forms[i], SETTING_B);
        config.counts_per_turn[0] = config.counts_per_turn[1] = AXT_ENCODER_COUNTS_MAX;
        axt_ident plain = ident_of(&config);
        axt_ident shifted = plain;
        while (b.sample < 4 * b.period) { /* some 40 turns, 6e8 counts */
            bench_step(&b);
            const uint32_t motor = (uint32_t)bench_count(&b, 0, AXT_ENCODER_COUNTS_MAX);
            const uint32_t table = (uint32_t)bench_count(&b, 1, AXT_ENCODER_COUNTS_MAX);
            CHECK(taken(
                axt_ident_counts(&plain, b.sample, (int32_t)motor, (int32_t)table, b.torque)));
            CHECK(taken(axt_ident_counts(&shifted, b.sample + 0x80000000U,
                                         (int32_t)(motor + 0x7FFFFFFFU),
                                         (int32_t)(table + 0x90000000U), b.torque)));
        }
        check_estimate(&plain, 2e-3, 2e-2);
        CHECK(UNCHANGED(shifted.rls, plain.rls));
    }
}

/* ---- Standard errors ------------------------------------------------------------------------ */

/* Torque that the estimator does not know of, whose mean over each step is white. */
static wide with_white_mean(uint64_t *seed, wide size, wide last) {
    return 2 * size * (wide)gaussian(seed) - last;
}

static void check_standard_errors(const axt_axis *axis) {
    enum { RUNS = 400, QUANTITIES = 7 };
    uint64_t seed = 2;
    double scatter[FORMS][QUANTITIES] = {{0}}; /* mean squares: of what is off, */
    double stated[FORMS][QUANTITIES] = {{0}};  /* and of its standard error */
    int inside[FORMS][QUANTITIES] = {{0}};     /* the 95 % interval */
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(axis, &modal), AXT_OK);
    for (uint32_t run = 0; run < RUNS; run++) {
        static bench b;
        bench_start_axis(&b, axis, SETTING_A, run + 1, 0);
        axt_ident ident[FORMS];
        for (size_t i = 0; i < FORMS; i++) {
            const axt_ident_config config = config_of(forms[i], SETTING_A);
            ident[i] = ident_of(&config);
        }
        wide on_motor = 0;
        wide on_table = 0;
        while (b.sample < 4 * b.period) {
            on_motor = with_white_mean(&seed, 2e-3L, on_motor);
            on_table = with_white_mean(&seed, 2e-3L, on_table);
            bench_step_disturbed(&b, on_motor, on_table);
            for (size_t i = 0; i < FORMS; i++) {
                take_motion(&ident[i], &b);
            }
        }
        for (size_t i = 0; i < FORMS; i++) {
            const axt_estimate e = estimate_of(&ident[i]);
            const axt_real off[QUANTITIES] = {e.axis.I1 - axis->I1,     e.axis.I2 - axis->I2,
                                              e.axis.B - axis->B,       e.axis.K - axis->K,
                                              e.modal.wn - modal.wn,    e.modal.wd - modal.wd,
                                              e.modal.zeta - modal.zeta};
            const axt_real error[QUANTITIES] = {
                e.axis_error.I1,  e.axis_error.I2,  e.axis_error.B,    e.axis_error.K,
                e.modal_error.wn, e.modal_error.wd, e.modal_error.zeta};
            for (int q = 0; q < QUANTITIES; q++) {
                const double ratio = (double)off[q] / (double)error[q];
                scatter[i][q] += (double)off[q] * (double)off[q] / RUNS;
                stated[i][q] += (double)error[q] * (double)error[q] / RUNS;
                inside[i][q] += (fabs(ratio) < 1.96) ? 1 : 0;
            }
        }
    }
    for (size_t i = 0; i < FORMS; i++) {
        for (int q = 0; q < QUANTITIES; q++) {
            /* over 400 runs these scatter by 0.035 and 1.1 % themselves */
            CHECK_NEAR(sqrt(stated[i][q] / scatter[i][q]), 1, 0.15);
            CHECK_NEAR(inside[i][q] / (double)RUNS, 0.95, 0.045);
        }
    }
}

CASE(standard_errors_are_the_scatter_of_many_runs) {
    check_standard_errors(&axt_axis_paper);
    const axt_axis damped = {
        .I1 = (axt_real)2e-5, .I2 = (axt_real)1.5e-5, .B = (axt_real)0.02, .K = 110};
    check_standard_errors(&damped); /* zeta 0.33: all terms of the gradients count */
}

CASE(a_parameter_is_valid_when_its_error_is_below_a_tenth) {
    uint64_t seed = 4;
    uint32_t seen = 0; /* combinations of flags, a bit each */
    for (uint32_t run = 0; run < 60; run++) {
        static bench b;
        bench_start(&b, SETTING_A, run + 1, 0);
        const axt_ident_config config = config_of(forms[run % FORMS], SETTING_A);
        axt_ident ident = ident_of(&config);
        const wide size = (wide)log_uniform(&seed, 1e-3, 1);
        wide on_motor = 0;
        while (b.sample < b.period) {
            on_motor = with_white_mean(&seed, size, on_motor);
            bench_step_disturbed(&b, on_motor, 0);
            take_motion(&ident, &b);
        }
        axt_estimate e;
        if (axt_ident_result(&ident, &e) == AXT_OK) {
            CHECK_EQUAL((e.valid & AXT_VALID_I1) != 0, 10 * e.axis_error.I1 < e.axis.I1);
            CHECK_EQUAL((e.valid & AXT_VALID_I2) != 0, 10 * e.axis_error.I2 < e.axis.I2);
            CHECK_EQUAL((e.valid & AXT_VALID_B) != 0, 10 * e.axis_error.B < e.axis.B);
            CHECK_EQUAL((e.valid & AXT_VALID_K) != 0, 10 * e.axis_error.K < e.axis.K);
            seen |= UINT32_C(1) << e.valid;
        }
    }
    /* all of them, all but the damping, none */
    const uint32_t expected = (UINT32_C(1) << AXT_VALID_ALL) |
                              (UINT32_C(1) << (AXT_VALID_ALL - AXT_VALID_B)) | UINT32_C(1);
    CHECK_EQUAL(seen & expected, expected);
}

/* ---- Nothing is learned from what shows nothing --------------------------------------------- */

static void check_knows_nothing(const axt_ident *ident) {
    axt_estimate estimate;
    memset(&estimate, 0x55, sizeof estimate);
    if (axt_ident_result(ident, &estimate) != AXT_ERROR_NO_DATA) {
        CHECK_EQUAL(estimate.valid, 0);
    } else {
        axt_estimate nothing = {.samples = estimate.samples};
        CHECK(UNCHANGED(estimate, nothing));
    }
}

CASE(no_sample_no_answer) {
    for (size_t i = 0; i < FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_A, 0, 0);
        const axt_ident_config config = config_of(forms[i], SETTING_A);
        axt_ident ident = ident_of(&config);
        for (int n = 0; n < 10; n++) {
            check_knows_nothing(&ident);
            bench_step(&b);
            take_motion(&ident, &b);
        }
    }
}

/* At rest, at constant speed, and under a constant torque that only accelerates. */
CASE(an_axis_that_does_not_vibrate_tells_nothing) {
    const wide inertia = (wide)axt_axis_paper.I1 + (wide)axt_axis_paper.I2;
    const wide torque = 0.1L;
    const wide twist = torque * (wide)axt_axis_paper.I2 / inertia / (wide)axt_axis_paper.K;
    for (size_t i = 0; i < FORMS; i++) {
        const axt_ident_config config = config_of(forms[i], SETTING_A);
        axt_ident at_rest = ident_of(&config);
        axt_ident moving = at_rest;
        axt_ident accelerating = at_rest;
        for (int n = 0; n < 20000; n++) {
            const wide t = n * (wide)config.time_step;
            const axt_motion rest = {.fraction = (axt_real)0.1};
            const axt_motion steady = {.speed = 10, .fraction = (axt_real)(10 * t / (2 * PI))};
            const axt_motion faster = {.twist = (axt_real)twist,
                                       .speed = (axt_real)(torque / inertia * t),
                                       .fraction =
                                           (axt_real)(torque / inertia * t * t / 2 / (2 * PI))};
            const uint32_t number = (uint32_t)n;
            CHECK(taken(axt_ident_motion(&at_rest, number, &rest, 0)));
            CHECK(taken(axt_ident_motion(&moving, number, &steady, 0)));
            CHECK(taken(axt_ident_motion(&accelerating, number, &faster, (axt_real)torque)));
        }
        check_knows_nothing(&at_rest);
        check_knows_nothing(&moving);
        check_knows_nothing(&accelerating);
    }
}

CASE(encoders_that_flicker_at_rest_teach_nothing) {
    static const uint32_t resolutions[][2] = {
        {1048576, 1048576}, {AXT_ENCODER_COUNTS_MAX, 20000}, {20000, AXT_ENCODER_COUNTS_MAX}};
    for (size_t i = 0; i < FORMS * COUNT_OF(resolutions); i++) {
        static bench b;
        bench_start(&b, SETTING_B, 1, 0);
        axt_ident_config config = config_of(forms[i % FORMS], SETTING_B);
        memcpy(config.counts_per_turn, resolutions[i / FORMS], sizeof config.counts_per_turn);
        config.forgetting = (axt_real)0.995;
        axt_ident fresh = ident_of(&config);
        axt_ident taught = fresh;
        while (b.sample < 4 * b.period) {
            bench_step(&b);
            take_counts(&taught, &b);
        }
        const axt_rls before = taught.rls;
        uint64_t seed = 3;
        for (int n = 0; n < 100000 / SHORTENED; n++) {
            const uint64_t bits = random_bits(&seed);
            const int32_t motor = (int32_t)(bits % 2);
            const int32_t table = (int32_t)(bits / 2 % 2);
            const uint32_t number = b.sample + 2 + (uint32_t)n; /* after a gap */
            CHECK_EQUAL(axt_ident_counts(&fresh, number, motor, table, 0), AXT_ERROR_NO_DATA);
            CHECK_EQUAL(axt_ident_counts(&taught, number, motor, table, 0), AXT_ERROR_NO_DATA);
        }
        check_knows_nothing(&fresh);
        CHECK(UNCHANGED(taught.rls, before));
    }
}

/* ---- Gaps, refusals, reset ------------------------------------------------------------------ */

CASE(nothing_is_learned_across_a_gap) {
    for (size_t i = 0; i < FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_A, 1, 0);
        const axt_ident_config config = config_of(forms[i], SETTING_A);
        axt_ident told = ident_of(&config);
        axt_ident untold = told;
        while (b.sample < 4 * b.period) {
            bench_step(&b);
            if (b.sample % 50 != 0) { /* that one is lost */
                const axt_motion motion = bench_motion(&b);
                const uint32_t unbroken = b.sample - b.sample / 50;
                take_motion(&told, &b);
                CHECK(taken(axt_ident_motion(&untold, unbroken, &motion, b.torque)));
            }
        }
        CHECK_EQUAL(told.counters.gaps, (4 * b.period - 1) / 50);
        CHECK_EQUAL(untold.counters.gaps, 0);
        check_estimate(&told, exact, exact);
        const double off = (double)estimate_of(&untold).axis.I1 / (double)axt_axis_paper.I1 - 1;
        CHECK(fabs(off) > 1e-3);
    }
}

CASE(counts_settle_anew_after_a_gap) {
    static bench b;
    bench_start(&b, SETTING_B, 1, 0);
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_B);
    config.counts_per_turn[0] = config.counts_per_turn[1] = AXT_ENCODER_COUNTS_MAX;
    axt_ident ident = ident_of(&config);
    while (b.sample < 8 * b.period) {
        bench_step(&b);
        if (b.sample % 700 != 0) {
            take_counts(&ident, &b);
        }
    }
    check_estimate(&ident, 2e-3, 2e-2);
}

CASE(a_refused_sample_is_counted_and_its_step_skipped) {
    for (size_t i = 0; i < FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_A, 1, 0);
        const axt_ident_config config = config_of(forms[i], SETTING_A);
        axt_ident ident = ident_of(&config);
        uint32_t refused = 0;
        while (b.sample < 4 * b.period) {
            bench_step(&b);
            if (b.sample % 50 != 0) {
                take_motion(&ident, &b);
                continue;
            }
            axt_motion motion = bench_motion(&b);
            axt_real torque = b.torque;
            axt_real *const elements[] = {&motion.twist,    &motion.twist_speed,  &motion.speed,
                                          &motion.fraction, &motion.fraction_low, &torque};
            *elements[refused % COUNT_OF(elements)] = not_finite[refused % COUNT_OF(not_finite)];
            axt_ident expected = ident;
            CHECK_EQUAL(axt_ident_motion(&ident, b.sample, &motion, torque), AXT_ERROR_NOT_FINITE);
            expected.counters.not_finite++;
            CHECK(UNCHANGED(ident, expected));
            refused++;
        }
        CHECK_EQUAL(ident.counters.not_finite, refused);
        CHECK_EQUAL(ident.counters.gaps, refused); /* one after each */
        check_estimate(&ident, exact, exact);
        /* neither the step to the refused sample nor the one from it */
        CHECK_EQUAL(estimate_of(&ident).samples, 4 * b.period - 1 - 2 * refused);
    }
}

CASE(a_motion_that_the_axis_cannot_reach_is_refused) {
    const axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
    axt_ident ident = ident_of(&config);
    const axt_motion rest = {.twist = 0};
    const axt_motion absurd[] = {{.twist_speed = (axt_real)1e4}, {.speed = (axt_real)-1e4}};
    CHECK_EQUAL(axt_ident_motion(&ident, 0, &rest, 0), AXT_ERROR_NO_DATA);
    axt_ident expected = ident;
    for (size_t i = 0; i < COUNT_OF(absurd); i++) {
        CHECK_EQUAL(axt_ident_motion(&ident, 1, &absurd[i], 0), AXT_ERROR_JUMP);
        expected.counters.jumped++;
        CHECK(UNCHANGED(ident, expected));
    }
    CHECK_EQUAL(axt_ident_motion(&ident, 2, &rest, 0), AXT_ERROR_NO_DATA); /* afresh */
    CHECK_EQUAL(axt_ident_motion(&ident, 3, &rest, 0), AXT_OK);
    CHECK_EQUAL(ident.samples, 1);
    CHECK_EQUAL(ident.counters.gaps, 1);
}

/* What no first sample can be judged by, the update of the estimator refuses. */
CASE(a_motion_beyond_all_bounds_is_refused_whenever_it_comes) {
    const axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
    axt_ident ident = ident_of(&config);
    const axt_motion absurd = {.twist = (axt_real)1e30};
    CHECK_EQUAL(axt_ident_motion(&ident, 0, &absurd, 0), AXT_ERROR_NO_DATA);
    CHECK(axt_ident_motion(&ident, 1, &absurd, 0) < 0);
    CHECK_EQUAL(ident.samples, 0);
    CHECK_EQUAL(ident.counters.range + ident.counters.not_finite, 1);
}

/* A spike on either encoder, at any phase of a running axis, and what the axis itself does. */
CASE(counts_that_jump_are_refused_and_no_others) {
    static bench b;
    bench_start(&b, SETTING_A, 1, -50);
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 1048576;
    axt_ident ident = ident_of(&config);
    uint32_t spikes = 0;
    while (b.sample < 20 * b.period) {
        bench_step(&b);
        if (b.sample % 499 != 0) {
            take_counts(&ident, &b);
            continue;
        }
        const int32_t spike = (spikes % 4 < 2) ? 2000 : INT32_MIN;
        int32_t count[2] = {bench_count(&b, 0, 1048576), bench_count(&b, 1, 1048576)};
        count[spikes % 2] = (int32_t)((uint32_t)count[spikes % 2] + (uint32_t)spike);
        axt_ident expected = ident;
        expected.counters.jumped++;
        CHECK_EQUAL(axt_ident_counts(&ident, b.sample, count[0], count[1], b.torque),
                    AXT_ERROR_JUMP);
        CHECK(UNCHANGED(ident, expected));
        spikes++;
    }
    CHECK(spikes >= 20);
    CHECK_EQUAL(ident.counters.jumped, spikes);
    check_estimate(&ident, 2e-3, 2e-2);
}

CASE(a_sample_that_is_not_newer_is_refused) {
    static const uint32_t starts[] = {0, 1000, 0x7FFFFFF0, 0xFFFFFFF0};
    for (size_t i = 0; i < COUNT_OF(starts) * FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_A, 1, 0);
        const axt_ident_config config = config_of(forms[i % FORMS], SETTING_A);
        axt_ident ident = ident_of(&config);
        const uint32_t start = starts[i / FORMS];
        uint64_t seed = i;
        uint32_t repeated = 0;
        while (b.sample < 2 * b.period) {
            bench_step(&b);
            const axt_motion motion = bench_motion(&b);
            const uint32_t number = start + b.sample;
            CHECK(taken(axt_ident_motion(&ident, number, &motion, b.torque)));
            if (b.sample % 9 == 0) { /* this one again, or one from long ago */
                const uint32_t old = number - (uint32_t)(random_bits(&seed) % 0x7FFFFFFF);
                axt_ident expected = ident;
                expected.counters.repeated++;
                CHECK_EQUAL(
                    axt_ident_motion(&ident, (repeated % 2 == 0) ? number : old, &motion, b.torque),
                    AXT_ERROR_REPEATED);
                CHECK(UNCHANGED(ident, expected));
                repeated++;
            }
        }
        CHECK_EQUAL(ident.counters.gaps, 0);
        check_estimate(&ident, nearly_exact, nearly_exact);
    }
}

CASE(a_bad_torque_with_counts_is_refused) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 1048576;
    axt_ident ident = ident_of(&config);
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        CHECK_EQUAL(axt_ident_counts(&ident, 0, 1, 1, not_finite[i]), AXT_ERROR_NOT_FINITE);
    }
    CHECK_EQUAL(axt_ident_counts(&ident, 0, 1, 1, (axt_real)201), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_ident_counts(&ident, 0, 1, 1, (axt_real)-201), AXT_ERROR_RANGE);
    CHECK_EQUAL(ident.counters.not_finite, COUNT_OF(not_finite));
    CHECK_EQUAL(ident.counters.range, 2);
    CHECK_EQUAL(ident.samples, 0);
}

CASE(the_counters_stop_at_their_ends) {
    const axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    axt_ident ident = ident_of(&config);
    const axt_motion rest = {.twist = 0};
    const axt_motion absurd = {.speed = (axt_real)1e6};
    const uint32_t full = UINT32_MAX;
    ident.counters = (axt_ident_counters){full, full, full, full, full};
    ident.samples = full;
    CHECK_EQUAL(axt_ident_motion(&ident, 5, &rest, 0), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_ident_motion(&ident, 6, &rest, 0), AXT_OK);
    CHECK_EQUAL(axt_ident_motion(&ident, 5, &rest, 0), AXT_ERROR_REPEATED);
    CHECK_EQUAL(axt_ident_motion(&ident, 7, &absurd, 0), AXT_ERROR_JUMP);
    CHECK_EQUAL(axt_ident_motion(&ident, 7, &rest, not_finite[0]), AXT_ERROR_NOT_FINITE);
    CHECK_EQUAL(axt_ident_motion(&ident, 9, &rest, 0), AXT_ERROR_NO_DATA);
    const axt_ident_counters expected = {full, full, full, full, full};
    CHECK(UNCHANGED(ident.counters, expected));
    CHECK_EQUAL(ident.samples, full);
}

CASE(the_wrong_kind_of_sample_is_refused_and_changes_nothing) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    axt_ident by_motion = ident_of(&config);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 1048576;
    axt_ident by_counts = ident_of(&config);
    const axt_ident motion_before = by_motion;
    const axt_ident counts_before = by_counts;
    const axt_motion motion = {.twist = 0};
    CHECK_EQUAL(axt_ident_counts(&by_motion, 0, 1, 1, 0), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_ident_motion(&by_counts, 0, &motion, 0), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(by_motion, motion_before));
    CHECK(UNCHANGED(by_counts, counts_before));
}

CASE(after_a_reset_all_is_learned_anew) {
    for (size_t i = 0; i < FORMS; i++) {
        for (uint32_t counts = 0; counts <= 1048576; counts += 1048576) {
            static bench b;
            bench_start(&b, SETTING_B, 1, 20);
            axt_ident_config config = config_of(forms[i], SETTING_B);
            config.counts_per_turn[0] = config.counts_per_turn[1] = counts;
            axt_ident fresh = ident_of(&config);
            axt_ident reset = fresh;
            void (*const take)(axt_ident *, const bench *) =
                (counts == 0) ? take_motion : take_counts;
            while (b.sample < 1000) {
                bench_step(&b);
                take(&reset, &b);
            }
            axt_ident_reset(&reset);
            check_knows_nothing(&reset);
            while (b.sample < 3000) {
                bench_step(&b);
                take(&reset, &b);
                take(&fresh, &b);
            }
            const axt_estimate expected = estimate_of(&fresh);
            const axt_estimate estimate = estimate_of(&reset);
            CHECK(UNCHANGED(estimate, expected));
        }
    }
}

CASE(counts_of_a_sample_that_is_not_newer_are_refused) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    config.counts_per_turn[0] = config.counts_per_turn[1] = 1048576;
    axt_ident ident = ident_of(&config);
    CHECK_EQUAL(axt_ident_counts(&ident, 7, 0, 0, 0), AXT_ERROR_NO_DATA);
    CHECK_EQUAL(axt_ident_counts(&ident, 7, 0, 0, 0), AXT_ERROR_REPEATED);
    CHECK_EQUAL(ident.counters.repeated, 1);
}

CASE(there_is_an_answer_before_its_errors_are_known_but_none_to_rely_on) {
    static bench b;
    bench_start(&b, SETTING_B, 1, 0);
    const axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_B);
    axt_ident ident = ident_of(&config);
    while (b.sample < 150) {
        bench_step(&b);
        take_motion(&ident, &b);
    }
    const axt_estimate estimate = estimate_of(&ident);
    check_axis(&estimate.axis, 1e-4, 1e-3);
    CHECK_EQUAL(estimate.valid, 0);
    CHECK_NEAR(estimate.axis_error.K, 0, 0);
}

/* zeta = 6: no vibration, and over long steps held torque hardly tells K and B. */
CASE(an_axis_damped_beyond_critical_is_found_or_there_is_no_answer) {
    axt_axis axis = axt_axis_paper;
    axis.B *= 150;
    for (int hold = 0; hold < 2; hold++) {
        static bench b;
        bench_start_axis(&b, &axis, SETTING_B, 1, 0);
        const held_map map = held_map_of_axis(&b.axis);
        axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_B);
        config.hold = (axt_hold)hold;
        axt_ident ident = ident_of(&config);
        while (b.sample < 2 * b.period) {
            if (hold == 0) {
                bench_step(&b);
            } else {
                bench_step_held(&b, &map);
            }
            take_motion(&ident, &b);
        }
        axt_estimate e;
        const axt_status status = axt_ident_result(&ident, &e);
        CHECK_EQUAL(status, (hold == 0) ? AXT_OK : AXT_ERROR_NO_DATA);
        if (status == AXT_OK) {
            CHECK_NEAR(e.axis.K / axis.K, 1, 1e-4);
            CHECK_NEAR(e.axis.B / axis.B, 1, 1e-4);
            CHECK_NEAR(e.modal.wd, 0, 0);
            CHECK(isfinite((double)e.modal_error.wd) && e.modal_error.zeta > 0);
        }
    }
}

/* Counts at most wrap around: beyond half of their range there is no telling a jump. */
CASE(the_limit_of_a_jump_stays_within_the_range_of_counts) {
    axt_ident_config config = config_of(AXT_IDENT_3X2, SETTING_A);
    config.counts_per_turn[0] = config.counts_per_turn[1] = AXT_ENCODER_COUNTS_MAX;
    config.torque = 1e6;
    config.time_step = (axt_real)0.1;
    const axt_ident ident = ident_of(&config);
    CHECK_EQUAL(ident.guard.change_max[0], 1 << 30);
    CHECK_EQUAL(ident.guard.change_max[1], 1 << 30);
}

/* ---- Invariances ---------------------------------------------------------------------------- */

CASE(neither_sign_nor_turns_change_a_bit) {
    for (size_t i = 0; i < FORMS; i++) {
        static bench b;
        bench_start(&b, SETTING_B, 1, 40);
        const axt_ident_config config = config_of(forms[i], SETTING_B);
        axt_ident plain = ident_of(&config);
        axt_ident negative = plain;
        axt_ident far = plain;
        while (b.sample < 2 * b.period) {
            bench_step(&b);
            axt_motion motion = bench_motion(&b);
            CHECK(taken(axt_ident_motion(&plain, b.sample, &motion, b.torque)));
            motion.turns = (int32_t)((uint32_t)motion.turns + 0x7FFFFFFEU);
            CHECK(taken(axt_ident_motion(&far, b.sample, &motion, b.torque)));
            motion.turns = -(int32_t)((uint32_t)motion.turns - 0x7FFFFFFEU);
            motion.twist = -motion.twist;
            motion.twist_speed = -motion.twist_speed;
            motion.speed = -motion.speed;
            motion.fraction = -motion.fraction;
            motion.fraction_low = -motion.fraction_low;
            CHECK(taken(axt_ident_motion(&negative, b.sample, &motion, -b.torque)));
        }
        const axt_estimate expected = estimate_of(&plain);
        const axt_estimate of_negative = estimate_of(&negative);
        const axt_estimate of_far = estimate_of(&far);
        CHECK(UNCHANGED(of_negative, expected));
        CHECK(UNCHANGED(of_far, expected));
    }
}

CASE(it_does_not_matter_when_one_starts_to_listen) {
    for (uint32_t start = 0; start < 512; start += 73) {
        for (size_t i = 0; i < FORMS; i++) {
            static bench b;
            bench_start(&b, SETTING_A, 0, 0);
            const axt_ident_config config = config_of(forms[i], SETTING_A);
            axt_ident ident = ident_of(&config);
            while (b.sample < start + 2 * b.period) {
                bench_step(&b);
                if (b.sample > start) {
                    take_motion(&ident, &b);
                }
            }
            check_estimate(&ident, nearly_exact, nearly_exact);
        }
    }
}

/* ---- The surplus entries of the 5x4 matrix -------------------------------------------------- */

enum { Q, R, Q_RATE, R_RATE, TORQUE };

/* Entry of the matrix of Eq. 8 in twist and rigid-body coordinates, in units of 1 / time. */
static double entry(const axt_ident *ident, uint32_t output, uint32_t input) {
    return (double)ident->rls.theta[output][input] *
           (double)(ident->regressor.scale[input] / ident->regressor.output_scale[output]);
}

CASE(the_surplus_entries_of_an_ideal_axis_are_zero) {
    static bench b;
    bench_start(&b, SETTING_A, 0, 300); /* many turns: the angle is reckoned from a nearby zero */
    const axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
    axt_ident ident = ident_of(&config);
    while (b.sample < 50 * b.period) {
        bench_step(&b);
        take_motion(&ident, &b);
    }
    /* the rates of q and r are q' and r'; the rates of q' and r' depend on neither r nor r' */
    CHECK_NEAR(entry(&ident, Q, Q_RATE), 1, BY_TYPE(1e-5, 1e-10));
    CHECK_NEAR(entry(&ident, R, R_RATE), 1, BY_TYPE(1e-5, 1e-10));
    static const uint32_t surplus[][2] = {
        {Q, Q},      {Q, R},      {Q, R_RATE}, {Q, TORQUE},      {R, Q},      {R, R},
        {R, Q_RATE}, {R, TORQUE}, {Q_RATE, R}, {Q_RATE, R_RATE}, {R_RATE, R}, {R_RATE, R_RATE}};
    for (size_t i = 0; i < COUNT_OF(surplus); i++) {
        CHECK_NEAR(ident.rls.theta[surplus[i][0]][surplus[i][1]], 0, BY_TYPE(1e-5, 1e-10));
    }
}

/* Friction and springs to ground in proportion to the inertias slow all motion down at one rate and
 * pull it back with one stiffness: they appear in the speed and the angle columns. */
static const wide ground_friction = 5;
static const wide ground_stiffness = 3e3L;

static void bench_step_grounded(bench *b) {
    bench ahead = *b;
    for (int n = 0; n < 20; n++) { /* what acts at the end of the step depends on the step */
        const wide on_motor = -b->axis.I[0] * (ground_friction * ahead.axis.speed[0] +
                                               ground_stiffness * ahead.axis.angle[0]);
        const wide on_table = -b->axis.I[1] * (ground_friction * ahead.axis.speed[1] +
                                               ground_stiffness * ahead.axis.angle[1]);
        ahead = *b;
        bench_step_disturbed(&ahead, on_motor, on_table);
    }
    *b = ahead;
}

static void check_ground(const axt_ident *ident, const bench *b, double tolerance) {
    const wide sum = 1 / b->axis.I[0] + 1 / b->axis.I[1];
    const double damping = (double)(b->axis.B * sum + ground_friction);
    const double stiffness = (double)(b->axis.K * sum + ground_stiffness);
    CHECK_NEAR(entry(ident, R_RATE, R_RATE) / (double)ground_friction, -1, 20 * tolerance);
    CHECK_NEAR(entry(ident, R_RATE, R) / (double)ground_stiffness, -1, 20 * tolerance);
    CHECK_NEAR(entry(ident, Q_RATE, Q_RATE) / damping, -1, tolerance);
    CHECK_NEAR(entry(ident, Q_RATE, Q) / stiffness, -1, tolerance);
    CHECK_NEAR(entry(ident, Q_RATE, TORQUE) * (double)b->axis.I[0], 1, tolerance);
    CHECK_NEAR(entry(ident, R_RATE, TORQUE) * (double)(b->axis.I[0] + b->axis.I[1]), 1, tolerance);
}

/* How often |t| of friction and of spring is above 1.96, when the axis is held back by so much
 * friction [N m s/rad] and so stiff a spring [N m/rad], and torque acts that nobody knows of. */
static void count_alarms(wide friction, wide spring, double share[2]) {
    enum { RUNS = 300 };
    uint64_t seed = 11;
    share[0] = share[1] = 0;
    for (uint32_t run = 0; run < RUNS; run++) {
        static bench b;
        bench_start(&b, SETTING_A, run + 1, (wide)uniform(&seed, -20, 20));
        const axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
        axt_ident ident = ident_of(&config);
        wide unknown = 0;
        while (b.sample < 4 * b.period) {
            unknown = with_white_mean(&seed, 2e-3L, unknown);
            bench_step_disturbed(
                &b, unknown - friction * b.axis.speed[0] - spring * b.axis.angle[0], 0);
            take_motion(&ident, &b);
        }
        const axt_estimate e = estimate_of(&ident);
        share[0] += (fabs((double)e.friction.t) > 1.96) ? 1.0 / RUNS : 0;
        share[1] += (fabs((double)e.spring.t) > 1.96) ? 1.0 / RUNS : 0;
    }
}

CASE(friction_and_spring_are_found_where_they_are_and_seldom_where_they_are_not) {
    double none[2];
    double friction[2];
    double spring[2];
    count_alarms(0, 0, none);
    count_alarms(2e-4L, 0, friction);
    count_alarms(0, 0.1L, spring);
    for (int i = 0; i < 2; i++) {
        CHECK_NEAR(none[i], 0.05, 0.04); /* of 300 runs: three times its own scatter */
    }
    CHECK(friction[0] > 0.95);
    CHECK(spring[1] > 0.95);
}

CASE(friction_and_springs_to_ground_show_in_the_surplus_entries) {
    static bench b;
    bench_start(&b, SETTING_A, 0, 20);
    axt_ident_config config = config_of(AXT_IDENT_5X4, SETTING_A);
    axt_ident by_motion = ident_of(&config);
    config.counts_per_turn[0] = config.counts_per_turn[1] = AXT_ENCODER_COUNTS_MAX;
    axt_ident by_counts = ident_of(&config);
    while (b.sample < 40 * b.period) {
        bench_step_grounded(&b);
        take_motion(&by_motion, &b);
        take_counts(&by_counts, &b);
    }
    check_ground(&by_motion, &b, BY_TYPE(1e-4, 1e-9));
    check_ground(&by_counts, &b, 1e-2);
}

/* ---- Settings ------------------------------------------------------------------------------- */

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    const axt_ident_config fine = config_of(AXT_IDENT_3X2, SETTING_A);
    axt_ident ident = ident_of(&fine);
    const axt_ident before = ident;
    axt_ident_config bad[40];
    size_t count = 0;
    const float time_steps[] = {0, -1e-4F, 0.9e-7F, 1.1F, NAN, INFINITY};
    for (size_t i = 0; i < COUNT_OF(time_steps); i++) {
        bad[count] = fine;
        bad[count++].time_step = (axt_real)time_steps[i];
    }
    const float forgettings[] = {0, 0.89F, 1.001F, -1, NAN};
    for (size_t i = 0; i < COUNT_OF(forgettings); i++) {
        bad[count] = fine;
        bad[count++].forgetting = (axt_real)forgettings[i];
    }
    const float torques[] = {0, -0.2F, 1e-10F, 1e10F, NAN, INFINITY};
    for (size_t i = 0; i < COUNT_OF(torques); i++) {
        bad[count] = fine;
        bad[count++].torque = (axt_real)torques[i];
    }
    const float parameters[] = {-1, NAN, INFINITY};
    for (size_t i = 0; i < COUNT_OF(parameters); i++) {
        bad[count] = fine;
        bad[count++].expected.I1 = (axt_real)parameters[i];
        bad[count] = fine;
        bad[count++].expected.K = (axt_real)parameters[i];
    }
    const uint32_t counts[][2] = {
        {1048576, 0}, {0, 1048576}, {AXT_ENCODER_COUNTS_MAX + 1, 1}, {1, UINT32_MAX}};
    for (size_t i = 0; i < COUNT_OF(counts); i++) {
        bad[count] = fine;
        memcpy(bad[count++].counts_per_turn, counts[i], sizeof counts[i]);
    }
    bad[count] = fine;
    bad[count++].form = (axt_ident_form)2;
    for (size_t i = 0; i < count; i++) {
        CHECK(axt_ident_init(&ident, &bad[i]) < 0);
        CHECK(UNCHANGED(ident, before));
    }
}

int main(void) {
    RUN(noise_free_motion_gives_the_parameters_back);
    RUN(a_thousand_periods_are_as_good_as_one);
    RUN(what_was_expected_may_be_wrong_by_a_factor_of_ten);
    RUN(modal_properties_are_those_of_the_axis_found);
    RUN(motion_under_held_torque_gives_the_parameters_back);
    RUN(the_wrong_hold_shows);
    RUN(counts_under_held_torque_give_the_parameters);
    RUN(the_full_form_from_counts_under_held_torque_is_refused);
    RUN(counts_alone_give_the_parameters);
    RUN(neither_the_zero_of_an_encoder_nor_its_wrap_changes_a_bit);
    RUN(standard_errors_are_the_scatter_of_many_runs);
    RUN(a_parameter_is_valid_when_its_error_is_below_a_tenth);
    RUN(no_sample_no_answer);
    RUN(an_axis_that_does_not_vibrate_tells_nothing);
    RUN(encoders_that_flicker_at_rest_teach_nothing);
    RUN(nothing_is_learned_across_a_gap);
    RUN(counts_settle_anew_after_a_gap);
    RUN(a_refused_sample_is_counted_and_its_step_skipped);
    RUN(a_motion_that_the_axis_cannot_reach_is_refused);
    RUN(a_motion_beyond_all_bounds_is_refused_whenever_it_comes);
    RUN(counts_that_jump_are_refused_and_no_others);
    RUN(a_sample_that_is_not_newer_is_refused);
    RUN(a_bad_torque_with_counts_is_refused);
    RUN(the_counters_stop_at_their_ends);
    RUN(the_wrong_kind_of_sample_is_refused_and_changes_nothing);
    RUN(after_a_reset_all_is_learned_anew);
    RUN(counts_of_a_sample_that_is_not_newer_are_refused);
    RUN(there_is_an_answer_before_its_errors_are_known_but_none_to_rely_on);
    RUN(an_axis_damped_beyond_critical_is_found_or_there_is_no_answer);
    RUN(the_limit_of_a_jump_stays_within_the_range_of_counts);
    RUN(neither_sign_nor_turns_change_a_bit);
    RUN(it_does_not_matter_when_one_starts_to_listen);
    RUN(the_surplus_entries_of_an_ideal_axis_are_zero);
    RUN(friction_and_spring_are_found_where_they_are_and_seldom_where_they_are_not);
    RUN(friction_and_springs_to_ground_show_in_the_surplus_entries);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    say_if_shortened("test_ident");
    return REPORT();
}
