#include "axt_paper_loops.h"

axt_status axt_loop_integrate(axt_method method, const axt_axis *axis, axt_real time_step,
                              const axt_motion *start, const axt_real *torque, size_t n,
                              axt_motion *motion, size_t *done) {
    axt_integrator integrator;
    *done = 0;
    axt_status status = axt_integrator_init(&integrator, method, axis, time_step);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        status = (i == 0) ? axt_integrator_set(&integrator, start, torque[0])
                          : axt_integrator_step(&integrator, torque[i]);
        if (status == AXT_OK) {
            axt_integrator_read(&integrator, &motion[i]);
            *done = i + 1;
        }
    }
    return status;
}

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

static uint32_t inputs_of(const axt_ident_config *config) {
    return (config->form == AXT_IDENT_5X4) ? 5 : 3;
}

static uint32_t outputs_of(const axt_ident_config *config) {
    return (config->form == AXT_IDENT_5X4) ? 4 : 2;
}

axt_status axt_loop_equations(const axt_ident_config *config, const axt_motion *motion,
                              const axt_real *torque, size_t n, axt_real *phi, axt_real *y,
                              size_t *count) {
    axt_regressor regressor;
    *count = 0;
    axt_status status = axt_regressor_init(&regressor, config);
    for (size_t i = 0; i < n && status == AXT_OK; i++) {
        axt_equation equation;
        const axt_status sampled =
            axt_regressor_motion(&regressor, &motion[i], torque[i], &equation);
        if (sampled == AXT_OK) {
            for (uint32_t j = 0; j < inputs_of(config); j++) {
                *phi++ = equation.phi[j];
            }
            for (uint32_t j = 0; j < outputs_of(config); j++) {
                *y++ = equation.y[j];
            }
            *count += 1;
        } else if (sampled != AXT_ERROR_NO_DATA) { /* none comes before the second sample */
            status = sampled;
        }
    }
    return status;
}

axt_status axt_loop_axes(const axt_ident_config *config, const axt_real *theta, size_t k,
                         axt_axis *axes) {
    axt_regressor regressor;
    const axt_status status = axt_regressor_init(&regressor, config);
    if (status != AXT_OK) {
        return status;
    }
    const uint32_t *column = axt_regressor_columns(&regressor);
    const uint32_t row = axt_regressor_row(&regressor);
    const uint32_t inputs = inputs_of(config);
    for (size_t i = 0; i < k; i++) {
        axt_rows rows;
        for (uint32_t j = 0; j < 3; j++) {
            const axt_real *twist = &theta[row * inputs + column[j]];
            rows.twist[j] = twist[0] * axt_regressor_unit(&regressor, 0, j);
            rows.body[j] = twist[inputs] * axt_regressor_unit(&regressor, 1, j);
        }
        axes[i] = (axt_axis){0};
        (void)axt_axis_from_rows(&rows, regressor.motor_share, &axes[i]); /* none: stays zero */
        theta += (size_t)inputs * outputs_of(config);
    }
    return AXT_OK;
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
