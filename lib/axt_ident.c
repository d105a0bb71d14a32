#include "axt_ident.h"

#include "axt_math.h"
#include "axt_rows.h"

enum {
    SETTLED_UPDATES = 20, /* fewer say nothing about the residuals */
    RELATIVE_ERROR = 10   /* valid: the standard error is less than a tenth of the value */
};

/* The prior of the scaled problem: so large that it is forgotten within a few samples. In float,
 * what it still pulls after some hundred would stay: corrections below the rounding are lost. */
#define PRIOR (AXT_IS_DOUBLE ? AXT_R(1e13) : AXT_R(1e9))

axt_status axt_ident_init(axt_ident *ident, const axt_ident_config *config) {
    axt_ident fresh = {.weight = AXT_R(0)};
    axt_status status = axt_regressor_init(&fresh.regressor, config);
    if (status == AXT_OK) {
        const bool full = config->form == AXT_IDENT_5X4;
        status = axt_rls_init(&fresh.rls, full ? 5 : 3, full ? 4 : 2, config->forgetting, PRIOR);
    }
    if (status == AXT_OK) {
        *ident = fresh;
    }
    return status;
}

void axt_ident_reset(axt_ident *ident) {
    axt_rls_reset(&ident->rls);
    for (uint32_t i = 0; i < 3; i++) {
        ident->residual[i] = AXT_R(0);
    }
    ident->weight = AXT_R(0);
    ident->samples = 0;
    axt_ident_gap(ident);
}

void axt_ident_gap(axt_ident *ident) {
    axt_regressor_gap(&ident->regressor);
}

/* Takes what became of a sample: an equation to learn from, none yet, or a refusal to count. */
static axt_status learn(axt_ident *ident, axt_status sampled, const axt_equation *equation) {
    if (sampled == AXT_ERROR_NO_DATA) {
        return AXT_OK;
    }
    if (sampled != AXT_OK) {
        ident->rls.rejected += (ident->rls.rejected < UINT32_MAX) ? 1U : 0U;
        return sampled;
    }
    const axt_status status = axt_rls_update(&ident->rls, equation->phi, equation->y);
    if (status != AXT_OK) { /* counted by the update */
        axt_ident_gap(ident);
        return status;
    }
    /* innovation x residual is the increase of the weighted sum of squares that LS minimises */
    const uint32_t row = axt_regressor_row(&ident->regressor);
    const axt_real twist = ident->rls.innovation[row];
    const axt_real body = ident->rls.innovation[row + 1];
    const axt_real certainty = ident->rls.certainty;
    const axt_real keep = ident->rls.forgetting;
    ident->samples += (ident->samples < UINT32_MAX) ? 1U : 0U;
    ident->residual[0] = keep * ident->residual[0] + twist * twist * certainty;
    ident->residual[1] = keep * ident->residual[1] + body * body * certainty;
    ident->residual[2] = keep * ident->residual[2] + twist * body * certainty;
    ident->weight = keep * ident->weight + AXT_R(1);
    return AXT_OK;
}

static bool from_encoders(const axt_ident *ident) {
    return ident->regressor.config.counts_per_turn[0] != 0;
}

axt_status axt_ident_motion(axt_ident *ident, const axt_motion *motion, axt_real torque) {
    if (from_encoders(ident)) {
        return AXT_ERROR_RANGE;
    }
    axt_equation equation;
    return learn(ident, axt_regressor_motion(&ident->regressor, motion, torque, &equation),
                 &equation);
}

axt_status axt_ident_counts(axt_ident *ident, int32_t motor, int32_t table, axt_real torque) {
    if (!from_encoders(ident)) {
        return AXT_ERROR_RANGE;
    }
    axt_equation equation;
    return learn(ident, axt_regressor_counts(&ident->regressor, motor, table, torque, &equation),
                 &equation);
}

static void read_rows(const axt_ident *ident, axt_rows *found) {
    const axt_regressor *regressor = &ident->regressor;
    const uint32_t *column = axt_regressor_columns(regressor);
    const uint32_t row = axt_regressor_row(regressor);
    for (uint32_t i = 0; i < 3; i++) {
        found->twist[i] = ident->rls.theta[row][column[i]] * axt_regressor_unit(regressor, 0, i);
        found->body[i] = ident->rls.theta[row + 1][column[i]] * axt_regressor_unit(regressor, 1, i);
    }
}

/* What the covariance of the two rows is made of; all scaled. */
typedef struct {
    axt_real P[3][3];
    axt_real residual[3]; /* variances of twist and body residuals, and their covariance */
    axt_real unit[2][3];  /* physical entry = unit x scaled entry */
} spread;

static void read_spread(const axt_ident *ident, spread *found) {
    const uint32_t *column = axt_regressor_columns(&ident->regressor);
    const axt_real per_freedom = AXT_R(1) / (ident->weight - (axt_real)ident->rls.inputs);
    for (uint32_t i = 0; i < 3; i++) {
        for (uint32_t j = 0; j < 3; j++) {
            found->P[i][j] = axt_rls_covariance(&ident->rls, column[i], column[j]);
        }
        found->unit[0][i] = axt_regressor_unit(&ident->regressor, 0, i);
        found->unit[1][i] = axt_regressor_unit(&ident->regressor, 1, i);
        found->residual[i] = ident->residual[i] * per_freedom;
    }
}

/* Standard error of a function of the rows with this gradient (delta method). */
static axt_real standard_error(const spread *s, const axt_rows *gradient) {
    axt_real variance = AXT_R(0);
    for (uint32_t i = 0; i < 3; i++) {
        const axt_real twist_i = gradient->twist[i] * s->unit[0][i];
        const axt_real body_i = gradient->body[i] * s->unit[1][i];
        for (uint32_t j = 0; j < 3; j++) {
            const axt_real twist_j = gradient->twist[j] * s->unit[0][j];
            const axt_real body_j = gradient->body[j] * s->unit[1][j];
            variance += s->P[i][j] *
                        (twist_i * twist_j * s->residual[0] + body_i * body_j * s->residual[1] +
                         AXT_R(2) * twist_i * body_j * s->residual[2]);
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
    axt_estimate found = {.samples = ident->samples};
    *estimate = found;
    if (ident->samples < SETTLED_UPDATES ||
        !(ident->weight > AXT_R(0.5) * AXT_R(SETTLED_UPDATES))) {
        return AXT_ERROR_NO_DATA;
    }
    const axt_real share = ident->regressor.motor_share;
    axt_rows rows;
    read_rows(ident, &rows);
    if (axt_axis_from_rows(&rows, share, &found.axis) != AXT_OK ||
        axt_axis_modal(&found.axis, &found.modal) != AXT_OK) {
        return AXT_ERROR_NO_DATA;
    }
    spread s;
    read_spread(ident, &s);
    find_errors(&s, share, &found);
    found.valid = valid_if(AXT_VALID_I1, found.axis.I1, found.axis_error.I1) |
                  valid_if(AXT_VALID_I2, found.axis.I2, found.axis_error.I2) |
                  valid_if(AXT_VALID_B, found.axis.B, found.axis_error.B) |
                  valid_if(AXT_VALID_K, found.axis.K, found.axis_error.K);
    *estimate = found;
    return AXT_OK;
}
