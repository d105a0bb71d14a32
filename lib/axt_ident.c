#include "axt_ident.h"

#include "axt_encoder.h"
#include "axt_math.h"
#include "axt_rows.h"

/* Columns and rows of the full form (5x4); the short form (3x2) has those that carry parameters. */
enum { Q, R, Q_RATE, R_RATE, TORQUE };

enum {
    SETTLED_UPDATES = 20, /* fewer say nothing about the residuals */
    RELATIVE_ERROR = 10   /* valid: the standard error is less than a tenth of the value */
};

/* How long the filter remembers its start: its slowest pole is w / 2, and e^-16 is 1e-7. */
#define SETTLING_RADIANS AXT_R(32)

/* The prior of the scaled problem: large enough to be forgotten, small enough that the first
 * updates leave digits in P. */
#define PRIOR (AXT_IS_DOUBLE ? AXT_R(1e13) : AXT_R(1e6))

/* The power of two next below x > 0. */
static axt_real power_of_two(axt_real x) {
    axt_real power = AXT_R(1);
    while (power > x && power > AXT_R(1e-30)) {
        power *= AXT_R(0.5);
    }
    while (power <= AXT_R(0.5) * x && power < AXT_R(1e30)) {
        power *= AXT_R(2);
    }
    return power;
}

static bool from_encoders(const axt_ident_config *config) {
    return config->counts_per_turn[0] != 0;
}

static axt_status check_config(const axt_ident_config *config) {
    const axt_status status = axt_axis_check(&config->expected);
    if (status != AXT_OK) {
        return status;
    }
    const bool form = config->form == AXT_IDENT_3X2 || config->form == AXT_IDENT_5X4;
    const bool encoders = (config->counts_per_turn[0] == 0) == (config->counts_per_turn[1] == 0) &&
                          config->counts_per_turn[0] <= AXT_ENCODER_COUNTS_MAX &&
                          config->counts_per_turn[1] <= AXT_ENCODER_COUNTS_MAX;
    const bool numbers = config->time_step >= AXT_R(1e-7) && config->time_step <= AXT_R(1) &&
                         config->torque >= AXT_R(1e-9) && config->torque <= AXT_R(1e9);
    return (form && encoders && numbers) ? AXT_OK : AXT_ERROR_RANGE;
}

/* Scales every quantity by a power of two to about 1, from the size it has when the expected torque
 * shakes the expected axis near its natural frequency. */
static void set_scales(axt_ident *ident, axt_real wn, axt_real rate) {
    const axt_ident_config *config = &ident->config;
    const axt_real inertia = config->expected.I1 + config->expected.I2;
    const axt_real twist = config->torque / (config->expected.I1 * wn * wn);
    const axt_real body = config->torque / (inertia * wn * wn) * AXT_R(16);
    const axt_real size[AXT_RLS_INPUTS_MAX] = {[Q] = twist,
                                               [R] = body,
                                               [Q_RATE] = twist * wn,
                                               [R_RATE] = body * wn / AXT_R(4),
                                               [TORQUE] = config->torque};
    for (uint32_t i = 0; i < AXT_RLS_INPUTS_MAX; i++) {
        ident->scale[i] = AXT_R(1) / power_of_two(size[i] * rate);
    }
    ident->output_scale[Q] = ident->scale[Q_RATE];
    ident->output_scale[R] = ident->scale[R_RATE];
    ident->output_scale[Q_RATE] = AXT_R(1) / power_of_two(twist * wn * wn * rate);
    ident->output_scale[R_RATE] = AXT_R(1) / power_of_two(config->torque / inertia * rate);
}

