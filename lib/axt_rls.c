#include "axt_rls.h"

#include "axt_math.h"

/* A sample is refused when the squares of its elements add up to more, and the factors start again
 * when 1 + phi' P phi does: far beyond anything scaled to 1. In float samples of up to 1e24 can be
 * chosen so that theta becomes infinite; of up to 1e18 fuzzing has found none. */
#define SIZE_LIMIT (AXT_IS_DOUBLE ? AXT_R(1e24) : AXT_R(1e18))

/* A direction is forgotten at the full rate when a sample renews it by a sixteenth of that, or
 * more. Less, and a direction that is seldom or weakly excited is followed late when it drifts;
 * more, and the noise of an axis at rest wears away sooner what motion has taught. */
#define RENEWAL 16

/* Place of element (i, j), i <= j, of the upper triangle stored by columns: the same for any number
 * of inputs, so that fewer than five are five with zeros. */
static inline uint32_t packed(uint32_t i, uint32_t j) {
    return j * (j + 1) / 2 + i;
}

/* Which update fits: inputs and outputs in a nibble each, and 3x2 made zero, which is the cheapest
 * to ask for. */
#define SHAPE(inputs, outputs) ((((inputs) << 4) | (outputs)) ^ 0x32U)

/* Where growth of D ends: a few roundings above the start, so that at the start it is not negative.
 */
static axt_real largest_factor(axt_real prior) {
    return prior * (AXT_R(1) + AXT_R(16) * AXT_EPSILON);
}

AXT_SEPARATE AXT_COLD void start_factors(axt_rls *rls) {
    for (uint32_t i = 0; i < AXT_RLS_FACTORS_MAX; i++) {
        rls->factor[i] = AXT_R(0);
    }
    axt_real *d = rls->factor;
    for (uint32_t j = 0; j < rls->inputs; j++) {
        *d = rls->prior;
        d += j + 2; /* along the diagonal */
    }
}

AXT_COLD axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs,
                                 axt_real forgetting, axt_real prior) {
    if (inputs < 1 || inputs > AXT_RLS_INPUTS_MAX || outputs < 1 || outputs > AXT_RLS_OUTPUTS_MAX ||
        !(forgetting >= AXT_R(0.9) && forgetting <= AXT_R(1)) ||
        !(prior >= AXT_R(1) && prior <= AXT_R(1e15))) {
        return AXT_ERROR_RANGE;
    }
    const axt_real growth_max = (AXT_R(1) - forgetting) / AXT_R(RENEWAL);
    *rls = (axt_rls){.forgetting = forgetting,
                     .prior = prior,
                     .growth_max = growth_max,
                     .growth_fade = growth_max / largest_factor(prior),
                     .shape = (uint8_t)SHAPE(inputs, outputs),
                     .inputs = (uint8_t)inputs,
                     .outputs = (uint8_t)outputs};
    axt_rls_reset(rls);
    return AXT_OK;
}

AXT_COLD void axt_rls_reset(axt_rls *rls) {
    for (uint32_t k = 0; k < AXT_RLS_OUTPUTS_MAX; k++) {
        for (uint32_t j = 0; j < AXT_RLS_INPUTS_MAX; j++) {
            rls->theta[k][j] = AXT_R(0);
        }
        rls->innovation[k] = AXT_R(0);
    }
    rls->certainty = AXT_R(1);
    start_factors(rls);
}

/* Refuses a sample before anything has changed. */
AXT_SEPARATE AXT_COLD axt_status reject(axt_rls *rls, axt_real size) {
    axt_count(&rls->rejected);
    return (size <= AXT_REAL_MAX) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
}

/* The factors have left the range of the number type, which no scaled motion was seen to do: what
 * was known of the uncertainty is lost, what was known of the axis is kept. */
AXT_SEPARATE AXT_COLD axt_status restart(axt_rls *rls) {
    start_factors(rls);
    axt_count(&rls->restarts);
    return AXT_ERROR_RANGE;
}

/* Eqs. 14-16 for n inputs and m outputs; n and m are constants at each place of call, so that all
 * loops unroll. Nothing is written before the sample has been found good. Each column of the
 * factors is read once and written once, so that the whole fits into the registers. */
