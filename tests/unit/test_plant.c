/* The plant, against Newmark's method as the paper writes it (absolute angles, extended precision),
 * closed forms of its period and damping, and what Newmark's method conserves. */
#include "axt_plant.h"

#include "axt_encoder.h"
#include "axt_excitation.h"
#include "check.h"
#include "reference.h"

enum { PERIOD = 2048, HOUR = 72000000 /* steps at 20 kHz */ };

static const axt_real step_20khz = (axt_real)5e-5;

/* alpha and delta of the trapezoidal rule, linear acceleration, Fox and Goodwin's method, and two
 * with numerical damping. All are stable for wn Dt < 2.4. */
static const axt_newmark newmarks[] = {{(axt_real)0.25, (axt_real)0.5},
                                       {(axt_real)(1.0 / 6), (axt_real)0.5},
                                       {(axt_real)(1.0 / 12), (axt_real)0.5},
                                       {(axt_real)0.3025, (axt_real)0.6},
                                       {1, 1}};

/* ---- The two axes side by side -------------------------------------------------------------- */

static wide twist_of(const textbook_axis *axis) {
    return axis->angle[0] - axis->angle[1];
}

static wide angle_of(const axt_motion *motion) {
    return 2 * PI * ((wide)motion->turns + (wide)motion->fraction + (wide)motion->fraction_low);
}

/* The same axis for both, with the numbers as the library's type rounds them. */
static textbook_axis textbook(const axt_axis *axis, axt_real time_step,
                              const axt_newmark *newmark) {
    return (textbook_axis){.I = {(wide)axis->I1, (wide)axis->I2},
                           .B = (wide)axis->B,
                           .K = (wide)axis->K,
                           .time_step = (wide)time_step,
                           .alpha = (wide)newmark->alpha,
                           .delta = (wide)newmark->delta};
}

/* Puts both into the same state. */
static void set_both(axt_plant *plant, textbook_axis *reference, const axt_motion *motion,
                     axt_real torque) {
    CHECK_EQUAL(axt_plant_set(plant, motion, torque), AXT_OK);
    reference->angle[0] = angle_of(motion);
    reference->angle[1] = reference->angle[0] - (wide)motion->twist;
    reference->speed[0] = (wide)motion->speed;
    reference->speed[1] = (wide)motion->speed - (wide)motion->twist_speed;
    textbook_start(reference, (wide)torque, 0);
}

/* Largest differences of a run, and the sizes to see them against. */
typedef struct {
    double twist, speed, angle;                                  /* largest differences */
    double twist_squares, slowest, fastest, leftmost, rightmost; /* of the reference */
    uint32_t samples;
} comparison;

static void compare(comparison *c, const axt_plant *plant, const textbook_axis *reference) {
    axt_motion motion;
    axt_plant_read(plant, &motion);
    const double twist = (double)twist_of(reference);
    const double speed = (double)reference->speed[0];
    const double angle = (double)reference->angle[0];
    if (c->samples == 0) {
        c->slowest = c->fastest = speed;
        c->leftmost = c->rightmost = angle;
    }
    c->twist = fmax(c->twist, (double)fabsl((wide)motion.twist - twist_of(reference)));
    c->speed = fmax(c->speed, (double)fabsl((wide)motion.speed - reference->speed[0]));
    c->angle = fmax(c->angle, (double)fabsl(angle_of(&motion) - reference->angle[0]));
    c->twist_squares += twist * twist;
    c->slowest = fmin(c->slowest, speed);
    c->fastest = fmax(c->fastest, speed);
    c->leftmost = fmin(c->leftmost, angle);
    c->rightmost = fmax(c->rightmost, angle);
    c->samples++;
}

static void check_agreement(const comparison *c, double twist, double speed, double angle) {
    CHECK_NEAR(c->twist / sqrt(c->twist_squares / c->samples), 0, twist);
    CHECK_NEAR(c->speed / (c->fastest - c->slowest), 0, speed);
    CHECK_NEAR(c->angle / (c->rightmost - c->leftmost), 0, angle);
}

