/* The axis with its effects: what holds whatever the parameters. Friction takes energy and sticks
 * at exactly zero, the shaft keeps energy, left is the mirror image of right, nothing is not
 * anything, and no parameter or torque ends in a number that is none. How large each effect is, is
 * checked from Python against scipy (tests/host/test_effects.py). */
#include "axt_catalogue.h"
#include "axt_emulated_axis.h"
#include "axt_encoder.h"
#include "axt_friction.h"
#include "axt_machine.h"
#include "check.h"
#include "reference.h"

static const axt_real step_20khz = (axt_real)5e-5;

static wide angle_of(const axt_motion *motion) {
    return 2 * PI * ((wide)motion->turns + (wide)motion->fraction + (wide)motion->fraction_low);
}

static axt_machine machine_of(const axt_axis *axis, axt_real time_step,
                              const axt_effects *effects) {
    axt_machine machine;
    CHECK_EQUAL(axt_machine_init(&machine, axis, time_step, AXT_TORQUE_LINEAR, effects), AXT_OK);
    return machine;
}

static axt_motion motion_of(const axt_machine *machine) {
    axt_motion motion;
    axt_machine_read(machine, &motion);
    return motion;
}

static axt_motion measured_of(const axt_machine *machine) {
    axt_motion motion;
    axt_machine_measure(machine, &motion);
    return motion;
}

/* Without the padding that there is between the members. */
static bool same_motion(const axt_motion *a, const axt_motion *b) {
    return a->twist == b->twist && a->twist_speed == b->twist_speed && a->speed == b->speed &&
           a->turns == b->turns && a->fraction == b->fraction && a->fraction_low == b->fraction_low;
}

/* ---- Nothing and next to nothing ------------------------------------------------------------- */

CASE(without_effects_it_is_the_plant_bit_for_bit) {
    const axt_effects none = {0};
    uint64_t seed = 1;
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &none);
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, step_20khz, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_motion start = {.twist = (axt_real)1e-3, .twist_speed = 2, .speed = -40, .turns = 7};
    CHECK_EQUAL(axt_machine_set(&machine, &start, (axt_real)0.1), AXT_OK);
    CHECK_EQUAL(axt_plant_set(&plant, &start, (axt_real)0.1), AXT_OK);
    for (int n = 0; n < 10000; n++) {
        const axt_real torque = (n % 1000 == 0) ? not_finite[n / 1000 % 3] : uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_machine_step(&machine, torque), axt_plant_step(&plant, torque));
        axt_motion expected;
        axt_plant_read(&plant, &expected);
        const axt_motion read = motion_of(&machine);
        const axt_motion measured = measured_of(&machine);
        CHECK(same_motion(&read, &expected));
        CHECK(same_motion(&measured, &expected));
    }
    CHECK_EQUAL(machine.rejected, 10);
}

/* Friction of next to nothing takes the way of an axis with effects. */
CASE(next_to_nothing_is_newmark_s_method) {
    const axt_effects faint = {.friction = {{.coulomb = (axt_real)1e-30}}};
    uint64_t seed = 2;
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &faint);
    textbook_axis reference = {.I = {(wide)axt_axis_paper.I1, (wide)axt_axis_paper.I2},
                               .B = (wide)axt_axis_paper.B,
                               .K = (wide)axt_axis_paper.K,
                               .time_step = (wide)step_20khz,
                               .alpha = 0.25L,
                               .delta = 0.5L};
    wide twist_error = 0;
    wide speed_error = 0;
    wide angle_error = 0;
    textbook_start(&reference, 0, 0);
    for (int n = 0; n < 100000; n++) {
        const axt_real torque = uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_machine_step(&machine, torque), AXT_OK);
        textbook_step(&reference, (wide)torque, 0);
        const axt_motion motion = motion_of(&machine);
        const wide twist = reference.angle[0] - reference.angle[1];
        twist_error = fmaxl(twist_error, fabsl((wide)motion.twist - twist));
        speed_error = fmaxl(speed_error, fabsl((wide)motion.speed - reference.speed[0]));
        angle_error = fmaxl(angle_error, fabsl(angle_of(&motion) - reference.angle[0]));
    }
    /* of a twist of 1e-2 rad, a speed of 100 rad/s, an angle of 100 rad */
    CHECK_NEAR(twist_error, 0, BY_TYPE(2e-7, 1e-15));
    CHECK_NEAR(speed_error, 0, BY_TYPE(2e-3, 1e-12));
    CHECK_NEAR(angle_error, 0, BY_TYPE(1e-2, 1e-11));
}

/* ---- Friction -------------------------------------------------------------------------------- */

typedef struct {
    axt_real start;
    axt_real change;
    axt_real trend;
    axt_real most;
} slide_case;

static slide_case any_slide(uint64_t *seed) {
    return (slide_case){.start = (random_bits(seed) % 5 == 0) ? 0 : uniform(seed, -1, 1),
                        .change = uniform(seed, -3, 3),
                        .most = (random_bits(seed) % 9 == 0) ? 0 : log_uniform(seed, 1e-3, 1e1)};
}

static axt_friction_step slide(const slide_case *c) {
    return axt_friction_slide(c->start, c->change, c->trend, c->most);
}

static wide end_of(const slide_case *c, const axt_friction_step *step) {
    return (wide)c->start + (wide)step->change;
}

static wide mean_of(const slide_case *c, const axt_friction_step *step) {
    return (wide)c->start + ((wide)step->change + (wide)step->bend) / 2;
}

