/* axt_torque.h - the excitation identified back from the motion it caused (Eq. 18).
 *
 * Eq. 18 for the motor, I1 theta1'' + B q' + K q = T, taken between two samples by the trapezoidal
 * rule, gives the mean torque over the step that has just ended:
 *
 *     (T[k+1] + T[k]) / 2 = I1 (w1[k+1] - w1[k]) / Dt + B mean(q') + K mean(q)
 *
 * exactly for samples of Newmark's method, half a step late for a running axis. What the axis was
 * commanded minus this is the torque that the model does not explain.
 */
#ifndef AXT_TORQUE_H
#define AXT_TORQUE_H

#include "axt_axis.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_status.h"

typedef struct {
    axt_real inertia_rate; /* I1 / Dt */
    axt_real half_damping; /* B / 2 */
    axt_real half_stiffness;
    axt_real twist;
    axt_real twist_speed;
    axt_real speed;
    bool started;
} axt_torque;

/* Fails as axt_axis_check(), or with AXT_ERROR_RANGE when time_step [s] is not within 1e-7 .. 1;
 * `torque` is then unchanged. */
axt_status axt_torque_init(axt_torque *torque, const axt_axis *axis, axt_real time_step);

/* The next sample of the motion; `mean` [N m] becomes the mean torque since the last one.
 * AXT_ERROR_NO_DATA at the first sample, AXT_ERROR_NOT_FINITE for one that is refused: `mean` is
 * then unchanged, and after a refusal the next sample is a first one. Cost: 6 operations. */
axt_status axt_torque_step(axt_torque *torque, const axt_motion *motion, axt_real *mean);

#endif
