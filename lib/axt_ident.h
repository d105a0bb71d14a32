/* axt_ident.h - the parameters of a running axis, identified while it runs: regressors
 * (axt_regressor.h), recursive least squares (axt_rls.h), and what their rows say (axt_rows.h),
 * with standard errors and validity.
 */
#ifndef AXT_IDENT_H
#define AXT_IDENT_H

#include "axt_axis.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_regressor.h"
#include "axt_rls.h"
#include "axt_status.h"

/* Bits of axt_estimate.valid; all set: AXT_VALID_ALL. */
enum { AXT_VALID_I1 = 1, AXT_VALID_I2 = 2, AXT_VALID_B = 4, AXT_VALID_K = 8, AXT_VALID_ALL = 15 };

typedef struct {
    axt_axis axis;         /* I1, I2, B, K */
    axt_modal modal;       /* wn, wd, zeta */
    axt_axis axis_error;   /* standard errors of I1, I2, B, K */
    axt_modal modal_error; /* standard errors of wn, wd, zeta */
    uint32_t valid;        /* which of I1, I2, B, K can be relied on; modal values need all */
    uint32_t samples;      /* taken into account so far */
} axt_estimate;

/* Fields are its own business; read it with axt_ident_result(). */
typedef struct {
    axt_regressor regressor;
    axt_rls rls;
    axt_real residual[3]; /* discounted sums of squares: twist, body, twist x body */
    axt_real weight;      /* discounted number of residuals */
    uint32_t samples;     /* learned from since the last reset, saturating */
} axt_ident;

/* AXT_ERROR_RANGE / _NOT_FINITE when the settings make no sense; `ident` is then unchanged. */
axt_status axt_ident_init(axt_ident *ident, const axt_ident_config *config);

/* Forgets what was learned; settings stay. */
void axt_ident_reset(axt_ident *ident);

/* The next sample will not be one time step after the last: nothing is learned across the gap. */
void axt_ident_gap(axt_ident *ident);

/* A sample with measured speeds: the motion and the torque [N m] of the same instant. Cost: one RLS
 * update and about 30 operations. A sample that is refused (not finite, or far beyond what
 * `expected` and `torque` allow) is counted in `rls.rejected`, nothing is learned from it, and the
 * next one starts afresh as after a gap. AXT_ERROR_RANGE when the settings say encoders. */
axt_status axt_ident_motion(axt_ident *ident, const axt_motion *motion, axt_real torque);

/* A sample from encoders alone: counts of motor and table and the torque of the same instant. Cost:
 * one RLS update and about 60 operations. Fails as axt_ident_motion(); AXT_ERROR_RANGE when the
 * settings say speeds. */
axt_status axt_ident_counts(axt_ident *ident, int32_t motor, int32_t table, axt_real torque);

/* The present answer. AXT_ERROR_NO_DATA (with the flags cleared and zeros) before the estimate
 * means anything. Cost: about 100 operations, 10 divisions and square roots: not for the interrupt.
 */
axt_status axt_ident_result(const axt_ident *ident, axt_estimate *estimate);

#endif
