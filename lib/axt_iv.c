#include "axt_iv.h"

#include "axt_math.h"

/* Instruments that point away from the regressors make lambda + phi' P z small or negative; an
 * update would then throw the estimate far off. */
#define LEAST_TOTAL AXT_R(0.01)

axt_status axt_iv_init(axt_iv *iv, axt_real forgetting, axt_real prior) {
    if (!(forgetting >= AXT_R(0.9) && forgetting <= AXT_R(1)) ||
        !(prior >= AXT_R(1) && prior <= AXT_R(1e15))) {
        return AXT_ERROR_RANGE;
    }
    *iv = (axt_iv){.forgetting = forgetting};
    for (uint32_t i = 0; i < AXT_IV_INPUTS; i++) {
        iv->P[i][i] = prior;
    }
    return AXT_OK;
}

static axt_status check_sample(const axt_real *values, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (!(axt_abs(values[i]) <= AXT_R(1e6))) {
            return axt_finite(values[i]) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
        }
    }
    return AXT_OK;
}

static axt_status reject(axt_iv *iv, axt_status why) {
    iv->rejected += (iv->rejected < UINT32_MAX) ? 1U : 0U;
    return why;
}

axt_status axt_iv_update(axt_iv *iv, const axt_real *phi, const axt_real *z, const axt_real *y) {
    axt_status status = check_sample(phi, AXT_IV_INPUTS);
    status = (status == AXT_OK) ? check_sample(z, AXT_IV_INPUTS) : status;
    status = (status == AXT_OK) ? check_sample(y, AXT_IV_OUTPUTS) : status;
    if (status != AXT_OK) {
        return reject(iv, status);
    }
    axt_real left[AXT_IV_INPUTS];  /* P z */
    axt_real right[AXT_IV_INPUTS]; /* phi' P */
    axt_real total = iv->forgetting;
    for (uint32_t i = 0; i < AXT_IV_INPUTS; i++) {
        left[i] = AXT_R(0);
        right[i] = AXT_R(0);
        for (uint32_t j = 0; j < AXT_IV_INPUTS; j++) {
            left[i] = axt_fma(iv->P[i][j], z[j], left[i]);
            right[i] = axt_fma(phi[j], iv->P[j][i], right[i]);
        }
        total = axt_fma(phi[i], left[i], total);
    }
    if (!(axt_abs(total) >= LEAST_TOTAL) || !axt_finite(total)) {
        return reject(iv, AXT_ERROR_RANGE);
    }
    const axt_real per_total = AXT_R(1) / total;
    const axt_real per_forgetting = AXT_R(1) / iv->forgetting;
    for (uint32_t k = 0; k < AXT_IV_OUTPUTS; k++) {
        axt_real innovation = y[k];
        for (uint32_t j = 0; j < AXT_IV_INPUTS; j++) {
            innovation = axt_fma(-phi[j], iv->theta[k][j], innovation);
        }
        for (uint32_t j = 0; j < AXT_IV_INPUTS; j++) {
            iv->theta[k][j] = axt_fma(left[j] * per_total, innovation, iv->theta[k][j]);
        }
    }
    for (uint32_t i = 0; i < AXT_IV_INPUTS; i++) {
        const axt_real gain = left[i] * per_total;
        for (uint32_t j = 0; j < AXT_IV_INPUTS; j++) {
            iv->P[i][j] = axt_fma(-gain, right[j], iv->P[i][j]) * per_forgetting;
        }
    }
    iv->updates += (iv->updates < UINT32_MAX) ? 1U : 0U;
    return AXT_OK;
}
