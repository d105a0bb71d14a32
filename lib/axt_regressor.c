#include "axt_regressor.h"

#include "axt_encoder.h"
#include "axt_math.h"

/* Columns and rows of the full form (5x4); the short form (3x2) has those that carry parameters. */
enum { Q, R, Q_RATE, R_RATE, TORQUE };

/* A twist that moves by less than this many counts shows the encoder and not the axis: nothing is
 * learned from it. A reading that flickers by one count on either encoder stays below. */
#define IDLE_COUNTS 2

/* How long the filter remembers its start: its slowest pole is w / 2, and e^-16 is 1e-7. */
#define SETTLING_RADIANS AXT_R(32)

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
static void scale_motion(axt_regressor *regressor, axt_real wn) {
    const axt_ident_config *config = &regressor->config;
    const axt_real inertia = config->expected.I1 + config->expected.I2;
    const axt_real twist = config->torque / (config->expected.I1 * wn * wn);
    const axt_real body = config->torque / (inertia * wn * wn) * AXT_R(16);
    const axt_real size[AXT_REGRESSOR_INPUTS_MAX] = {[Q] = twist,
                                                     [R] = body,
                                                     [Q_RATE] = twist * wn,
                                                     [R_RATE] = body * wn / AXT_R(4),
                                                     [TORQUE] = config->torque};
    for (uint32_t i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
        regressor->scale[i] = AXT_R(1) / power_of_two(size[i]);
    }
    regressor->output_scale[Q] = regressor->scale[Q_RATE];
    regressor->output_scale[R] = regressor->scale[R_RATE];
    regressor->output_scale[Q_RATE] = AXT_R(1) / power_of_two(twist * wn * wn);
    regressor->output_scale[R_RATE] = AXT_R(1) / power_of_two(config->torque / inertia);
}

/* Encoders: what enters the filters is scaled, and their time runs in units of 1 / corner, so what
 * leaves them is of size 1 without another multiplication. */
static void scale_counts(axt_regressor *regressor, axt_real wn, axt_real corner) {
    const axt_ident_config *config = &regressor->config;
    const axt_real inertia = config->expected.I1 + config->expected.I2;
    const axt_real twist =
        AXT_R(1) / power_of_two(config->torque / (config->expected.I1 * wn * wn));
    const axt_real body = AXT_R(1) / power_of_two(config->torque / (inertia * wn * wn));
    for (uint32_t i = 0; i < 2; i++) {
        regressor->count_unit[i] = twist * axt_encoder_angle(config->counts_per_turn[i], 1);
    }
    regressor->body_unit = body * axt_encoder_angle(config->counts_per_turn[0], 1);
    regressor->body_share = regressor->motor_share * body / twist;
    regressor->torque_unit = AXT_R(1) / power_of_two(config->torque);
    regressor->idle = AXT_R(IDLE_COUNTS) * ((regressor->count_unit[0] > regressor->count_unit[1])
                                                ? regressor->count_unit[0]
                                                : regressor->count_unit[1]);
    /* the equation is taken one derivative up: q stands for q', and so on */
    regressor->scale[Q] = twist / corner;
    regressor->scale[R] = body / corner;
    regressor->scale[Q_RATE] = twist / (corner * corner);
    regressor->scale[R_RATE] = body / (corner * corner);
    regressor->scale[TORQUE] = regressor->torque_unit / corner;
    regressor->output_scale[Q] = regressor->scale[Q_RATE];
    regressor->output_scale[R] = regressor->scale[R_RATE];
    regressor->output_scale[Q_RATE] = regressor->scale[Q_RATE] / corner;
    regressor->output_scale[R_RATE] = regressor->scale[R_RATE] / corner;
}

axt_status axt_regressor_init(axt_regressor *regressor, const axt_ident_config *config) {
    axt_modal modal;
    axt_status status = check_config(config);
    if (status == AXT_OK) {
        status = axt_axis_modal(&config->expected, &modal);
    }
    if (status != AXT_OK) {
        return status;
    }
    const axt_real inertia = config->expected.I1 + config->expected.I2;
    axt_regressor fresh = {.config = *config, .motor_share = config->expected.I2 / inertia};
    if (from_encoders(config)) {
        /* at the natural frequency, where the twist shows, but below the Nyquist frequency */
        const axt_real highest = AXT_R(2) / config->time_step;
        const axt_real corner = (modal.wn < highest) ? modal.wn : highest;
        status = axt_filter_init(&fresh.filter, AXT_R(1), corner * config->time_step);
        if (status != AXT_OK) {
            return status;
        }
        fresh.settling = (uint32_t)(SETTLING_RADIANS / (corner * config->time_step)) + 1;
        scale_counts(&fresh, modal.wn, corner);
    } else {
        scale_motion(&fresh, modal.wn);
    }
    *regressor = fresh;
    return AXT_OK;
}

