/* axt_els.h - extended least squares: recursive least squares whose noise is a moving average.
 *
 *     y[k] = theta' phi[k] + c e[k-1] + e[k]
 *
 * The residual of the last update joins the regressors in place of the unknown e[k-1] (L. Ljung,
 * System Identification, section 10.4, pseudo-linear regression). For the twist form
 * (axt_regressor.h, 3x2): white noise on measured speeds makes just such a noise in their
 * difference quotient.
 */
#ifndef AXT_ELS_H
#define AXT_ELS_H

#include "axt_real.h"
#include "axt_rls.h"
#include "axt_status.h"

enum { AXT_ELS_INPUTS = 3, AXT_ELS_OUTPUTS = 2 };

/* Each output has a noise, and so a regressor, of its own. */
typedef struct {
    axt_rls rls[AXT_ELS_OUTPUTS]; /* theta[0][0 .. 2] and, fourth, c */
    axt_real residual[AXT_ELS_OUTPUTS];
} axt_els;

/* Settings and failures of axt_rls_init(). */
axt_status axt_els_init(axt_els *els, axt_real forgetting, axt_real prior);

/* One sample: phi[3], y[2], scaled to about 1. Cost: two updates of 4 x 1, 72 multiply-adds and 8
 * divisions. Fails as axt_rls_update(), before anything has changed but the counter. */
axt_status axt_els_update(axt_els *els, const axt_real *phi, const axt_real *y);

#endif
