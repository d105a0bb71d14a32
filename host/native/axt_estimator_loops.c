#include "axt_estimator_loops.h"

enum { INPUTS = 3, OUTPUTS = 2 };

/* Takes what became of a sample: an equation, none yet, or a failure. */
static axt_status take(axt_status sampled, const axt_equation *equation, axt_real *phi, axt_real *y,
                       size_t *count) {
    if (sampled == AXT_OK) {
        for (size_t i = 0; i < INPUTS; i++) {
            phi[*count * INPUTS + i] = equation->phi[i];
        }
        for (size_t k = 0; k < OUTPUTS; k++) {
            y[*count * OUTPUTS + k] = equation->y[k];
        }
        *count += 1;
    }
    return (sampled == AXT_ERROR_NO_DATA) ? AXT_OK : sampled;
}

axt_status axt_loop_equations_motion(axt_regressor *regressor, const axt_motion *motion,
                                     const axt_real *torque, size_t n, axt_real *phi, axt_real *y,
                                     int64_t *sample, size_t *count) {
    axt_status status = AXT_OK;
    *count = 0;
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        axt_equation equation;
        sample[*count] = (int64_t)i;
        status = axt_regressor_motion(regressor, &motion[i], torque[i], &equation);
        status = take(status, &equation, phi, y, count);
    }
    return status;
}

axt_status axt_loop_equations_counts(axt_regressor *regressor, const int32_t *motor,
                                     const int32_t *table, const axt_real *torque, size_t n,
                                     axt_real *phi, axt_real *y, int64_t *sample, size_t *count) {
    axt_status status = AXT_OK;
    *count = 0;
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        axt_equation equation;
        sample[*count] = (int64_t)i;
        status = axt_regressor_counts(regressor, motor[i], table[i], torque[i], &equation);
        status = take(status, &equation, phi, y, count);
    }
    return status;
}

static bool due(size_t i, size_t n, size_t every) {
    return (i + 1) % every == 0 || i + 1 == n;
}

axt_status axt_loop_els(axt_real forgetting, axt_real prior, const axt_real *phi, const axt_real *y,
                        size_t n, size_t every, axt_real *theta, uint32_t *rejected) {
    axt_els els;
    const axt_status status = axt_els_init(&els, forgetting, prior);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        (void)axt_els_update(&els, &phi[i * INPUTS], &y[i * OUTPUTS]); /* counts what it refuses */
        for (size_t k = 0; k < OUTPUTS && due(i, n, every); k++) {
            for (size_t j = 0; j < INPUTS; j++) {
                *theta++ = els.rls[k].theta[0][j];
            }
        }
    }
    *rejected = (status == AXT_OK) ? els.rls[0].rejected + els.rls[1].rejected : 0;
    return status;
}

axt_status axt_loop_iv(axt_real forgetting, axt_real prior, const axt_real *phi, const axt_real *y,
                       size_t n, size_t delay, size_t every, axt_real *theta, uint32_t *rejected) {
    axt_iv iv;
    const axt_status status = axt_iv_init(&iv, forgetting, prior);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        if (i >= delay) {
            (void)axt_iv_update(&iv, &phi[i * INPUTS], &phi[(i - delay) * INPUTS],
                                &y[i * OUTPUTS]); /* counts what it refuses */
        }
        for (size_t k = 0; k < OUTPUTS && due(i, n, every); k++) {
            for (size_t j = 0; j < INPUTS; j++) {
                *theta++ = iv.theta[k][j];
            }
        }
    }
    *rejected = (status == AXT_OK) ? iv.rejected : 0;
    return status;
}