static axt_player schroeder_player(axt_real *table) {
    const axt_schroeder signal = {.length = PERIOD,
                                  .first = 1,
                                  .stride = 1,
                                  .lines = 136, /* twice the natural frequency at 20 kHz */
                                  .rms = (axt_real)0.2};
    CHECK_EQUAL(axt_schroeder_fill(&signal, table, PERIOD), AXT_OK);
    axt_player player;
    CHECK_EQUAL(axt_player_init(&player, table, PERIOD), AXT_OK);
    return player;
}

/* ---- Agreement with the textbook ------------------------------------------------------------ */

CASE(the_plant_is_newmark_s_method_whatever_alpha_and_delta) {
    uint64_t seed = 1;
    for (size_t i = 0; i < COUNT_OF(newmarks); i++) {
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &newmarks[i]), AXT_OK);
        textbook_axis reference = textbook(&axt_axis_paper, step_20khz, &newmarks[i]);
        const axt_motion start = {.twist = (axt_real)1e-3,
                                  .twist_speed = -2,
                                  .speed = 30,
                                  .turns = -12,
                                  .fraction = (axt_real)0.3};
        set_both(&plant, &reference, &start, (axt_real)0.1);
        comparison c = {0};
        for (uint32_t n = 0; n < 20000; n++) {
            const axt_real torque = uniform(&seed, -1, 1);
            CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
            textbook_step(&reference, (wide)torque, 0);
            compare(&c, &plant, &reference);
        }
        check_agreement(&c, BY_TYPE(1e-5, 1e-12), BY_TYPE(1e-6, 1e-14), BY_TYPE(1e-6, 1e-14));
    }
}

/* One hour of periodic torque at 20 kHz; compared now and then, and throughout the last periods.
 * The tolerances in double are those of the reference, whose absolute angles grow to 4e5 rad. */
static void run_for_an_hour(axt_real initial_speed) {
    static axt_real table[PERIOD];
    axt_player player = schroeder_player(table);
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    textbook_axis reference = textbook(&axt_axis_paper, step_20khz, &axt_newmark_trapezoidal);
    const axt_motion start = {.speed = initial_speed};
    set_both(&plant, &reference, &start, 0);

    const uint32_t steps = HOUR / SHORTENED;
    comparison c = {0};
    for (uint32_t n = 0; n < steps; n++) {
        const axt_real torque = axt_player_step(&player);
        CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
        textbook_step(&reference, (wide)torque, 0);
        if (n % 1000 < 4 || n > steps - 3 * PERIOD) {
            compare(&c, &plant, &reference);
        }
    }
    check_agreement(&c, BY_TYPE(1e-5, 1e-9), BY_TYPE(1e-6, 1e-10), BY_TYPE(1e-6, 1e-14));
}

CASE(an_hour_from_rest_at_20_khz_agrees_with_extended_precision) {
    run_for_an_hour(0);
}

CASE(an_hour_at_100_rad_s_at_20_khz_agrees_with_extended_precision) {
    run_for_an_hour(100);
}

/* ---- Where it starts ------------------------------------------------------------------------ */

CASE(the_first_acceleration_is_that_of_equilibrium) {
    uint64_t seed = 2;
    for (int n = 0; n < 1000; n++) {
        const axt_newmark *newmark = &newmarks[(size_t)n % COUNT_OF(newmarks)];
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, newmark), AXT_OK);
        textbook_axis reference = textbook(&axt_axis_paper, step_20khz, newmark);
        const axt_motion start = {.twist = uniform(&seed, -1e-3, 1e-3),
                                  .twist_speed = uniform(&seed, -5, 5),
                                  .speed = uniform(&seed, -100, 100)};
        set_both(&plant, &reference, &start, uniform(&seed, -1, 1));
        const axt_real torque = uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
        textbook_step(&reference, (wide)torque, 0);
        axt_motion motion;
        axt_plant_read(&plant, &motion);
        CHECK_NEAR((wide)motion.twist - twist_of(&reference), 0, 1e-3 * 8 * REAL_EPSILON);
        CHECK_NEAR((wide)motion.speed - reference.speed[0], 0, 100 * 8 * REAL_EPSILON);
        CHECK_NEAR(angle_of(&motion) - reference.angle[0], 0, 0.01 * 8 * REAL_EPSILON);
    }
}

CASE(an_axis_at_rest_stays_at_rest) {
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_plant before = plant;
    for (int n = 0; n < 1000; n++) {
        CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
    }
    CHECK(UNCHANGED(plant, before));
}

