/* The integrators, against the textbook's methods in absolute angles and extended precision, the
 * exact map against closed forms, and all of them against their orders of convergence. */
#include "axt_integrator.h"

#include "check.h"
#include "reference.h"

static const axt_method methods[] = {AXT_METHOD_NEWMARK, AXT_METHOD_HOUBOLT,
                                     AXT_METHOD_WILSON,  AXT_METHOD_RUNGE_KUTTA,
                                     AXT_METHOD_EXACT,   AXT_METHOD_EXACT_HELD};
enum { METHODS = COUNT_OF(methods) };

/* Steps of the paper's two settings [s]. */
static const double paper_steps[] = {2.9480912e-5, 1.0760687e-4};

static axt_integrator integrator_of(axt_method method, const axt_axis *axis, double step) {
    axt_integrator integrator;
    CHECK_EQUAL(axt_integrator_init(&integrator, method, axis, (axt_real)step), AXT_OK);
    return integrator;
}

/* ---- The textbook (K.-J. Bathe, Finite Element Procedures, chapter 9), in motor and table angle
 * -------------------------------------------------------------------------------------------- */

typedef struct {
    textbook_axis axis; /* and Newmark's method, 1/4 1/2 */
    wide torque;
    wide before[2][2]; /* angles one and two steps ago */
    int steps;
} textbook;

static textbook textbook_of(const axt_axis *axis, axt_real step) {
    return (textbook){.axis = {.I = {(wide)axis->I1, (wide)axis->I2},
                               .B = (wide)axis->B,
                               .K = (wide)axis->K,
                               .time_step = (wide)step,
                               .alpha = 0.25L,
                               .delta = 0.5L}};
}

/* (inertia_factor I + damping_factor [B] + [K]) x = right, a 2 x 2 system by Cramer's rule. */
static void solve(const textbook_axis *axis, wide inertia_factor, wide damping_factor,
                  const wide right[2], wide x[2]) {
    const wide coupling = damping_factor * axis->B + axis->K;
    const wide motor = inertia_factor * axis->I[0] + coupling;
    const wide table = inertia_factor * axis->I[1] + coupling;
    const wide per_determinant = 1 / (motor * table - coupling * coupling);
    x[0] = (right[0] * table + right[1] * coupling) * per_determinant;
    x[1] = (right[1] * motor + right[0] * coupling) * per_determinant;
}

static void textbook_houbolt(textbook *t, wide torque) {
    textbook_axis *axis = &t->axis;
    const wide h = axis->time_step;
    wide inertia[2];
    wide damping[2];
    for (int i = 0; i < 2; i++) {
        const wide x = axis->angle[i];
        const wide x1 = t->before[0][i];
        const wide x2 = t->before[1][i];
        inertia[i] = (5 * x - 4 * x1 + x2) / (h * h);
        damping[i] = (3 * x - 1.5L * x1 + x2 / 3) / h;
    }
    const wide shaft = axis->B * (damping[0] - damping[1]);
    const wide right[2] = {torque + axis->I[0] * inertia[0] + shaft,
                           axis->I[1] * inertia[1] - shaft};
    wide next[2];
    solve(axis, 2 / (h * h), 11 / (6 * h), right, next);
    for (int i = 0; i < 2; i++) {
        axis->acceleration[i] = 2 / (h * h) * next[i] - inertia[i];
        axis->speed[i] = 11 / (6 * h) * next[i] - damping[i];
        axis->angle[i] = next[i];
    }
}

