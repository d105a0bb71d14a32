/* axt_integrator.h - other ways to integrate the axis of Eq. 3, to compare with Newmark's.
 *
 * Each method steps the same two equations as axt_plant.h, x'' + d x' + k x = f for twist and rigid
 * body, from samples of the torque, all but one taking it as linear between samples:
 *
 *     Newmark        Eqs. 4-6 with 1/4, 1/2
 *     Houbolt        backward differences of three past positions (its first two steps: Newmark)
 *     Wilson-theta   acceleration linear over 1.4 Dt
 *     Runge-Kutta    the classical method of fourth order; explicit, stable for wn Dt < 2.8
 *     exact          the matrix exponential, torque linear between samples
 *     exact, held    the matrix exponential, torque held from each sample to the next, as a
 *                    drive does: a new sample acts from the end of the step on
 *
 * The formulas are those of K.-J. Bathe, Finite Element Procedures, chapter 9. The plant to emulate
 * an axis with is axt_plant.h: here the rigid-body angle is one plain number.
 */
#ifndef AXT_INTEGRATOR_H
#define AXT_INTEGRATOR_H

#include "axt_axis.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_status.h"

typedef enum {
    AXT_METHOD_NEWMARK = 0,
    AXT_METHOD_HOUBOLT = 1,
    AXT_METHOD_WILSON = 2,
    AXT_METHOD_RUNGE_KUTTA = 3,
    AXT_METHOD_EXACT = 4,
    AXT_METHOD_EXACT_HELD = 5
} axt_method;

/* The exact step of x'' + d x' + k x = f: position and speed change by rows of
 * a [position, speed] + held f[n] + ramp (f[n+1] - f[n]). The matrix exponential is 1 + a: of a
 * short step the 1 would swallow the digits that make the damping. */
typedef struct {
    axt_real a[2][2];
    axt_real held[2];
    axt_real ramp[2];
} axt_exact_map;

/* x'' + d x' + k x = f, f = torque / inertia, and where it is. */
typedef struct {
    axt_real damping;     /* d [1/s] */
    axt_real stiffness;   /* k [1/s2] */
    axt_real per_inertia; /* [1/(kg m2)] */
    axt_exact_map map;
    axt_real position;     /* [rad] */
    axt_real speed;        /* [rad/s] */
    axt_real acceleration; /* [rad/s2] */
    axt_real before[2];    /* positions one and two steps ago (Houbolt) */
} axt_oscillator;

typedef struct {
    axt_method method;
    axt_real time_step;
    axt_real motor_share;
    axt_real torque_max; /* takes a resting axis to half a turn a step [N m] */
    axt_oscillator twist;
    axt_oscillator body;
    axt_real torque;
    uint32_t steps; /* taken since the start, saturating */
} axt_integrator;

/* The axis at rest at angle 0 under torque 0. Fails as axt_plant_init(), which sets the limits, and
 * with AXT_ERROR_RANGE where Runge-Kutta is unstable; `integrator` is then unchanged. Cost: two 4 x
 * 4 matrix exponentials. */
axt_status axt_integrator_init(axt_integrator *integrator, axt_method method, const axt_axis *axis,
                               axt_real time_step);

/* Starts from `motion` with `torque` [N m] acting; turns are not kept. Fails as axt_plant_set(),
 * and everything is then as it was. */
axt_status axt_integrator_set(axt_integrator *integrator, const axt_motion *motion,
                              axt_real torque);

/* One step; `torque` [N m] is the torque at its end. Cost: 20 to 70 operations.
 * AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE as axt_plant_step(): nothing moves. The speed of the
 * rigid body does not saturate. */
axt_status axt_integrator_step(axt_integrator *integrator, axt_real torque);

/* The present motion; turns is 0 and the whole angle is in `fraction`. */
void axt_integrator_read(const axt_integrator *integrator, axt_motion *motion);

/* The exact step of x'' + damping x' + stiffness x = f over time_step, damping and stiffness as
 * they come (any sign of the discriminant; both 0 is the rigid body). AXT_ERROR_RANGE when they are
 * negative or the step is so long that its exponential would not be accurate (stiffness Dt^2 or
 * damping Dt above 1e6). */
axt_status axt_exact_map_init(axt_exact_map *map, axt_real damping, axt_real stiffness,
                              axt_real time_step);

#endif