AXT_UNROLLED axt_status update(axt_rls *restrict rls, uint32_t n, uint32_t m,
                               const axt_real *restrict phi, const axt_real *restrict y) {
    axt_real size = y[0] * y[0];
    AXT_UNROLL
    for (uint32_t k = 1; k < m; k++) {
        size = axt_fma(y[k], y[k], size);
    }
    AXT_UNROLL
    for (uint32_t j = 0; j < n; j++) {
        size = axt_fma(phi[j], phi[j], size);
    }
    if (!(size <= SIZE_LIMIT)) {
        return reject(rls, size);
    }

    /* Bierman's update. alpha runs from 1 to 1 + phi' P phi. */
    axt_real *factor = rls->factor;
    const axt_real growth_max = rls->growth_max;
    const axt_real growth_fade = rls->growth_fade;
    const axt_real renewal = AXT_R(RENEWAL);
    axt_real gain[AXT_RLS_INPUTS_MAX]; /* P phi, summed up column by column */
    axt_real alpha = AXT_R(1);
    axt_real per_alpha = AXT_R(1);
    AXT_UNROLL
    for (uint32_t j = 0; j < n; j++) {
        axt_real f = phi[j]; /* U' phi */
        AXT_UNROLL
        for (uint32_t i = 0; i < j; i++) {
            f = axt_fma(factor[packed(i, j)], phi[i], f);
        }
        const axt_real d = factor[packed(j, j)];
        const axt_real v = d * f;
        const axt_real share = v * f;
        /*@ assert square: share >= 0; */
        const axt_real slope = f * per_alpha;
        const axt_real before = alpha;
        alpha += share;
        const axt_real left = before / alpha; /* of D; exactly 1 when there is nothing new */
        /*@ assert left: 0 < left <= 1; */

        const axt_real most = axt_fma(-growth_fade, d, growth_max);
        const axt_real growth = (share < most) ? share : most;
        factor[packed(j, j)] = d * axt_fma(renewal, growth, left);
        per_alpha *= left;
        gain[j] = v;
        AXT_UNROLL
        for (uint32_t i = 0; i < j; i++) {
            const axt_real u = factor[packed(i, j)];
            factor[packed(i, j)] = axt_fma(-slope, gain[i], u);
            gain[i] = axt_fma(u, v, gain[i]);
        }
    }
    if (!(alpha <= SIZE_LIMIT)) {
        return restart(rls);
    }

    AXT_UNROLL
    for (uint32_t k = 0; k < m; k++) {
        axt_real *theta = rls->theta[k];
        axt_real innovation = y[k];
        AXT_UNROLL
        for (uint32_t j = 0; j < n; j++) {
            innovation = axt_fma(-phi[j], theta[j], innovation);
        }
        const axt_real step = innovation * per_alpha;
        AXT_UNROLL
        for (uint32_t j = 0; j < n; j++) {
            theta[j] = axt_fma(step, gain[j], theta[j]);
        }
        rls->innovation[k] = innovation;
    }
    rls->certainty = per_alpha;
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
    if (rls->shape == SHAPE(3U, 2U)) {
        return update_3x2(rls, phi, y);
    }
    if (rls->shape == SHAPE(5U, 4U)) {
        return update_5x4(rls, phi, y);
    }
    return update_padded(rls, phi, y);
}

AXT_COLD axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column) {
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

/* P^-1 = U^-T D^-1 U^-1, so with U x = the unit vector of this input it is the sum of x^2 / D. */
AXT_COLD axt_real axt_rls_information(const axt_rls *rls, uint32_t input) {
    if (input >= rls->inputs) {
        return AXT_R(0);
    }
    axt_real x[AXT_RLS_INPUTS_MAX];
    axt_real sum = AXT_R(0);
    for (uint32_t j = input + 1; j-- > 0;) {
        x[j] = (j == input) ? AXT_R(1) : AXT_R(0);
        for (uint32_t k = j + 1; k <= input; k++) {
            x[j] -= rls->factor[packed(j, k)] * x[k];
        }
        sum += x[j] * x[j] / rls->factor[packed(j, j)];
    }
    return sum;
}

AXT_COLD bool axt_rls_invariants(const axt_rls *rls) {
    const uint32_t n = rls->inputs;
    bool holds = n >= 1 && n <= AXT_RLS_INPUTS_MAX && rls->outputs >= 1 &&
                 rls->outputs <= AXT_RLS_OUTPUTS_MAX && rls->forgetting >= AXT_R(0.9) &&
                 rls->forgetting <= AXT_R(1);
    for (uint32_t i = 0; holds && i < n; i++) {
        const axt_real d = rls->factor[packed(i, i)];
        holds =
            d > AXT_R(0) && d <= largest_factor(rls->prior) * (AXT_R(1) + AXT_R(16) * AXT_EPSILON);
        for (uint32_t j = i + 1; holds && j < n; j++) {
            holds = axt_finite(rls->factor[packed(i, j)]);
        }
        for (uint32_t k = 0; holds && k < rls->outputs; k++) {
            holds = axt_finite(rls->theta[k][i]) && axt_finite(rls->innovation[k]);
        }
    }
    return holds;
}