static void textbook_wilson(textbook *t, wide torque) {
    textbook_axis *axis = &t->axis;
    const wide theta = 1.4L;
    const wide h = axis->time_step;
    const wide tau = theta * h;
    wide inertia[2];
    wide damping[2];
    for (int i = 0; i < 2; i++) {
        const wide x = axis->angle[i];
        const wide v = axis->speed[i];
        const wide a = axis->acceleration[i];
        inertia[i] = 6 / (tau * tau) * x + 6 / tau * v + 2 * a;
        damping[i] = 3 / tau * x + 2 * v + tau / 2 * a;
    }
    const wide shaft = axis->B * (damping[0] - damping[1]);
    const wide far = t->torque + theta * (torque - t->torque);
    const wide right[2] = {far + axis->I[0] * inertia[0] + shaft, axis->I[1] * inertia[1] - shaft};
    wide there[2];
    solve(axis, 6 / (tau * tau), 3 / tau, right, there);
    for (int i = 0; i < 2; i++) {
        const wide x = axis->angle[i];
        const wide v = axis->speed[i];
        const wide a = axis->acceleration[i];
        const wide next =
            6 / (theta * tau * tau) * (there[i] - x) - 6 / (theta * tau) * v + (1 - 3 / theta) * a;
        axis->acceleration[i] = next;
        axis->speed[i] = v + h / 2 * (next + a);
        axis->angle[i] = x + h * v + h * h / 6 * (next + 2 * a);
    }
}

/* The rates of angles and speeds where they are `at`, Eq. 3. */
static void rates(const textbook_axis *axis, wide torque, const wide at[4], wide rate[4]) {
    const wide shaft = axis->B * (at[2] - at[3]) + axis->K * (at[0] - at[1]);
    rate[0] = at[2];
    rate[1] = at[3];
    rate[2] = (torque - shaft) / axis->I[0];
    rate[3] = shaft / axis->I[1];
}

static void textbook_runge_kutta(textbook *t, wide torque) {
    textbook_axis *axis = &t->axis;
    static const wide place[4] = {0, 0.5L, 0.5L, 1};
    static const wide weight[4] = {1 / 6.0L, 1 / 3.0L, 1 / 3.0L, 1 / 6.0L};
    const wide start[4] = {axis->angle[0], axis->angle[1], axis->speed[0], axis->speed[1]};
    wide end[4];
    wide rate[4] = {0};
    memcpy(end, start, sizeof end);
    for (int stage = 0; stage < 4; stage++) {
        wide at[4];
        for (int i = 0; i < 4; i++) {
            at[i] = start[i] + place[stage] * axis->time_step * rate[i];
        }
        rates(axis, t->torque + place[stage] * (torque - t->torque), at, rate);
        for (int i = 0; i < 4; i++) {
            end[i] += weight[stage] * axis->time_step * rate[i];
        }
    }
    for (int i = 0; i < 2; i++) {
        axis->angle[i] = end[i];
        axis->speed[i] = end[2 + i];
    }
}

/* Closed form of x'' + d x' + k x = f + f' t, less than critically damped or without k and d. */
static void closed_form(wide d, wide k, wide h, wide f, wide ramp, wide *x, wide *v) {
    if (k > 0) {
        const wide slope = ramp / k;
        const wide rest = (f - d * slope) / k;
        const wide decay = d / 2;
        const wide wd = sqrtl(k - decay * decay);
        const wide x0 = *x - rest;
        const wide v0 = *v - slope;
        const wide e = expl(-decay * h);
        const wide c = cosl(wd * h);
        const wide s = sinl(wd * h) / wd;
        *x = e * (x0 * (c + decay * s) + v0 * s) + rest + slope * h;
        *v = e * (v0 * (c - decay * s) - x0 * k * s) + slope;
    } else {
        *x += h * (*v + h * (f / 2 + h * ramp / 6));
        *v += h * (f + h * ramp / 2);
    }
}

static void textbook_exact(textbook *t, wide from, wide to) {
    textbook_axis *axis = &t->axis;
    const wide h = axis->time_step;
    const wide inertia = axis->I[0] + axis->I[1];
    const wide reduced = axis->I[0] * axis->I[1] / inertia;
    wide twist = axis->angle[0] - axis->angle[1];
    wide rate = axis->speed[0] - axis->speed[1];
    wide body = (axis->I[0] * axis->angle[0] + axis->I[1] * axis->angle[1]) / inertia;
    wide speed = (axis->I[0] * axis->speed[0] + axis->I[1] * axis->speed[1]) / inertia;
    const wide ramp = (to - from) / h;
    closed_form(axis->B / reduced, axis->K / reduced, h, from / axis->I[0], ramp / axis->I[0],
                &twist, &rate);
    closed_form(0, 0, h, from / inertia, ramp / inertia, &body, &speed);
    axis->angle[0] = body + axis->I[1] / inertia * twist;
    axis->angle[1] = axis->angle[0] - twist;
    axis->speed[0] = speed + axis->I[1] / inertia * rate;
    axis->speed[1] = axis->speed[0] - rate;
}

