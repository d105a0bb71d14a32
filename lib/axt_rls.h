/* axt_rls.h - recursive least squares (Eqs. 14-16) for several outputs on the same regressors, with
 * directional forgetting.
 *
 *     e = y - phi' theta                           innovation, one for each output
 *     r = phi' P phi,  g = P phi / (1 + r)
 *     theta <- theta + g e
 *     P^-1  <- P^-1 + b phi phi'                   b = 1: Eq. 16
 *
 * P does not depend on the outputs, so four outputs cost little more than one. It is kept as its
 * factors P = U D U', U unit upper triangular and D diagonal (G. J. Bierman, Factorization Methods
 * for Discrete Sequential Estimation, 1977): D stays positive whatever the rounding, so P stays
 * positive definite. A plain update of P does not: from a large prior, with regressors that are
 * nearly collinear at first, it turns indefinite within a few samples in float and in double.
 *
 * Exponential forgetting divides P by lambda at every step, and at standstill P grows without
 * bound. Directional forgetting (R. Kulhavy, Automatica 23 (1987) 589-600) forgets only along the
 * direction in which the sample brings something new:
 *
 *     b = 1 - l - l / r,   l = n (1 - lambda),     but never below -1
 *
 * In steady excitation r settles at l / (1 - l), where exponential forgetting with the same lambda
 * has it. What no sample renews is not forgotten. And an element of D never grows beyond its start.
 * The price: a parameter that drifts is followed less well than exponential forgetting follows it
 * (docs/estimators.md has the figures).
 */
#ifndef AXT_RLS_H
#define AXT_RLS_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_RLS_INPUTS_MAX = 5, AXT_RLS_OUTPUTS_MAX = 4, AXT_RLS_FACTORS_MAX = 15 };

typedef struct {
    axt_real theta[AXT_RLS_OUTPUTS_MAX][AXT_RLS_INPUTS_MAX]; /* theta[output][input] */
    axt_real
        factor[AXT_RLS_FACTORS_MAX]; /* upper triangle by columns: D on the diagonal, U above */
    axt_real innovation[AXT_RLS_OUTPUTS_MAX]; /* of the last update */
    axt_real certainty;  /* 1 / (1 + phi' P phi) of the last update: innovation x certainty
                            is the residual that is left after it */
    axt_real forgetting; /* lambda */
    axt_real lost;       /* l = inputs (1 - lambda) */
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

/* One sample: phi[inputs], y[outputs], scaled to about 1. Cost for 5 x 4: 104 multiply-adds and 7
 * divisions; for 3 x 2: 38 and 5; for any other shape that of 5 x 4. AXT_ERROR_NOT_FINITE, or
 * AXT_ERROR_RANGE when phi' P phi and the squares of all elements add up to more than 1e18 (1e25 in
 * double): counted in `rejected`, nothing else changes. */
axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y);

/* Element (row, column) of P = U D U'; 0 for indices out of range. */
axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column);

/* Every condition that holds between two calls: settings in range, finite state, D positive and not
 * above its start, and with it P positive definite. For tests, fuzzers and self-checks; about 50
 * operations. */
bool axt_rls_invariants(const axt_rls *rls);

#endif