CASE(dry_friction_obeys_its_law_and_takes_energy) {
    uint64_t seed = 3;
    for (int n = 0; n < 200000; n++) {
        const slide_case c = any_slide(&seed);
        const axt_friction_step step = slide(&c);
        const wide end = end_of(&c, &step);
        const wide mean = mean_of(&c, &step);
        const double altered = (double)step.change - (double)c.change;
        const double rounding = 8 * REAL_EPSILON * (1 + (double)c.most);
        CHECK(fabs(altered) <= (double)c.most + rounding);
        if (end * (wide)c.start > 0) { /* slides on: all of it, all the time */
            CHECK_NEAR(fabs(altered), c.most, rounding);
            CHECK(step.bend == 0 && !step.held);
        }
        CHECK(step.held == (c.start + step.change == 0));
        if (c.start == 0 && fabs((double)c.change) < (double)c.most) {
            CHECK(step.change == 0 && step.bend == 0 && step.held);
        }
        /* friction takes its limit times the way, which is no shorter than how far it gets */
        const wide taken = (wide)c.change * mean - (end * end - (wide)c.start * (wide)c.start) / 2;
        CHECK(taken >= (wide)c.most * fabsl(mean) - (wide)rounding);
        if (c.most == 0) {
            CHECK(step.change == c.change && step.bend == 0);
        }
    }
}

CASE(dry_friction_is_the_same_both_ways) {
    uint64_t seed = 30;
    for (int n = 0; n < 20000; n++) {
        slide_case c = any_slide(&seed);
        c.trend = (n % 2 == 0) ? 0 : uniform(&seed, -2, 2);
        const slide_case back = {-c.start, -c.change, -c.trend, c.most};
        const axt_friction_step step = slide(&c);
        const axt_friction_step mirrored = slide(&back);
        CHECK_NEAR(mirrored.change, -step.change, 0);
        CHECK_NEAR(mirrored.bend, -step.bend, 0);
        CHECK(mirrored.held == step.held);
    }
}

/* What a force that is linear in time does from `from` to `to`, of the whole step. */
static slide_case part_of(const slide_case *c, axt_real start, axt_real from, axt_real to) {
    const axt_real part = to - from;
    return (slide_case){.start = start,
                        .change = part * (c->change - c->trend * (1 - from - to)),
                        .trend = part * part * c->trend,
                        .most = part * c->most};
}

/* How often an inertia is at rest when a step is made in many, and where that ends; the way it goes
 * is that of trapezoids, less what they miss of the course of a force with a trend. */
static int follow(const slide_case *c, wide *end, wide *way) {
    enum { PARTS = 64 };
    axt_real speed = c->start;
    int rests = c->start == 0;
    *way = 0;
    for (int i = 0; i < PARTS; i++) {
        const slide_case part = part_of(c, speed, (axt_real)i / PARTS, (axt_real)(i + 1) / PARTS);
        const axt_friction_step step = slide(&part);
        *way += (mean_of(&part, &step) - (wide)part.trend / 6) / PARTS;
        const axt_real next = speed + step.change;
        rests += next * speed < 0 || (step.held && speed != 0);
        /* may have been at rest twice in this part: as slow as that is what has just left it */
        rests += (step.bend != 0 || speed == 0) && !step.held &&
                 fabs((double)next) < 4 * fabs((double)part.trend);
        speed = next;
    }
    *end = (wide)speed;
    return rests;
}

/* Whatever is exact for a force does not depend on the steps that it is made in. */
CASE(many_steps_against_dry_friction_are_one_step) {
    uint64_t seed = 20;
    int stops = 0;
    for (int n = 0; n < 20000; n++) {
        slide_case c = any_slide(&seed);
        if (n % 2 == 1) {
            c.trend = uniform(&seed, -2, 2);
        }
        const axt_friction_step step = slide(&c);
        wide end;
        wide way;
        const int rests = follow(&c, &end, &way);
        if (rests > 1 || (rests == 1 && end * (wide)c.start > 0)) { /* twice, or goes on from it */
            continue;
        }
        const double rounding = 100 * REAL_EPSILON * (1 + (double)c.most);
        CHECK_NEAR(end_of(&c, &step), end, rounding);
        CHECK_NEAR(mean_of(&c, &step) - (wide)c.trend / 6, way, rounding);
        stops += rests;
    }
    CHECK(stops > 10000);
}

/* On that the sweeps of axt_machine.c rest. */
CASE(the_end_speed_follows_the_force_by_none_to_all_of_it) {
    uint64_t seed = 21;
    for (int n = 0; n < 200000; n++) {
        const slide_case c = any_slide(&seed);
        const double more = (double)log_uniform(&seed, 1e-4, 1e1);
        slide_case pushed = c;
        pushed.change += (axt_real)more;
        const axt_friction_step low = slide(&c);
        const axt_friction_step high = slide(&pushed);
        const double rise = (double)(end_of(&pushed, &high) - end_of(&c, &low));
        const double rounding = 16 * REAL_EPSILON * (1 + (double)c.most + more);
        CHECK(rise >= -rounding);
        CHECK(rise <= more + rounding);
    }
}

CASE(what_just_stops_is_held) {
    const slide_case cases[] = {{0, 0, 0, 0},
                                {0, 1, 0, 1},
                                {0, -1, 0, 1},
                                {1, (axt_real)-0.5, 0, (axt_real)0.5},
                                {1, -2, 0, 2}};
    for (size_t i = 0; i < COUNT_OF(cases); i++) {
        const slide_case c = cases[i];
        const axt_friction_step step = slide(&c);
        CHECK(step.held && step.change == -c.start);
        CHECK_NEAR(step.bend, (i == 4) ? -0.75 : 0, 0);
    }
}