static void textbook_advance(textbook *t, axt_method method, wide torque) {
    const wide angle[2] = {t->axis.angle[0], t->axis.angle[1]};
    if (method == AXT_METHOD_NEWMARK || (method == AXT_METHOD_HOUBOLT && t->steps < 2)) {
        textbook_step(&t->axis, torque, 0);
    } else if (method == AXT_METHOD_HOUBOLT) {
        textbook_houbolt(t, torque);
    } else if (method == AXT_METHOD_WILSON) {
        textbook_wilson(t, torque);
    } else if (method == AXT_METHOD_RUNGE_KUTTA) {
        textbook_runge_kutta(t, torque);
    } else {
        textbook_exact(t, t->torque, (method == AXT_METHOD_EXACT) ? torque : t->torque);
    }
    memcpy(t->before[1], t->before[0], sizeof angle);
    memcpy(t->before[0], angle, sizeof angle);
    t->torque = torque;
    t->steps++;
}

static wide angle_of(const axt_motion *motion) {
    return 2 * PI * ((wide)motion->turns + (wide)motion->fraction + (wide)motion->fraction_low);
}

/* Motion against the textbook's, relative to the largest of each seen so far. */
static void check_motion(const axt_motion *motion, const textbook *t, wide largest[4],
                         double tolerance) {
    const wide found[4] = {(wide)motion->twist, (wide)motion->twist_speed, (wide)motion->speed,
                           angle_of(motion)};
    const wide expected[4] = {t->axis.angle[0] - t->axis.angle[1],
                              t->axis.speed[0] - t->axis.speed[1], t->axis.speed[0],
                              t->axis.angle[0]};
    for (int i = 0; i < 4; i++) {
        largest[i] = fmaxl(largest[i], fabsl(expected[i]));
        CHECK_NEAR((found[i] - expected[i]) / (largest[i] + 1e-30L), 0, tolerance);
    }
}

/* Houbolt's method divides differences of positions by the step squared, and loses the digits. */
static double tolerance_of(axt_method method) {
    return (method == AXT_METHOD_HOUBOLT) ? BY_TYPE(2e-2, 2e-11) : BY_TYPE(1e-4, 1e-12);
}

/* An axis within a factor of ten of the paper's. */
static axt_axis random_axis(uint64_t *seed) {
    return (axt_axis){.I1 = log_uniform(seed, 2.7e-6, 2.7e-4),
                      .I2 = log_uniform(seed, 8.3e-7, 8.3e-5),
                      .B = log_uniform(seed, 1e-4, 3e-3),
                      .K = log_uniform(seed, 11, 1100)};
}

static double natural_frequency(const axt_axis *axis) {
    return sqrt((double)axis->K * (1 / (double)axis->I1 + 1 / (double)axis->I2));
}

CASE(each_method_is_the_textbook_s_whatever_the_axis_and_the_step) {
    uint64_t seed = 1;
    for (int n = 0; n < 60; n++) {
        const axt_axis axis = (n < 10) ? axt_axis_paper : random_axis(&seed);
        const axt_real step =
            (axt_real)((double)log_uniform(&seed, 0.03, 1.5) / natural_frequency(&axis));
        for (size_t m = 0; m < METHODS; m++) {
            axt_integrator integrator = integrator_of(methods[m], &axis, (double)step);
            textbook t = textbook_of(&axis, step);
            wide largest[4] = {0};
            for (int i = 0; i < 500; i++) {
                const axt_real torque = uniform(&seed, -1, 1);
                CHECK_EQUAL(axt_integrator_step(&integrator, torque), AXT_OK);
                textbook_advance(&t, methods[m], (wide)torque);
                axt_motion motion;
                axt_integrator_read(&integrator, &motion);
                check_motion(&motion, &t, largest, tolerance_of(methods[m]));
            }
        }
    }
}

