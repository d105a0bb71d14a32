/* axt_rls.h - recursive least squares (Eqs. 14-16) with exponential forgetting, for several outputs
 * on the same regressors.
 *
 *     e = y - phi' theta            innovation, one for each output
 *     g = P phi / (lambda + phi' P phi)
 *     theta <- theta + g e,   P <- (P - g phi' P) / lambda
 *
 * P does not depend on the outputs, so four outputs cost little more than one. P is symmetric and
 * only its upper triangle is stored and updated: it cannot lose its symmetry.
 */
#ifndef AXT_RLS_H
#define AXT_RLS_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_RLS_INPUTS_MAX = 5, AXT_RLS_OUTPUTS_MAX = 4, AXT_RLS_COVARIANCE_MAX = 15 };

typedef struct {
    axt_real theta[AXT_RLS_OUTPUTS_MAX][AXT_RLS_INPUTS_MAX]; /* theta[output][input] */
    axt_real P[AXT_RLS_COVARIANCE_MAX];     /* upper triangle by rows: P00 P01 .. P11 P12 .. */
    axt_real residual[AXT_RLS_OUTPUTS_MAX]; /* discounted sum of squared residuals */
    axt_real weight;                        /* discounted number of updates */
    axt_real forgetting;                    /* lambda */
    axt_real prior;                         /* P0, the diagonal of P at the start */
    uint32_t inputs;
    uint32_t outputs;
    uint32_t updates;  /* samples taken, saturating */
    uint32_t rejected; /* samples refused because they were not finite, saturating */
} axt_rls;

/* inputs 1 .. 5, outputs 1 .. 4; forgetting 0.9 .. 1 (1: none); prior > 0, P starts as prior x I.
 * AXT_ERROR_RANGE leaves `rls` unchanged. */
axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs, axt_real forgetting,
                        axt_real prior);

/* Forgets everything but the settings and the counters. */
void axt_rls_reset(axt_rls *rls);

/* One sample: phi[inputs], y[outputs], scaled to about 1. Cost for 5 x 4: 90 multiply-adds and one
 * division; for 3 x 2: 33 and one. AXT_ERROR_NOT_FINITE when the sample, or what it would make of
 * the state, is not finite: counted in `rejected`, nothing else changes. */
axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y);

/* Element (row, column) of P; 0 for indices out of range. */
axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column);

/* Every condition that holds between two calls: finite state, positive diagonal, |Pij|^2 <= Pii
 * Pjj, settings in range. For tests, fuzzers and self-checks; about 100 operations. */
bool axt_rls_invariants(const axt_rls *rls);

#endif
