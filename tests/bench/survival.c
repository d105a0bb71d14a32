/* What the estimator survives, in float32: standing still for hours, motor and table angle that are
 * almost the same number, regressors of very different size, old age.
 *
 *     survival CASE        prints  steps N, error E, finite 0|1 and what else the case measures
 *
 * The samples come from a simulation in double, so that what is measured is the estimator's error.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drive.h"

enum { INPUTS = 5, OUTPUTS = 4, CHECK_EVERY = 1000 };

static void report(const char *what, double value) {
    printf("%s %.9g\n", what, value);
}

static void require(axt_status status) {
    if (status != AXT_OK) {
        (void)fprintf(stderr, "%s\n", axt_status_string(status));
        exit(1);
    }
}

/* ---- The axis in double: Eq. 3 by the trapezoidal rule, twist and rigid body
 * -------------------*/

typedef struct {
    double twist, twist_speed, twist_acceleration;
    double angle, speed; /* of the rigid body */
    double torque;
} true_axis;

static double inertia(void) {
    return (double)axt_axis_paper.I1 + (double)axt_axis_paper.I2;
}

static double motor_share(void) {
    return (double)axt_axis_paper.I2 / inertia();
}

static void true_step(true_axis *a, double torque) {
    const double h = (double)drive_time_step() / 2;
    const double per_reduced = 1 / (double)axt_axis_paper.I1 + 1 / (double)axt_axis_paper.I2;
    const double d = (double)axt_axis_paper.B * per_reduced;
    const double k = (double)axt_axis_paper.K * per_reduced;
    const double rate = a->twist_speed + h * a->twist_acceleration;
    const double twist = a->twist + h * (a->twist_speed + rate);
    const double acceleration =
        (torque / (double)axt_axis_paper.I1 - d * rate - k * twist) / (1 + h * d + h * h * k);
    a->twist = twist + h * h * acceleration;
    a->twist_speed = rate + h * acceleration;
    a->twist_acceleration = acceleration;

    const double speed = a->speed + h * (a->torque + torque) / inertia();
    a->angle += h * (a->speed + speed);
    a->speed = speed;
    a->torque = torque;
}

static double motor_angle(const true_axis *a) {
    return a->angle + motor_share() * a->twist;
}

static double motor_speed(const true_axis *a) {
    return a->speed + motor_share() * a->twist_speed;
}

/* ---- How it is seen and what is learned
 * ---------------------------------------------------------*/

static axt_motion seen_motion(const true_axis *a) {
    const double turns = motor_angle(a) / (2 * M_PI);
    const double whole = round(turns);
    const float fraction = (float)(turns - whole);
    return (axt_motion){.twist = (float)a->twist,
                        .twist_speed = (float)a->twist_speed,
                        .speed = (float)motor_speed(a),
                        .turns = (int32_t)whole,
                        .fraction = fraction,
                        .fraction_low = (float)(turns - whole - (double)fraction)};
}

static int32_t seen_count(double angle) {
    return (int32_t)llround(angle / (2 * M_PI) * DRIVE_COUNTS);
}

/* A uniform number from -1 to 1 (xorshift64*). */
static double noise(void) {
    static uint64_t state = 88172645463325252U;
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (double)(int64_t)(state * 2685821657736338717U) / 9223372036854775808.0;
}

static double dither; /* counts of noise on the encoders, and that per mille on the torque */

static axt_status learn(axt_ident *ident, const true_axis *a, bool encoders) {
    const uint32_t number = ident->guard.next;
    if (!encoders) {
        const axt_motion motion = seen_motion(a);
        return axt_ident_motion(ident, number, &motion, (float)a->torque);
    }
    const double count = 2 * M_PI / DRIVE_COUNTS;
    const double torque = a->torque + dither * 1e-3 * (double)DRIVE_TORQUE * noise();
    return axt_ident_counts(ident, number, seen_count(motor_angle(a) + dither * count * noise()),
                            seen_count(motor_angle(a) - a->twist + dither * count * noise()),
                            (float)torque);
}

static double relative(axt_real value, axt_real reference) {
    return fabs(((double)value - (double)reference) / (double)reference);
}

/* Worst of the four parameters. */
static double difference(const axt_axis *a, const axt_axis *reference) {
    return fmax(fmax(relative(a->I1, reference->I1), relative(a->I2, reference->I2)),
                fmax(relative(a->B, reference->B), relative(a->K, reference->K)));
}

/* Worst of the four parameters; infinite when the estimator says it does not know. */
static double ident_error(const axt_ident *ident) {
    axt_estimate e;
    if (axt_ident_result(ident, &e) != AXT_OK) {
        return (double)INFINITY;
    }
    return difference(&e.axis, &axt_axis_paper);
}