CASE(each_method_starts_from_the_motion_that_was_set) {
    const axt_motion start = {
        .twist = (axt_real)1e-3, .twist_speed = -3, .speed = 20, .fraction = (axt_real)-0.3};
    for (size_t m = 0; m < METHODS; m++) {
        axt_integrator integrator = integrator_of(methods[m], &axt_axis_paper, paper_steps[0]);
        for (int i = 0; i < 5; i++) { /* what was before must not matter, nor Houbolt's past */
            CHECK_EQUAL(axt_integrator_step(&integrator, 1), AXT_OK);
        }
        const axt_real torque = (axt_real)0.4;
        CHECK_EQUAL(axt_integrator_set(&integrator, &start, torque), AXT_OK);
        textbook t = textbook_of(&axt_axis_paper, (axt_real)paper_steps[0]);
        t.axis.angle[0] = 2 * PI * (wide)start.fraction;
        t.axis.angle[1] = t.axis.angle[0] - (wide)start.twist;
        t.axis.speed[0] = (wide)start.speed;
        t.axis.speed[1] = (wide)start.speed - (wide)start.twist_speed;
        t.torque = (wide)torque;
        textbook_start(&t.axis, (wide)torque, 0);
        wide largest[4] = {0};
        axt_motion motion;
        axt_integrator_read(&integrator, &motion);
        check_motion(&motion, &t, largest, 4 * REAL_EPSILON);
        for (int i = 0; i < 200; i++) {
            CHECK_EQUAL(axt_integrator_step(&integrator, torque), AXT_OK);
            textbook_advance(&t, methods[m], (wide)torque);
            axt_integrator_read(&integrator, &motion);
            check_motion(&motion, &t, largest, tolerance_of(methods[m]));
        }
    }
}

/* ---- The exact map --------------------------------------------------------------------------- */

CASE(the_exact_map_is_the_matrix_exponential_for_any_damping) {
    uint64_t seed = 2;
    for (int n = 0; n < 2000; n++) {
        const axt_real h = log_uniform(&seed, 1e-6, 1);
        const axt_real x = log_uniform(&seed, 1e-3, 10);
        const axt_real zeta = (n % 4 == 0) ? 0 : log_uniform(&seed, 1e-3, 8);
        const axt_real k = x / h * (x / h);
        const axt_real d = 2 * zeta * x / h;
        axt_exact_map map;
        CHECK_EQUAL(axt_exact_map_init(&map, d, k, h), AXT_OK);
        wide a[2][2];
        exponential_less_one((wide)d, (wide)k, (wide)h, a);
        const wide unit[2][2] = {{1, (wide)h}, {1 / (wide)h, 1}};
        const double rounding = 1000 * REAL_EPSILON * (1 + (double)x);
        for (int i = 0; i < 2; i++) {
            for (int j = 0; j < 2; j++) {
                const wide size = fmaxl(fabsl(a[i][j]), fminl(1, (wide)x * (wide)x) * unit[i][j]);
                CHECK_NEAR(((wide)map.a[i][j] - a[i][j]) / size, 0, rounding);
            }
        }
    }
}

CASE(the_exact_map_of_a_short_step_keeps_the_digits_of_the_damping) {
    const axt_real h = (axt_real)1e-6;
    axt_exact_map map;
    CHECK_EQUAL(axt_exact_map_init(&map, 1, 0, h), AXT_OK);
    CHECK_NEAR((wide)map.a[1][1] / -(wide)h, 1, 1e-6);
    CHECK_NEAR(map.a[0][0], 0, 0);
}

/* What a constant force or a ramp does follows from a by integration, x'' + d x' + k x = f:
 * k held[0] + d (change of x) + (change of x') = f h, and so on. */