CASE(an_axis_that_sticks_does_not_move_at_all) {
    const axt_effects effects = {.friction = {{.coulomb = (axt_real)0.05}, {.coulomb = 1}},
                                 .torque_offset = {(axt_real)0.01, (axt_real)-0.5}};
    uint64_t seed = 4;
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    const axt_motion start = {.fraction = (axt_real)0.3, .turns = 5};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    for (int n = 0; n < 100000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, uniform(&seed, -0.059, 0.039)), AXT_OK);
        const axt_motion motion = motion_of(&machine);
        CHECK(same_motion(&motion, &start));
    }
    for (int n = 0; n < 10; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, (axt_real)0.1), AXT_OK);
    }
    CHECK(motion_of(&machine).speed > 0);
}

/* A table that sticks is a wall: the motor swings against it, and nothing of the table moves. */
CASE(a_table_that_sticks_has_exactly_zero_speed_while_the_motor_swings) {
    const axt_effects effects = {.friction = {{0}, {.coulomb = 10}}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    uint64_t seed = 5;
    wide most = 0;
    for (int n = 0; n < 20000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, uniform(&seed, -1, 1)), AXT_OK);
        const axt_motion motion = motion_of(&machine);
        CHECK(motion.speed - motion.twist_speed == 0);
        CHECK_NEAR(angle_of(&motion) - (wide)motion.twist, 0, BY_TYPE(1e-7, 1e-15));
        most = fmaxl(most, fabsl((wide)motion.speed));
    }
    CHECK(most > 1);
}

