/* axt_filter.h - position-only state-variable filter: a signal, its rate and its acceleration, all
 * seen through the same low-pass filter
 *
 *     F(s) = w^3 / ((s + w) (s^2 + w s + w^2))          (Butterworth, third order)
 *
 * discretised by the trapezoidal rule. When every channel of a linear system passes through the
 * same F, its equation of motion holds between the filtered channels exactly as between the raw
 * ones, so it can be identified from positions and torque alone. The trapezoidal rule is Newmark's
 * (1/4, 1/2), so for samples of axt_plant this holds without any discretisation error.
 */
#ifndef AXT_FILTER_H
#define AXT_FILTER_H

#include "axt_real.h"
#include "axt_status.h"

/* What all channels share. */
typedef struct {
    axt_real w;            /* corner [rad/s] */
    axt_real half_dt;      /* Dt / 2 [s] */
    axt_real pull;         /* jerk for 1 of input - value, */
    axt_real drag;         /* of rate, */
    axt_real deceleration; /* and of acceleration: see axt_filter.c */
} axt_filter;

/* One signal's memory: what its three integrators start the next step from. */
typedef struct {
    axt_real value;        /* [unit] */
    axt_real rate;         /* [unit/s] */
    axt_real acceleration; /* [unit/s2] */
} axt_filter_state;

/* What comes out. */
typedef struct {
    axt_real value;        /* [unit] */
    axt_real rate;         /* [unit/s] */
    axt_real acceleration; /* [unit/s2] */
    axt_real jerk;         /* [unit/s3] */
} axt_filtered;

/* `corner` [rad/s] > 0 with corner x time_step <= 3 (below the Nyquist frequency), time_step [s] >
 * 0. AXT_ERROR_RANGE leaves the filter unchanged. */
axt_status axt_filter_init(axt_filter *filter, axt_real corner, axt_real time_step);

/* Starts a channel as if `value` had stood there for ever. */
void axt_filter_start(axt_filter_state *state, axt_real value);

/* One sample. Cost: 9 multiply-adds and a subtraction. The caller keeps the input finite. */
axt_filtered axt_filter_step(const axt_filter *filter, axt_filter_state *state, axt_real input);

/* Moves the channel's zero by `shift`, as if every sample so far had been that much larger. */
void axt_filter_shift(axt_filter_state *state, axt_real shift);

#endif