CASE(the_exact_map_balances_force_and_momentum) {
    uint64_t seed = 3;
    for (int n = 0; n < 1000; n++) {
        const axt_real h = log_uniform(&seed, 1e-5, 1);
        const axt_real x = log_uniform(&seed, 0.05, 3);
        const axt_real k = x / h * (x / h);
        const axt_real d = 2 * log_uniform(&seed, 1e-2, 3) * x / h;
        axt_exact_map map;
        CHECK_EQUAL(axt_exact_map_init(&map, d, k, h), AXT_OK);
        /* where the force holds the spring, x = f / k, nothing moves */
        const wide rest = 1 / (wide)k;
        CHECK_NEAR((wide)map.a[0][0] * rest / (wide)map.held[0], -1, BY_TYPE(2e-5, 1e-12));
        CHECK_NEAR((wide)map.a[1][0] * rest / (wide)map.held[1], -1, BY_TYPE(2e-5, 1e-12));
        /* on a force that grows with time, x = t / k - d / k^2 goes along, at speed 1 / k */
        const wide behind = -(wide)d / ((wide)k * (wide)k);
        const wide moved =
            (wide)map.a[0][0] * behind + (wide)map.a[0][1] * rest + (wide)map.ramp[0] * (wide)h;
        const wide faster =
            (wide)map.a[1][0] * behind + (wide)map.a[1][1] * rest + (wide)map.ramp[1] * (wide)h;
        const wide size = fabsl((wide)map.a[0][0] * behind) + rest * (wide)h;
        CHECK_NEAR((moved - rest * (wide)h) / size, 0, BY_TYPE(2e-5, 1e-12));
        const wide pull = fabsl((wide)map.a[1][0] * behind) + fabsl((wide)map.a[1][1] * rest);
        CHECK_NEAR(faster / pull, 0, BY_TYPE(2e-5, 1e-12));
    }
}

CASE(the_exact_map_of_a_rigid_body_is_a_parabola) {
    const axt_real h = (axt_real)0.25;
    axt_exact_map map;
    CHECK_EQUAL(axt_exact_map_init(&map, 0, 0, h), AXT_OK);
    CHECK_NEAR(map.a[0][0], 0, 0);
    CHECK_NEAR(map.a[0][1], 0.25, 0);
    CHECK_NEAR(map.a[1][0], 0, 0);
    CHECK_NEAR(map.a[1][1], 0, 0);
    CHECK_NEAR(map.held[0], 0.25 * 0.25 / 2, 0);
    CHECK_NEAR(map.held[1], 0.25, 0);
    CHECK_NEAR(map.ramp[0], 0.25 * 0.25 / 6, REAL_EPSILON);
    CHECK_NEAR(map.ramp[1], 0.25 / 2, 0);
}

CASE(an_exact_map_that_makes_no_sense_is_refused_and_nothing_is_written) {
    const struct {
        double damping;
        double stiffness;
        double step;
    } bad[] = {{-1, 1, 1},
               {1, -1, 1},
               {1, 1, 0},
               {1, 1, -1},
               {1.1e6, 1, 1},
               {1, 1.1e6, 1},
               {(double)NAN, 1, 1},
               {1, (double)NAN, 1},
               {1, 1, (double)NAN},
               {(double)INFINITY, 1, 1},
               {1, 1, (double)INFINITY}};
    axt_exact_map map = {.held = {1, 2}};
    const axt_exact_map before = map;
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_exact_map_init(&map, (axt_real)bad[i].damping, (axt_real)bad[i].stiffness,
                                       (axt_real)bad[i].step),
                    AXT_ERROR_RANGE);
        CHECK(UNCHANGED(map, before));
    }
}

/* ---- What the methods promise ----------------------------------------------------------------
 */

/* Twist of the paper's axis after `periods` of free vibration without damping from a twist of 1. */
static wide free_twist(axt_method method, int steps_a_period, int periods) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    const double h = 2 * (double)PI / natural_frequency(&axis) / steps_a_period;
    axt_integrator integrator = integrator_of(method, &axis, h);
    const axt_motion start = {.twist = 1};
    CHECK_EQUAL(axt_integrator_set(&integrator, &start, 0), AXT_OK);
    /* a quarter of a period on, where the twist itself says how late the method is */
    for (int n = 0; n < periods * steps_a_period + steps_a_period / 4; n++) {
        CHECK_EQUAL(axt_integrator_step(&integrator, 0), AXT_OK);
    }
    axt_motion motion;
    axt_integrator_read(&integrator, &motion);
    return (wide)motion.twist;
}

