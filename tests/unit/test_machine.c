/* The equations of the machine term by term: against the same rule in extended precision, solved
 * without elimination, and against closed forms. What holds whatever the parameters is tested in
 * test_effects.c. */
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
        {.friction = {{.viscous = (axt_real)1e-3, .asymmetry = (axt_real)1e-3}}},
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

/* ---- The smooth effects: the trapezoidal rule in extended precision -------------------------- */

enum { MOTOR, TABLE, FURTHER, INERTIAS };

typedef struct {
    const axt_effects *effects;
    wide time_step;
    wide angle[INERTIAS];
    wide speed[INERTIAS];
    wide torque;      /* at the end of the last step */
    wide last_change; /* of the motor's speed, in that */
} smooth_axis;

/* axt_machine.h's equations with forces of time and of the motor's angle at the middle of step `n`,
 * where that is if the speed goes on changing as it did in the step before. */
static void find_acceleration(const smooth_axis *axis, int n, wide torque,
                              const wide angle[INERTIAS], const wide speed[INERTIAS],
                              wide acceleration[INERTIAS]) {
    const axt_effects *e = axis->effects;
    const wide time = (n + 0.5L) * axis->time_step;
    const wide speed_ahead = axis->speed[MOTOR] + axis->last_change / 4;
    const wide ahead = axis->angle[MOTOR] + axis->time_step / 2 * speed_ahead;
    const wide I2 = (wide)axt_axis_paper.I2;
    const wide further = (wide)e->extra_mode.mass_ratio * I2;
    const wide p = (wide)e->extra_mode.frequency;
    const wide damping = 2 * (wide)e->extra_mode.damping_ratio * p;
    const wide mode = further * (p * p * (angle[TABLE] - angle[FURTHER]) +
                                 damping * (speed[TABLE] - speed[FURTHER]));
    const wide shaft = (wide)axt_axis_paper.K * (1 + (wide)e->stiffness_drift * time) *
                           (angle[MOTOR] - angle[TABLE]) +
                       (wide)axt_axis_paper.B * (speed[MOTOR] - speed[TABLE]);
    const wide since = n + 1 - (wide)e->load_change.time / axis->time_step; /* in this step */
    const wide loaded = fminl(fmaxl(since, 0), 1);
    wide ripple = 0;
    for (int i = 0; i < AXT_EFFECTS_WAVES; i++) {
        const axt_wave *wave = &e->torque_ripple[i];
        ripple += (wide)wave->amplitude * sinl((wide)wave->periods * ahead + (wide)wave->phase);
    }
    wide force[2] = {torque + ripple - shaft, shaft - mode};
    for (int i = 0; i < 2; i++) {
        const axt_disturbance *d = &e->disturbance[i];
        const axt_friction *friction = &e->friction[i];
        force[i] += (wide)e->torque_offset[i] +
                    (wide)d->amplitude * sinl((wide)d->frequency * time + (wide)d->phase) -
                    (wide)friction->viscous * (1 + (wide)friction->drift * time) * speed[i];
    }
    acceleration[MOTOR] = force[MOTOR] / (wide)axt_axis_paper.I1;
    acceleration[TABLE] = force[TABLE] / (I2 * (1 + (wide)e->load_change.ratio * loaded));
    acceleration[FURTHER] = (further > 0) ? mode / further : 0;
}

/* The implicit equations are solved by putting their solution in again, which gains a digit each
 * time or more where wn h / 2 is small. */
static void smooth_step(smooth_axis *axis, int n, wide torque, axt_torque_course course) {
    const wide mean = (course == AXT_TORQUE_HELD) ? axis->torque : (axis->torque + torque) / 2;
    wide acceleration[INERTIAS] = {0};
    for (int i = 0; i < 40; i++) {
        wide angle[INERTIAS];
        wide speed[INERTIAS];
        for (int k = 0; k < INERTIAS; k++) { /* in the mean over the step */
            speed[k] = axis->speed[k] + axis->time_step / 2 * acceleration[k];
            angle[k] = axis->angle[k] + axis->time_step / 2 * speed[k];
        }
        find_acceleration(axis, n, mean, angle, speed, acceleration);
    }
    axis->last_change = axis->time_step * acceleration[MOTOR];
    for (int k = 0; k < INERTIAS; k++) {
        const wide before = axis->speed[k];
        axis->speed[k] += axis->time_step * acceleration[k];
        axis->angle[k] += axis->time_step / 2 * (before + axis->speed[k]);
    }
    axis->torque = torque;
}

