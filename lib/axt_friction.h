/* axt_friction.h - friction at one point of the axis that truly sticks.
 *
 *     torque = -(coulomb + stribeck exp(-(w / stribeck_speed)^2)) sign(w) - viscous w
 *
 * At speed zero the dry part is whatever holds the inertia, up to its limit. That is no function of
 * the speed, so it is not evaluated but solved for, step by step (Moreau's time-stepping), and no
 * constant smooths sign(w).
 */
#ifndef AXT_FRICTION_H
#define AXT_FRICTION_H

#include "axt_real.h"

/* All zero: none. */
typedef struct {
    axt_real coulomb;        /* [N m], 0 .. 1e6 */
    axt_real viscous;        /* [N m s/rad], 0 .. 1e6 */
    axt_real stribeck;       /* break-away torque above Coulomb's [N m], 0 .. 1e6 */
    axt_real stribeck_speed; /* [rad/s], 1e-6 .. 1e6 when there is any */
    axt_real drift;          /* of all three [1/s], -1e3 .. 1e3: (1 + drift t) times, at least 0 */
} axt_friction;

/* The limit of dry friction [N m] at a speed [rad/s], without drift. Cost: 4 operations, and an
 * exponential and a division for Stribeck's part. */
axt_real axt_friction_limit(const axt_friction *friction, axt_real speed);

/* How dry friction ends a step. */
typedef struct {
    axt_real impulse; /* [N m s] */
    axt_real speed;   /* [rad/s] */
    bool held;        /* the speed is not that of a sliding contact but exact: mostly 0, sticking */
} axt_friction_end;

/* An inertia that begins a step with speed `start`, and would end it with speed `free` but for dry
 * friction of at most `limit` >= 0 [N m s], changes its end speed by `compliance` > 0 for an
 * impulse of 1. The impulse never adds energy: impulse (start + end) <= 0. An inertia at rest stays
 * there, exactly, when the limit allows it. One whose speed changes sign by itself comes to rest at
 * the end of the next step. Cost: 4 comparisons, 2 operations. */
axt_friction_end axt_friction_step(axt_real start, axt_real free, axt_real compliance,
                                   axt_real limit);

#endif