CASE(errors_fall_with_the_order_of_the_method) {
    static const struct {
        axt_method method;
        int steps_a_period;
        double order;
    } promised[] = {{AXT_METHOD_NEWMARK, 64, 2},
                    {AXT_METHOD_HOUBOLT, 128, 2},
                    {AXT_METHOD_WILSON, 64, 2},
                    {AXT_METHOD_RUNGE_KUTTA, 16, 4}};
    for (size_t i = 0; i < COUNT_OF(promised); i++) {
        const wide coarse = free_twist(promised[i].method, promised[i].steps_a_period, 1);
        const wide fine = free_twist(promised[i].method, 2 * promised[i].steps_a_period, 1);
        CHECK_NEAR(log2l(fabsl(coarse / fine)), promised[i].order, 0.2);
    }
    CHECK_NEAR(free_twist(AXT_METHOD_EXACT, 16, 20), 0, BY_TYPE(1e-4, 1e-12));
}

/* Newmark 1/4, 1/2 keeps the energy of a free vibration, Houbolt and Wilson take it away, and so
 * does Runge and Kutta's method below its limit. */
CASE(numerical_damping_is_where_it_belongs) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    for (size_t m = 0; m < METHODS; m++) {
        axt_integrator integrator = integrator_of(methods[m], &axis, 1 / natural_frequency(&axis));
        const axt_motion start = {.twist = 1};
        CHECK_EQUAL(axt_integrator_set(&integrator, &start, 0), AXT_OK);
        wide first = 0;
        wide energy = 0;
        for (int n = 0; n < 200; n++) {
            CHECK_EQUAL(axt_integrator_step(&integrator, 0), AXT_OK);
            axt_motion motion;
            axt_integrator_read(&integrator, &motion);
            const wide rate = (wide)motion.twist_speed / (wide)natural_frequency(&axis);
            energy = (wide)motion.twist * (wide)motion.twist + rate * rate;
            first = (n == 2) ? energy : first;
        }
        const bool keeps = methods[m] == AXT_METHOD_NEWMARK || methods[m] == AXT_METHOD_EXACT ||
                           methods[m] == AXT_METHOD_EXACT_HELD;
        if (keeps) {
            CHECK_NEAR(energy / first, 1, BY_TYPE(1e-4, 1e-12));
        } else {
            CHECK(energy < 0.5L * first);
        }
    }
}

CASE(a_held_torque_acts_one_step_later) {
    for (size_t s = 0; s < COUNT_OF(paper_steps); s++) {
        axt_integrator held = integrator_of(AXT_METHOD_EXACT_HELD, &axt_axis_paper, paper_steps[s]);
        CHECK_EQUAL(axt_integrator_step(&held, 1), AXT_OK);
        axt_motion motion;
        axt_integrator_read(&held, &motion);
        CHECK_NEAR(motion.twist, 0, 0);
        CHECK_NEAR(motion.speed, 0, 0);
        CHECK_EQUAL(axt_integrator_step(&held, 0), AXT_OK);
        axt_integrator_read(&held, &motion);
        CHECK(motion.twist > 0 && motion.speed > 0);
    }
}

/* ---- What they refuse ------------------------------------------------------------------------
 */

/* Takes a resting axis to half a turn a step, as for the plant. */
static double torque_limit(const axt_axis *axis, double step) {
    return (double)PI * ((double)axis->I1 + (double)axis->I2) / (step * step);
}

CASE(a_bad_torque_moves_nothing) {
    const double limit = torque_limit(&axt_axis_paper, paper_steps[0]);
    const struct {
        double torque;
        axt_status expected;
    } bad[] = {{(double)NAN, AXT_ERROR_NOT_FINITE},       {(double)INFINITY, AXT_ERROR_NOT_FINITE},
               {(double)-INFINITY, AXT_ERROR_NOT_FINITE}, {1.01 * limit, AXT_ERROR_RANGE},
               {-1.01 * limit, AXT_ERROR_RANGE},          {(double)FLT_MAX, AXT_ERROR_RANGE}};
    for (size_t m = 0; m < METHODS; m++) {
        axt_integrator integrator = integrator_of(methods[m], &axt_axis_paper, paper_steps[0]);
        CHECK_EQUAL(axt_integrator_step(&integrator, 1), AXT_OK);
        CHECK_EQUAL(axt_integrator_step(&integrator, (axt_real)(0.99 * limit)), AXT_OK);
        const axt_integrator before = integrator;
        const axt_motion still = {.fraction = 0};
        for (size_t i = 0; i < COUNT_OF(bad); i++) {
            CHECK_EQUAL(axt_integrator_step(&integrator, (axt_real)bad[i].torque), bad[i].expected);
            CHECK(UNCHANGED(integrator, before));
            CHECK_EQUAL(axt_integrator_set(&integrator, &still, (axt_real)bad[i].torque),
                        bad[i].expected);
            CHECK(UNCHANGED(integrator, before));
        }
    }
}