static void compare_with_trapezoids(const axt_effects *effects, axt_torque_course course) {
    const axt_real time_step = (axt_real)0x1p-14;
    axt_machine machine;
    CHECK_EQUAL(axt_machine_init(&machine, &axt_axis_paper, time_step, course, effects), AXT_OK);
    smooth_axis reference = {.effects = effects, .time_step = (wide)time_step};
    uint64_t seed = 3;
    for (int n = 0; n < 400; n++) {
        const axt_real torque = uniform(&seed, -0.5, 0.5);
        CHECK_EQUAL(axt_machine_step(&machine, torque), AXT_OK);
        smooth_step(&reference, n, (wide)torque, course);
        axt_motion motion;
        axt_machine_read(&machine, &motion);
        const wide twist = reference.angle[MOTOR] - reference.angle[TABLE];
        const wide twist_speed = reference.speed[MOTOR] - reference.speed[TABLE];
        const wide angle = 2 * PI * ((wide)motion.turns + (wide)motion.fraction);
        /* of speeds of 10 rad/s, twists of 1e-3 rad and angles of 0.1 rad and more */
        CHECK_NEAR(motion.speed, reference.speed[MOTOR], BY_TYPE(3e-4, 1e-11));
        CHECK_NEAR(motion.twist_speed, twist_speed, BY_TYPE(3e-4, 1e-11));
        CHECK_NEAR(motion.twist, twist, BY_TYPE(1e-7, 1e-14));
        CHECK_NEAR(angle, reference.angle[MOTOR], BY_TYPE(1e-5, 1e-12));
    }
}

CASE(smooth_effects_are_their_equations_by_the_trapezoidal_rule) {
    const axt_effects each[] = {
        {.friction = {{.viscous = (axt_real)1e-3, .drift = 20},
                      {.viscous = (axt_real)5e-4, .drift = -10}}},
        {.torque_offset = {(axt_real)0.02, (axt_real)-0.01}},
        {.disturbance = {{(axt_real)0.2, 3000, 1}, {(axt_real)-0.1, 500, (axt_real)-0.5}}},
        {.torque_ripple =
             {{(axt_real)0.1, 7, (axt_real)0.4}, [3] = {(axt_real)0.1, (axt_real)2.5, 2}}},
        {.stiffness_drift = 20},
        {.load_change = {(axt_real)0.5, (axt_real)(20.5 * 0x1p-14)}},
        {.extra_mode = {2500, (axt_real)0.1, (axt_real)0.5}},
    };
    axt_effects all = {.friction = {each[0].friction[0], each[0].friction[1]},
                       .torque_offset = {each[1].torque_offset[0], each[1].torque_offset[1]},
                       .disturbance = {each[2].disturbance[0], each[2].disturbance[1]},
                       .torque_ripple = {each[3].torque_ripple[0], [2] = each[3].torque_ripple[3]},
                       .stiffness_drift = -5,
                       .load_change = {-0.5, (axt_real)(7 * 0x1p-14)},
                       .extra_mode = each[6].extra_mode};
    for (size_t i = 0; i < COUNT_OF(each); i++) {
        compare_with_trapezoids(&each[i], AXT_TORQUE_LINEAR);
    }
    compare_with_trapezoids(&all, AXT_TORQUE_LINEAR);
    compare_with_trapezoids(&all, AXT_TORQUE_HELD);
}

/* ---- Friction that changes with the speed ---------------------------------------------------- */

/* The friction of both inertias is in proportion to them, so the shaft stays straight and
 * w' = -(c + s exp(-(w / v)^2)); its solution by Runge and Kutta's method with short steps. The
 * friction of the beginning of each step instead of its middle would be off by 1e-2 rad/s. */
