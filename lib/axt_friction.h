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

/* How the speed changes in a step with dry friction. */
typedef struct {
    axt_real change; /* [rad/s] */
    bool held;       /* not sliding: the speed at the end is exact, mostly 0 */
} axt_friction_step;

/* An inertia begins a step with speed `start`, which would change by `change` but for dry friction;
 * that can alter the change by at most `most` >= 0 [rad/s]. It never adds energy: what it alters
 * times start + end is not positive. An inertia at rest stays there, exactly, when the limit allows
 * it. One whose speed changes sign by itself comes to rest at the end of the next step. Cost: 8
 * comparisons, 3 additions, no branch. */
axt_friction_step axt_friction_slide(axt_real start, axt_real change, axt_real most);

#endif
