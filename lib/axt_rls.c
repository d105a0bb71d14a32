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
        fresh.P[packed(rls->inputs, i, i)] = rls->prior;
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

/* Eqs. 14-16 for n inputs and m outputs; n and m are constants at each place of call, so that the
 * compiler unrolls the loops. */
static inline axt_status update(axt_rls *rls, uint32_t n, uint32_t m, const axt_real *phi,
                                const axt_real *y) {
    axt_status status = check_sample(phi, n);
    status = (status == AXT_OK) ? check_sample(y, m) : status;
    if (status != AXT_OK) {
        return reject(rls, status);
    }

    axt_real Pphi[AXT_RLS_INPUTS_MAX];
    axt_real spread = AXT_R(0); /* phi' P phi */
    bool unknown = false;       /* is a direction as uncertain as at the start? */
    for (uint32_t i = 0; i < n; i++) {
        axt_real sum = AXT_R(0);
        for (uint32_t j = 0; j < n; j++) {
            sum = axt_fma(rls->P[(i < j) ? packed(n, i, j) : packed(n, j, i)], phi[j], sum);
        }
        Pphi[i] = sum;
        spread = axt_fma(sum, phi[i], spread);
        unknown = unknown || rls->P[packed(n, i, i)] >= rls->prior;
    }
    const axt_real forgetting = unknown ? AXT_R(1) : rls->forgetting;
    const axt_real total = forgetting + spread;
    if (!(spread >= AXT_R(0)) || !axt_finite(total)) {
        return reject(rls, AXT_ERROR_RANGE);
    }

    const axt_real per_total = AXT_R(1) / total;
    const axt_real per_forgetting = unknown ? AXT_R(1) : AXT_R(1) / rls->forgetting;
    for (uint32_t k = 0; k < m; k++) {
        axt_real innovation = y[k];
        for (uint32_t j = 0; j < n; j++) {
            innovation = axt_fma(-phi[j], rls->theta[k][j], innovation);
        }
        rls->innovation[k] = innovation;
        const axt_real step = innovation * per_total;
        for (uint32_t j = 0; j < n; j++) {
            rls->theta[k][j] = axt_fma(step, Pphi[j], rls->theta[k][j]);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        const axt_real gain = Pphi[i] * per_total;
        for (uint32_t j = i; j < n; j++) {
            axt_real *element = &rls->P[packed(n, i, j)];
            *element = axt_fma(-gain, Pphi[j], *element) * per_forgetting;
        }
    }
    rls->certainty = forgetting * per_total;
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
    if (row >= rls->inputs || column >= rls->inputs) {
        return AXT_R(0);
    }
    return rls
        ->P[(row < column) ? packed(rls->inputs, row, column) : packed(rls->inputs, column, row)];
}

bool axt_rls_invariants(const axt_rls *rls) {
    const uint32_t n = rls->inputs;
    bool holds = n >= 1 && n <= AXT_RLS_INPUTS_MAX && rls->outputs >= 1 &&
                 rls->outputs <= AXT_RLS_OUTPUTS_MAX && rls->forgetting >= AXT_R(0.9) &&
                 rls->forgetting <= AXT_R(1);
    for (uint32_t i = 0; holds && i < n; i++) {
        const axt_real Pii = rls->P[packed(n, i, i)];
        holds = Pii > AXT_R(0) && axt_finite(Pii);
        for (uint32_t j = i + 1; holds && j < n; j++) {
            const axt_real Pij = rls->P[packed(n, i, j)];
            const axt_real limit = Pii * rls->P[packed(n, j, j)];
            holds = Pij * Pij <= limit * (AXT_R(1) + AXT_R(8) * AXT_EPSILON);
        }
        for (uint32_t k = 0; holds && k < rls->outputs; k++) {
            holds = axt_finite(rls->theta[k][i]) && axt_finite(rls->innovation[k]);
        }
    }
    return holds;
}