static void slow_down(double s) {
    const double c = 500;
    const double v = 5;
    axt_effects effects = {.backlash = 0};
    const axt_real inertia[2] = {axt_axis_paper.I1, axt_axis_paper.I2};
    for (int i = 0; i < 2; i++) {
        effects.friction[i].coulomb = (axt_real)c * inertia[i];
        effects.friction[i].stribeck = (axt_real)s * inertia[i];
        effects.friction[i].stribeck_speed = (axt_real)v;
    }
    axt_machine machine = machine_with(&effects);
    const axt_motion start = {.speed = 10};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    double w = 10;
    while (w > 1) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        const double h = (double)step;
        double slope = 0;
        double sum = 0;
        for (int stage = 0; stage < 4; stage++) {
            const double at = w + slope * h * ((stage == 3) ? 1 : 0.5);
            slope = -(c + s * exp(-at * at / (v * v)));
            sum += slope * ((stage == 0 || stage == 3) ? 1 : 2);
        }
        w += h * sum / 6;
        axt_motion motion;
        axt_machine_read(&machine, &motion);
        CHECK_NEAR(motion.speed, w, 5e-4);
        CHECK_NEAR(motion.twist_speed, 0, BY_TYPE(1e-3, 1e-12));
    }
}

CASE(a_stribeck_effect_slows_down_with_the_speed_in_the_middle_of_the_step) {
    slow_down(500);
    slow_down(-400); /* friction that rises to Coulomb's with speed */
}

/* ---- Friction that differs by direction ------------------------------------------------------ */

/* Friction and load of both inertias are in proportion to them, so the shaft stays straight and
 * w' = f - (c + a sign(w)) w: an exponential until it turns round, another one from there. */
static wide error_of_turn(axt_real time_step, wide start) {
    const wide f = 1000;
    const wide c = 50;
    const wide a = 30;
    axt_effects effects = {.backlash = 0};
    const axt_real inertia[2] = {axt_axis_paper.I1, axt_axis_paper.I2};
    for (int i = 0; i < 2; i++) {
        effects.friction[i].viscous = (axt_real)c * inertia[i];
        effects.friction[i].asymmetry = (axt_real)a * inertia[i];
        effects.torque_offset[i] = (axt_real)f * inertia[i];
    }
    axt_machine machine;
    CHECK_EQUAL(axt_machine_init(&machine, &axt_axis_paper, time_step, AXT_TORQUE_LINEAR, &effects),
                AXT_OK);
    axt_motion motion = {.speed = (axt_real)start};
    CHECK_EQUAL(axt_machine_set(&machine, &motion, 0), AXT_OK);
    const int steps = (int)(0x1p-6 / (double)time_step);
    for (int n = 0; n < steps; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
    }
    axt_machine_read(&machine, &motion);
    const wide backwards = f / (c - a);
    const wide turns = logl(1 - (wide)start / backwards) / (c - a);
    const wide expected = f / (c + a) * (1 - expl((c + a) * (turns - 0x1p-6L)));
    return (wide)motion.speed - expected;
}

CASE(friction_of_a_direction_acts_from_the_reversal_on_to_second_order) {
    wide errors[2] = {0, 0};
    uint64_t seed = 6;
    for (int n = 0; n < 64; n++) {
        const wide start = (wide)uniform(&seed, -12, -4);
        errors[0] += powl(error_of_turn((axt_real)0x1p-12, start), 2);
        errors[1] += powl(error_of_turn((axt_real)0x1p-13, start), 2);
    }
    CHECK(errors[0] < 64 * 2e-3L * 2e-3L);
    CHECK(errors[0] > 3 * 3 * errors[1]);
}

/* ---- Exact steps ----------------------------------------------------------------------------- */

static axt_status exact_machine(axt_machine *machine, const axt_axis *axis, double turn,
                                axt_torque_course course) {
    const axt_effects none = {.backlash = 0};
    const double wn = sqrt((double)axis->K * (1 / (double)axis->I1 + 1 / (double)axis->I2));
    CHECK_EQUAL(axt_machine_init(machine, axis, (axt_real)(turn / wn), course, &none), AXT_OK);
    return axt_machine_make_exact(machine);
}

/* Without damping the twist swings about T I2 / (I1 + I2) / K and the rigid body goes by T / (I1 +
 * I2): both are closed forms from one sample to the next. */
