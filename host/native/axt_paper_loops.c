#include "axt_paper_loops.h"

static bool due(size_t i, size_t n, size_t every) {
    return (i + 1) % every == 0 || i + 1 == n;
}

axt_status axt_loop_rls(uint32_t inputs, uint32_t outputs, axt_real forgetting, axt_real prior,
                        const axt_real *phi, const axt_real *y, size_t n, size_t every,
                        axt_real *theta, uint8_t *definite, size_t *done) {
    axt_rls rls;
    bool so_far = true;
    *done = 0;
    axt_status status = axt_rls_init(&rls, inputs, outputs, forgetting, prior);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status = axt_rls_update(&rls, &phi[i * inputs], &y[i * outputs]);
        so_far = so_far && axt_rls_invariants(&rls);
        if (status == AXT_OK && due(i, n, every)) {
            for (uint32_t k = 0; k < outputs; k++) {
                for (uint32_t j = 0; j < inputs; j++) {
                    *theta++ = rls.theta[k][j];
                }
            }
            *definite++ = so_far ? 1 : 0;
        }
        *done += (status == AXT_OK);
    }
    return status;
}

axt_status axt_loop_torque(const axt_axis *axis, axt_real time_step, const axt_motion *motion,
                           size_t n, axt_real *mean, size_t *done) {
    axt_torque torque;
    *done = 0;
    axt_status status = axt_torque_init(&torque, axis, time_step);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        const axt_status stepped = axt_torque_step(&torque, &motion[i], mean);
        if (stepped == AXT_OK) {
            mean++;
        } else if (stepped != AXT_ERROR_NO_DATA) { /* there is no step before the first sample */
            status = stepped;
        }
        *done += (status == AXT_OK);
    }
    return status;
}