CASE(a_motion_that_was_set_is_read_back_at_any_number_of_turns) {
    uint64_t seed = 3;
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &newmarks[3]), AXT_OK);
    for (int n = 0; n < 100000; n++) {
        const axt_motion set = {.twist = uniform(&seed, -1e-2, 1e-2),
                                .twist_speed = uniform(&seed, -50, 50),
                                .speed = uniform(&seed, -1000, 1000),
                                .turns = (int32_t)(uint32_t)random_bits(&seed),
                                .fraction = uniform(&seed, -0.5, 0.5),
                                .fraction_low = uniform(&seed, -1e-9, 1e-9)};
        CHECK_EQUAL(axt_plant_set(&plant, &set, uniform(&seed, -1, 1)), AXT_OK);
        axt_motion read;
        axt_plant_read(&plant, &read);
        CHECK_NEAR((wide)read.twist - (wide)set.twist, 0, 1e-2 * 2 * REAL_EPSILON);
        CHECK_NEAR((wide)read.twist_speed - (wide)set.twist_speed, 0, 50 * 2 * REAL_EPSILON);
        CHECK_NEAR((wide)read.speed - (wide)set.speed, 0, 1000 * 4 * REAL_EPSILON);
        const wide turned = (wide)((int64_t)read.turns - set.turns);
        const wide fraction = (wide)set.fraction + (wide)set.fraction_low;
        CHECK_NEAR(turned + (wide)read.fraction + (wide)read.fraction_low - fraction, 0,
                   BY_TYPE(4e-10, 1e-18));
    }
}

CASE(a_plant_set_to_what_another_reads_carries_on_alike) {
    uint64_t seed = 4;
    for (size_t i = 0; i < COUNT_OF(newmarks); i++) {
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &newmarks[i]), AXT_OK);
        axt_real torque = 0;
        for (int n = 0; n < 1000; n++) {
            torque = uniform(&seed, -1, 1);
            CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
        }
        axt_motion motion;
        axt_plant_read(&plant, &motion);
        axt_plant second;
        CHECK_EQUAL(axt_plant_init(&second, &axt_axis_paper, step_20khz, &newmarks[i]), AXT_OK);
        CHECK_EQUAL(axt_plant_set(&second, &motion, torque), AXT_OK);
        for (int n = 0; n < 1000; n++) {
            torque = uniform(&seed, -1, 1);
            CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
            CHECK_EQUAL(axt_plant_step(&second, torque), AXT_OK);
        }
        axt_motion expected;
        axt_plant_read(&plant, &expected);
        axt_plant_read(&second, &motion);
        CHECK_NEAR((wide)motion.twist - (wide)expected.twist, 0, 1e-3 * 64 * REAL_EPSILON);
        CHECK_NEAR((wide)motion.speed - (wide)expected.speed, 0, 100 * 64 * REAL_EPSILON);
        CHECK_NEAR(angle_of(&motion) - angle_of(&expected), 0, 64 * REAL_EPSILON);
    }
}

/* ---- Period and damping of the method itself ------------------------------------------------ */

static axt_axis undamped(void) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    return axis;
}

/* Newmark's characteristic polynomial for an oscillator, z^2 - 2 A1 z + A2 (T. J. R. Hughes, The
 * Finite Element Method, section 9.1): here x = wn Dt. */
static void characteristic(wide wn, wide zeta, const textbook_axis *axis, wide *sum,
                           wide *product) {
    const wide x = wn * axis->time_step;
    const wide denominator = 1 + 2 * axis->delta * zeta * x + axis->alpha * x * x;
    *sum = 2 - (2 * zeta * x + x * x * (axis->delta + 0.5L)) / denominator;
    *product = 1 - (2 * zeta * x + x * x * (axis->delta - 0.5L)) / denominator;
}

/* A free vibration obeys q[n+1] = sum q[n] - product q[n-1]; both follow from three samples and the
 * next, here from many by least squares. */
