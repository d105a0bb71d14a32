#include "axt_rls.h"

#include "axt_math.h"

/* A sample is refused when phi' P phi and the squares of its elements add up to more: far beyond
 * anything scaled to 1, small enough that no product in the update overflows, and that D, which is
 * at least 1 / sum(phi^2), does not fall to zero. */
#define SAMPLE_MAX (AXT_IS_DOUBLE ? 1e25 : 1e18)

/* Place of element (i, j), i <= j, of the upper triangle stored by columns: the same for any number
 * of inputs, so that fewer than five are five with zeros. */
static inline uint32_t packed(uint32_t i, uint32_t j) {
    return j * (j + 1) / 2 + i;
}

axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs, axt_real forgetting,
                        axt_real prior) {
    if (inputs < 1 || inputs > AXT_RLS_INPUTS_MAX || outputs < 1 || outputs > AXT_RLS_OUTPUTS_MAX ||
        !(forgetting >= AXT_R(0.9) && forgetting <= AXT_R(1)) ||
        !(prior >= AXT_R(1) && prior <= AXT_R(1e15))) {
        return AXT_ERROR_RANGE;
    }
    *rls = (axt_rls){.forgetting = forgetting,
                     .lost = (axt_real)inputs * (AXT_R(1) - forgetting),
                     .prior = prior,
                     .inputs = inputs,
                     .outputs = outputs};
    axt_rls_reset(rls);
    return AXT_OK;
}

