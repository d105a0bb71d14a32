/* axt_regressor.h - from samples of a running axis to the regressors of its equation of motion.
 *
 * Newmark's method with (1/4, 1/2) is the trapezoidal rule, so between two of its samples
 *
 *     (X[k+1] - X[k]) / Dt = A (X[k+1] + X[k]) / 2 + C (T[k+1] + T[k]) / 2
 *
 * holds exactly: regressing the difference quotient on the means gives the matrices of Eq. 8
 * without bias (the paper's Eq. 9, forward Euler, does not). The state is taken in the twist q and
 * the rigid-body angle r = theta1 - I2 / (I1 + I2) q of the expected axis, where float32 suffices:
 *
 *     5x4:  d/dt [q, r, q', r'] on [q, r, q', r', T]: the whole of Eq. 8. Its surplus entries
 *           are zero for the ideal axis, and say what is not ideal when they are not.
 *     3x2:  d/dt [q', r'] on [q, q', T]: just what the four parameters need.
 *
 * The regression is linear, so motor and table accelerations are sums of its rows, and the
 * parameters do not depend on the inertias that were expected.
 *
 * Torque that a drive holds from one sample to the next is not what the trapezoidal rule takes. The
 * state then moves by F = exp(A Dt), and the same quotients and means obey an equation with other
 * entries and the torque T[k] in place of its mean; axt_rows.h has the way back from these entries.
 *
 * Both forms take either motion with measured speeds, or encoder counts alone. Counts and torque
 * then pass through the same state-variable filter (axt_filter.h), and rate, acceleration and jerk
 * of what comes out take the place of value, rate and acceleration: an unknown zero of either
 * encoder and a constant load drop out. Under held torque the means pass the filter, and the rate
 * of the torque's rate is one regressor more (4x2).
 *
 * A twist that moves by less than two counts shows the encoders and not the axis, and yields no
 * equation: at standstill nothing is learned from their flicker.
 */
#ifndef AXT_REGRESSOR_H
#define AXT_REGRESSOR_H

#include "axt_axis.h"
#include "axt_filter.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_rows.h"
#include "axt_status.h"

enum { AXT_REGRESSOR_INPUTS_MAX = 5, AXT_REGRESSOR_OUTPUTS_MAX = 4 };

typedef enum { AXT_IDENT_3X2 = 0, AXT_IDENT_5X4 = 1 } axt_ident_form;

/* How the torque goes on from one sample to the next. */
typedef enum {
    AXT_HOLD_LINEAR = 0, /* to the next one in a straight line, as Newmark's method takes it */
    AXT_HOLD_ZERO = 1    /* not at all until the next one, as a drive has it */
} axt_hold;

typedef struct {
    axt_ident_form form;
    axt_hold hold;
    axt_real time_step;  /* between samples [s] */
    axt_real forgetting; /* lambda of the estimator, 0.9 .. 1; 1: nothing is forgotten */
    axt_axis expected; /* the axis as far as it is known: within a factor of 10 is enough. Sets the
                          scaling (powers of two) and the filter, never the answer */
    axt_real torque;   /* size of the torque to come [N m], within a factor of 10 */
    uint32_t counts_per_turn[2]; /* encoders at motor and table; 0: samples come with speeds */
} axt_ident_config;

/* One equation for an estimator: y = theta phi, scaled to about 1. */
typedef struct {
    axt_real phi[AXT_REGRESSOR_INPUTS_MAX];
    axt_real y[AXT_REGRESSOR_OUTPUTS_MAX];
} axt_equation;

/* Fields are its own business. */
typedef struct {
    axt_ident_config config;
    axt_filter filter;
    axt_filter_state channel[3];                      /* twist, body, torque */
    axt_real scale[AXT_REGRESSOR_INPUTS_MAX];         /* regressor = scale x value; powers of two */
    axt_real output_scale[AXT_REGRESSOR_OUTPUTS_MAX]; /* likewise for the outputs */
    axt_real last[AXT_REGRESSOR_INPUTS_MAX];          /* q, r, q', r', T of the last sample */
    /* encoders: scaled twist and body angle a count, torque a N m, and what counts as standstill */
    axt_real count_unit[2];
    axt_real body_unit;
    axt_real body_share;
    axt_real torque_unit;
    axt_real torque_max; /* no larger one is taken [N m] */
    axt_real idle;
    axt_real motor_share; /* I2 / (I1 + I2) of the expected axis: r = theta1 - motor_share q */
    int32_t zero[2];      /* counts of both encoders, or turns, from which angles are reckoned */
    uint32_t settling;    /* samples until the filter has forgotten its start */
    uint32_t wait;        /* samples until there is an equation */
    bool started;
} axt_regressor;

/* AXT_ERROR_RANGE / _NOT_FINITE when the settings make no sense, or ask for 5x4 from encoders under
 * held torque, which would take six regressors; `regressor` is then unchanged. */
axt_status axt_regressor_init(axt_regressor *regressor, const axt_ident_config *config);

/* The next sample will not be one time step after the last: no equation spans the gap. */
void axt_regressor_gap(axt_regressor *regressor);

/* A sample with measured speeds: the motion and the torque [N m] of the same instant. AXT_OK:
 * `equation` is the one between this sample and the last. AXT_ERROR_NO_DATA: taken, but there is no
 * equation yet. AXT_ERROR_NOT_FINITE: refused, and nothing has changed. AXT_ERROR_RANGE when the
 * settings say encoders. Cost: about 40 operations. */
axt_status axt_regressor_motion(axt_regressor *regressor, const axt_motion *motion, axt_real torque,
                                axt_equation *equation);

/* A sample from encoders alone: counts of motor and table and the torque [N m] of the same instant.
 * Answers as axt_regressor_motion(); AXT_ERROR_RANGE also for a torque a thousand times larger than
 * expected. Cost: about 60 operations. */
axt_status axt_regressor_counts(axt_regressor *regressor, int32_t motor, int32_t table,
                                axt_real torque, axt_equation *equation);

/* The shape of the equations. */
uint32_t axt_regressor_inputs(const axt_regressor *regressor);
uint32_t axt_regressor_outputs(const axt_regressor *regressor);

/* Places of q, q' and T among the regressors, and of q'' among the outputs (r'' is next). */
const uint32_t *axt_regressor_columns(const axt_regressor *regressor);
uint32_t axt_regressor_row(const axt_regressor *regressor);

/* What 1 of the scaled entry (output, input) of theta means: the entry in physical units. The
 * output is 0, 1 for q'', r''; the input one of the form's five or three. */
axt_real axt_regressor_unit(const axt_regressor *regressor, uint32_t output, uint32_t input);

#endif