CASE(a_free_twist_has_newmark_s_period_and_numerical_damping) {
    enum { SAMPLES = 60 };
    const axt_axis axes[] = {undamped(), axt_axis_paper};
    for (size_t i = 0; i < COUNT_OF(axes) * COUNT_OF(newmarks); i++) {
        const axt_axis *axis = &axes[i / COUNT_OF(newmarks)];
        const axt_newmark *newmark = &newmarks[i % COUNT_OF(newmarks)];
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, axis, step_20khz, newmark), AXT_OK);
        const axt_motion start = {.twist = (axt_real)1e-3};
        CHECK_EQUAL(axt_plant_set(&plant, &start, 0), AXT_OK);
        wide q[SAMPLES];
        for (int n = 0; n < SAMPLES; n++) {
            axt_motion motion;
            axt_plant_read(&plant, &motion);
            q[n] = (wide)motion.twist;
            CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
        }
        wide s11 = 0;
        wide s12 = 0;
        wide s22 = 0;
        wide r1 = 0;
        wide r2 = 0;
        for (int n = 1; n + 1 < SAMPLES; n++) {
            s11 += q[n] * q[n];
            s12 -= q[n] * q[n - 1];
            s22 += q[n - 1] * q[n - 1];
            r1 += q[n] * q[n + 1];
            r2 -= q[n - 1] * q[n + 1];
        }
        const wide determinant = s11 * s22 - s12 * s12;
        const textbook_axis reference = textbook(axis, step_20khz, newmark);
        const wide wn = sqrtl(reference.K * (1 / reference.I[0] + 1 / reference.I[1]));
        wide sum;
        wide product;
        characteristic(wn, reference.B * wn / (2 * reference.K), &reference, &sum, &product);
        CHECK_NEAR((r1 * s22 - r2 * s12) / determinant - sum, 0, 16 * REAL_EPSILON);
        CHECK_NEAR((r2 * s11 - r1 * s12) / determinant - product, 0, 16 * REAL_EPSILON);
    }
}

/* The trapezoidal rule turns the state (wn q, q') by 2 atan(wn Dt / 2) a step, not by wn Dt. */
CASE(the_trapezoidal_rule_lowers_the_frequency_as_its_closed_form_says) {
    enum { STEPS = 20000 };
    const axt_axis axis = undamped();
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
    const struct {
        axt_real time_step;
        double lowered; /* per cent, as measured in a study of the paper's two settings */
    } settings[] = {{axt_time_step(512, 10, modal.wn), 0.125},
                    {axt_time_step(2048, 146, modal.wn), 1.62}};
    for (size_t i = 0; i < COUNT_OF(settings); i++) {
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axis, settings[i].time_step, &axt_newmark_trapezoidal),
                    AXT_OK);
        const textbook_axis reference =
            textbook(&axis, settings[i].time_step, &axt_newmark_trapezoidal);
        const wide wn = sqrtl(reference.K * (1 / reference.I[0] + 1 / reference.I[1]));
        const axt_motion start = {.twist = (axt_real)1e-3};
        CHECK_EQUAL(axt_plant_set(&plant, &start, 0), AXT_OK);
        wide phase = 0;
        wide last = 0;
        for (int n = 0; n < STEPS; n++) {
            CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
            axt_motion motion;
            axt_plant_read(&plant, &motion);
            const wide now = atan2l(-(wide)motion.twist_speed, wn * (wide)motion.twist);
            phase += now - last + ((now < last) ? 2 * PI : 0);
            last = now;
        }
        const wide frequency = phase / (STEPS * reference.time_step);
        const wide expected = 2 / reference.time_step * atanl(wn * reference.time_step / 2);
        CHECK_NEAR(frequency / expected, 1, 4 * REAL_EPSILON);
        CHECK_NEAR(100 * (1 - frequency / wn), settings[i].lowered, 0.005);
    }
}

/* ---- What the method conserves -------------------------------------------------------------- */

/* Of the vibration, per unit of reduced inertia. */
static wide vibration_energy(const axt_plant *plant, wide stiffness) {
    axt_motion motion;
    axt_plant_read(plant, &motion);
    return ((wide)motion.twist_speed * (wide)motion.twist_speed +
            stiffness * (wide)motion.twist * (wide)motion.twist) /
           2;
}

