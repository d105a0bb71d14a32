/* axt_rls.h - recursive least squares (Eqs. 14-16) for several outputs on the same regressors, with
 * directional forgetting.
 *
 *     e = y - phi' theta                           innovation, one for each output
 *     r = phi' P phi,  g = P phi / (1 + r)
 *     theta <- theta + g e
 *     P^-1  <- P^-1 + phi phi'                     Eq. 16
 *
 * P does not depend on the outputs, so four outputs cost little more than one. It is kept as its
 * factors P = U D U', U unit upper triangular and D diagonal (G. J. Bierman, Factorization Methods
 * for Discrete Sequential Estimation, 1977): every element of D is multiplied by a positive number,
 * so P stays positive definite whatever the rounding. A plain update of P does not: from a large
 * prior, with regressors that are nearly collinear at first, it turns indefinite within a few
 * samples in float and in double.
 *
 * Exponential forgetting divides P by lambda at every step, in all directions, and at standstill P
 * grows without bound. Here each direction of the factors (a column of U) is forgotten for itself,
 * and only as far as samples renew it. With f = U' phi a sample renews direction j by s = D f^2,
 * and r is the sum of these. To each element of D, after Eq. 16, is added
 *
 *     D min(16 s, (1 - lambda) (1 - D / prior))        D before the sample
 *
 * A direction that is excited is forgotten as exponential forgetting would; one that is not keeps
 * what is known of it. What a sample wears away is at most 15 times what it brings, so the noise of
 * an axis at rest takes a very long time to do harm. And D never grows beyond its start.
 */
#ifndef AXT_RLS_H
#define AXT_RLS_H

#include "axt_real.h"
#include "axt_status.h"

enum { AXT_RLS_INPUTS_MAX = 5, AXT_RLS_OUTPUTS_MAX = 4, AXT_RLS_FACTORS_MAX = 15 };

typedef struct {
    axt_real theta[AXT_RLS_OUTPUTS_MAX][AXT_RLS_INPUTS_MAX]; /* theta[output][input] */
    axt_real factor[AXT_RLS_FACTORS_MAX];     /* triangle by columns: D on the diagonal, U above */
    axt_real innovation[AXT_RLS_OUTPUTS_MAX]; /* of the last update */
    axt_real certainty;   /* 1 / (1 + phi' P phi) of the last update: innovation x certainty is
                             the residual that is left after it */
    axt_real forgetting;  /* lambda */
    axt_real prior;       /* D at the start: P starts as prior x I */
    axt_real growth_max;  /* of D in a step, over 16; */
    axt_real growth_fade; /* less this for 1 of D */
    uint32_t rejected;    /* samples refused since initialisation; both counters saturate */
    uint32_t restarts;    /* samples after which P started again from its prior */
    uint8_t inputs;
    uint8_t outputs;
    uint8_t shape; /* which of the unrolled updates fits */
} axt_rls;

/* inputs 1 .. 5, outputs 1 .. 4; forgetting 0.9 .. 1 (1: none); prior 1 .. 1e15, P starts as
 * prior x I. AXT_ERROR_RANGE leaves `rls` unchanged. */
axt_status axt_rls_init(axt_rls *rls, uint32_t inputs, uint32_t outputs, axt_real forgetting,
                        axt_real prior);

/* Forgets everything but the settings and the counters. */
void axt_rls_reset(axt_rls *rls);

/* One sample: phi[inputs], y[outputs], scaled to about 1. Cost for 5 x 4: 99 multiply-adds, 38
 * other operations and 5 divisions; for 3 x 2: 36, 22 and 3; for any other shape that of 5 x 4. No
 * branch depends on the data. AXT_ERROR_NOT_FINITE, or AXT_ERROR_RANGE when the squares of all
 * elements add up to more than 1e18 (1e24 in double): counted in `rejected`, nothing else changes.
 * AXT_ERROR_RANGE also when phi' P phi is larger than that, which scaled samples never are: P
 * starts again from its prior, theta stays, `restarts` counts. */
axt_status axt_rls_update(axt_rls *rls, const axt_real *phi, const axt_real *y);

/* Element (row, column) of P = U D U'; 0 for indices out of range. */
axt_real axt_rls_covariance(const axt_rls *rls, uint32_t row, uint32_t column);

/* Element (input, input) of P^-1: how much is known in the direction of one input, the others left
 * as they are. 0 for an index out of range. Cost: up to 15 operations and 5 divisions. */
axt_real axt_rls_information(const axt_rls *rls, uint32_t input);

/* Every condition that holds between two calls: settings in range, finite state, D positive and not
 * above its start, and with it P positive definite. For tests, fuzzers and self-checks; about 50
 * operations. */
bool axt_rls_invariants(const axt_rls *rls);

#endif
