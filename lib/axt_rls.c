#include "axt_rls.h"

#include "axt_math.h"

/* A sample is refused when phi' P phi or the sum of the innovations' magnitudes is larger: far
 * beyond anything scaled to 1, and small enough that no product in the update overflows. */
#define SPREAD_MAX   1e18
#define SURPRISE_MAX 1e12

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

static axt_status reject(axt_rls *rls, axt_status why) {
    rls->rejected += (rls->rejected < UINT32_MAX) ? 1U : 0U;
    return why;
}

/* How much of the information phi phi' of a sample is added to what is known. Directional
 * forgetting (R. Kulhavy, Automatica 23 (1987) 589-600) lets the information along P phi settle
 * where spread = phi' P phi is lost / (1 - lost), and adds 1 - lost - lost / spread of the
 * sample's: all of it without forgetting, none when settled, and less than none while more is known
 * than is to be kept. The floor of -1 is ours: a sample takes away no more than it brings, so that
 * the noise of an axis at rest, tiny samples in random directions, does not wear away what motion
 * has taught. */
static axt_real information_gain(axt_real lost, axt_real spread) {
    if (!(lost > AXT_R(0))) {
        return AXT_R(1);
    }
    const axt_real kept = AXT_R(1) - lost;
    return (lost < (AXT_R(1) + kept) * spread) ? kept - lost / spread : AXT_R(-1);
}

/* Eqs. 14-16 for n inputs and m outputs; n and m are constants at each place of call, so that the
 * compiler unrolls the loops. Nothing is written before the sample has been found good. */
static inline axt_status update(axt_rls *rls, uint32_t n, uint32_t m, const axt_real *phi,
                                const axt_real *y) {
    axt_real *factor = rls->factor;
    axt_real f[AXT_RLS_INPUTS_MAX]; /* U' phi */
    axt_real v[AXT_RLS_INPUTS_MAX]; /* D U' phi */
    axt_real spread = AXT_R(0);     /* phi' P phi */
    for (uint32_t j = 0; j < n; j++) {
        f[j] = phi[j];
        for (uint32_t i = 0; i < j; i++) {
            f[j] = axt_fma(factor[packed(n, i, j)], phi[i], f[j]);
        }
        v[j] = factor[packed(n, j, j)] * f[j];
        spread = axt_fma(v[j], f[j], spread);
    }
    axt_real innovation[AXT_RLS_OUTPUTS_MAX];
    axt_real surprise = AXT_R(0);
    for (uint32_t k = 0; k < m; k++) {
        innovation[k] = y[k];
        for (uint32_t j = 0; j < n; j++) {
            innovation[k] = axt_fma(-phi[j], rls->theta[k][j], innovation[k]);
        }
        surprise += axt_abs(innovation[k]);
    }
    if (!(spread <= AXT_R(SPREAD_MAX)) || !(surprise <= AXT_R(SURPRISE_MAX))) {
        const bool finite = axt_finite(spread) && axt_finite(surprise);
        return reject(rls, finite ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE);
    }

    /* Bierman's update of the factors. alpha runs from 1 to 1 + gained spread, which is not below
     * 1 - lost. The n regressors share what exponential forgetting would lose in one step. */
    const axt_real lost = (axt_real)n * (AXT_R(1) - rls->forgetting);
    const axt_real gained = information_gain(lost, spread);
    axt_real gain[AXT_RLS_INPUTS_MAX]; /* P phi, summed up column by column */
    axt_real alpha = AXT_R(1);
    axt_real per_alpha = AXT_R(1);
    for (uint32_t j = 0; j < n; j++) {
        const axt_real gained_f = gained * f[j];
        const axt_real slope = -gained_f * per_alpha;
        const axt_real before = alpha;
        alpha = axt_fma(gained_f, v[j], alpha);
        per_alpha = AXT_R(1) / alpha;
        const axt_real d = factor[packed(n, j, j)] * (before * per_alpha);
        factor[packed(n, j, j)] = (d < rls->prior) ? d : rls->prior;
        gain[j] = v[j];
        for (uint32_t i = 0; i < j; i++) {
            axt_real *u = &factor[packed(n, i, j)];
            const axt_real old = *u;
            *u = axt_fma(gain[i], slope, old);
            gain[i] = axt_fma(old, v[j], gain[i]);
        }
    }
    const axt_real certainty = AXT_R(1) / (AXT_R(1) + spread);
    for (uint32_t k = 0; k < m; k++) {
        const axt_real step = innovation[k] * certainty;
        for (uint32_t j = 0; j < n; j++) {
            rls->theta[k][j] = axt_fma(step, gain[j], rls->theta[k][j]);
        }
        rls->innovation[k] = innovation[k];
    }
    rls->certainty = certainty;
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