static double largest_variance(const axt_rls *rls) {
    double largest = 0;
    for (uint32_t i = 0; i < rls->inputs; i++) {
        largest = fmax(largest, (double)axt_rls_covariance(rls, i, i));
    }
    return largest;
}

/* Largest relative change of the four parameters; infinite when there is no answer any more. */
static double moved(const axt_ident *now, const axt_ident *then) {
    axt_estimate a;
    axt_estimate b;
    if (axt_ident_result(now, &a) != AXT_OK || axt_ident_result(then, &b) != AXT_OK) {
        return (double)INFINITY;
    }
    return difference(&a.axis, &b.axis);
}

/* ---- Standing still with forgetting
 * -------------------------------------------------------------*/

typedef struct {
    axt_ident ident;
    true_axis axis;
    bool encoders;
    axt_real excitation[DRIVE_PERIOD];
} trial;

static void start_trial(trial *t, axt_ident_form form, axt_real forgetting, bool encoders) {
    const axt_ident_config config = drive_ident_config(form, forgetting, encoders);
    *t = (trial){.encoders = encoders};
    drive_fill_excitation(t->excitation);
    require(axt_ident_init(&t->ident, &config));
}

/* Excites for some periods and returns the largest error of the last one. */
static double excite(trial *t, int periods) {
    double worst = 0;
    for (int n = 0; n < periods * DRIVE_PERIOD; n++) {
        true_step(&t->axis, (double)t->excitation[n % DRIVE_PERIOD]);
        (void)learn(&t->ident, &t->axis, t->encoders);
        if (n >= (periods - 1) * DRIVE_PERIOD) {
            worst = fmax(worst, ident_error(&t->ident));
        }
    }
    return worst;
}

static void brake(trial *t) {
    enum { SAMPLES = DRIVE_PERIOD / 2 };
    const double torque = -t->axis.speed * inertia() / ((double)drive_time_step() * SAMPLES);
    for (int n = 0; n < SAMPLES; n++) {
        true_step(&t->axis, torque);
        (void)learn(&t->ident, &t->axis, t->encoders);
    }
}

/* The shaft rings down, and then nothing happens for a long time. */
static void standstill(axt_ident_form form, bool encoders) {
    enum { STEPS = 10000000, RINGING = 20 * DRIVE_PERIOD, LEARN = 4, AGAIN = 2 };
    trial t;
    start_trial(&t, form, 0.995F, encoders);
    const double prior = largest_variance(&t.ident.rls);
    report("error_before", excite(&t, LEARN));
    brake(&t);
    const axt_ident before = t.ident;
    double variance = 0;
    bool finite = true;
    for (int n = 0; n < STEPS; n++) {
        true_step(&t.axis, 0);
        (void)learn(&t.ident, &t.axis, encoders);
        if (n == RINGING) {
            report("moved_while_ringing", moved(&t.ident, &before));
        }
        if (n % CHECK_EVERY == 0) {
            variance = fmax(variance, largest_variance(&t.ident.rls));
            finite = finite && axt_rls_invariants(&t.ident.rls);
        }
    }
    report("moved", moved(&t.ident, &before));
    report("variance_to_prior", variance / prior);
    (void)excite(&t, AGAIN);
    report("steps", STEPS);
    report("error", ident_error(&t.ident));
    report("finite", finite && axt_rls_invariants(&t.ident.rls));
}

static void standstill_3x2(void) {
    standstill(AXT_IDENT_3X2, false);
}

static void standstill_5x4(void) {
    standstill(AXT_IDENT_5X4, false);
}

static void standstill_counts_3x2(void) {
    standstill(AXT_IDENT_3X2, true);
}

static void standstill_counts_5x4(void) {
    standstill(AXT_IDENT_5X4, true);
}

static void standstill_dither_3x2(void) {
    dither = 1;
    standstill(AXT_IDENT_3X2, true);
}

/* ---- Motor and table angle almost the same number
 * ----------------------------------------------*/

enum { COLLINEAR_STEPS = 900000 };
#define COLLINEAR 1e-4

/* A slow swing of the whole axis under the excitation, so wide that the twist is 1e-4 of it. */
static double swing_torque(const trial *t, int n) {
    const double period = 13 * DRIVE_PERIOD;
    const double w = 2 * M_PI / (period * (double)drive_time_step());
    const double twist_rms = 1.89e-3; /* under the excitation alone */
    const double amplitude = sqrt(2.0) * twist_rms / COLLINEAR;
    return (double)t->excitation[n % DRIVE_PERIOD] +
           amplitude * inertia() * w * w * cos(2 * M_PI * n / period);
}