CASE(an_undamped_free_axis_keeps_its_energy) {
    const uint32_t steps = BY_TYPE(100000, 10000000) / SHORTENED;
    const axt_axis axis = undamped();
    const wide stiffness = (wide)axis.K * (1 / (wide)axis.I1 + 1 / (wide)axis.I2);
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axis, step_20khz, &axt_newmark_trapezoidal), AXT_OK);
    const axt_motion start = {.twist = (axt_real)1e-3, .speed = 10};
    CHECK_EQUAL(axt_plant_set(&plant, &start, 0), AXT_OK);
    const wide energy = vibration_energy(&plant, stiffness);
    for (uint32_t n = 0; n < steps; n++) {
        CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
        CHECK_NEAR(vibration_energy(&plant, stiffness) / energy, 1, BY_TYPE(1e-2, 1e-8));
    }
}

/* Under forcing, the trapezoidal rule keeps both books exactly: each step the momentum grows by
 * mean(T) Dt, and the energy by mean(T) x the motor's travel less B mean(q')^2 Dt. */
CASE(work_and_impulse_account_for_energy_and_momentum) {
    enum { STEPS = 20000 };
    const textbook_axis axis = textbook(&axt_axis_paper, step_20khz, &axt_newmark_trapezoidal);
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    uint64_t seed = 5;
    axt_motion last;
    axt_plant_read(&plant, &last);
    wide last_torque = 0;
    wide expected_energy = 0;
    wide expected_momentum = 0;
    wide work = 0;
    wide largest_momentum = 0;
    for (int n = 0; n < STEPS; n++) {
        const axt_real torque = uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
        axt_motion now;
        axt_plant_read(&plant, &now);
        const wide mean_torque = ((wide)torque + last_torque) / 2;
        const wide mean_rate = ((wide)now.twist_speed + (wide)last.twist_speed) / 2;
        const wide done = mean_torque * (angle_of(&now) - angle_of(&last));
        work += fabsl(done);
        expected_energy += done - axis.B * mean_rate * mean_rate * axis.time_step;
        expected_momentum += mean_torque * axis.time_step;

        const wide motor = (wide)now.speed;
        const wide table = (wide)now.speed - (wide)now.twist_speed;
        const wide energy = (axis.I[0] * motor * motor + axis.I[1] * table * table +
                             axis.K * (wide)now.twist * (wide)now.twist) /
                            2;
        const wide momentum = axis.I[0] * motor + axis.I[1] * table;
        largest_momentum = fmaxl(largest_momentum, fabsl(momentum));
        CHECK_NEAR((energy - expected_energy) / (work + 1e-3L), 0, BY_TYPE(1e-5, 1e-13));
        CHECK_NEAR((momentum - expected_momentum) / (largest_momentum + 1e-6L), 0,
                   8 * REAL_EPSILON);
        last = now;
        last_torque = (wide)torque;
    }
}

/* ---- Standing still ------------------------------------------------------------------------- */

static void check_counts(const axt_plant *plant, int32_t motor, int32_t table) {
    axt_motion motion;
    axt_plant_read(plant, &motion);
    int32_t count = 0;
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &motion, AXT_ENCODER_MOTOR, &count),
                AXT_OK);
    CHECK_EQUAL(count, motor);
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &motion, AXT_ENCODER_TABLE, &count),
                AXT_OK);
    CHECK_EQUAL(count, table);
}

/* Half an hour of there and back, each torque sample answered by its opposite so that the axis
 * stops where it was (+p, -p, -p, +p takes speed and travel back), then half an hour of rest. */
CASE(a_stopped_axis_stays_on_its_count) {
    enum { PATTERN = 512, ROUND_TRIP = 4 * PATTERN, SECOND = 20000 };
    static axt_real table[PERIOD];
    (void)schroeder_player(table);
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_motion start = {.turns = 2000000, .fraction = (axt_real)0.123};
    CHECK_EQUAL(axt_plant_set(&plant, &start, 0), AXT_OK);
    axt_motion motion;
    axt_plant_read(&plant, &motion);
    int32_t motor = 0;
    CHECK_EQUAL(axt_encoder_read(AXT_ENCODER_COUNTS_MAX, &motion, AXT_ENCODER_MOTOR, &motor),
                AXT_OK);

    const uint32_t moving = HOUR / 2 / SHORTENED / ROUND_TRIP * ROUND_TRIP;
    for (uint32_t n = 0; n < moving; n++) {
        const uint32_t quarter = n % ROUND_TRIP / PATTERN;
        const axt_real torque = table[n % PATTERN];
        CHECK_EQUAL(axt_plant_step(&plant, (quarter == 0 || quarter == 3) ? torque : -torque),
                    AXT_OK);
    }
    for (uint32_t n = 0; n < HOUR / 2 / SHORTENED; n++) {
        CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
        if (n >= SECOND && n % 1000 == 0) {
            check_counts(&plant, motor, motor);
        }
    }
}

