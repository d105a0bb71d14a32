#include "axt_ident.h"

#include "axt_math.h"
#include "axt_rows.h"

enum {
    FEWEST_SAMPLES = 20, /* with fewer there is no answer */
    RELATIVE_ERROR = 10, /* valid: the standard error is less than a tenth of the value */
    WINDOW = 56,         /* samples; the noise of differences is correlated over two */
    ANGLE_COLUMN = 1,    /* of the full form: r, */
    SPEED_COLUMN = 3     /* and r' */
};

/* The prior of the scaled problem: so large that it is forgotten within a few samples. In float,
 * what it still pulls after some hundred would stay: corrections below the rounding are lost. */
#define PRIOR (AXT_IS_DOUBLE ? AXT_R(1e13) : AXT_R(1e9))

/* No axis changes its speed in one sample by this many times what the expected torque does to the
 * lighter of the expected inertias: ten for each of them being off by that factor, and three for
 * what a resonance adds. */
#define CHANGE_RANGE AXT_R(300)

/* Two readings of an encoder are rounded. */
#define CHANGE_COUNTS AXT_R(4)

static bool from_encoders(const axt_ident *ident) {
    return ident->regressor.config.counts_per_turn[0] != 0;
}

/* How far speeds [rad/s] and steps [counts] may change from one sample to the next. */
static void set_guard(axt_ident_guard *guard, const axt_ident_config *config) {
    const axt_axis *axis = &config->expected;
    const axt_real lighter = (axis->I1 < axis->I2) ? axis->I1 : axis->I2;
    const axt_real change = CHANGE_RANGE * config->torque / lighter * config->time_step;
    for (uint32_t i = 0; i < 2; i++) {
        guard->speed_change_max[i] = change;
        const axt_real counts =
            change * config->time_step * ((axt_real)config->counts_per_turn[i] / AXT_TWO_PI) +
            CHANGE_COUNTS;
        guard->change_max[i] = (counts < AXT_R(1073741824)) ? (int32_t)counts : INT32_C(1073741824);
    }
}

axt_status axt_ident_init(axt_ident *ident, const axt_ident_config *config) {
    axt_ident fresh = {.samples = 0};
    axt_regressor *regressor = &fresh.regressor;
    axt_status status = axt_regressor_init(regressor, config);
    if (status != AXT_OK) {
        return status;
    }
    const uint32_t inputs = axt_regressor_inputs(regressor);
    set_guard(&fresh.guard, config);
    status = axt_rls_init(&fresh.rls, inputs, axt_regressor_outputs(regressor), config->forgetting,
                          PRIOR);
    if (status == AXT_OK) {
        /* what is left of noise in the filter after half of its settling is 0.03 % */
        const uint32_t memory = from_encoders(&fresh) ? regressor->settling / 2 : 0;
        status = axt_scatter_init(&fresh.scatter, inputs, WINDOW + memory);
    }
    if (status == AXT_OK) {
        *ident = fresh;
    }
    return status;
}

void axt_ident_reset(axt_ident *ident) {
    axt_rls_reset(&ident->rls);
    axt_scatter_reset(&ident->scatter);
    ident->samples = 0;
    ident->guard.known = 0;
    axt_regressor_gap(&ident->regressor);
}

/* ---- Samples ------------------------------------------------------------------------------------
 */

/* Whether a sample of this number may be taken: the next one, or after a gap any newer one. */
AXT_SEPARATE axt_status after_gap(axt_ident *ident, uint32_t number) {
    axt_ident_guard *guard = &ident->guard;
    if (guard->known > 0) {
        if (axt_wrap_sub((int32_t)number, (int32_t)guard->next) < 0) {
            axt_count(&ident->counters.repeated);
            return AXT_ERROR_REPEATED;
        }
        axt_count(&ident->counters.gaps);
    }
    guard->known = 0;
    axt_regressor_gap(&ident->regressor);
    return AXT_OK;
}

static inline axt_status check_number(axt_ident *ident, uint32_t number) {
    const bool follows = number == ident->guard.next && ident->guard.known > 0;
    return follows ? AXT_OK : after_gap(ident, number);
}

AXT_SEPARATE axt_status refuse(axt_ident *ident, axt_status why) {
    axt_ident_counters *counters = &ident->counters;
    if (why == AXT_ERROR_NOT_FINITE) {
        axt_count(&counters->not_finite);
    } else if (why == AXT_ERROR_JUMP) {
        axt_count(&counters->jumped);
    } else {
        axt_count(&counters->range);
    }
    return why;
}

/* A step that differs from the last one by more than the axis can: not for the first two samples.
 */