void axt_regressor_gap(axt_regressor *regressor) {
    regressor->seen = 0;
}

/* Regresses the rates of [q, r, q', r'] on [q, r, q', r', T] or, in the short form, on those of
 * them that carry the parameters. */
static void scale_equation(const axt_regressor *regressor, const axt_real *quantity,
                           const axt_real *rate, axt_equation *equation) {
    const axt_real *scale = regressor->scale;
    const axt_real *output_scale = regressor->output_scale;
    if (regressor->config.form == AXT_IDENT_5X4) {
        for (uint32_t i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
            equation->phi[i] = quantity[i] * scale[i];
        }
        for (uint32_t i = 0; i < AXT_REGRESSOR_OUTPUTS_MAX; i++) {
            equation->y[i] = rate[i] * output_scale[i];
        }
    } else {
        equation->phi[0] = quantity[Q] * scale[Q];
        equation->phi[1] = quantity[Q_RATE] * scale[Q_RATE];
        equation->phi[2] = quantity[TORQUE] * scale[TORQUE];
        equation->y[0] = rate[Q_RATE] * output_scale[Q_RATE];
        equation->y[1] = rate[R_RATE] * output_scale[R_RATE];
    }
}

static void count_sample(axt_regressor *regressor) {
    regressor->seen += (regressor->seen < UINT32_MAX) ? 1U : 0U;
}

/* A sample that cannot be used ends the sequence: the next one starts anew. */
static axt_status refuse(axt_regressor *regressor, axt_status why) {
    axt_regressor_gap(regressor);
    return why;
}

axt_status axt_regressor_motion(axt_regressor *regressor, const axt_motion *motion, axt_real torque,
                                axt_equation *equation) {
    if (from_encoders(&regressor->config)) {
        return AXT_ERROR_RANGE;
    }
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed) || !axt_finite(motion->fraction) ||
        !axt_finite(motion->fraction_low) || !axt_finite(torque)) {
        return refuse(regressor, AXT_ERROR_NOT_FINITE);
    }
    if (regressor->seen == 0) {
        regressor->zero[0] = motion->turns;
    }
    const int32_t turns = axt_encoder_difference(motion->turns, regressor->zero[0]);
    const axt_real angle =
        AXT_TWO_PI * (((axt_real)turns + motion->fraction) + motion->fraction_low);
    const axt_real now[AXT_REGRESSOR_INPUTS_MAX] = {
        [Q] = motion->twist,
        [R] = angle - regressor->motor_share * motion->twist,
        [Q_RATE] = motion->twist_speed,
        [R_RATE] = motion->speed - regressor->motor_share * motion->twist_speed,
        [TORQUE] = torque};

    axt_status status = AXT_ERROR_NO_DATA;
    if (regressor->seen > 0) {
        axt_real mean[AXT_REGRESSOR_INPUTS_MAX];
        axt_real rate[AXT_REGRESSOR_INPUTS_MAX];
        const axt_real per_step = AXT_R(1) / regressor->config.time_step;
        for (uint32_t i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
            mean[i] = AXT_R(0.5) * (now[i] + regressor->last[i]);
            rate[i] = (now[i] - regressor->last[i]) * per_step;
        }
        scale_equation(regressor, mean, rate, equation);
        status = AXT_OK;
    }
    for (uint32_t i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
        regressor->last[i] = now[i];
    }
    if (turns > 1 || turns < -1) { /* keep the angle, and with it its digits, near zero */
        regressor->zero[0] = motion->turns;
        regressor->last[R] -= AXT_TWO_PI * (axt_real)turns;
    }
    count_sample(regressor);
    return status;
}

/* Motor and table counts from their zeros. Both zeros move by whole turns, exactly, when the motor
 * is more than a turn away; the filter's memory of the angle moves with them. */
