#include "axt_els.h"

#include "axt_math.h"

axt_status axt_els_init(axt_els *els, axt_real forgetting, axt_real prior) {
    axt_els fresh = {.residual = {AXT_R(0)}};
    for (uint32_t k = 0; k < AXT_ELS_OUTPUTS; k++) {
        const axt_status status =
            axt_rls_init(&fresh.rls[k], AXT_ELS_INPUTS + 1, 1, forgetting, prior);
        if (status != AXT_OK) {
            return status;
        }
    }
    *els = fresh;
    return AXT_OK;
}

axt_status axt_els_update(axt_els *els, const axt_real *phi, const axt_real *y) {
    axt_els next = *els;
    for (uint32_t k = 0; k < AXT_ELS_OUTPUTS; k++) {
        axt_rls *rls = &next.rls[k];
        const axt_real extended[AXT_ELS_INPUTS + 1] = {phi[0], phi[1], phi[2], els->residual[k]};
        const axt_status status = axt_rls_update(rls, extended, &y[k]);
        if (status != AXT_OK) {
            els->rls[k].rejected = rls->rejected;
            return status;
        }
        next.residual[k] = rls->innovation[0] * rls->certainty;
    }
    *els = next;
    return AXT_OK;
}
