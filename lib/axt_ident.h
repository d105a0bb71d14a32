/* axt_ident.h - from samples of a running axis to its parameters, while it runs.
 *
 * Newmark's method with (1/4, 1/2) is the trapezoidal rule, so between two of its samples
 *
 *     (X[k+1] - X[k]) / Dt = A (X[k+1] + X[k]) / 2 + C (T[k+1] + T[k]) / 2
 *
 * holds exactly: regressing the difference quotient on the means gives the matrices of Eq. 8
 * without bias (the paper's Eq. 9, forward Euler, does not). The state is taken in the twist q and
 * the rigid-body angle r = theta1 - I2 / (I1 + I2) q of the expected axis, where float32 suffices:
 *
 *     5x4:  d/dt [q, r, q', r'] on [q, r, q', r', T]: the whole of Eq. 8. Its surplus entries are
 * zero for the ideal axis and say what is not ideal when they are not. 3x2:  d/dt [q', r'] on [q,
 * q', T]: just what the four parameters need.
 *
 * The regression is linear, so motor and table accelerations are sums of its rows, and the
 * parameters do not depend on the inertias that were expected.
 *
 * Both forms take either motion with measured speeds, or encoder counts alone. Counts and torque
 * then pass through the same state-variable filter (axt_filter.h), and rate, acceleration and jerk
 * of what comes out take the place of value, rate and acceleration: an unknown zero of either
 * encoder and a constant load drop out.
 */
#ifndef AXT_IDENT_H
#define AXT_IDENT_H

#include "axt_axis.h"
#include "axt_filter.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_rls.h"
#include "axt_status.h"

typedef enum { AXT_IDENT_3X2 = 0, AXT_IDENT_5X4 = 1 } axt_ident_form;

typedef struct {
    axt_ident_form form;
    axt_real time_step;  /* between samples [s] */
    axt_real forgetting; /* lambda, 0.9 .. 1; 1 - 1/n remembers about n samples */
    axt_axis expected; /* the axis as far as it is known: within a factor of 100 is enough. Sets the
                          scaling (powers of two) and the filter, never the answer */
    axt_real torque;   /* size of the torque to come [N m], within a factor of 100 */
    uint32_t counts_per_turn[2]; /* encoders at motor and table; 0: samples come with speeds */
} axt_ident_config;

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
    axt_ident_config config;
    axt_rls rls;
    axt_filter filter;
    axt_filter_state twist_filter;
    axt_filter_state body_filter;
    axt_filter_state torque_filter;
    axt_real scale[AXT_RLS_INPUTS_MAX];         /* regressor = scale x value; powers of two */
    axt_real output_scale[AXT_RLS_OUTPUTS_MAX]; /* likewise for the outputs */
    axt_real last[AXT_RLS_INPUTS_MAX];          /* q, r, q', r', T of the last sample */
    axt_real residual[3]; /* discounted sums of squares: twist, body, twist x body */
    axt_real weight;      /* discounted number of residuals */
    axt_real motor_share; /* I2 / (I1 + I2) of the expected axis: r = theta1 - motor_share q */
    int32_t zero[2];      /* counts of both encoders, or turns, from which angles are reckoned */
    uint32_t seen;        /* samples since the start or the last gap, saturating */
    uint32_t settling;    /* samples until the filter has forgotten its start */
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
