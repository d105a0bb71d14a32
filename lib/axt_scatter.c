#include "axt_scatter.h"

#include "axt_math.h"

/* When so many windows are in the sum it is halved: what is added to it stays above its rounding
 * for ever, and an axis that grows noisy is found to have. */
#define WINDOWS_MAX 4096

/* Sum of squares of overlapping triangular windows over that of their length. */
#define WINDOW_POWER (AXT_R(2) / AXT_R(3))

axt_status axt_scatter_init(axt_scatter *scatter, uint32_t inputs, uint32_t length) {
    if (inputs < 1 || inputs > AXT_RLS_INPUTS_MAX || length < AXT_SCATTER_LENGTH_MIN) {
        return AXT_ERROR_RANGE;
    }
    *scatter =
        (axt_scatter){.slope = AXT_R(1) / (axt_real)length, .inputs = inputs, .length = length};
    axt_scatter_reset(scatter);
    return AXT_OK;
}

void axt_scatter_reset(axt_scatter *scatter) {
    *scatter = (axt_scatter){.slope = scatter->slope,
                             .inputs = scatter->inputs,
                             .length = scatter->length,
                             .falling = 1,
                             .whole = 2,
                             .column = AXT_SCATTER_ROWS * scatter->inputs};
}

/* Adds one element of g g' to M: a whole column in one sample would be a burst. */
AXT_SEPARATE void add_element(axt_scatter *scatter) {
    const axt_real *g = scatter->score[scatter->whole];
    axt_real *element = &scatter->sum[scatter->place];
    const axt_real kept = scatter->halving ? AXT_R(0.5) * *element : *element;
    *element = axt_fma(g[scatter->row], g[scatter->column], kept);
    scatter->place++;
    if (scatter->row < scatter->column) {
        scatter->row++;
        return;
    }
    scatter->row = 0;
    scatter->column++;
    if (scatter->column == AXT_SCATTER_ROWS * scatter->inputs) {
        scatter->windows = (scatter->halving ? WINDOWS_MAX / 2 : scatter->windows) + 1;
    }
}

/* Half a window is over: one window ends, the next begins. The first to end had no first half. */
AXT_SEPARATE void turn_over(axt_scatter *scatter) {
    const bool first = scatter->seen[0] <= AXT_R(0);
    const uint8_t free = scatter->whole;
    scatter->whole = scatter->falling;
    scatter->falling = scatter->rising;
    scatter->rising = free;
    _Pragma("GCC unroll 10") for (uint32_t i = 0; i < AXT_SCATTER_SCORES_MAX; i++) {
        scatter->score[free][i] = AXT_R(0);
    }
    scatter->halving = scatter->windows >= WINDOWS_MAX;
    for (uint32_t i = 0; i < scatter->inputs; i++) {
        const axt_real kept = scatter->halving ? AXT_R(0.5) * scatter->seen[i] : scatter->seen[i];
        scatter->seen[i] = kept + scatter->power[i];
        scatter->power[i] = AXT_R(0);
    }
    scatter->taken = 0;
    scatter->place = 0;
    scatter->row = 0;
    scatter->column = first ? AXT_SCATTER_ROWS * scatter->inputs : 0;
}

/* n is a constant at each place of call. */
AXT_UNROLLED void add(axt_scatter *restrict scatter, uint32_t n, const axt_real *restrict phi,
                      const axt_real *restrict residual) {
    const axt_real weight = (axt_real)scatter->taken * scatter->slope;
    axt_real *restrict rising = scatter->score[scatter->rising];
    axt_real *restrict falling = scatter->score[scatter->falling];
    AXT_UNROLL
    for (uint32_t row = 0; row < AXT_SCATTER_ROWS; row++) {
        const axt_real up = weight * residual[row];
        const axt_real down = residual[row] - up;
        AXT_UNROLL
        for (uint32_t i = 0; i < n; i++) {
            const uint32_t at = row * n + i;
            rising[at] = axt_fma(phi[i], up, rising[at]);
            falling[at] = axt_fma(phi[i], down, falling[at]);
        }
    }
    AXT_UNROLL
    for (uint32_t i = 0; i < n; i++) {
        scatter->power[i] = axt_fma(phi[i], phi[i], scatter->power[i]);
    }
}

AXT_SEPARATE void add_3(axt_scatter *restrict scatter, const axt_real *restrict phi,
                        const axt_real *restrict residual) {
    add(scatter, 3, phi, residual);
}

AXT_SEPARATE void add_5(axt_scatter *restrict scatter, const axt_real *restrict phi,
                        const axt_real *restrict residual) {
    add(scatter, 5, phi, residual);
}

/* Any other number of inputs. */
AXT_SEPARATE void add_n(axt_scatter *restrict scatter, const axt_real *restrict phi,
                        const axt_real *restrict residual) {
    add(scatter, scatter->inputs, phi, residual);
}

void axt_scatter_add(axt_scatter *restrict scatter, const axt_real *restrict phi,
                     const axt_real *restrict residual) {
    const uint32_t n = scatter->inputs;
    if (n == 3) {
        add_3(scatter, phi, residual);
    } else if (n == 5) {
        add_5(scatter, phi, residual);
    } else {
        add_n(scatter, phi, residual);
    }
    if (scatter->column < AXT_SCATTER_ROWS * n) {
        add_element(scatter);
    }
    scatter->taken++;
    if (scatter->taken == scatter->length) {
        turn_over(scatter);
    }
}

bool axt_scatter_known(const axt_scatter *scatter) {
    return scatter->windows >= scatter->inputs + 2;
}

axt_real axt_scatter_variance(const axt_scatter *scatter, const axt_rls *rls, axt_real share,
                              axt_real gradient[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX]) {
    const uint32_t n = scatter->inputs;
    if (!axt_scatter_known(scatter)) {
        return AXT_R(-1);
    }
    /* gradient' P, for each score, and M scaled to what is kept */
    axt_real weight[AXT_SCATTER_SCORES_MAX];
    for (uint32_t i = 0; i < n; i++) {
        const axt_real kept = axt_rls_information(rls, i) / scatter->seen[i];
        const axt_real scale = axt_finite(kept) ? axt_sqrt(kept) : AXT_R(1);
        for (uint32_t row = 0; row < AXT_SCATTER_ROWS; row++) {
            axt_real sum = AXT_R(0);
            for (uint32_t j = 0; j < n; j++) {
                sum += axt_rls_covariance(rls, i, j) * gradient[row][j];
            }
            weight[row * n + i] = sum * scale;
        }
    }
    axt_real variance = AXT_R(0);
    const axt_real *element = scatter->sum;
    for (uint32_t j = 0; j < AXT_SCATTER_ROWS * n; j++) {
        for (uint32_t i = 0; i < j; i++) {
            variance += AXT_R(2) * weight[i] * *element++ * weight[j];
        }
        variance += weight[j] * *element++ * weight[j];
    }
    /* the parameters were fitted to the same scores */
    const axt_real windows = (axt_real)scatter->windows;
    return share * variance / WINDOW_POWER * windows / (windows - (axt_real)n);
}