CASE(a_motion_that_makes_no_sense_is_refused_and_nothing_moves) {
    axt_integrator integrator = integrator_of(AXT_METHOD_WILSON, &axt_axis_paper, paper_steps[0]);
    const axt_integrator before = integrator;
    const double half_turn_a_step = (double)PI / paper_steps[0];
    const axt_motion out_of_range[] = {{.twist = (axt_real)1001},
                                       {.twist = (axt_real)-1001},
                                       {.twist_speed = (axt_real)1.001e9},
                                       {.speed = (axt_real)(1.001 * half_turn_a_step)},
                                       {.speed = (axt_real)(-1.001 * half_turn_a_step)},
                                       {.fraction = (axt_real)1.001},
                                       {.fraction = (axt_real)-1.001}};
    for (size_t i = 0; i < COUNT_OF(out_of_range); i++) {
        CHECK_EQUAL(axt_integrator_set(&integrator, &out_of_range[i], 0), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(integrator, before));
    }
    const axt_motion at_the_limit[] = {{.twist = 1000},
                                       {.twist = -1000},
                                       {.twist_speed = (axt_real)1e9},
                                       {.fraction = 1},
                                       {.fraction = -1}};
    for (size_t i = 0; i < COUNT_OF(at_the_limit); i++) {
        axt_integrator moved = before;
        CHECK_EQUAL(axt_integrator_set(&moved, &at_the_limit[i], 0), AXT_OK);
    }
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        const axt_motion bad[] = {{.twist = not_finite[i]},
                                  {.twist_speed = not_finite[i]},
                                  {.speed = not_finite[i]},
                                  {.fraction = not_finite[i]}};
        for (size_t j = 0; j < COUNT_OF(bad); j++) {
            CHECK_EQUAL(axt_integrator_set(&integrator, &bad[j], 0), AXT_ERROR_NOT_FINITE);
            CHECK(UNCHANGED(integrator, before));
        }
    }
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_integrator integrator = integrator_of(AXT_METHOD_EXACT, &axt_axis_paper, paper_steps[0]);
    const axt_integrator before = integrator;
    axt_axis negative = axt_axis_paper;
    negative.K = -negative.K;
    const double steps[] = {0, -1e-5, 0.9e-7, 1.1, 0.25 /* wn Dt above 1000 */};
    for (size_t m = 0; m < METHODS; m++) {
        CHECK_EQUAL(axt_integrator_init(&integrator, methods[m], &negative, (axt_real)1e-5),
                    AXT_ERROR_RANGE);
        for (size_t i = 0; i < COUNT_OF(steps); i++) {
            CHECK_EQUAL(
                axt_integrator_init(&integrator, methods[m], &axt_axis_paper, (axt_real)steps[i]),
                AXT_ERROR_RANGE);
        }
        for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
            CHECK_EQUAL(
                axt_integrator_init(&integrator, methods[m], &axt_axis_paper, not_finite[i]),
                AXT_ERROR_RANGE);
        }
    }
    const axt_method unknown[] = {(axt_method)6, (axt_method)-1};
    for (size_t i = 0; i < COUNT_OF(unknown); i++) {
        CHECK_EQUAL(axt_integrator_init(&integrator, unknown[i], &axt_axis_paper, (axt_real)1e-5),
                    AXT_ERROR_RANGE);
    }
    CHECK(UNCHANGED(integrator, before));
}

/* The limit of an undamped vibration is wn Dt = 2 sqrt(2); by much damping the real root decides,
 * whose limit is 2.785. */
