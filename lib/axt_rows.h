/* axt_rows.h - from the rows that a regression finds to the parameters of the axis. */
#ifndef AXT_ROWS_H
#define AXT_ROWS_H

#include "axt_axis.h"
#include "axt_real.h"
#include "axt_status.h"

/* What a regression in twist q and rigid-body angle r = theta1 - share q finds: the entries of q,
 * q' and T in q'' and in r'' [1/s2, 1/s, 1/(kg m2)]. */
typedef struct {
    axt_real twist[3];
    axt_real body[3];
} axt_rows;

/* The axis with these rows. Motor and table accelerations are sums of the rows, theta1'' = r'' +
 * share q'' and theta2'' = theta1'' - q'', so any share will do that was used in the regression:
 * I1 = 1 / (T in q''), K = - I1 (q in theta1''), I2 = K / (q in theta2''), and B from q' in q''.
 * AXT_ERROR_NO_DATA when that is no axis (out of the ranges of axt_axis.h); `axis` is then
 * unchanged. Cost: 4 divisions. */
axt_status axt_axis_from_rows(const axt_rows *rows, axt_real share, axt_axis *axis);

/* Which equation rows of held torque belong to: of positions and speeds, or of positions alone. */
typedef enum { AXT_ROWS_OF_SPEEDS, AXT_ROWS_OF_POSITIONS } axt_rows_kind;

/* Under torque that is held over each time step [s], the entries that a regression on quotients and
 * means finds are not those of Eq. 8. With N = (2 / Dt) tanh(A Dt / 2) = a 1 + b A, A = [[0, 1],
 * [-k, -d]], the row of q'' reads
 *
 *     of speeds     [-b k,   a - b d,  b / I1]
 *     of positions  [-det N, trace N, det N / (k I1)]
 *
 * Turns them into the rows of Eq. 8, and `factor` into what each of the three columns was
 * multiplied with. That depends on k and d themselves, but little: found by fixed point in at most
 * 60 exact maps (axt_integrator.h), not for the interrupt. AXT_ERROR_NO_DATA when there is no such
 * axis, or when it is damped beyond critical and the step so long that the rows hardly tell;
 * nothing is then changed. */
axt_status axt_rows_from_held(axt_rows *rows, axt_rows_kind kind, axt_real time_step,
                              axt_real factor[3]);

#endif