static void count_from_zero(axt_regressor *regressor, const int32_t count[2],
                            int32_t from_zero[2]) {
    const int32_t per_turn = (int32_t)regressor->config.counts_per_turn[0];
    const int32_t motor = axt_encoder_difference(count[0], regressor->zero[0]);
    if (motor >= per_turn || motor <= -per_turn) {
        const int32_t turns = motor / per_turn;
        for (uint32_t i = 0; i < 2; i++) {
            const uint32_t moved = (uint32_t)turns * regressor->config.counts_per_turn[i];
            regressor->zero[i] = axt_wrap_add(regressor->zero[i], (int32_t)moved);
        }
        axt_filter_shift(&regressor->body_filter,
                         -regressor->body_unit * (axt_real)(turns * per_turn));
    }
    for (uint32_t i = 0; i < 2; i++) {
        from_zero[i] = axt_encoder_difference(count[i], regressor->zero[i]);
    }
}

axt_status axt_regressor_counts(axt_regressor *regressor, int32_t motor, int32_t table,
                                axt_real torque, axt_equation *equation) {
    const axt_ident_config *config = &regressor->config;
    if (!from_encoders(config)) {
        return AXT_ERROR_RANGE;
    }
    if (!(axt_abs(torque) <= AXT_R(1e3) * config->torque)) {
        return refuse(regressor, axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE);
    }
    const int32_t count[2] = {motor, table};
    if (regressor->seen == 0) {
        regressor->zero[0] = motor;
        regressor->zero[1] = table;
        axt_filter_start(&regressor->twist_filter, AXT_R(0));
        axt_filter_start(&regressor->body_filter, AXT_R(0));
        axt_filter_start(&regressor->torque_filter, regressor->torque_unit * torque);
    }
    int32_t from_zero[2];
    count_from_zero(regressor, count, from_zero);
    const axt_real twist = (config->counts_per_turn[0] == config->counts_per_turn[1])
                               ? regressor->count_unit[0] *
                                     (axt_real)axt_encoder_difference(from_zero[0], from_zero[1])
                               : regressor->count_unit[0] * (axt_real)from_zero[0] -
                                     regressor->count_unit[1] * (axt_real)from_zero[1];
    const axt_real body =
        regressor->body_unit * (axt_real)from_zero[0] - regressor->body_share * twist;

    axt_filter_step(&regressor->filter, &regressor->twist_filter, twist);
    axt_filter_step(&regressor->filter, &regressor->body_filter, body);
    axt_filter_step(&regressor->filter, &regressor->torque_filter, regressor->torque_unit * torque);
    count_sample(regressor);

    const axt_filter_state *q = &regressor->twist_filter;
    const axt_filter_state *r = &regressor->body_filter;
    const bool idle = axt_abs(q->rate) + axt_abs(q->acceleration) <= regressor->idle;
    if (regressor->seen <= regressor->settling || idle) {
        return AXT_ERROR_NO_DATA;
    }
    if (config->form == AXT_IDENT_5X4) {
        *equation = (axt_equation){.phi = {q->rate, r->rate, q->acceleration, r->acceleration,
                                           regressor->torque_filter.rate},
                                   .y = {q->acceleration, r->acceleration, q->jerk, r->jerk}};
    } else {
        equation->phi[0] = q->rate;
        equation->phi[1] = q->acceleration;
        equation->phi[2] = regressor->torque_filter.rate;
        equation->y[0] = q->jerk;
        equation->y[1] = r->jerk;
    }
    return AXT_OK;
}

const uint32_t *axt_regressor_columns(const axt_regressor *regressor) {
    static const uint32_t full[3] = {Q, Q_RATE, TORQUE};
    static const uint32_t reduced[3] = {0, 1, 2};
    return (regressor->config.form == AXT_IDENT_5X4) ? full : reduced;
}

uint32_t axt_regressor_row(const axt_regressor *regressor) {
    return (regressor->config.form == AXT_IDENT_5X4) ? (uint32_t)Q_RATE : 0;
}

axt_real axt_regressor_unit(const axt_regressor *regressor, uint32_t output, uint32_t input) {
    static const uint32_t quantity[3] = {Q, Q_RATE, TORQUE};
    return regressor->scale[quantity[input]] / regressor->output_scale[Q_RATE + output];
}