axt_status axt_ident_init(axt_ident *ident, const axt_ident_config *config) {
    axt_modal modal;
    axt_rls rls;
    axt_status status = check_config(config);
    if (status == AXT_OK) {
        status = axt_axis_modal(&config->expected, &modal);
    }
    if (status == AXT_OK) {
        const bool full = config->form == AXT_IDENT_5X4;
        status = axt_rls_init(&rls, full ? 5 : 3, full ? 4 : 2, config->forgetting, PRIOR);
    }
    if (status != AXT_OK) {
        return status;
    }

    const axt_real inertia = config->expected.I1 + config->expected.I2;
    axt_ident fresh = {.config = *config, .rls = rls, .motor_share = config->expected.I2 / inertia};
    axt_real rate = AXT_R(1); /* size of a rate against its quantity */
    if (from_encoders(config)) {
        /* at the natural frequency, where the twist shows, but below the Nyquist frequency */
        const axt_real highest = AXT_R(2) / config->time_step;
        rate = (modal.wn < highest) ? modal.wn : highest;
        status = axt_filter_init(&fresh.filter, rate, config->time_step);
        if (status != AXT_OK) {
            return status;
        }
        fresh.settling = (uint32_t)(SETTLING_RADIANS / (rate * config->time_step)) + 1;
    }
    set_scales(&fresh, modal.wn, rate);
    *ident = fresh;
    return AXT_OK;
}

void axt_ident_reset(axt_ident *ident) {
    axt_rls_reset(&ident->rls);
    for (uint32_t i = 0; i < 3; i++) {
        ident->residual[i] = AXT_R(0);
    }
    ident->weight = AXT_R(0);
    axt_ident_gap(ident);
}

void axt_ident_gap(axt_ident *ident) {
    ident->seen = 0;
}

/* Regresses the rates of [q, r, q', r'] on [q, r, q', r', T] or, in the short form, on those of
 * them that carry the parameters. */
static axt_status learn(axt_ident *ident, const axt_real *quantity, const axt_real *rate) {
    axt_real phi[AXT_RLS_INPUTS_MAX];
    axt_real y[AXT_RLS_OUTPUTS_MAX];
    uint32_t twist_row;
    if (ident->config.form == AXT_IDENT_5X4) {
        for (uint32_t i = 0; i < AXT_RLS_INPUTS_MAX; i++) {
            phi[i] = quantity[i] * ident->scale[i];
        }
        for (uint32_t i = 0; i < AXT_RLS_OUTPUTS_MAX; i++) {
            y[i] = rate[i] * ident->output_scale[i];
        }
        twist_row = Q_RATE;
    } else {
        phi[0] = quantity[Q] * ident->scale[Q];
        phi[1] = quantity[Q_RATE] * ident->scale[Q_RATE];
        phi[2] = quantity[TORQUE] * ident->scale[TORQUE];
        y[0] = rate[Q_RATE] * ident->output_scale[Q_RATE];
        y[1] = rate[R_RATE] * ident->output_scale[R_RATE];
        twist_row = 0;
    }
    const axt_status status = axt_rls_update(&ident->rls, phi, y);
    if (status != AXT_OK) {
        return status;
    }
    /* innovation x residual is the increase of the weighted sum of squares that LS minimises */
    const axt_real twist = ident->rls.innovation[twist_row];
    const axt_real body = ident->rls.innovation[twist_row + 1];
    const axt_real certainty = ident->rls.certainty;
    const axt_real keep = ident->config.forgetting;
    ident->residual[0] = keep * ident->residual[0] + twist * twist * certainty;
    ident->residual[1] = keep * ident->residual[1] + body * body * certainty;
    ident->residual[2] = keep * ident->residual[2] + twist * body * certainty;
    ident->weight = keep * ident->weight + AXT_R(1);
    return AXT_OK;
}

static void count_sample(axt_ident *ident) {
    ident->seen += (ident->seen < UINT32_MAX) ? 1U : 0U;
}

/* A sample that cannot be used ends the sequence: the next one starts anew. */
static axt_status refuse(axt_ident *ident, axt_status why) {
    ident->rls.rejected += (ident->rls.rejected < UINT32_MAX) ? 1U : 0U;
    axt_ident_gap(ident);
    return why;
}