CASE(exact_steps_are_the_axis_itself) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    const wide inertia = (wide)axis.I1 + (wide)axis.I2;
    const wide share = (wide)axis.I2 / inertia;
    const wide wn = sqrtl((wide)axis.K * (1 / (wide)axis.I1 + 1 / (wide)axis.I2));
    const double turns[] = {0.02, 0.3, 1.9};
    for (size_t i = 0; i < COUNT_OF(turns); i++) {
        axt_machine machine;
        CHECK_EQUAL(exact_machine(&machine, &axis, turns[i], AXT_TORQUE_HELD), AXT_OK);
        const wide h = (wide)machine.time_step;
        const wide c = cosl(wn * h);
        const wide s = sinl(wn * h);
        wide twist = 0;
        wide rate = 0;
        wide body = 0;
        wide speed = 0;
        wide torque = 0;
        uint64_t seed = 8;
        for (int n = 0; n < 200; n++) {
            const axt_real next = uniform(&seed, -0.05, 0.05);
            CHECK_EQUAL(axt_machine_step(&machine, next), AXT_OK);
            const wide rest = torque * share / (wide)axis.K;
            const wide away = twist - rest;
            twist = rest + away * c + rate / wn * s;
            rate = rate * c - away * wn * s;
            body += h * (speed + h / 2 * torque / inertia);
            speed += h * torque / inertia;
            torque = (wide)next;
            axt_motion motion;
            axt_machine_read(&machine, &motion);
            const wide angle = 2 * PI * ((wide)motion.turns + (wide)motion.fraction);
            /* of twists of 1e-4 rad, speeds of 1 rad/s and more */
            CHECK_NEAR(motion.twist, twist, BY_TYPE(3e-8, 1e-15));
            CHECK_NEAR(motion.twist_speed, rate, BY_TYPE(1e-4, 1e-12));
            CHECK_NEAR(motion.speed, speed + share * rate, BY_TYPE(1e-4, 1e-12));
            CHECK_NEAR(angle, body + share * twist, BY_TYPE(3e-6, 1e-12));
        }
    }
}

/* A damped vibration keeps frequency and damping; what jumps of a force add is of second order. */
CASE(exact_steps_keep_the_damping) {
    const double turn = 0.5;
    axt_axis axis = axt_axis_paper;
    axis.B *= 20; /* damping ratio 0.8 */
    axt_machine machine;
    CHECK_EQUAL(exact_machine(&machine, &axis, turn, AXT_TORQUE_HELD), AXT_OK);
    const axt_motion start = {.twist = (axt_real)1e-3};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    const wide wn = sqrtl((wide)axis.K * (1 / (wide)axis.I1 + 1 / (wide)axis.I2));
    const wide zeta = (wide)axis.B * wn / (2 * (wide)axis.K);
    /* x[n + 1] = trace x[n] - determinant x[n - 1] is what both roots have in common */
    const wide trace = 2 * expl(-zeta * (wide)turn) * cosl((wide)turn * sqrtl(1 - zeta * zeta));
    const wide determinant = expl(-2 * zeta * (wide)turn);
    wide twist[3] = {(wide)start.twist, 0, 0};
    for (int n = 1; n < 12; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, 0), AXT_OK);
        axt_motion motion;
        axt_machine_read(&machine, &motion);
        twist[2] = twist[1];
        twist[1] = twist[0];
        twist[0] = (wide)motion.twist;
        if (n > 1) {
            CHECK_NEAR(twist[0], trace * twist[1] - determinant * twist[2], BY_TYPE(1e-9, 1e-17));
        }
    }
}

CASE(steps_that_cannot_be_exact_are_refused) {
    axt_machine machine;
    CHECK_EQUAL(exact_machine(&machine, &axt_axis_paper, 0.5, AXT_TORQUE_LINEAR), AXT_ERROR_RANGE);
    CHECK_EQUAL(exact_machine(&machine, &axt_axis_paper, 2.1, AXT_TORQUE_HELD), AXT_ERROR_RANGE);
    CHECK_EQUAL(exact_machine(&machine, &axt_axis_paper, 0.5, AXT_TORQUE_HELD), AXT_OK);
    const axt_machine before = machine;
    CHECK_EQUAL(axt_machine_make_exact(&machine), AXT_ERROR_RANGE); /* twice */
    CHECK(UNCHANGED(machine, before));
}