/* Steady from the start: no constant speed that would carry the axis away. */
static void start_swing(trial *t) {
    double mean_speed = 0;
    double mean_angle = 0;
    enum { SAMPLES = 13 * DRIVE_PERIOD };
    for (int pass = 0; pass < 2; pass++) {
        trial ahead = *t;
        mean_speed = 0;
        mean_angle = 0;
        for (int n = 0; n < SAMPLES; n++) {
            true_step(&ahead.axis, swing_torque(t, n));
            mean_speed += ahead.axis.speed / SAMPLES;
            mean_angle += ahead.axis.angle / SAMPLES;
        }
        t->axis.speed -= (pass == 0) ? mean_speed : 0;
        t->axis.angle -= (pass == 1) ? mean_angle : 0;
    }
}

/* The 5x4 equation in absolute coordinates, theta1, theta2 and their speeds, each scaled by a power
 * of two: what an estimator without a model of the axis is given. */
static void absolute_state(const true_axis *a, float x[INPUTS]) {
    x[0] = (float)motor_angle(a);
    x[1] = (float)(motor_angle(a) - a->twist);
    x[2] = (float)motor_speed(a);
    x[3] = (float)(motor_speed(a) - a->twist_speed);
    x[4] = (float)a->torque;
}

static void collinear_raw(void) {
    const float scale[INPUTS] = {0x1p-4F, 0x1p-4F, 0x1p-9F, 0x1p-9F, 0x1p2F};
    const float output_scale[OUTPUTS] = {0x1p-9F, 0x1p-9F, 0x1p-13F, 0x1p-13F};
    trial t;
    start_trial(&t, AXT_IDENT_5X4, 0.995F, false);
    start_swing(&t);
    axt_rls rls;
    require(axt_rls_init(&rls, INPUTS, OUTPUTS, 0.995F, 1e6F));
    float last[INPUTS];
    absolute_state(&t.axis, last);
    double twist = 0;
    double angle = 0;
    bool finite = true;
    for (int n = 0; n < COLLINEAR_STEPS; n++) {
        true_step(&t.axis, swing_torque(&t, n));
        float now[INPUTS];
        float phi[INPUTS];
        float y[OUTPUTS];
        absolute_state(&t.axis, now);
        for (int i = 0; i < INPUTS; i++) {
            phi[i] = 0.5F * (now[i] + last[i]) * scale[i];
        }
        for (int i = 0; i < OUTPUTS; i++) {
            y[i] = (now[i] - last[i]) / drive_time_step() * output_scale[i];
        }
        memcpy(last, now, sizeof last);
        (void)axt_rls_update(&rls, phi, y);
        finite = finite && axt_rls_invariants(&rls);
        twist += t.axis.twist * t.axis.twist;
        angle += motor_angle(&t.axis) * motor_angle(&t.axis);
    }
    axt_axis found;
    found.I1 = output_scale[2] / scale[4] / rls.theta[2][4];
    found.K = -rls.theta[2][0] * (scale[0] / output_scale[2]) * found.I1;
    found.B = -rls.theta[2][2] * (scale[2] / output_scale[2]) * found.I1;
    found.I2 = found.K / (rls.theta[3][0] * (scale[0] / output_scale[3]));
    report("twist_to_angle", sqrt(twist / angle));
    report("steps", COLLINEAR_STEPS);
    report("error", difference(&found, &axt_axis_paper));
    report("finite", finite);
}

static void collinear_axis(axt_ident_form form) {
    trial t;
    start_trial(&t, form, 0.995F, false);
    start_swing(&t);
    double worst = 0;
    bool finite = true;
    for (int n = 0; n < COLLINEAR_STEPS; n++) {
        true_step(&t.axis, swing_torque(&t, n));
        (void)learn(&t.ident, &t.axis, false);
        finite = finite && axt_rls_invariants(&t.ident.rls);
        if (n > COLLINEAR_STEPS / 2 && n % (CHECK_EVERY + 1) == 0) {
            worst = fmax(worst, ident_error(&t.ident));
        }
    }
    report("worst_of_last_half", worst);
    report("steps", COLLINEAR_STEPS);
    report("error", ident_error(&t.ident));
    report("finite", finite);
}

static void collinear_axis_3x2(void) {
    collinear_axis(AXT_IDENT_3X2);
}

static void collinear_axis_5x4(void) {
    collinear_axis(AXT_IDENT_5X4);
}

/* ---- The bare engine on made-up regressors
 * -----------------------------------------------------*/

/* y = theta phi with entries of about 1 against regressors of these sizes; the error is against the
 * largest entry. */