axt_status axt_ident_motion(axt_ident *ident, const axt_motion *motion, axt_real torque) {
    if (from_encoders(&ident->config)) {
        return AXT_ERROR_RANGE;
    }
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed) || !axt_finite(motion->fraction) ||
        !axt_finite(motion->fraction_low) || !axt_finite(torque)) {
        return refuse(ident, AXT_ERROR_NOT_FINITE);
    }
    if (ident->seen == 0) {
        ident->zero[0] = motion->turns;
    }
    const int32_t turns = axt_encoder_difference(motion->turns, ident->zero[0]);
    const axt_real angle =
        AXT_TWO_PI * (((axt_real)turns + motion->fraction) + motion->fraction_low);
    const axt_real now[AXT_RLS_INPUTS_MAX] = {[Q] = motion->twist,
                                              [R] = angle - ident->motor_share * motion->twist,
                                              [Q_RATE] = motion->twist_speed,
                                              [R_RATE] = motion->speed -
                                                         ident->motor_share * motion->twist_speed,
                                              [TORQUE] = torque};

    axt_status status = AXT_OK;
    if (ident->seen > 0) {
        axt_real mean[AXT_RLS_INPUTS_MAX];
        axt_real rate[AXT_RLS_INPUTS_MAX];
        const axt_real per_step = AXT_R(1) / ident->config.time_step;
        for (uint32_t i = 0; i < AXT_RLS_INPUTS_MAX; i++) {
            mean[i] = AXT_R(0.5) * (now[i] + ident->last[i]);
            rate[i] = (now[i] - ident->last[i]) * per_step;
        }
        status = learn(ident, mean, rate);
    }
    if (status != AXT_OK) {
        axt_ident_gap(ident); /* the update has counted it */
        return status;
    }
    for (uint32_t i = 0; i < AXT_RLS_INPUTS_MAX; i++) {
        ident->last[i] = now[i];
    }
    if (turns > 1 || turns < -1) { /* keep the angle, and with it its digits, near zero */
        ident->zero[0] = motion->turns;
        ident->last[R] -= AXT_TWO_PI * (axt_real)turns;
    }
    count_sample(ident);
    return AXT_OK;
}

/* Motor and table counts from their zeros. Both zeros move by whole turns, exactly, when the motor
 * is more than a turn away; the filter's memory of the angle moves with them. */
static void count_from_zero(axt_ident *ident, const int32_t count[2], int32_t from_zero[2]) {
    const int32_t per_turn = (int32_t)ident->config.counts_per_turn[0];
    const int32_t motor = axt_encoder_difference(count[0], ident->zero[0]);
    if (motor >= per_turn || motor <= -per_turn) {
        const int32_t turns = motor / per_turn;
        for (uint32_t i = 0; i < 2; i++) {
            const uint32_t moved = (uint32_t)turns * ident->config.counts_per_turn[i];
            ident->zero[i] = axt_wrap_add(ident->zero[i], (int32_t)moved);
        }
        axt_filter_shift(&ident->body_filter, -AXT_TWO_PI * (axt_real)turns);
    }
    for (uint32_t i = 0; i < 2; i++) {
        from_zero[i] = axt_encoder_difference(count[i], ident->zero[i]);
    }
}

