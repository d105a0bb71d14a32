/* axt_rls.h - recursive least squares (Eqs. 14-16) with exponential forgetting, for several outputs
 * on the same regressors.
 *
 *     e = y - phi' theta                           innovation, one for each output
 *     g = P phi / (lambda + phi' P phi)
 *     theta <- theta + g e,   P <- (P - g phi' P) / lambda
 *
 * P does not depend on the outputs, so four outputs cost little more than one. It is kept as its
 * factors P = U D U', U unit upper triangular and D diagonal (G. J. Bierman, Factorization Methods
 * for Discrete Sequential Estimation, 1977): D stays positive whatever the rounding, so P stays
 * positive definite. A plain update of P does not: from a large prior, with regressors that are
 * nearly collinear at first, it turns indefinite within a few samples in float and in double.
 *
 * An element of D never grows beyond its start. Without excitation, forgetting then ends at
 * "nothing is known", and not at infinity.
 */
#ifndef AXT_RLS_H
#define AXT_RLS_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_RLS_INPUTS_MAX = 5, AXT_RLS_OUTPUTS_MAX = 4, AXT_RLS_FACTORS_MAX = 15 };

/* Largest magnitude of a regressor or output that an update accepts; they are to be scaled to 1. */
#define AXT_RLS_SAMPLE_MAX 1e6

typedef struct {
    axt_real theta[AXT_RLS_OUTPUTS_MAX][AXT_RLS_INPUTS_MAX]; /* theta[output][input] */
    axt_real
        factor[AXT_RLS_FACTORS_MAX]; /* upper triangle by rows: D on the diagonal, U above it */
    axt_real innovation[AXT_RLS_OUTPUTS_MAX]; /* of the last update */
    axt_real certainty; /* lambda / (lambda + phi' P phi) of the last update: innovation x certainty
                           is the residual that is left after it */
    axt_real forgetting; /* lambda */
    axt_real prior;      /* D at the start: P starts as prior x I */
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

/* One sample: phi[inputs], y[outputs], scaled to about 1. Cost for 5 x 4: 94 multiply-adds and 5
 * divisions; for 3 x 2: 38 and 3. AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE (an element beyond
 * AXT_RLS_SAMPLE_MAX, or factors so far apart that the update would not be finite): counted in
 * `rejected`, nothing else changes. */
axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y);

/* Element (row, column) of P = U D U'; 0 for indices out of range. */
axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column);

/* Every condition that holds between two calls: finite state, positive diagonal, |Pij|^2 <= Pii
 * Pjj, settings in range. For tests, fuzzers and self-checks; about 100 operations. */
bool axt_rls_invariants(const axt_rls *rls);

#endif
