#include "axt_rls.h"

#include "axt_math.h"

/* Place of element (i, j), i <= j, of the upper triangle of an n x n matrix stored by rows. */
static inline uint32_t packed(uint32_t n, uint32_t i, uint32_t j) {
    return i * n - i * (i + 1) / 2 + j;
}

axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs, axt_real forgetting,
                        axt_real prior) {
    if (inputs < 1 || inputs > AXT_RLS_INPUTS_MAX || outputs < 1 || outputs > AXT_RLS_OUTPUTS_MAX ||
        !(forgetting >= AXT_R(0.9) && forgetting <= AXT_R(1)) ||
        !(prior >= AXT_R(1) && prior <= AXT_R(1e15))) {
        return AXT_ERROR_RANGE;
    }
    *rls =
        (axt_rls){.forgetting = forgetting, .prior = prior, .inputs = inputs, .outputs = outputs};
    axt_rls_reset(rls);
    return AXT_OK;
}

void axt_rls_reset(axt_rls *rls) {
    axt_rls fresh = {.certainty = AXT_R(1),
                     .forgetting = rls->forgetting,
                     .prior = rls->prior,
                     .inputs = rls->inputs,
                     .outputs = rls->outputs,
                     .rejected = rls->rejected};
    for (uint32_t i = 0; i < rls->inputs; i++) {
        fresh.factor[packed(rls->inputs, i, i)] = rls->prior;
    }
    *rls = fresh;
}

static axt_status check_sample(const axt_real *values, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (!(axt_abs(values[i]) <= AXT_R(AXT_RLS_SAMPLE_MAX))) {
            return axt_finite(values[i]) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
        }
    }
    return AXT_OK;
}

static axt_status reject(axt_rls *rls, axt_status why) {
    rls->rejected += (rls->rejected < UINT32_MAX) ? 1U : 0U;
    return why;
}

/* Bierman's update of U and D for one sample of n regressors; `gain` becomes P phi, unscaled, and
 * the result is lambda + phi' P phi, or 0 when that is not finite. Every partial sum alpha is a sum
 * of lambda and squares, so nothing is divided by less than lambda. */
static inline axt_real update_factors(axt_real *factor, uint32_t n, axt_real forgetting,
                                      axt_real prior, const axt_real *phi, axt_real *gain) {
    axt_real f[AXT_RLS_INPUTS_MAX]; /* U' phi */
    axt_real v[AXT_RLS_INPUTS_MAX]; /* D U' phi */
    axt_real total = forgetting;
    for (uint32_t j = 0; j < n; j++) {
        f[j] = phi[j];
        for (uint32_t i = 0; i < j; i++) {
            f[j] = axt_fma(factor[packed(n, i, j)], phi[i], f[j]);
        }
        v[j] = factor[packed(n, j, j)] * f[j];
        total = axt_fma(v[j], f[j], total);
    }
    if (!axt_finite(total)) {
        return AXT_R(0);
    }

    const axt_real per_forgetting = AXT_R(1) / forgetting;
    axt_real alpha = forgetting;
    axt_real per_alpha = per_forgetting;
    for (uint32_t j = 0; j < n; j++) {
        const axt_real slope = -f[j] * per_alpha;
        const axt_real shrunk = alpha * per_forgetting;
        alpha = axt_fma(v[j], f[j], alpha);
        per_alpha = AXT_R(1) / alpha;
        const axt_real d = factor[packed(n, j, j)] * (shrunk * per_alpha);
        factor[packed(n, j, j)] = (d < prior) ? d : prior;
        gain[j] = v[j];
        for (uint32_t i = 0; i < j; i++) {
            axt_real *u = &factor[packed(n, i, j)];
            const axt_real old = *u;
            *u = axt_fma(gain[i], slope, old);
            gain[i] = axt_fma(old, v[j], gain[i]);
        }
    }
    return alpha;
}

/* Eqs. 14-16 for n inputs and m outputs; n and m are constants at each place of call, so that the
 * compiler unrolls the loops. */
static inline axt_status update(axt_rls *rls, uint32_t n, uint32_t m, const axt_real *phi,
                                const axt_real *y) {
    axt_status status = check_sample(phi, n);
    status = (status == AXT_OK) ? check_sample(y, m) : status;
    if (status != AXT_OK) {
        return reject(rls, status);
    }
    axt_real gain[AXT_RLS_INPUTS_MAX];
    const axt_real total = update_factors(rls->factor, n, rls->forgetting, rls->prior, phi, gain);
    if (!(total > AXT_R(0))) {
        return reject(rls, AXT_ERROR_RANGE);
    }
    const axt_real per_total = AXT_R(1) / total;
    for (uint32_t k = 0; k < m; k++) {
        axt_real innovation = y[k];
        for (uint32_t j = 0; j < n; j++) {
            innovation = axt_fma(-phi[j], rls->theta[k][j], innovation);
        }
        rls->innovation[k] = innovation;
        const axt_real step = innovation * per_total;
        for (uint32_t j = 0; j < n; j++) {
            rls->theta[k][j] = axt_fma(step, gain[j], rls->theta[k][j]);
        }
    }
    rls->certainty = rls->forgetting * per_total;
    rls->updates += (rls->updates < UINT32_MAX) ? 1U : 0U;
    return AXT_OK;
}

axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y) {
    if (rls->inputs == 5 && rls->outputs == 4) {
        return update(rls, 5, 4, phi, y);
    }
    if (rls->inputs == 3 && rls->outputs == 2) {
        return update(rls, 3, 2, phi, y);
    }
    return update(rls, rls->inputs, rls->outputs, phi, y);
}

axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column) {
    const uint32_t n = rls->inputs;
    if (row >= n || column >= n) {
        return AXT_R(0);
    }
    axt_real sum = AXT_R(0);
    for (uint32_t k = (row < column) ? column : row; k < n; k++) {
        const axt_real left = (k == row) ? AXT_R(1) : rls->factor[packed(n, row, k)];
        const axt_real right = (k == column) ? AXT_R(1) : rls->factor[packed(n, column, k)];
        sum = axt_fma(left * right, rls->factor[packed(n, k, k)], sum);
    }
    return sum;
}

bool axt_rls_invariants(const axt_rls *rls) {
    const uint32_t n = rls->inputs;
    bool holds = n >= 1 && n <= AXT_RLS_INPUTS_MAX && rls->outputs >= 1 &&
                 rls->outputs <= AXT_RLS_OUTPUTS_MAX && rls->forgetting >= AXT_R(0.9) &&
                 rls->forgetting <= AXT_R(1);
    for (uint32_t i = 0; holds && i < n; i++) {
        const axt_real d = rls->factor[packed(n, i, i)];
        holds = d > AXT_R(0) && d <= rls->prior;
        for (uint32_t j = i + 1; holds && j < n; j++) {
            holds = axt_finite(rls->factor[packed(n, i, j)]);
        }
        for (uint32_t k = 0; holds && k < rls->outputs; k++) {
            holds = axt_finite(rls->theta[k][i]) && axt_finite(rls->innovation[k]);
        }
    }
    return holds;
}