axt_status axt_ident_counts(axt_ident *ident, int32_t motor, int32_t table, axt_real torque) {
    const axt_ident_config *config = &ident->config;
    if (!from_encoders(config)) {
        return AXT_ERROR_RANGE;
    }
    if (!(axt_abs(torque) <= AXT_R(1e3) * config->torque)) {
        return refuse(ident, axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE);
    }
    const int32_t count[2] = {motor, table};
    if (ident->seen == 0) {
        ident->zero[0] = motor;
        ident->zero[1] = table;
        axt_filter_start(&ident->twist_filter, AXT_R(0));
        axt_filter_start(&ident->body_filter, AXT_R(0));
        axt_filter_start(&ident->torque_filter, torque);
    }
    int32_t from_zero[2];
    count_from_zero(ident, count, from_zero);
    const axt_real angle = axt_encoder_angle(config->counts_per_turn[0], from_zero[0]);
    const axt_real twist =
        (config->counts_per_turn[0] == config->counts_per_turn[1])
            ? axt_encoder_angle(config->counts_per_turn[0],
                                axt_encoder_difference(from_zero[0], from_zero[1]))
            : angle - axt_encoder_angle(config->counts_per_turn[1], from_zero[1]);

    axt_filter_step(&ident->filter, &ident->twist_filter, twist);
    axt_filter_step(&ident->filter, &ident->body_filter, angle - ident->motor_share * twist);
    axt_filter_step(&ident->filter, &ident->torque_filter, torque);
    count_sample(ident);
    if (ident->seen <= ident->settling) {
        return AXT_OK;
    }
    const axt_filter_state *q = &ident->twist_filter;
    const axt_filter_state *r = &ident->body_filter;
    const axt_real quantity[AXT_RLS_INPUTS_MAX] = {[Q] = q->rate,
                                                   [R] = r->rate,
                                                   [Q_RATE] = q->acceleration,
                                                   [R_RATE] = r->acceleration,
                                                   [TORQUE] = ident->torque_filter.rate};
    const axt_real rate[AXT_RLS_OUTPUTS_MAX] = {
        [Q] = q->acceleration, [R] = r->acceleration, [Q_RATE] = q->jerk, [R_RATE] = r->jerk};
    const axt_status status = learn(ident, quantity, rate);
    if (status != AXT_OK) {
        axt_ident_gap(ident);
    }
    return status;
}

/* A row of theta without its scaling. `column` are the places of q, q' and T. */
static void read_rows(const axt_ident *ident, const uint32_t column[3], axt_rows *found) {
    static const uint32_t quantity[3] = {Q, Q_RATE, TORQUE};
    const uint32_t row = (ident->config.form == AXT_IDENT_5X4) ? (uint32_t)Q_RATE : 0;
    for (uint32_t i = 0; i < 3; i++) {
        const axt_real scale = ident->scale[quantity[i]];
        found->twist[i] = ident->rls.theta[row][column[i]] * (scale / ident->output_scale[Q_RATE]);
        found->body[i] =
            ident->rls.theta[row + 1][column[i]] * (scale / ident->output_scale[R_RATE]);
    }
}

/* What the covariance of the two rows is made of, in physical units. */
typedef struct {
    axt_real P[3][3];
    axt_real residual[3]; /* variances of twist and body residuals, and their covariance */
} spread;

static void read_spread(const axt_ident *ident, const uint32_t column[3], spread *found) {
    static const uint32_t quantity[3] = {Q, Q_RATE, TORQUE};
    for (uint32_t i = 0; i < 3; i++) {
        for (uint32_t j = 0; j < 3; j++) {
            found->P[i][j] = axt_rls_covariance(&ident->rls, column[i], column[j]) *
                             ident->scale[quantity[i]] * ident->scale[quantity[j]];
        }
    }
    const axt_real twist = AXT_R(1) / ident->output_scale[Q_RATE];
    const axt_real body = AXT_R(1) / ident->output_scale[R_RATE];
    const axt_real per_freedom = AXT_R(1) / (ident->weight - AXT_R(3));
    found->residual[0] = ident->residual[0] * per_freedom * twist * twist;
    found->residual[1] = ident->residual[1] * per_freedom * body * body;
    found->residual[2] = ident->residual[2] * per_freedom * twist * body;
}

/* Standard error of a function of the rows with this gradient (delta method). */
static axt_real standard_error(const spread *s, const axt_rows *gradient) {
    axt_real variance = AXT_R(0);
    for (uint32_t i = 0; i < 3; i++) {
        for (uint32_t j = 0; j < 3; j++) {
            const axt_real weight =
                gradient->twist[i] * gradient->twist[j] * s->residual[0] +
                gradient->body[i] * gradient->body[j] * s->residual[1] +
                AXT_R(2) * gradient->twist[i] * gradient->body[j] * s->residual[2];
            variance += weight * s->P[i][j];
        }
    }
    return (variance > AXT_R(0)) ? axt_sqrt(variance) : AXT_R(0);
}

/* sum = a x + b y */
static void combine(axt_real a, const axt_rows *x, axt_real b, const axt_rows *y, axt_rows *sum) {
    for (uint32_t i = 0; i < 3; i++) {
        sum->twist[i] = a * x->twist[i] + b * y->twist[i];
        sum->body[i] = a * x->body[i] + b * y->body[i];
    }
}