/* ---- What it refuses, and where it saturates ------------------------------------------------ */

/* The torque that turns the paper's axis by half a turn in one step of 20 kHz. */
static axt_real half_turn_torque(void) {
    const wide inertia = (wide)axt_axis_paper.I1 + (wide)axt_axis_paper.I2;
    return (axt_real)(PI * inertia / ((wide)step_20khz * (wide)step_20khz));
}

CASE(a_rejected_torque_changes_nothing_but_the_counter) {
    const struct {
        axt_real torque;
        axt_status expected;
    } bad[] = {{not_finite[0], AXT_ERROR_NOT_FINITE},
               {not_finite[1], AXT_ERROR_NOT_FINITE},
               {not_finite[2], AXT_ERROR_NOT_FINITE},
               {(axt_real)1.01 * half_turn_torque(), AXT_ERROR_RANGE},
               {(axt_real)-1.01 * half_turn_torque(), AXT_ERROR_RANGE},
               {(axt_real)FLT_MAX, AXT_ERROR_RANGE}};
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    uint64_t seed = 6;
    for (int n = 0; n < 100; n++) {
        CHECK_EQUAL(axt_plant_step(&plant, uniform(&seed, -1, 1)), AXT_OK);
    }
    axt_plant expected = plant;
    const axt_motion motion = {.turns = 7};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_plant_step(&plant, bad[i].torque), bad[i].expected);
        expected.rejected++;
        CHECK(UNCHANGED(plant, expected));
        CHECK_EQUAL(axt_plant_set(&plant, &motion, bad[i].torque), bad[i].expected);
        CHECK(UNCHANGED(plant, expected));
    }
}

CASE(a_motion_that_makes_no_sense_is_refused_and_the_plant_stays) {
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_plant before = plant;
    const double half_turn_a_step = (double)PI / 5e-5;
    const axt_motion out_of_range[] = {
        {.twist = (axt_real)1001},
        {.twist = (axt_real)-1001},
        {.twist_speed = (axt_real)1.001e9},
        {.speed = (axt_real)(1.001 * half_turn_a_step)},
        {.speed = (axt_real)(-1.001 * half_turn_a_step)},
        {.fraction = (axt_real)1.001},
        {.fraction_low = (axt_real)-1.001},
    };
    for (size_t i = 0; i < COUNT_OF(out_of_range); i++) {
        CHECK_EQUAL(axt_plant_set(&plant, &out_of_range[i], 0), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(plant, before));
    }
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        const axt_motion bad[] = {{.twist = not_finite[i]},
                                  {.twist_speed = not_finite[i]},
                                  {.speed = not_finite[i]},
                                  {.fraction = not_finite[i]},
                                  {.fraction_low = not_finite[i]}};
        for (size_t j = 0; j < COUNT_OF(bad); j++) {
            CHECK_EQUAL(axt_plant_set(&plant, &bad[j], 0), AXT_ERROR_NOT_FINITE);
            CHECK(UNCHANGED(plant, before));
        }
    }
}

CASE(the_limits_themselves_are_in_range) {
    axt_axis soft = axt_axis_paper;
    soft.K = (axt_real)1e-3;
    axt_plant plant;
    const axt_newmark limits[] = {{(axt_real)0.01, (axt_real)0.5}, {1, (axt_real)0.5}, {1, 1}};
    for (size_t i = 0; i < COUNT_OF(limits); i++) {
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, (axt_real)1e-7, &limits[i]), AXT_OK);
    }
    CHECK_EQUAL(axt_plant_init(&plant, &soft, 1, &axt_newmark_trapezoidal), AXT_OK);
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    for (int sign = -1; sign <= 1; sign += 2) {
        const axt_motion limit = {.twist = (axt_real)(sign * 1000),
                                  .twist_speed = (axt_real)sign,
                                  .fraction = (axt_real)sign,
                                  .fraction_low = (axt_real)sign};
        CHECK_EQUAL(axt_plant_set(&plant, &limit, 0), AXT_OK);
    }
}