static inline bool steps_jump(const axt_ident_guard *guard, const int32_t step[2]) {
    bool jumps = false;
    for (uint32_t i = 0; i < 2; i++) {
        const uint32_t most = (uint32_t)guard->change_max[i];
        jumps |= (uint32_t)axt_wrap_sub(step[i], guard->step[i]) + most > 2 * most;
    }
    return jumps && guard->known > 1;
}

/* What an accepted sample, and an equation that it may have given, leave behind. */
static inline void follow(axt_ident_guard *guard, uint32_t number) {
    guard->next = number + 1;
    guard->known += (guard->known < 2) ? 1U : 0U;
}

static axt_status learn(axt_ident *ident) {
    const axt_equation *equation = &ident->equation;
    axt_rls *rls = &ident->rls;
    const axt_status status = axt_rls_update(rls, equation->phi, equation->y);
    if (status != AXT_OK) {
        axt_regressor_gap(&ident->regressor);
        return refuse(ident, status);
    }
    const uint32_t row = axt_regressor_row(&ident->regressor);
    const axt_real residual[2] = {rls->innovation[row] * rls->certainty,
                                  rls->innovation[row + 1] * rls->certainty};
    axt_scatter_add(&ident->scatter, equation->phi, residual);
    axt_count(&ident->samples);
    return AXT_OK;
}

axt_status axt_ident_motion(axt_ident *ident, uint32_t number, const axt_motion *motion,
                            axt_real torque) {
    if (from_encoders(ident)) {
        return AXT_ERROR_RANGE;
    }
    axt_ident_guard *guard = &ident->guard;
    axt_status status = check_number(ident, number);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real speed[2] = {motion->speed, motion->twist_speed};
    for (uint32_t i = 0; i < 2; i++) {
        if (guard->known > 0 && axt_abs(speed[i] - guard->speed[i]) > guard->speed_change_max[i]) {
            return refuse(ident, axt_finite(speed[i]) ? AXT_ERROR_JUMP : AXT_ERROR_NOT_FINITE);
        }
    }
    status = axt_regressor_motion(&ident->regressor, motion, torque, &ident->equation);
    if (status != AXT_OK && status != AXT_ERROR_NO_DATA) {
        return refuse(ident, status);
    }
    guard->speed[0] = speed[0];
    guard->speed[1] = speed[1];
    follow(guard, number);
    return (status == AXT_OK) ? learn(ident) : status;
}

axt_status axt_ident_counts(axt_ident *ident, uint32_t number, int32_t motor, int32_t table,
                            axt_real torque) {
    if (!from_encoders(ident)) {
        return AXT_ERROR_RANGE;
    }
    axt_ident_guard *guard = &ident->guard;
    axt_status status = check_number(ident, number);
    if (status != AXT_OK) {
        return status;
    }
    const int32_t step[2] = {axt_wrap_sub(motor, guard->count[0]),
                             axt_wrap_sub(table, guard->count[1])};
    if (steps_jump(guard, step)) {
        return refuse(ident, AXT_ERROR_JUMP);
    }
    status = axt_regressor_counts(&ident->regressor, motor, table, torque, &ident->equation);
    if (status != AXT_OK && status != AXT_ERROR_NO_DATA) {
        return refuse(ident, status);
    }
    guard->count[0] = motor;
    guard->count[1] = table;
    guard->step[0] = step[0];
    guard->step[1] = step[1];
    follow(guard, number);
    return (status == AXT_OK) ? learn(ident) : status;
}

/* ---- Answers ------------------------------------------------------------------------------------
 */

/* What the answer is made of. */
typedef struct {
    const axt_ident *ident;
    axt_real share;     /* see axt_scatter_variance() */
    axt_real factor[3]; /* column of Eq. 8 = factor x column found */
} answer;

/* base^exponent by squaring. */
static axt_real raised(axt_real base, uint32_t exponent) {
    axt_real result = AXT_R(1);
    for (; exponent > 0; exponent >>= 1) {
        result *= ((exponent & 1U) != 0) ? base : AXT_R(1);
        base *= base;
    }
    return result;
}

static axt_status read_rows(answer *a, axt_rows *found) {
    const axt_regressor *regressor = &a->ident->regressor;
    const axt_rls *rls = &a->ident->rls;
    const uint32_t *column = axt_regressor_columns(regressor);
    const uint32_t row = axt_regressor_row(regressor);
    for (uint32_t i = 0; i < 3; i++) {
        found->twist[i] = rls->theta[row][column[i]] * axt_regressor_unit(regressor, 0, column[i]);
        found->body[i] =
            rls->theta[row + 1][column[i]] * axt_regressor_unit(regressor, 1, column[i]);
        a->factor[i] = AXT_R(1);
    }
    if (regressor->config.hold == AXT_HOLD_LINEAR) {
        return AXT_OK;
    }
    return axt_rows_from_held(found,
                              from_encoders(a->ident) ? AXT_ROWS_OF_POSITIONS : AXT_ROWS_OF_SPEEDS,
                              regressor->config.time_step, a->factor);
}