/* The errors of all values, from the gradients of axt_axis_from_rows() and axt_axis_modal(). */
static void find_errors(const spread *s, axt_real share, axt_estimate *e) {
    const axt_axis *axis = &e->axis;
    const axt_real inertia = axis->I1 + axis->I2;
    const axt_real reduced = axis->I1 * axis->I2 / inertia;
    const axt_real wn = e->modal.wn;
    const axt_real zeta = e->modal.zeta;

    const axt_rows dI1 = {.twist = {0, 0, -axis->I1 * axis->I1}};
    const axt_rows dK = {.twist = {-axis->I1 * share, 0, -axis->K * axis->I1},
                         .body = {-axis->I1, 0, 0}};
    const axt_real per_table = axis->I2 * axis->I2 / axis->K;
    const axt_rows dTable = {.twist = {(AXT_R(1) - share) * per_table, 0, 0},
                             .body = {-per_table, 0, 0}};
    axt_rows dI2;
    combine(axis->I2 / axis->K, &dK, AXT_R(1), &dTable, &dI2);
    axt_rows dB;
    const axt_real motor_part = axis->I2 / inertia;
    const axt_real table_part = axis->I1 / inertia;
    const axt_real damping = axis->B / reduced;
    combine(damping * motor_part * motor_part, &dI1, damping * table_part * table_part, &dI2, &dB);
    dB.twist[1] -= reduced;

    const axt_rows dwn = {.twist = {AXT_R(-0.5) / wn, 0, 0}};
    const axt_rows dzeta = {.twist = {AXT_R(0.5) * zeta / (wn * wn), AXT_R(-0.5) / wn, 0}};
    const axt_real root = e->modal.wd / wn; /* sqrt(1 - zeta^2) */
    axt_rows dwd;
    combine(root, &dwn, (root > AXT_R(0)) ? -wn * zeta / root : AXT_R(0), &dzeta, &dwd);

    e->axis_error = (axt_axis){.I1 = standard_error(s, &dI1),
                               .I2 = standard_error(s, &dI2),
                               .B = standard_error(s, &dB),
                               .K = standard_error(s, &dK)};
    e->modal_error = (axt_modal){.wn = standard_error(s, &dwn),
                                 .wd = standard_error(s, &dwd),
                                 .zeta = standard_error(s, &dzeta)};
}

static uint32_t valid_if(uint32_t flag, axt_real value, axt_real error) {
    return (axt_finite(error) && error * AXT_R(RELATIVE_ERROR) < value) ? flag : 0;
}

axt_status axt_ident_result(const axt_ident *ident, axt_estimate *estimate) {
    static const uint32_t full_columns[3] = {Q, Q_RATE, TORQUE};
    static const uint32_t short_columns[3] = {0, 1, 2};
    const uint32_t *column = (ident->config.form == AXT_IDENT_5X4) ? full_columns : short_columns;

    axt_estimate found = {.samples = ident->rls.updates};
    *estimate = found;
    if (ident->rls.updates < SETTLED_UPDATES || !(ident->weight > AXT_R(SETTLED_UPDATES / 2))) {
        return AXT_ERROR_NO_DATA;
    }
    axt_rows row;
    read_rows(ident, column, &row);
    if (axt_axis_from_rows(&row, ident->motor_share, &found.axis) != AXT_OK ||
        axt_axis_modal(&found.axis, &found.modal) != AXT_OK) {
        return AXT_ERROR_NO_DATA;
    }
    spread s;
    read_spread(ident, column, &s);
    find_errors(&s, ident->motor_share, &found);
    found.valid = valid_if(AXT_VALID_I1, found.axis.I1, found.axis_error.I1) |
                  valid_if(AXT_VALID_I2, found.axis.I2, found.axis_error.I2) |
                  valid_if(AXT_VALID_B, found.axis.B, found.axis_error.B) |
                  valid_if(AXT_VALID_K, found.axis.K, found.axis_error.K);
    *estimate = found;
    return AXT_OK;
}
