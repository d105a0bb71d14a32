/* axt_rls.h - recursive least squares (Eqs. 14-16) with exponential forgetting, for several outputs
 * on the same regressors.
 *
 *     e = y - phi' theta                           innovation, one for each output
 *     g = P phi / (lambda + phi' P phi)
 *     theta <- theta + g e,   P <- (P - g phi' P) / lambda
 *
 * P does not depend on the outputs, so four outputs cost little more than one. P is symmetric and
 * only its upper triangle is stored and updated: it cannot lose its symmetry. Forgetting pauses
 * while an element of P's diagonal is as large as at the start: without excitation P does not grow
 * beyond what it was when nothing was known.
 */
#ifndef AXT_RLS_H
#define AXT_RLS_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_RLS_INPUTS_MAX = 5, AXT_RLS_OUTPUTS_MAX = 4, AXT_RLS_COVARIANCE_MAX = 15 };

/* Largest magnitude of a regressor or output that an update accepts; they are to be scaled to 1. */
#define AXT_RLS_SAMPLE_MAX 1e6

typedef struct {
    axt_real theta[AXT_RLS_OUTPUTS_MAX][AXT_RLS_INPUTS_MAX]; /* theta[output][input] */
    axt_real P[AXT_RLS_COVARIANCE_MAX];       /* upper triangle by rows: P00 P01 .. P11 P12 .. */
    axt_real innovation[AXT_RLS_OUTPUTS_MAX]; /* of the last update */
    axt_real certainty; /* lambda / (lambda + phi' P phi) of the last update: innovation x certainty
                           is the residual that is left after it */
    axt_real forgetting; /* lambda */
    axt_real prior;      /* the diagonal of P at the start */
    uint32_t inputs;
    uint32_t outputs;
    uint32_t updates;  /* samples taken since the last reset, saturating */
    uint32_t rejected; /* samples refused since initialisation, saturating */
} axt_rls;

/* inputs 1 .. 5, outputs 1 .. 4; forgetting 0.9 .. 1 (1: none); prior 1 .. 1e15, P starts as
 * prior x I. AXT_ERROR_RANGE leaves `rls` unchanged. */
axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs, axt_real forgetting,
                        axt_real prior);

/* Forgets everything but the settings and the counter of refused samples. */
void axt_rls_reset(axt_rls *rls);

/* One sample: phi[inputs], y[outputs], scaled to about 1. Cost for 5 x 4: 90 multiply-adds and one
 * division; for 3 x 2: 33 and one. AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE (an element beyond
 * AXT_RLS_SAMPLE_MAX, or P so ill-conditioned that the update would not be finite): counted in
 * `rejected`, nothing else changes. */
axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y);

/* Element (row, column) of P; 0 for indices out of range. */
axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column);

/* Every condition that holds between two calls: finite state, positive diagonal, |Pij|^2 <= Pii
 * Pjj, settings in range. For tests, fuzzers and self-checks; about 100 operations. */
bool axt_rls_invariants(const axt_rls *rls);

#endif