void axt_rls_reset(axt_rls *rls) {
    axt_rls fresh = {.certainty = AXT_R(1),
                     .forgetting = rls->forgetting,
                     .lost = rls->lost,
                     .prior = rls->prior,
                     .inputs = rls->inputs,
                     .outputs = rls->outputs,
                     .rejected = rls->rejected};
    for (uint32_t i = 0; i < rls->inputs; i++) {
        fresh.factor[packed(i, i)] = rls->prior;
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
static inline axt_real information_gain(axt_real lost, axt_real spread) {
    const axt_real kept = AXT_R(1) - lost;
    return (lost < (kept + AXT_R(1)) * spread) ? kept - lost / spread : AXT_R(-1);
}

/* Where information is taken away the factors grow; no element of D beyond its start. */
AXT_UNROLLED void limit_factors(axt_real *factor, uint32_t n, axt_real prior) {
    AXT_UNROLL
    for (uint32_t j = 0; j < n; j++) {
        if (factor[packed(j, j)] > prior) {
            factor[packed(j, j)] = prior;
        }
    }
}

/* Eqs. 14-16 for n inputs and m outputs; n and m are constants at each place of call, so that all
 * loops unroll. Nothing is written before the sample has been found good. */
AXT_UNROLLED axt_status update(axt_rls *restrict rls, uint32_t n, uint32_t m,
                               const axt_real *restrict phi, const axt_real *restrict y) {
    axt_real *factor = rls->factor;
    axt_real f[AXT_RLS_INPUTS_MAX]; /* U' phi */
    axt_real v[AXT_RLS_INPUTS_MAX]; /* D U' phi */
    axt_real spread = AXT_R(0);     /* phi' P phi */
    axt_real size = AXT_R(0);
    AXT_UNROLL
    for (uint32_t j = 0; j < n; j++) {
        f[j] = phi[j];
        size = axt_fma(phi[j], phi[j], size);
        AXT_UNROLL
        for (uint32_t i = 0; i < j; i++) {
            f[j] = axt_fma(factor[packed(i, j)], phi[i], f[j]);
        }
        v[j] = factor[packed(j, j)] * f[j];
        spread = axt_fma(v[j], f[j], spread);
    }
    size += spread;
    AXT_UNROLL
    for (uint32_t k = 0; k < m; k++) {
        size = axt_fma(y[k], y[k], size);
    }
    if (!(size <= AXT_R(SAMPLE_MAX))) {
        return reject(rls, axt_finite(size) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE);
    }

    /* Bierman's update of the factors. alpha runs from 1 to 1 + gained spread, which is not below
     * 1 - lost. */
    const axt_real gained = information_gain(rls->lost, spread);
    axt_real gain[AXT_RLS_INPUTS_MAX]; /* P phi, summed up column by column */
    axt_real alpha = AXT_R(1);
    axt_real per_alpha = AXT_R(1);
    AXT_UNROLL
    for (uint32_t j = 0; j < n; j++) {
        const axt_real gained_f = gained * f[j];
        const axt_real slope = -gained_f * per_alpha;
        const axt_real before = alpha;
        alpha = axt_fma(gained_f, v[j], alpha);
        per_alpha = AXT_R(1) / alpha;
        factor[packed(j, j)] *= before * per_alpha;
        gain[j] = v[j];
        AXT_UNROLL
        for (uint32_t i = 0; i < j; i++) {
            axt_real *u = &factor[packed(i, j)];
            const axt_real old = *u;
            *u = axt_fma(gain[i], slope, old);
            gain[i] = axt_fma(old, v[j], gain[i]);
        }
    }
    if (gained < AXT_R(0)) {
        limit_factors(factor, n, rls->prior);
    }

    const axt_real certainty = AXT_R(1) / (AXT_R(1) + spread);
    AXT_UNROLL
    for (uint32_t k = 0; k < m; k++) {
        axt_real *theta = rls->theta[k];
        axt_real innovation = y[k];
        AXT_UNROLL
        for (uint32_t j = 0; j < n; j++) {
            innovation = axt_fma(-phi[j], theta[j], innovation);
        }
        const axt_real step = innovation * certainty;
        AXT_UNROLL
        for (uint32_t j = 0; j < n; j++) {
            theta[j] = axt_fma(step, gain[j], theta[j]);
        }
        rls->innovation[k] = innovation;
    }
    rls->certainty = certainty;
    rls->updates += (rls->updates < UINT32_MAX) ? 1U : 0U;
    return AXT_OK;
}

AXT_SEPARATE axt_status update_3x2(axt_rls *restrict rls, const axt_real *restrict phi,
                                   const axt_real *restrict y) {
    return update(rls, 3, 2, phi, y);
}

AXT_SEPARATE axt_status update_5x4(axt_rls *restrict rls, const axt_real *restrict phi,
                                   const axt_real *restrict y) {
    return update(rls, 5, 4, phi, y);
}

/* Fewer than five inputs and four outputs: zeros for the rest. */
AXT_SEPARATE axt_status update_padded(axt_rls *restrict rls, const axt_real *restrict phi,
                                      const axt_real *restrict y) {
    axt_real all_phi[AXT_RLS_INPUTS_MAX] = {AXT_R(0)};
    axt_real all_y[AXT_RLS_OUTPUTS_MAX] = {AXT_R(0)};
    for (uint32_t i = 0; i < rls->inputs; i++) {
        all_phi[i] = phi[i];
    }
    for (uint32_t k = 0; k < rls->outputs; k++) {
        all_y[k] = y[k];
    }
    return update_5x4(rls, all_phi, all_y);
}

axt_status axt_rls_update(axt_rls *restrict rls, const axt_real *restrict phi,
                          const axt_real *restrict y) {
    if (rls->inputs == 3 && rls->outputs == 2) {
        return update_3x2(rls, phi, y);
    }
    if (rls->inputs == 5 && rls->outputs == 4) {
        return update_5x4(rls, phi, y);
    }
    return update_padded(rls, phi, y);
}

axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column) {
    const uint32_t n = rls->inputs;
    if (row >= n || column >= n) {
        return AXT_R(0);
    }
    axt_real sum = AXT_R(0);
    for (uint32_t k = (row < column) ? column : row; k < n; k++) {
        const axt_real left = (k == row) ? AXT_R(1) : rls->factor[packed(row, k)];
        const axt_real right = (k == column) ? AXT_R(1) : rls->factor[packed(column, k)];
        sum = axt_fma(left * right, rls->factor[packed(k, k)], sum);
    }
    return sum;
}

bool axt_rls_invariants(const axt_rls *rls) {
    const uint32_t n = rls->inputs;
    bool holds = n >= 1 && n <= AXT_RLS_INPUTS_MAX && rls->outputs >= 1 &&
                 rls->outputs <= AXT_RLS_OUTPUTS_MAX && rls->forgetting >= AXT_R(0.9) &&
                 rls->forgetting <= AXT_R(1);
    for (uint32_t i = 0; holds && i < n; i++) {
        const axt_real d = rls->factor[packed(i, i)];
        holds = d > AXT_R(0) && d <= rls->prior;
        for (uint32_t j = i + 1; holds && j < n; j++) {
            holds = axt_finite(rls->factor[packed(i, j)]);
        }
        for (uint32_t k = 0; holds && k < rls->outputs; k++) {
            holds = axt_finite(rls->theta[k][i]) && axt_finite(rls->innovation[k]);
        }
    }
    return holds;
}