static void made_up(int steps, float prior, const double size[INPUTS], double collinear) {
    axt_rls rls;
    require(axt_rls_init(&rls, INPUTS, OUTPUTS, 0.995F, prior));
    double theta[OUTPUTS][INPUTS];
    for (int row = 0; row < OUTPUTS; row++) {
        for (int i = 0; i < INPUTS; i++) {
            theta[row][i] = (0.5 + 0.1 * (row + 1) * (i + 1) * ((i % 2 == 0) ? 1 : -1)) / size[i];
        }
    }
    bool finite = true;
    for (int n = 0; n < steps; n++) {
        float phi[INPUTS];
        float y[OUTPUTS];
        for (int i = 0; i < INPUTS; i++) {
            phi[i] = (float)(size[i] * noise());
        }
        if (collinear > 0) { /* two pairs that differ by this much */
            phi[1] = (float)((double)phi[0] + collinear * noise());
            phi[3] = (float)((double)phi[2] + collinear * noise());
        }
        for (int row = 0; row < OUTPUTS; row++) {
            double sum = 0;
            for (int i = 0; i < INPUTS; i++) {
                sum += theta[row][i] * (double)phi[i];
            }
            y[row] = (float)sum;
        }
        (void)axt_rls_update(&rls, phi, y);
        finite = finite && axt_rls_invariants(&rls);
    }
    double error = 0;
    for (int row = 0; row < OUTPUTS; row++) {
        for (int i = 0; i < INPUTS; i++) {
            error = fmax(error, fabs((double)rls.theta[row][i] - theta[row][i]) * size[i]);
        }
    }
    report("steps", steps);
    report("error", error);
    report("finite", finite);
}

static void collinear_made_up(void) {
    static const double size[INPUTS] = {1, 1, 1, 1, 1};
    made_up(COLLINEAR_STEPS, 1e6F, size, COLLINEAR);
}

static void nine_decades(void) {
    static const double size[INPUTS] = {1e3, 5.6, 3.2e-2, 1.8e-4, 1e-6};
    made_up(1000000, 1e15F, size, 0);
}

/* ---- Old age
 * -----------------------------------------------------------------------------------*/

/* The whole chain in float32: excitation, plant, identification from motion. */
static void age(axt_real forgetting) {
    enum { STEPS = 1000000000, TURN = 200 };
    axt_real excitation[DRIVE_PERIOD];
    drive_fill_excitation(excitation);
    drive d;
    require(drive_init(&d, excitation, TURN));
    const axt_ident_config config = drive_ident_config(AXT_IDENT_3X2, forgetting, false);
    require(axt_ident_init(&d.ident, &config));
    double worst = 0;
    bool finite = true;
    for (int n = 0; n < STEPS; n++) {
        const axt_real torque = axt_player_step(&d.excitation);
        axt_motion motion;
        (void)axt_plant_step(&d.plant, torque);
        axt_plant_read(&d.plant, &motion);
        (void)axt_ident_motion(&d.ident, d.number++, &motion, torque);
        if (n % (CHECK_EVERY * DRIVE_PERIOD) == CHECK_EVERY) {
            worst = fmax(worst, ident_error(&d.ident));
            finite = finite && axt_rls_invariants(&d.ident.rls);
        }
    }
    report("worst_error", worst);
    report("steps", STEPS);
    report("error", ident_error(&d.ident));
    report("finite", finite && axt_rls_invariants(&d.ident.rls));
}

static void age_forgetting(void) {
    age(0.9999F);
}

static void age_remembering(void) {
    age(1.0F);
}

/* -------------------------------------------------------------------------------------------------*/

static const struct {
    const char *name;
    void (*run)(void);
} cases[] = {
    {"standstill_3x2", standstill_3x2},
    {"standstill_5x4", standstill_5x4},
    {"standstill_counts_3x2", standstill_counts_3x2},
    {"standstill_counts_5x4", standstill_counts_5x4},
    {"standstill_dither_3x2", standstill_dither_3x2},
    {"collinear_raw", collinear_raw},
    {"collinear_axis_3x2", collinear_axis_3x2},
    {"collinear_axis_5x4", collinear_axis_5x4},
    {"collinear_made_up", collinear_made_up},
    {"nine_decades", nine_decades},
    {"age_forgetting", age_forgetting},
    {"age_remembering", age_remembering},
};

int main(int count, char **argument) {
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        if (count == 2 && strcmp(argument[1], cases[i].name) == 0) {
            cases[i].run();
            return 0;
        }
    }
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        printf("%s\n", cases[i].name);
    }
    return (count == 1) ? 0 : 2;
}
