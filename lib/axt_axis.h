/* axt_axis.h - the axis of Eq. 3: motor and table inertia joined by a shaft.
 *
 *     I1 theta1'' + B (theta1' - theta2') + K (theta1 - theta2) = T
 *     I2 theta2'' - B (theta1' - theta2') - K (theta1 - theta2) = 0
 *
 * A linear axis reads kg, N s/m, N/m, N and m for kg m2, N m s/rad, N m/rad, N m and rad.
 */
#ifndef AXT_AXIS_H
#define AXT_AXIS_H

#include "axt_real.h"
#include "axt_status.h"

/* Parameters of the axis. */
typedef struct {
    axt_real I1; /* motor inertia [kg m2], 1e-9 .. 1e6 */
    axt_real I2; /* table inertia seen at the motor [kg m2], 1e-9 .. 1e6 */
    axt_real B;  /* shaft damping [N m s/rad], 0 .. 1e9 */
    axt_real K;  /* shaft stiffness [N m/rad], 1e-6 .. 1e12 */
} axt_axis;

/* The vibration of the shaft: the one conjugate pair of eigenvalues -zeta wn +- j wd of Eq. 8. */
typedef struct {
    axt_real wn;   /* undamped natural frequency [rad/s] */
    axt_real wd;   /* damped frequency wn sqrt(1 - zeta^2) [rad/s]; 0 when zeta >= 1 */
    axt_real zeta; /* damping ratio [1] */
} axt_modal;

/* The axis of the paper's Table 1, and its lead: 5 mm of table travel a turn, in m/rad. */
extern const axt_axis axt_axis_paper;
extern const axt_real axt_lead_paper;

/* AXT_OK when every parameter lies in its range, AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE otherwise.
 */
axt_status axt_axis_check(const axt_axis *axis);

/* wn = sqrt(K (1/I1 + 1/I2)), zeta = B wn / (2 K). Cost: 2 square roots, 4 divisions.
 * Fails as axt_axis_check(); `modal` is then unchanged. */
axt_status axt_axis_modal(const axt_axis *axis, axt_modal *modal);

/* The way back: the axis with inertias I1, I2 [kg m2] whose shaft vibrates at wn [rad/s] with
 * damping ratio zeta [1]; wd is not read. Fails when the axis found is out of range; `axis` is then
 * unchanged. */
axt_status axt_axis_from_modal(axt_real I1, axt_real I2, const axt_modal *modal, axt_axis *axis);

/* The paper's criterion for the time step: Dt = 2 pi k / (N wn) [s], so that wn is line k of a
 * period of N samples. Returns 0 when wn is not positive and finite, or k or N is 0. */
axt_real axt_time_step(uint32_t N, uint32_t k, axt_real wn);

/* Table travel x = l q [m] for lead l [m/rad] and angle q [rad]. */
axt_real axt_lead_to_travel(axt_real lead, axt_real angle);

#endif
