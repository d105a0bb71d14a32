/* axt_shaft.h - the torque of a shaft with play and a spring that hardens.
 *
 *     torque = stiffness z + hardening z^3 + damping z'
 *
 * where z is the twist beyond the play: in the play nothing is transmitted, and a shaft in contact
 * is a spring and a damper side by side.
 */
#ifndef AXT_SHAFT_H
#define AXT_SHAFT_H

#include "axt_real.h"

typedef struct {
    axt_real stiffness; /* [N m/rad] */
    axt_real damping;   /* [N m s/rad] */
    axt_real hardening; /* [N m/rad3]; where it is negative the spring softens, down to no torque */
    axt_real play;      /* from the middle to either flank: half the gap [rad] */
} axt_shaft;

/* The mean torque of a step, how it rises with the mean twist speed, and the mean stiffness on the
 * way: by which the torque at its end is another than at its beginning. */
typedef struct {
    axt_real torque;    /* [N m] */
    axt_real slope;     /* [N m s/rad], not negative */
    axt_real stiffness; /* [N m/rad], not negative */
} axt_shaft_torque;

/* The mean torque over a step of `time_step` [s] that begins at `twist` [rad] and goes on at a mean
 * twist speed of `rate` [rad/s]: the change of the spring's energy divided by the change of the
 * twist. A step with this torque keeps the energy to the last digit, whether or not it meets a
 * flank, and for the plain spring it is the trapezoidal rule. Cost: about 20 operations; 2
 * divisions more with play. */
axt_shaft_torque axt_shaft_mean(const axt_shaft *shaft, axt_real twist, axt_real rate,
                                axt_real time_step);

#endif