/* Both inertias slow down alike, so there is no twist: v = v0 - a t, stopped after v0^2 / 2 a. */
CASE(an_axis_coasts_to_a_stop_after_v2_over_2a_and_stays) {
    const double a = 1000;
    const double v0 = 50;
    const axt_effects effects = {
        .friction = {{.coulomb = (axt_real)(a * (double)axt_axis_paper.I1)},
                     {.coulomb = (axt_real)(a * (double)axt_axis_paper.I2)}}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    const axt_motion start = {.speed = (axt_real)v0};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    for (int n = 1; n <= 2000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        const double t = fmin(n * (double)step_20khz, v0 / a);
        const axt_motion motion = motion_of(&machine);
        CHECK_NEAR(motion.speed, v0 - a * t, v0 * BY_TYPE(1e-4, 1e-12));
        CHECK_NEAR(angle_of(&motion), v0 * t - a * t * t / 2, BY_TYPE(1e-5, 1e-12));
    }
    const axt_motion motion = motion_of(&machine);
    CHECK(motion.speed == 0 && motion.twist_speed == 0);
}

/* Thrown against a constant torque, in a play that has no end, the motor slows down by g + a and
 * comes back by g - a: right to rounding, however many steps there are and wherever it turns. */
CASE(a_motor_thrown_up_comes_down_as_its_closed_form_in_any_step) {
    const double a = 300;
    const double g = 1000;
    const double v0 = 20;
    const double inertia = (double)axt_axis_paper.I1;
    const axt_effects effects = {.friction = {{.coulomb = (axt_real)(a * inertia)}},
                                 .torque_offset = {(axt_real)(-g * inertia)},
                                 .backlash = 10};
    const double step[] = {1.3e-5, 7e-5, 2.4e-4};
    for (size_t i = 0; i < COUNT_OF(step); i++) {
        axt_machine machine = machine_of(&axt_axis_paper, (axt_real)step[i], &effects);
        const axt_motion start = {.twist_speed = (axt_real)v0, .speed = (axt_real)v0};
        CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
        const double top = v0 / (g + a);
        for (int n = 1; n * step[i] < 3 * top; n++) {
            CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
            const double t = n * (double)(axt_real)step[i] - top;
            const double rate = (t < 0) ? g + a : g - a;
            const axt_motion motion = motion_of(&machine);
            CHECK_NEAR(motion.speed, -rate * t, BY_TYPE(1e-3, 1e-11));
            CHECK_NEAR(angle_of(&motion), v0 * top / 2 - rate * t * t / 2, BY_TYPE(2e-5, 1e-12));
            CHECK_NEAR(motion.twist, angle_of(&motion), BY_TYPE(1e-6, 1e-14));
        }
    }
}

/* ---- Second order through stops -------------------------------------------------------------- */

/* w' = drive sin(x) - dry sign(w) with x = frequency t + phase: from rest it breaks away at x1,
 * goes on to x2 and turns round there. Speeds times frequency, angles times its square. */
typedef struct {
    wide drive;
    wide dry;
} shaken;

static wide speed_since(const shaken *s, wide from, wide x, wide way) {
    return s->drive * (cosl(from) - cosl(x)) - way * s->dry * (x - from);
}

static wide angle_since(const shaken *s, wide from, wide x, wide way) {
    return s->drive * (cosl(from) * (x - from) - (sinl(x) - sinl(from))) -
           way * s->dry * (x - from) * (x - from) / 2;
}

static wide turning_point(const shaken *s, wide from) {
    wide low = PI / 2;
    wide high = 3 * PI / 2;
    for (int i = 0; i < 60; i++) {
        const wide middle = (low + high) / 2;
        if (speed_since(s, from, middle, 1) > 0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

typedef struct {
    wide broke_away;   /* speed at first */
    wide turned;       /* speed in the end */
    wide turned_angle; /* angle in the end */
} squared_errors;

/* Both inertias are shaken in proportion, so the shaft stays straight. */
static void add_errors(double time_step, wide phase, squared_errors *sum) {
    const wide frequency = 400;
    const shaken s = {.drive = 4000, .dry = 1500};
    const wide inertia[2] = {(wide)axt_axis_paper.I1, (wide)axt_axis_paper.I2};
    axt_effects effects = {0};
    for (int i = 0; i < 2; i++) {
        effects.friction[i].coulomb = (axt_real)(s.dry * inertia[i]);
        effects.disturbance[i].amplitude = (axt_real)(s.drive * inertia[i]);
        effects.disturbance[i].frequency = (axt_real)frequency;
        effects.disturbance[i].phase = (axt_real)phase;
    }
    axt_machine machine = machine_of(&axt_axis_paper, (axt_real)time_step, &effects);
    const wide first = asinl(s.dry / s.drive);
    const wide second = turning_point(&s, first);
    const int steps = (int)lrintl(4.6L / (frequency * (wide)time_step));
    for (int n = 1; n <= steps; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        const axt_motion motion = motion_of(&machine);
        const wide x = frequency * n * (wide)(axt_real)time_step + phase;
        if (n == steps / 3) {
            const wide speed = speed_since(&s, first, x, 1) / frequency;
            sum->broke_away += powl((wide)motion.speed - speed, 2);
        }
        if (n == steps) {
            const wide speed = speed_since(&s, second, x, -1) / frequency;
            const wide angle =
                (angle_since(&s, first, second, 1) + angle_since(&s, second, x, -1)) /
                (frequency * frequency);
            sum->turned += powl((wide)motion.speed - speed, 2);
            sum->turned_angle += powl(angle_of(&motion) - angle, 2);
        }
    }
}

CASE(half_the_step_leaves_a_quarter_of_the_error_of_breaking_away_and_turning) {
    squared_errors errors[2] = {{.turned = 0}};
    uint64_t seed = 22;
    for (int n = 0; n < 64; n++) { /* the events fall anywhere in a step */
        const wide phase = (wide)uniform(&seed, -0.2, 0);
        add_errors(2e-4, phase, &errors[0]);
        add_errors(1e-4, phase, &errors[1]);
    }
    /* of 10 rad/s and 0.05 rad; of first order it would be twice the error */
    CHECK(errors[0].turned < 64 * 4e-3L * 4e-3L);
    CHECK(errors[0].turned_angle < 64 * 3e-5L * 3e-5L);
    CHECK(errors[0].broke_away > 3 * 3 * errors[1].broke_away);
    CHECK(errors[0].turned > 3 * 3 * errors[1].turned);
    CHECK(errors[0].turned_angle > 3 * 3 * errors[1].turned_angle);
}

/* The table sticks, and the motor swings on the shaft against friction: each half swing is shorter
 * by 2 L / K than the one before, until the spring does not overcome the limit L. */
static wide error_of_rest(double time_step, int swings, wide left) {
    const axt_real dry = (axt_real)0.01;
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    const axt_effects effects = {.friction = {{.coulomb = dry}, {.coulomb = 10}}};
    const wide unit = (wide)dry / (wide)axis.K;
    axt_machine machine = machine_of(&axis, (axt_real)time_step, &effects);
    const axt_motion start = {.twist = (axt_real)((2 * swings + left) * unit)};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    for (int n = 0; n * time_step < 2e-3 * (swings + 1); n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
    }
    const axt_motion motion = motion_of(&machine);
    CHECK(motion.speed == 0 && motion.twist_speed == 0);
    const wide side = (swings % 2 == 0) ? 1 : -1;
    return (wide)motion.twist / unit - side * left;
}

CASE(a_swing_on_the_shaft_ends_where_its_closed_form_says_to_second_order) {
    wide errors[2] = {0, 0};
    uint64_t seed = 23;
    for (int n = 0; n < 64; n++) {
        const wide left = (wide)uniform(&seed, -0.6, 0.6);
        errors[0] += powl(error_of_rest(1e-4, 3, left), 2);
        errors[1] += powl(error_of_rest(5e-5, 3, left), 2);
    }
    CHECK(errors[0] < 64 * 3e-4L * 3e-4L);
    CHECK(errors[0] > 3 * 3 * errors[1]);
}

/* ---- Energy ---------------------------------------------------------------------------------- */

static wide energy_of(const axt_machine *machine, const axt_axis *axis) {
    const axt_motion motion = motion_of(machine);
    const wide w1 = (wide)motion.speed;
    const wide w2 = w1 - (wide)motion.twist_speed;
    const wide z = fmaxl(fabsl((wide)motion.twist) - (wide)machine->effects.backlash / 2, 0);
    return ((wide)axis->I1 * w1 * w1 + (wide)axis->I2 * w2 * w2 + (wide)axis->K * z * z +
            (wide)machine->effects.stiffness_hardening * z * z * z * z / 2) /
           2;
}

/* A free axis: random friction, play, hardening and start; steps up to wn Dt = 1, the limit that
 * the header gives. */
CASE(a_free_axis_never_gains_energy) {
    uint64_t seed = 6;
    for (int trial = 0; trial < 400 / SHORTENED; trial++) {
        const bool bent = trial % 4 == 0;
        axt_axis axis = axt_axis_paper;
        axis.B = (trial % 3 == 0) ? 0 : log_uniform(&seed, 1e-5, 1e-1);
        axt_effects effects = {0};
        for (int i = 0; i < 2; i++) {
            if (random_bits(&seed) % 4 != 0) {
                effects.friction[i].coulomb = log_uniform(&seed, 1e-5, 1);
                effects.friction[i].viscous = log_uniform(&seed, 1e-6, 1e-1);
                effects.friction[i].asymmetry = uniform(&seed, -1, 1) * effects.friction[i].viscous;
            }
            if (bent && random_bits(&seed) % 2 == 0) {
                effects.friction[i].stribeck = log_uniform(&seed, 1e-4, 1);
                effects.friction[i].stribeck_speed = log_uniform(&seed, 1e-2, 10);
            }
        }
        if (bent) {
            effects.backlash = log_uniform(&seed, 1e-5, 1e-2);
            effects.stiffness_hardening = log_uniform(&seed, 1e3, 1e6);
        }
        axt_modal modal;
        CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
        const axt_real time_step = log_uniform(&seed, 1e-2, 1) / modal.wn;
        axt_machine machine = machine_of(&axis, time_step, &effects);
        const axt_motion start = {.twist = uniform(&seed, -1e-2, 1e-2),
                                  .twist_speed = uniform(&seed, -10, 10),
                                  .speed = uniform(&seed, -10, 10)};
        CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
        const wide first = energy_of(&machine, &axis);
        wide last = first;
        for (int n = 0; n < 500; n++) {
            CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
            const wide energy = energy_of(&machine, &axis);
            CHECK(energy <= last + first * BY_TYPE(1e-5L, 1e-12L));
            last = energy;
        }
    }
}

CASE(play_and_hardening_without_damping_keep_the_energy) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    const axt_effects effects = {.backlash = (axt_real)2e-3, .stiffness_hardening = (axt_real)1e6};
    axt_machine machine = machine_of(&axis, step_20khz, &effects);
    const axt_motion start = {.twist_speed = 20, .speed = 10};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    const wide energy = energy_of(&machine, &axis);
    for (int n = 0; n < 100000 / SHORTENED; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        CHECK_NEAR(energy_of(&machine, &axis) / energy, 1, BY_TYPE(1e-3, 1e-8));
    }
}

/* ---- Symmetry and play ----------------------------------------------------------------------- */

CASE(left_is_the_mirror_image_of_right_bit_for_bit) {
    const axt_effects effects = {
        .friction = {{.coulomb = (axt_real)0.02,
                      .viscous = (axt_real)1e-4,
                      .asymmetry = (axt_real)6e-5,
                      .stribeck = (axt_real)0.01,
                      .stribeck_speed = 3,
                      .drift = (axt_real)0.1},
                     {.coulomb = (axt_real)0.03, .stribeck = (axt_real)0.02, .stribeck_speed = 1}},
        .backlash = (axt_real)1e-3,
        .stiffness_hardening = (axt_real)1e5,
        .stiffness_drift = (axt_real)-0.05,
        .load_change = {(axt_real)0.5, (axt_real)0.1},
        .extra_mode = {3000, (axt_real)0.03, (axt_real)0.3},
        .torque_delay = (axt_real)7.3e-5,
        .torque_saturation = (axt_real)0.5,
        .encoder_delay = {(axt_real)1e-4, (axt_real)2.6e-5}};
    axt_machine right = machine_of(&axt_axis_paper, step_20khz, &effects);
    axt_effects mirrored = effects;
    mirrored.friction[0].asymmetry = -effects.friction[0].asymmetry;
    axt_machine left = machine_of(&axt_axis_paper, step_20khz, &mirrored);
    uint64_t seed = 7;
    axt_real torque = 0;
    for (int n = 0; n < 20000; n++) {
        torque = (axt_real)0.99 * torque + uniform(&seed, -0.1, 0.1);
        CHECK_EQUAL(axt_machine_step(&right, torque), AXT_OK);
        CHECK_EQUAL(axt_machine_step(&left, -torque), AXT_OK);
        const axt_motion r = measured_of(&right);
        const axt_motion l = measured_of(&left);
        CHECK(r.twist == -l.twist && r.twist_speed == -l.twist_speed && r.speed == -l.speed);
        CHECK(r.turns == -l.turns && r.fraction == -l.fraction &&
              r.fraction_low == -l.fraction_low);
    }
}

/* In the play, table and further inertia m I2 swing against each other with the frequency
 * p sqrt(1 + m), and the table has m / (1 + m) of that. */
CASE(a_further_mode_swings_on_from_its_state) {
    const double p = 200;
    const double m = 0.3;
    const double amplitude = 1e-3;
    const axt_effects effects = {.backlash = (axt_real)0.2,
                                 .extra_mode = {(axt_real)p, 0, (axt_real)m}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    const axt_motion start = {0};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    CHECK_EQUAL(axt_machine_set_mode(&machine, (axt_real)amplitude, 0), AXT_OK);
    const double omega = p * sqrt(1 + m);
    for (int n = 1; n < 2000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        const double swung = 1 - cos(omega * n * (double)step_20khz);
        CHECK_NEAR(motion_of(&machine).twist, m / (1 + m) * amplitude * swung, 1e-3 * amplitude);
    }
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    CHECK_EQUAL(axt_machine_set_mode(&machine, 0, (axt_real)(amplitude * omega)), AXT_OK);
    for (int n = 1; n < 2000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        /* The inertia carries the table along: both go on with the speed they have in common. */
        const double turned = omega * n * (double)step_20khz;
        const double ahead = m / (1 + m) * amplitude * (turned - sin(turned));
        CHECK_NEAR(motion_of(&machine).twist, ahead, 1e-3 * amplitude * (1 + turned / 10));
    }
}

CASE(a_further_mode_that_cannot_be_is_refused) {
    const axt_effects effects = {.extra_mode = {200, 0, (axt_real)0.3}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    CHECK_EQUAL(axt_machine_set_mode(&machine, 1, 2), AXT_OK);
    const axt_real far = (axt_real)1.1 * (axt_real)(2 * PI) / step_20khz;
    const struct {
        axt_real twist, speed;
        axt_status status;
    } wrong[] = {{(axt_real)NAN, 0, AXT_ERROR_NOT_FINITE},
                 {0, (axt_real)INFINITY, AXT_ERROR_NOT_FINITE},
                 {1001, 0, AXT_ERROR_RANGE},
                 {0, far, AXT_ERROR_RANGE}};
    for (size_t i = 0; i < COUNT_OF(wrong); i++) {
        CHECK_EQUAL(axt_machine_set_mode(&machine, wrong[i].twist, wrong[i].speed),
                    wrong[i].status);
        CHECK(machine.mode_twist == 1 && machine.mode_speed == 2);
    }
}

CASE(in_the_play_the_motor_turns_alone) {
    const axt_effects effects = {.backlash = (axt_real)0.2};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    const double torque = 0.01;
    const double acceleration = torque / (double)axt_axis_paper.I1;
    const axt_motion start = {.twist = (axt_real)-0.09};
    CHECK_EQUAL(axt_machine_set(&machine, &start, (axt_real)torque), AXT_OK);
    for (int n = 1; n < 1000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, (axt_real)torque), AXT_OK);
        const double t = n * (double)step_20khz;
        const axt_motion motion = motion_of(&machine);
        if (acceleration * t * t / 2 > 0.18) {
            break;
        }
        CHECK_NEAR(angle_of(&motion), acceleration * t * t / 2, BY_TYPE(1e-5, 1e-13));
        CHECK(motion.speed == motion.twist_speed); /* the table stands still */
    }
    CHECK(motion_of(&machine).speed > 10);
}

/* ---- Channels -------------------------------------------------------------------------------- */

CASE(a_torque_delayed_by_whole_steps_is_the_torque_of_then) {
    const axt_effects effects = {.torque_delay = 7 * step_20khz,
                                 .torque_saturation = (axt_real)0.8};
    const axt_effects none = {0};
    axt_machine late = machine_of(&axt_axis_paper, step_20khz, &effects);
    axt_machine prompt = machine_of(&axt_axis_paper, step_20khz, &none);
    uint64_t seed = 8;
    axt_real torque[1000];
    for (int n = 0; n < 1000; n++) {
        torque[n] = uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_machine_step(&late, torque[n]), AXT_OK);
        const axt_real then = (n >= 7) ? torque[n - 7] : 0;
        const axt_real most = (axt_real)0.8;
        CHECK_EQUAL(axt_machine_step(&prompt, (then > most)    ? most
                                              : (then < -most) ? -most
                                                               : then),
                    AXT_OK);
        CHECK_NEAR(motion_of(&late).twist, motion_of(&prompt).twist, BY_TYPE(1e-8, 1e-17));
    }
}

/* Angles as they were a whole number of steps ago, and at a part of a step by a cubic: 1e-4 of a
 * vibration of 14 steps a period. */
CASE(an_encoder_that_is_late_shows_the_past) {
    enum { STEPS = 400 };
    const axt_effects effects = {.encoder_delay = {3 * step_20khz, (axt_real)4.5 * step_20khz}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    const axt_motion start = {.twist = (axt_real)1e-3, .speed = 300, .turns = 3};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    wide motor[STEPS];
    wide table[STEPS];
    wide rate[STEPS];
    for (int n = 0; n < STEPS; n++) {
        const axt_motion motion = motion_of(&machine);
        motor[n] = angle_of(&motion);
        table[n] = motor[n] - (wide)motion.twist;
        rate[n] = (wide)motion.speed - (wide)motion.twist_speed;
        const axt_motion shown = measured_of(&machine);
        if (n >= 5) {
            const wide h = (wide)step_20khz;
            const wide then =
                (table[n - 4] + table[n - 5]) / 2 - h / 8 * (rate[n - 4] - rate[n - 5]);
            CHECK_NEAR(angle_of(&shown) - motor[n - 3], 0, BY_TYPE(3e-7, 1e-12));
            CHECK_NEAR(angle_of(&shown) - (wide)shown.twist - then, 0, BY_TYPE(1e-6, 1e-12));
        } else { /* before the start it moved at its speed */
            CHECK_NEAR(angle_of(&shown),
                       (n >= 3) ? motor[n - 3] : motor[0] - (3 - n) * 300 * (wide)step_20khz,
                       BY_TYPE(3e-6, 1e-11));
        }
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
    }
}

CASE(a_coarse_encoder_shows_the_nearest_of_its_counts) {
    const uint32_t counts[2] = {1000, 36};
    const axt_effects effects = {.quantisation = {(axt_real)counts[0], (axt_real)counts[1]}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    uint64_t seed = 9;
    for (int n = 0; n < 10000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, uniform(&seed, -1, 1.2)), AXT_OK);
        const axt_motion motion = motion_of(&machine);
        const axt_motion shown = measured_of(&machine);
        for (uint32_t i = 0; i < 2; i++) {
            const axt_encoder_place place = (axt_encoder_place)i;
            int32_t direct;
            CHECK_EQUAL(axt_encoder_read(counts[i], &motion, place, &direct), AXT_OK);
            int32_t fine; /* 1024 times finer: a whole number of coarse counts */
            CHECK_EQUAL(axt_encoder_read(1024 * counts[i], &shown, place, &fine), AXT_OK);
            CHECK_EQUAL(fine, 1024 * direct);
        }
    }
}

CASE(encoder_errors_are_those_of_their_formulas) {
    const axt_effects effects = {
        .lead_error = {{0}, {(axt_real)1e-3, 3, (axt_real)0.5}, {(axt_real)2e-3, (axt_real)0.7, 1}},
        .encoder_eccentricity = {{(axt_real)2e-3, (axt_real)-0.4}, {(axt_real)1e-3, 2}}};
    axt_machine machine = machine_of(&axt_axis_paper, step_20khz, &effects);
    uint64_t seed = 10;
    for (int n = 0; n < 1000; n++) {
        const axt_motion start = {.twist = uniform(&seed, -0.3, 0.3),
                                  .turns = (int32_t)(random_bits(&seed) % 20) - 10,
                                  .fraction = uniform(&seed, -0.5, 0.5)};
        CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
        const wide motor = angle_of(&start);
        const wide table = motor - (wide)start.twist;
        const axt_motion shown = measured_of(&machine);
        const wide table_error = 1e-3L * sinl(3 * table + 0.5L) + 2e-3L * sinl(0.7L * table + 1) +
                                 1e-3L * sinl(table + 2);
        CHECK_NEAR(angle_of(&shown), motor + 2e-3L * sinl(motor - 0.4L), BY_TYPE(1e-6, 1e-13));
        CHECK_NEAR(angle_of(&shown) - (wide)shown.twist, table + table_error, BY_TYPE(1e-6, 1e-13));
    }
}

/* ---- The axis of an emulated drive ------------------------------------------------------------
 */

CASE(an_emulated_drive_can_have_a_worn_axis) {
    const axt_effects stuck = {.friction = {{.coulomb = 1}}};
    const axt_effects wrong = {.friction = {{.coulomb = -1}}};
    const uint32_t counts[2] = {1048576, 1048576};
    axt_emulated_axis axis;
    CHECK_EQUAL(axt_emulated_axis_init(&axis, &axt_axis_paper, step_20khz, counts), AXT_OK);
    CHECK_EQUAL(axt_emulated_axis_set_effects(&axis, &stuck), AXT_OK);
    CHECK_EQUAL(axt_emulated_axis_set_effects(&axis, &wrong), AXT_ERROR_RANGE);
    int32_t position[2] = {1, 1};
    for (int n = 0; n < 100; n++) {
        axt_emulated_axis_apply_torque(&axis, (axt_real)0.9);
        axt_emulated_axis_read_encoders(&axis, position);
        CHECK(position[0] == 0 && position[1] == 0);
    }
    for (int n = 0; n < 100; n++) {
        axt_emulated_axis_apply_torque(&axis, 2);
    }
    axt_emulated_axis_read_encoders(&axis, position);
    CHECK(position[0] > 0);
}

/* ---- Whatever comes in ----------------------------------------------------------------------- */

static bool all_finite(const axt_motion *motion) {
    return isfinite(motion->twist) && isfinite(motion->twist_speed) && isfinite(motion->speed) &&
           isfinite(motion->fraction) && isfinite(motion->fraction_low);
}

/* Any bits as a number: of all magnitudes, infinite, none. */
static axt_real any_bits(uint64_t *seed) {
    const uint64_t bits = random_bits(seed);
    axt_real number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

enum { NUMBERS = sizeof(axt_effects) / sizeof(axt_real) };

CASE(no_parameter_and_no_torque_makes_a_number_that_is_none) {
    uint64_t seed = 11;
    int accepted = 0;
    for (int trial = 0; trial < 20000 / SHORTENED; trial++) {
        axt_real numbers[NUMBERS];
        for (int i = 0; i < NUMBERS; i++) {
            /* mostly sizes that have a chance, at the edges too */
            const uint64_t kind = random_bits(&seed) % 64;
            numbers[i] = (kind == 0)   ? any_bits(&seed)
                         : (kind < 20) ? log_uniform(&seed, 1e-9, 1e6)
                         : (kind < 30) ? log_uniform(&seed, 1e-6, 1e-3)
                                       : 0;
        }
        axt_effects effects;
        memcpy(&effects, numbers, sizeof effects);
        const axt_axis axis = {log_uniform(&seed, 1e-9, 1e6), log_uniform(&seed, 1e-9, 1e6),
                               log_uniform(&seed, 1e-9, 1e9), log_uniform(&seed, 1e-6, 1e12)};
        axt_machine machine;
        if (axt_machine_init(&machine, &axis, log_uniform(&seed, 1e-7, 1),
                             (axt_torque_course)(trial % 2), &effects) != AXT_OK) {
            effects = (axt_effects){.friction = {{.coulomb = log_uniform(&seed, 1e-9, 1e6)}},
                                    .backlash = log_uniform(&seed, 1e-9, 1e3),
                                    .stiffness_hardening = log_uniform(&seed, 1, 1e15),
                                    .extra_mode = {log_uniform(&seed, 1e-3, 1e6), 1, 1e3}};
            if (axt_machine_init(&machine, &axis, log_uniform(&seed, 1e-7, 1), AXT_TORQUE_LINEAR,
                                 &effects) != AXT_OK) {
                continue;
            }
        }
        accepted++;
        uint32_t refused = 0;
        for (int n = 0; n < 50; n++) {
            const axt_real torque = (n % 5 == 0)
                                        ? any_bits(&seed)
                                        : uniform(&seed, -1, 1) * (axt_real)machine.plant.half_turn;
            const axt_motion before = motion_of(&machine);
            const bool taken = axt_machine_step(&machine, torque) == AXT_OK;
            const axt_motion motion = motion_of(&machine);
            const axt_motion shown = measured_of(&machine);
            CHECK(taken || same_motion(&motion, &before));
            refused += !taken;
            CHECK_EQUAL(machine.rejected, refused);
            CHECK(all_finite(&motion));
            CHECK(all_finite(&shown));
        }
    }
    CHECK(accepted > 2000 / SHORTENED);
}

CASE(a_parameter_that_is_no_number_is_refused_wherever_it_is) {
    for (int i = 0; i < NUMBERS; i++) {
        for (size_t k = 0; k < COUNT_OF(not_finite); k++) {
            axt_real numbers[NUMBERS] = {0};
            numbers[i] = not_finite[k];
            axt_effects effects;
            memcpy(&effects, numbers, sizeof effects);
            axt_machine machine = {0};
            const axt_machine before = machine;
            CHECK_EQUAL(axt_machine_init(&machine, &axt_axis_paper, step_20khz, AXT_TORQUE_LINEAR,
                                         &effects),
                        AXT_ERROR_NOT_FINITE);
            CHECK(UNCHANGED(machine, before));
        }
    }
}

CASE(parameters_out_of_range_are_refused) {
    const axt_effects wrong[] = {
        {.friction = {{.coulomb = (axt_real)-0.1}}},
        {.friction = {{0}, {.viscous = (axt_real)-0.1}}},
        {.friction = {{.viscous = (axt_real)0.1, .asymmetry = (axt_real)-0.2}}}, /* would drive */
        {.friction = {{.stribeck = (axt_real)0.1}}}, /* without a speed */
        {.friction = {{.coulomb = (axt_real)0.1, .stribeck = (axt_real)-0.2, .stribeck_speed = 1}}},
        {.disturbance = {{.amplitude = 1, .frequency = 70000}}},
        {.torque_ripple = {{1, -1, 0}}},
        {.backlash = (axt_real)-1e-3},
        {.load_change = {-1, 0}},
        {.extra_mode = {.mass_ratio = (axt_real)0.1}}, /* without a frequency */
        {.torque_delay = AXT_DELAY_STEPS * step_20khz},
        {.encoder_delay = {(axt_real)-1e-6}},
        {.quantisation = {(axt_real)10.5}},
        {.torque_saturation = -1},
    };
    for (size_t i = 0; i < COUNT_OF(wrong); i++) {
        CHECK_EQUAL(axt_effects_check(&wrong[i], step_20khz), AXT_ERROR_RANGE);
    }
}

/* ---- The catalogue --------------------------------------------------------------------------- */

CASE(the_catalogue_names_every_number_once) {
    int named[NUMBERS] = {0};
    uint32_t count = 0;
    for (const axt_catalogue_entry *entry; (entry = axt_catalogue(count)) != NULL; count++) {
        CHECK(axt_catalogue_find(entry->effect, entry->location, entry->parameter) == entry);
        for (uint32_t i = 0; i < entry->instances; i++) {
            axt_effects effects = {0};
            CHECK_EQUAL(axt_catalogue_set(entry, i, 1, &effects), AXT_OK);
            axt_real numbers[NUMBERS];
            memcpy(numbers, &effects, sizeof effects);
            for (int k = 0; k < NUMBERS; k++) {
                named[k] += numbers[k] == 1;
            }
        }
        axt_effects effects = {0};
        CHECK_EQUAL(axt_catalogue_set(entry, entry->instances, 1, &effects), AXT_ERROR_RANGE);
    }
    for (int k = 0; k < NUMBERS; k++) {
        CHECK_EQUAL(named[k], 1);
    }
    CHECK(axt_catalogue_find("friction_coulomb", "table", "torq") == NULL);
    CHECK(axt_catalogue_find("friction_coulomb", "shaft", "torque") == NULL);
    CHECK(axt_catalogue_find("friction", "table", "torque") == NULL);
}

int main(void) {
    say_if_shortened("test_effects");
    RUN(without_effects_it_is_the_plant_bit_for_bit);
    RUN(next_to_nothing_is_newmark_s_method);
    RUN(dry_friction_obeys_its_law_and_takes_energy);
    RUN(dry_friction_is_the_same_both_ways);
    RUN(many_steps_against_dry_friction_are_one_step);
    RUN(the_end_speed_follows_the_force_by_none_to_all_of_it);
    RUN(what_just_stops_is_held);
    RUN(an_axis_that_sticks_does_not_move_at_all);
    RUN(a_table_that_sticks_has_exactly_zero_speed_while_the_motor_swings);
    RUN(an_axis_coasts_to_a_stop_after_v2_over_2a_and_stays);
    RUN(a_motor_thrown_up_comes_down_as_its_closed_form_in_any_step);
    RUN(half_the_step_leaves_a_quarter_of_the_error_of_breaking_away_and_turning);
    RUN(a_swing_on_the_shaft_ends_where_its_closed_form_says_to_second_order);
    RUN(a_free_axis_never_gains_energy);
    RUN(play_and_hardening_without_damping_keep_the_energy);
    RUN(left_is_the_mirror_image_of_right_bit_for_bit);
    RUN(a_further_mode_swings_on_from_its_state);
    RUN(a_further_mode_that_cannot_be_is_refused);
    RUN(in_the_play_the_motor_turns_alone);
    RUN(a_torque_delayed_by_whole_steps_is_the_torque_of_then);
    RUN(an_encoder_that_is_late_shows_the_past);
    RUN(a_coarse_encoder_shows_the_nearest_of_its_counts);
    RUN(encoder_errors_are_those_of_their_formulas);
    RUN(an_emulated_drive_can_have_a_worn_axis);
    RUN(no_parameter_and_no_torque_makes_a_number_that_is_none);
    RUN(a_parameter_that_is_no_number_is_refused_wherever_it_is);
    RUN(parameters_out_of_range_are_refused);
    RUN(the_catalogue_names_every_number_once);
    return REPORT();
}