/* wn Dt = 2 is where (delta / 2 - alpha) (wn Dt)^2 is exactly 1 for alpha = 1/4, delta = 1. */
CASE(the_limit_of_stability_itself_is_not_stable) {
    axt_axis axis = {.I1 = 2, .I2 = 2, .B = 0, .K = 4};
    const axt_newmark newmark = {(axt_real)0.25, 1};
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axis, 1, &newmark), AXT_ERROR_RANGE);
    axis.K -= 8 * (axt_real)REAL_EPSILON;
    CHECK_EQUAL(axt_plant_init(&plant, &axis, 1, &newmark), AXT_OK);
}

CASE(settings_that_make_no_sense_are_refused_and_the_plant_stays) {
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_plant before = plant;
    axt_axis negative = axt_axis_paper;
    negative.I2 = -negative.I2;
    CHECK_EQUAL(axt_plant_init(&plant, &negative, step_20khz, &axt_newmark_trapezoidal),
                AXT_ERROR_RANGE);
    const float steps[] = {0, -5e-5F, 0.9e-7F, 1.1F, 0.25F /* wn Dt above 1000 */, NAN, INFINITY};
    for (size_t i = 0; i < COUNT_OF(steps); i++) {
        CHECK_EQUAL(
            axt_plant_init(&plant, &axt_axis_paper, (axt_real)steps[i], &axt_newmark_trapezoidal),
            AXT_ERROR_RANGE);
    }
    const axt_newmark bad[] = {
        {(axt_real)-0.01, (axt_real)0.5}, {(axt_real)1.01, (axt_real)0.5},
        {(axt_real)0.25, (axt_real)0.49}, {(axt_real)0.25, (axt_real)1.01},
        {not_finite[0], (axt_real)0.5},   {(axt_real)0.25, not_finite[0]},
        {not_finite[1], (axt_real)0.5},   {(axt_real)0.25, not_finite[1]},
    };
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &bad[i]), AXT_ERROR_RANGE);
    }
    /* linear acceleration, Fox and Goodwin: stable up to wn Dt = sqrt(12) and sqrt(6) */
    const double limits[] = {0, 3.4641, 2.4495};
    for (size_t i = 1; i < COUNT_OF(limits); i++) {
        axt_plant stable;
        const axt_axis axis = axt_axis_paper;
        CHECK_EQUAL(
            axt_plant_init(&stable, &axis, (axt_real)(0.999 * limits[i] / 4162.58), &newmarks[i]),
            AXT_OK);
        CHECK_EQUAL(
            axt_plant_init(&plant, &axis, (axt_real)(1.001 * limits[i] / 4162.58), &newmarks[i]),
            AXT_ERROR_RANGE);
    }
    CHECK(UNCHANGED(plant, before));
}

CASE(the_speed_saturates_at_half_a_turn_a_step_and_comes_back) {
    const double half_turn_a_step = (double)PI / (double)step_20khz;
    for (int sign = -1; sign <= 1; sign += 2) {
        axt_plant plant;
        CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                    AXT_OK);
        const axt_real torque = (axt_real)(sign * 1000);
        axt_motion motion;
        for (int n = 0; n < 1000; n++) {
            CHECK_EQUAL(axt_plant_step(&plant, torque), AXT_OK);
        }
        for (int n = 0; n < 1000; n++) { /* the shaft comes to rest */
            CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
        }
        axt_plant_read(&plant, &motion);
        CHECK_NEAR((double)motion.speed / half_turn_a_step, sign, 1e-5);
        const int32_t before = motion.turns;
        for (int n = 0; n < 1000; n++) {
            CHECK_EQUAL(axt_plant_step(&plant, 0), AXT_OK);
        }
        axt_plant_read(&plant, &motion);
        CHECK_NEAR(motion.turns - before, sign * 500, 1);

        const uint32_t brake = (uint32_t)(half_turn_a_step * 35.3e-6 / 1000 / 5e-5);
        for (uint32_t n = 0; n < brake; n++) {
            CHECK_EQUAL(axt_plant_step(&plant, -torque), AXT_OK);
        }
        axt_plant_read(&plant, &motion);
        CHECK(fabs((double)motion.speed) < 0.1 * half_turn_a_step);
    }
}