static axt_real root_of(axt_real variance) {
    return (variance > AXT_R(0)) ? axt_sqrt(variance) : AXT_R(0);
}

/* Standard error of a function of the rows with this gradient (delta method). Held torque: the
 * factor's own dependence on the rows, a share of (wn Dt)^2 / 12 or so, is left out. */
static axt_real standard_error(const answer *a, const axt_rows *gradient) {
    const axt_regressor *regressor = &a->ident->regressor;
    const uint32_t *column = axt_regressor_columns(regressor);
    axt_real scaled[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{AXT_R(0)}};
    for (uint32_t i = 0; i < 3; i++) {
        const uint32_t j = column[i];
        scaled[0][j] = gradient->twist[i] * a->factor[i] * axt_regressor_unit(regressor, 0, j);
        scaled[1][j] = gradient->body[i] * a->factor[i] * axt_regressor_unit(regressor, 1, j);
    }
    return root_of(axt_scatter_variance(&a->ident->scatter, &a->ident->rls, a->share, scaled));
}

/* sum = a x + b y */
static void combine(axt_real a, const axt_rows *x, axt_real b, const axt_rows *y, axt_rows *sum) {
    for (uint32_t i = 0; i < 3; i++) {
        sum->twist[i] = a * x->twist[i] + b * y->twist[i];
        sum->body[i] = a * x->body[i] + b * y->body[i];
    }
}

/* The errors of all values, from the gradients of axt_axis_from_rows() and axt_axis_modal(). */
static void find_errors(const answer *s, axt_estimate *e) {
    const axt_real share = s->ident->regressor.motor_share;
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

/* Torque to ground for 1 of this column: I1 theta1'' + I2 theta2'' is what acts from outside, and
 * in terms of the rows that is I r'' + (I share - I2) q''. */
static axt_surplus find_surplus(const answer *a, const axt_axis *axis, uint32_t column) {
    const axt_regressor *regressor = &a->ident->regressor;
    const axt_rls *rls = &a->ident->rls;
    const uint32_t row = axt_regressor_row(regressor);
    const axt_real inertia = axis->I1 + axis->I2;
    axt_real gradient[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{AXT_R(0)}};
    gradient[0][column] =
        (axis->I2 - inertia * regressor->motor_share) * axt_regressor_unit(regressor, 0, column);
    gradient[1][column] = -inertia * axt_regressor_unit(regressor, 1, column);
    axt_surplus found = {.value = gradient[0][column] * rls->theta[row][column] +
                                  gradient[1][column] * rls->theta[row + 1][column]};
    found.error = root_of(axt_scatter_variance(&a->ident->scatter, rls, a->share, gradient));
    found.t = (found.error > AXT_R(0)) ? found.value / found.error : AXT_R(0);
    return found;
}

static uint32_t valid_if(uint32_t flag, axt_real value, axt_real error) {
    return (axt_finite(error) && error * AXT_R(RELATIVE_ERROR) < value) ? flag : 0;
}

axt_status axt_ident_result(const axt_ident *ident, axt_estimate *estimate) {
    const axt_real forgetting = ident->rls.forgetting;
    axt_estimate found = {.samples = ident->samples};
    *estimate = found;
    if (ident->samples < FEWEST_SAMPLES) {
        return AXT_ERROR_NO_DATA;
    }
    answer a = {.ident = ident,
                .share = (AXT_R(1) + raised(forgetting, ident->samples)) / (AXT_R(1) + forgetting)};
    axt_rows rows;
    if (read_rows(&a, &rows) != AXT_OK ||
        axt_axis_from_rows(&rows, ident->regressor.motor_share, &found.axis) != AXT_OK ||
        axt_axis_modal(&found.axis, &found.modal) != AXT_OK) {
        return AXT_ERROR_NO_DATA;
    }
    if (!axt_scatter_known(&ident->scatter)) {
        *estimate = found;
        return AXT_OK;
    }
    find_errors(&a, &found);
    if (ident->regressor.config.form == AXT_IDENT_5X4) {
        found.spring = find_surplus(&a, &found.axis, ANGLE_COLUMN);
        found.friction = find_surplus(&a, &found.axis, SPEED_COLUMN);
    }
    found.valid = valid_if(AXT_VALID_I1, found.axis.I1, found.axis_error.I1) |
                  valid_if(AXT_VALID_I2, found.axis.I2, found.axis_error.I2) |
                  valid_if(AXT_VALID_B, found.axis.B, found.axis_error.B) |
                  valid_if(AXT_VALID_K, found.axis.K, found.axis_error.K);
    *estimate = found;
    return AXT_OK;
}
