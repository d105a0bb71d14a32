#include "axt_regressor.h"

#include "axt_encoder.h"
#include "axt_filter_step.h"
#include "axt_math.h"

/* Columns and rows of the full form (5x4); the short form (3x2) has those that carry parameters. */
enum { Q, R, Q_RATE, R_RATE, TORQUE };

/* What passes through the filter. */
enum { TWIST_CHANNEL, BODY_CHANNEL, TORQUE_CHANNEL };

/* A torque that is this many times the expected one is none. */
#define TORQUE_RANGE AXT_R(1e3)

/* A twist that moves by less than this many counts shows the encoder and not the axis: nothing is
 * learned from it. A reading that flickers by one count on either encoder stays below. */
#define IDLE_COUNTS 2

/* How long the filter remembers its start: its slowest pole is w / 2, and e^-16 is 1e-7. */
#define SETTLING_RADIANS AXT_R(32)

/* An axis so slow against the step that its filter would take more samples than that is not told
 * from one that stands still. */
#define SETTLING_MAX AXT_R(1e9)

static bool from_encoders(const axt_ident_config *config) {
    return config->counts_per_turn[0] != 0;
}

static axt_status check_config(const axt_ident_config *config) {
    const axt_status status = axt_axis_check(&config->expected);
    if (status != AXT_OK) {
        return status;
    }
    const bool hold = config->hold == AXT_HOLD_LINEAR || config->hold == AXT_HOLD_ZERO;
    const bool short_form = config->form == AXT_IDENT_3X2;
    const bool full_form = config->form == AXT_IDENT_5X4 &&
                           (config->hold == AXT_HOLD_LINEAR || !from_encoders(config));
    const bool encoders = (config->counts_per_turn[0] == 0) == (config->counts_per_turn[1] == 0) &&
                          config->counts_per_turn[0] <= AXT_ENCODER_COUNTS_MAX &&
                          config->counts_per_turn[1] <= AXT_ENCODER_COUNTS_MAX;
    const bool numbers = config->time_step >= AXT_R(1e-7) && config->time_step <= AXT_R(1) &&
                         config->torque >= AXT_R(1e-9) && config->torque <= AXT_R(1e9);
    return ((short_form || full_form) && hold && encoders && numbers) ? AXT_OK : AXT_ERROR_RANGE;
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
        regressor->scale[i] = AXT_R(1) / axt_power_of_two(size[i]);
    }
    regressor->output_scale[Q] = regressor->scale[Q_RATE];
    regressor->output_scale[R] = regressor->scale[R_RATE];
    regressor->output_scale[Q_RATE] = AXT_R(1) / axt_power_of_two(twist * wn * wn);
    regressor->output_scale[R_RATE] = AXT_R(1) / axt_power_of_two(config->torque / inertia);
}

/* Encoders: what enters the filters is scaled, and their time runs in units of 1 / corner, so what
 * leaves them is of size 1 without another multiplication. */
static void scale_counts(axt_regressor *regressor, axt_real wn, axt_real corner) {
    const axt_ident_config *config = &regressor->config;
    const axt_real inertia = config->expected.I1 + config->expected.I2;
    const axt_real twist =
        AXT_R(1) / axt_power_of_two(config->torque / (config->expected.I1 * wn * wn));
    const axt_real body = AXT_R(1) / axt_power_of_two(config->torque / (inertia * wn * wn));
    for (uint32_t i = 0; i < 2; i++) {
        regressor->count_unit[i] = twist * axt_encoder_angle(config->counts_per_turn[i], 1);
    }
    regressor->body_unit = body * axt_encoder_angle(config->counts_per_turn[0], 1);
    regressor->body_share = regressor->motor_share * body / twist;
    regressor->torque_unit = AXT_R(1) / axt_power_of_two(config->torque);
    regressor->torque_max = TORQUE_RANGE * config->torque;
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
        const axt_real settling = SETTLING_RADIANS / (corner * config->time_step);
        if (!(settling <= SETTLING_MAX)) {
            return AXT_ERROR_RANGE;
        }
        fresh.settling = (uint32_t)settling + 1;
        scale_counts(&fresh, modal.wn, corner);
    } else {
        scale_motion(&fresh, modal.wn);
    }
    *regressor = fresh;
    return AXT_OK;
}