CASE(runge_and_kutta_s_method_is_refused_where_it_is_unstable) {
    static const struct {
        double zeta;
        double limit;
    } limits[] = {{0, 2.828427}, {2, 2.785293 / 3.732051}, {100, 2.785293 / 200}};
    for (size_t i = 0; i < COUNT_OF(limits); i++) {
        const double wn = natural_frequency(&axt_axis_paper);
        axt_axis axis = axt_axis_paper;
        axis.B = (axt_real)(2 * limits[i].zeta * (double)axis.K / wn);
        axt_integrator integrator;
        CHECK_EQUAL(axt_integrator_init(&integrator, AXT_METHOD_RUNGE_KUTTA, &axis,
                                        (axt_real)(0.999 * limits[i].limit / wn)),
                    AXT_OK);
        CHECK_EQUAL(axt_integrator_init(&integrator, AXT_METHOD_RUNGE_KUTTA, &axis,
                                        (axt_real)(1.001 * limits[i].limit / wn)),
                    AXT_ERROR_RANGE);
    }
}

static bool finite_motion(const axt_motion *motion) {
    return isfinite(motion->twist) && isfinite(motion->twist_speed) && isfinite(motion->speed) &&
           isfinite(motion->fraction);
}

CASE(nothing_but_finite_numbers_come_out_of_any_integrator) {
    uint64_t seed = 4;
    int accepted = 0;
    for (int n = 0; n < 20000 / SHORTENED; n++) {
        const axt_axis axis = {.I1 = log_uniform(&seed, 1.1e-9, 0.9e6),
                               .I2 = log_uniform(&seed, 1.1e-9, 0.9e6),
                               .B = log_uniform(&seed, 1e-12, 0.9e9),
                               .K = log_uniform(&seed, 1.1e-6, 0.9e12)};
        const double step = (double)log_uniform(&seed, 1e-7, 1);
        axt_integrator integrator;
        if (axt_integrator_init(&integrator, methods[n % METHODS], &axis, (axt_real)step) !=
            AXT_OK) {
            continue;
        }
        accepted++;
        const axt_real size = log_uniform(&seed, 1e-9, 0.9) * (axt_real)torque_limit(&axis, step);
        bool finite = true;
        for (int i = 0; i < 300; i++) {
            CHECK_EQUAL(axt_integrator_step(&integrator, uniform(&seed, -1, 1) * size), AXT_OK);
            axt_motion motion;
            axt_integrator_read(&integrator, &motion);
            finite = finite && finite_motion(&motion);
        }
        CHECK(finite);
    }
    CHECK(accepted > 1000 / SHORTENED);
}

CASE(the_count_of_steps_stops_at_its_end) {
    axt_integrator integrator;
    CHECK_EQUAL(
        axt_integrator_init(&integrator, AXT_METHOD_HOUBOLT, &axt_axis_paper, (axt_real)1e-5),
        AXT_OK);
    integrator.steps = UINT32_MAX - 1;
    for (int i = 0; i < 3; i++) {
        CHECK_EQUAL(axt_integrator_step(&integrator, 0), AXT_OK);
        CHECK_EQUAL(integrator.steps, UINT32_MAX);
    }
}

int main(void) {
    RUN(the_count_of_steps_stops_at_its_end);
    RUN(each_method_is_the_textbook_s_whatever_the_axis_and_the_step);
    RUN(each_method_starts_from_the_motion_that_was_set);
    RUN(the_exact_map_is_the_matrix_exponential_for_any_damping);
    RUN(the_exact_map_of_a_short_step_keeps_the_digits_of_the_damping);
    RUN(the_exact_map_balances_force_and_momentum);
    RUN(the_exact_map_of_a_rigid_body_is_a_parabola);
    RUN(an_exact_map_that_makes_no_sense_is_refused_and_nothing_is_written);
    RUN(errors_fall_with_the_order_of_the_method);
    RUN(numerical_damping_is_where_it_belongs);
    RUN(a_held_torque_acts_one_step_later);
    RUN(a_bad_torque_moves_nothing);
    RUN(a_motion_that_makes_no_sense_is_refused_and_nothing_moves);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    RUN(runge_and_kutta_s_method_is_refused_where_it_is_unstable);
    RUN(nothing_but_finite_numbers_come_out_of_any_integrator);
    say_if_shortened("test_integrator");
    return REPORT();
}