static bool finite_motion(const axt_motion *motion) {
    return isfinite(motion->twist) && isfinite(motion->twist_speed) && isfinite(motion->speed) &&
           isfinite(motion->fraction) && isfinite(motion->fraction_low);
}

/* Any axis, any step, any alpha and delta that are accepted, and torque up to the limit. */
CASE(nothing_but_finite_numbers_come_out_of_any_plant) {
    uint64_t seed = 7;
    int accepted = 0;
    for (int n = 0; n < 20000 / SHORTENED; n++) {
        const axt_axis axis = {.I1 = log_uniform(&seed, 1.1e-9, 0.9e6),
                               .I2 = log_uniform(&seed, 1.1e-9, 0.9e6),
                               .B = log_uniform(&seed, 1e-12, 0.9e9),
                               .K = log_uniform(&seed, 1.1e-6, 0.9e12)};
        const axt_newmark newmark = {.alpha = uniform(&seed, 0, 1),
                                     .delta = uniform(&seed, 0.5, 1)};
        axt_plant plant;
        if (axt_plant_init(&plant, &axis, log_uniform(&seed, 1e-7, 1), &newmark) != AXT_OK) {
            continue;
        }
        accepted++;
        const axt_real size = log_uniform(&seed, 1e-9, 0.99) * plant.half_turn;
        axt_motion motion;
        bool finite = true;
        for (int i = 0; i < 1000; i++) {
            CHECK_EQUAL(axt_plant_step(&plant, uniform(&seed, -1, 1) * size), AXT_OK);
            axt_plant_read(&plant, &motion);
            finite = finite && finite_motion(&motion);
        }
        CHECK(finite);
    }
    CHECK(accepted > 0);
}

/* A twist that would be beyond all bounds a step later. */
CASE(a_twist_speed_that_leaves_the_range_within_a_step_is_refused) {
    const axt_axis soft = {.I1 = 1, .I2 = 1, .B = 0, .K = (axt_real)1e-3};
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &soft, (axt_real)1e-3, &axt_newmark_trapezoidal), AXT_OK);
    const axt_plant before = plant;
    const axt_real turning[] = {(axt_real)2.1e6, (axt_real)1.5e6}; /* 2100 and 1500 rad a step */
    for (size_t i = 0; i < COUNT_OF(turning); i++) {
        const axt_motion motion = {
            .twist = 900, .twist_speed = turning[i], .speed = turning[i] / 2};
        CHECK_EQUAL(axt_plant_set(&plant, &motion, 0), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(plant, before));
    }
    const axt_motion fine = {.twist = 900, .twist_speed = 1000, .speed = 500};
    CHECK_EQUAL(axt_plant_set(&plant, &fine, 0), AXT_OK);
}

int main(void) {
    RUN(a_twist_speed_that_leaves_the_range_within_a_step_is_refused);
    RUN(the_plant_is_newmark_s_method_whatever_alpha_and_delta);
    RUN(the_first_acceleration_is_that_of_equilibrium);
    RUN(an_axis_at_rest_stays_at_rest);
    RUN(a_motion_that_was_set_is_read_back_at_any_number_of_turns);
    RUN(a_plant_set_to_what_another_reads_carries_on_alike);
    RUN(a_free_twist_has_newmark_s_period_and_numerical_damping);
    RUN(the_trapezoidal_rule_lowers_the_frequency_as_its_closed_form_says);
    RUN(an_undamped_free_axis_keeps_its_energy);
    RUN(work_and_impulse_account_for_energy_and_momentum);
    RUN(a_rejected_torque_changes_nothing_but_the_counter);
    RUN(a_motion_that_makes_no_sense_is_refused_and_the_plant_stays);
    RUN(the_limits_themselves_are_in_range);
    RUN(the_limit_of_stability_itself_is_not_stable);
    RUN(settings_that_make_no_sense_are_refused_and_the_plant_stays);
    RUN(the_speed_saturates_at_half_a_turn_a_step_and_comes_back);
    RUN(nothing_but_finite_numbers_come_out_of_any_plant);
    RUN(a_stopped_axis_stays_on_its_count);
    RUN(an_hour_from_rest_at_20_khz_agrees_with_extended_precision);
    RUN(an_hour_at_100_rad_s_at_20_khz_agrees_with_extended_precision);
    say_if_shortened("test_plant");
    return REPORT();
}
