/* axt_friction.h - friction at one point of the axis that truly sticks.
 *
 *     torque = -(coulomb + stribeck exp(-(w / stribeck_speed)^2)) sign(w)
 *              - viscous w - asymmetry |w|
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
    axt_real stribeck;       /* break-away torque above Coulomb's [N m], -coulomb .. 1e6; below it
                                when friction only rises to Coulomb's with speed */
    axt_real stribeck_speed; /* [rad/s], 1e-6 .. 1e6 when there is any */
    axt_real asymmetry;      /* more viscous friction forwards, less backwards [N m s/rad],
                                -viscous .. viscous: beyond that it would drive */
    axt_real drift;          /* of all four [1/s], -1e3 .. 1e3: (1 + drift t) times, at least 0 */
} axt_friction;

/* The limit of dry friction [N m] at a speed [rad/s], without drift. Cost: 4 operations, and an
 * exponential and a division for Stribeck's part. */
axt_real axt_friction_limit(const axt_friction *friction, axt_real speed);

/* Viscous friction [N m s/rad] in the direction of a speed [rad/s], without drift; at speed 0 the
 * mean of both. Cost: 2 comparisons, an addition. */
axt_real axt_friction_viscous(const axt_friction *friction, axt_real speed);

/* How the speed changes in a step with dry friction. */
typedef struct {
    axt_real change; /* [rad/s] */
    axt_real bend;   /* the mean speed is start + (change + bend) / 2 [rad/s] */
    bool held;       /* at rest at the end: start + change is exactly 0 */
} axt_friction_step;

/* An inertia begins a step with speed `start`, which a force would change by `change` but for dry
 * friction; that would change it by `most` >= 0 if it acted one way all the time [rad/s]. Under a
 * force that is not constant the speed would change by `change` + `trend` at the rate of the end of
 * the step, and by `change` - `trend` at that of its beginning. Exact for a force that is constant,
 * or linear in time unless the inertia comes to rest twice or goes on the way it came: one that
 * comes to rest within the step goes back, at once or when the force is beyond the limit, or stays,
 * and one at rest stays there, exactly, as long as the limit allows it. Under a constant force it
 * gains in energy the work of the force over the way it goes less that of friction, which is never
 * negative. The step's mean force in place of one that changes makes errors of second order in the
 * step. Cost: 4 additions, 3 comparisons; about 40 operations, a division and, with a trend, a
 * square root and a division more when it stops. */
axt_friction_step axt_friction_slide(axt_real start, axt_real change, axt_real trend,
                                     axt_real most);

#endif