void axt_regressor_gap(axt_regressor *regressor) {
    regressor->started = false;
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

axt_status axt_regressor_motion(axt_regressor *regressor, const axt_motion *motion, axt_real torque,
                                axt_equation *equation) {
    if (from_encoders(&regressor->config)) {
        return AXT_ERROR_RANGE;
    }
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed) || !axt_finite(motion->fraction) ||
        !axt_finite(motion->fraction_low) || !axt_finite(torque)) {
        return AXT_ERROR_NOT_FINITE;
    }
    const bool started = regressor->started;
    if (!started) {
        regressor->zero[0] = motion->turns;
        regressor->started = true;
    }
    const int32_t turns = axt_wrap_sub(motion->turns, regressor->zero[0]);
    const axt_real angle =
        AXT_TWO_PI * (((axt_real)turns + motion->fraction) + motion->fraction_low);
    const axt_real now[AXT_REGRESSOR_INPUTS_MAX] = {
        [Q] = motion->twist,
        [R] = angle - regressor->motor_share * motion->twist,
        [Q_RATE] = motion->twist_speed,
        [R_RATE] = motion->speed - regressor->motor_share * motion->twist_speed,
        [TORQUE] = torque};

    axt_status status = AXT_ERROR_NO_DATA;
    if (started) {
        axt_real mean[AXT_REGRESSOR_INPUTS_MAX];
        axt_real rate[AXT_REGRESSOR_INPUTS_MAX];
        const axt_real per_step = AXT_R(1) / regressor->config.time_step;
        for (uint32_t i = 0; i < AXT_REGRESSOR_INPUTS_MAX; i++) {
            mean[i] = AXT_R(0.5) * (now[i] + regressor->last[i]);
            rate[i] = (now[i] - regressor->last[i]) * per_step;
        }
        if (regressor->config.hold == AXT_HOLD_ZERO) {
            mean[TORQUE] = regressor->last[TORQUE];
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
    return status;
}

/* Both zeros move by whole turns, exactly, when the motor is more than a turn away; what remembers
 * the angle moves with them. */
AXT_SEPARATE void move_zeros(axt_regressor *regressor, int32_t motor) {
    const int32_t per_turn = (int32_t)regressor->config.counts_per_turn[0];
    const int32_t turns = axt_wrap_sub(motor, regressor->zero[0]) / per_turn;
    for (uint32_t i = 0; i < 2; i++) {
        const uint32_t moved = (uint32_t)turns * regressor->config.counts_per_turn[i];
        regressor->zero[i] = axt_wrap_add(regressor->zero[i], (int32_t)moved);
    }
    const axt_real shift = -regressor->body_unit * (axt_real)(turns * per_turn);
    axt_filter_shift(&regressor->channel[BODY_CHANNEL], shift);
    regressor->last[R] += shift;
}

/* Scaled twist, body angle and torque of a sample, as they enter the filter. */
typedef struct {
    axt_real twist;
    axt_real body;
    axt_real torque;
} channels;

AXT_UNROLLED channels scale_sample(const axt_regressor *regressor, int32_t motor, int32_t table,
                                   axt_real torque) {
    const uint32_t *per_turn = regressor->config.counts_per_turn;
    const int32_t from_motor = axt_wrap_sub(motor, regressor->zero[0]);
    const int32_t from_table = axt_wrap_sub(table, regressor->zero[1]);
    channels now;
    if (per_turn[0] == per_turn[1]) { /* integers keep all digits of the small difference */
        now.twist = regressor->count_unit[0] * (axt_real)axt_wrap_sub(from_motor, from_table);
    } else {
        now.twist = regressor->count_unit[0] * (axt_real)from_motor -
                    regressor->count_unit[1] * (axt_real)from_table;
    }
    now.body =
        axt_fma(-regressor->body_share, now.twist, regressor->body_unit * (axt_real)from_motor);
    now.torque = regressor->torque_unit * torque;
    return now;
}

AXT_SEPARATE void start_channels(axt_regressor *regressor, int32_t motor, int32_t table,
                                 axt_real torque) {
    regressor->zero[0] = motor;
    regressor->zero[1] = table;
    axt_filter_start(&regressor->channel[TWIST_CHANNEL], AXT_R(0));
    axt_filter_start(&regressor->channel[BODY_CHANNEL], AXT_R(0));
    axt_filter_start(&regressor->channel[TORQUE_CHANNEL], regressor->torque_unit * torque);
    regressor->last[Q] = AXT_R(0);
    regressor->last[R] = AXT_R(0);
    regressor->last[TORQUE] = regressor->torque_unit * torque;
    regressor->wait = regressor->settling;
    regressor->started = true;
}

/* Held torque: the means of two positions go with the torque between them. */
static void take_means(axt_regressor *regressor, channels *now) {
    const channels sample = *now;
    now->twist = AXT_R(0.5) * (sample.twist + regressor->last[Q]);
    now->body = AXT_R(0.5) * (sample.body + regressor->last[R]);
    now->torque = regressor->last[TORQUE];
    regressor->last[Q] = sample.twist;
    regressor->last[R] = sample.body;
    regressor->last[TORQUE] = sample.torque;
}

axt_status axt_regressor_counts(axt_regressor *regressor, int32_t motor, int32_t table,
                                axt_real torque, axt_equation *equation) {
    const axt_ident_config *config = &regressor->config;
    if (!from_encoders(config)) {
        return AXT_ERROR_RANGE;
    }
    if (!(axt_abs(torque) <= regressor->torque_max)) {
        return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
    }
    if (!regressor->started) {
        start_channels(regressor, motor, table, torque);
    }
    const uint32_t per_turn = config->counts_per_turn[0];
    if ((uint32_t)axt_wrap_sub(motor, regressor->zero[0]) + per_turn > 2 * per_turn) {
        move_zeros(regressor, motor);
    }
    channels now = scale_sample(regressor, motor, table, torque);
    const bool held = config->hold == AXT_HOLD_ZERO;
    if (held) {
        take_means(regressor, &now);
    }
    const axt_filter *filter = &regressor->filter;
    axt_filter_state *channel = regressor->channel;
    const axt_filtered q = filter_step(filter, &channel[TWIST_CHANNEL], now.twist);
    const axt_filtered r = filter_step(filter, &channel[BODY_CHANNEL], now.body);
    const axt_filtered t = filter_step(filter, &channel[TORQUE_CHANNEL], now.torque);
    if (regressor->wait > 0) {
        regressor->wait--;
        return AXT_ERROR_NO_DATA;
    }
    if (axt_abs(q.rate) + axt_abs(q.acceleration) <= regressor->idle) {
        return AXT_ERROR_NO_DATA;
    }
    if (config->form == AXT_IDENT_5X4) {
        *equation = (axt_equation){.phi = {q.rate, r.rate, q.acceleration, r.acceleration, t.rate},
                                   .y = {q.acceleration, r.acceleration, q.jerk, r.jerk}};
        return AXT_OK;
    }
    equation->phi[0] = q.rate;
    equation->phi[1] = q.acceleration;
    equation->phi[2] = t.rate;
    equation->y[0] = q.jerk;
    equation->y[1] = r.jerk;
    if (held) {
        equation->phi[3] = t.acceleration;
    }
    return AXT_OK;
}

uint32_t axt_regressor_inputs(const axt_regressor *regressor) {
    const axt_ident_config *config = &regressor->config;
    if (config->form == AXT_IDENT_5X4) {
        return 5;
    }
    return (config->hold == AXT_HOLD_ZERO && from_encoders(config)) ? 4 : 3;
}

uint32_t axt_regressor_outputs(const axt_regressor *regressor) {
    return (regressor->config.form == AXT_IDENT_5X4) ? 4 : 2;
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
    static const uint32_t reduced[3] = {Q, Q_RATE, TORQUE};
    const uint32_t quantity = (regressor->config.form == AXT_IDENT_5X4) ? input : reduced[input];
    return regressor->scale[quantity] / regressor->output_scale[Q_RATE + output];
}