/* ---- Digits ---------------------------------------------------------------------------------- */

/* At 300 rad/s a speed in float is good to 3e-5 rad/s, and the twist would wander by it. */
CASE(the_twist_follows_its_speed_to_digits_that_the_speed_does_not_have) {
    const axt_effects faint = {.friction = {{.coulomb = (axt_real)1e-30}}};
    axt_machine machine = machine_with(&faint);
    const axt_motion start = {.speed = 300};
    CHECK_EQUAL(axt_machine_set(&machine, &start, 0), AXT_OK);
    uint64_t seed = 4;
    axt_motion before = start;
    for (int n = 0; n < 1000; n++) {
        CHECK_EQUAL(axt_machine_step(&machine, uniform(&seed, -1e-4, 1e-4)), AXT_OK);
        axt_motion motion;
        axt_machine_read(&machine, &motion);
        const wide mean = ((wide)before.twist_speed + (wide)motion.twist_speed) / 2;
        const double size = fabs((double)motion.twist) + (double)step * fabs((double)mean);
        CHECK_NEAR((wide)motion.twist - (wide)before.twist - (wide)step * mean, 0,
                   4 * REAL_EPSILON * size);
        before = motion;
    }
}

CASE(a_fine_encoder_shows_the_nearest_of_its_counts) {
    uint64_t seed = 5;
    const axt_real counts[] = {16777215, 16777213, 9999991};
    for (int n = 0; n < 3000; n++) {
        const axt_real resolution = counts[n % 3];
        const axt_effects effects = {.quantisation = {resolution}};
        axt_machine machine = machine_with(&effects);
        const axt_motion motion = {.fraction = uniform(&seed, -0.5, 0.5),
                                   .fraction_low = uniform(&seed, -2e-8, 2e-8)};
        /* inside the axis it is ideal, whose plant rounds its angle */
        CHECK_EQUAL(axt_machine_set(&machine, &motion, 0), AXT_OK);
        axt_motion real;
        axt_motion shown;
        axt_machine_read(&machine, &real);
        axt_machine_measure(&machine, &shown);
        const wide exact = (wide)resolution * ((wide)real.fraction + (wide)real.fraction_low);
        const wide read = (wide)resolution * ((wide)shown.fraction + (wide)shown.fraction_low);
        CHECK_NEAR(read, roundl(read), 1e-5);
        CHECK_NEAR(read, exact, 0.5 + 1e-5);
    }
}

CASE(half_a_turn_is_read_as_it_was_set) {
    const axt_effects effects = {.backlash = (axt_real)1e-4};
    for (int sign = -1; sign <= 1; sign += 2) {
        axt_machine machine = machine_with(&effects);
        const axt_motion half = {.fraction = (axt_real)(0.5 * sign), .turns = 7};
        CHECK_EQUAL(axt_machine_set(&machine, &half, 0), AXT_OK);
        axt_motion motion;
        axt_machine_read(&machine, &motion);
        CHECK_EQUAL(motion.turns, 7);
        CHECK_NEAR(motion.fraction, half.fraction, 0);
    }
}

int main(void) {
    RUN(each_effect_alone_changes_the_motion);
    RUN(a_state_that_the_plant_refuses_is_refused_and_nothing_changes);
    RUN(a_refused_torque_is_counted);
    RUN(measured_speeds_are_those_of_the_axis);
    RUN(the_count_of_steps_stops_at_its_end);
    RUN(smooth_effects_are_their_equations_by_the_trapezoidal_rule);
    RUN(a_stribeck_effect_slows_down_with_the_speed_in_the_middle_of_the_step);
    RUN(friction_of_a_direction_acts_from_the_reversal_on_to_second_order);
    RUN(exact_steps_are_the_axis_itself);
    RUN(exact_steps_keep_the_damping);
    RUN(steps_that_cannot_be_exact_are_refused);
    RUN(the_twist_follows_its_speed_to_digits_that_the_speed_does_not_have);
    RUN(a_fine_encoder_shows_the_nearest_of_its_counts);
    RUN(half_a_turn_is_read_as_it_was_set);
    return REPORT();
}
