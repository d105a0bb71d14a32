/* axt_iv.h - recursive instrumental variables: least squares that noise on the regressors does not
 * bias, as long as the instruments are free of that noise.
 *
 *     e = y - phi' theta,   g = P z / (lambda + phi' P z)
 *     theta <- theta + g e, P <- (P - g phi' P) / lambda
 *
 * z are the instruments: like the regressors, without their noise, for instance the regressors one
 * period of a periodic excitation earlier (L. Ljung, System Identification, section 11.5). P is not
 * symmetric and nothing keeps it definite: for trials, not for years of running.
 */
#ifndef AXT_IV_H
#define AXT_IV_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_IV_INPUTS = 3, AXT_IV_OUTPUTS = 2 };

typedef struct {
    axt_real theta[AXT_IV_OUTPUTS][AXT_IV_INPUTS];
    axt_real P[AXT_IV_INPUTS][AXT_IV_INPUTS];
    axt_real forgetting;
    uint32_t updates;  /* samples taken, saturating */
    uint32_t rejected; /* samples refused, saturating */
} axt_iv;

/* forgetting 0.9 .. 1; P starts as prior x I, 1 .. 1e15. AXT_ERROR_RANGE leaves `iv` unchanged. */
axt_status axt_iv_init(axt_iv *iv, axt_real forgetting, axt_real prior);

/* One sample: regressors phi[3], instruments z[3], outputs y[2], scaled to about 1. Cost: 42
 * multiply-adds and 2 divisions. AXT_ERROR_NOT_FINITE, or AXT_ERROR_RANGE for an element beyond 1e6
 * or when lambda + phi' P z is too small to divide by: counted in `rejected`, nothing else changes.
 */
axt_status axt_iv_update(axt_iv *iv, const axt_real *phi, const axt_real *z, const axt_real *y);

#endif
