/* axt_effects.h - what an axis does that Eq. 3 does not say.
 *
 * Any of them at once; all zero is the ideal axis. axt_catalogue.h gives each its public name.
 * axt_machine.h is the axis that does all this.
 */
#ifndef AXT_EFFECTS_H
#define AXT_EFFECTS_H

#include "axt_axis.h"
#include "axt_friction.h"
#include "axt_real.h"
#include "axt_status.h"

#define AXT_EFFECTS_WAVES 4 /* harmonics of torque ripple and of lead error */

/* amplitude sin(periods angle + phase). */
typedef struct {
    axt_real amplitude; /* [N m] or [rad], -1e6 .. 1e6 */
    axt_real periods;   /* a turn, 0 .. 1e5; need not be whole */
    axt_real phase;     /* [rad], -1e3 .. 1e3 */
} axt_wave;

/* amplitude sin(angle + phase). */
typedef struct {
    axt_real amplitude; /* [rad], -1 .. 1 */
    axt_real phase;     /* [rad], -1e3 .. 1e3 */
} axt_eccentricity;

/* amplitude sin(frequency t + phase). */
typedef struct {
    axt_real amplitude; /* [N m], -1e6 .. 1e6 */
    axt_real frequency; /* [rad/s], 0 .. pi / Dt */
    axt_real phase;     /* [rad], -1e3 .. 1e3 */
} axt_disturbance;

/* Indices [2] are motor and table, with their encoders 1 and 2. Time is counted from the start. */
typedef struct {
    axt_friction friction[2];
    axt_real torque_offset[2]; /* acts like a positive torque [N m], -1e6 .. 1e6 */
    axt_disturbance disturbance[2];
    axt_wave torque_ripple[AXT_EFFECTS_WAVES]; /* adds to the motor's torque; in its angle */

    axt_real backlash;            /* width of the gap [rad], 0 .. 1e3 */
    axt_real stiffness_hardening; /* [N m/rad3], -1e15 .. 1e15 */
    axt_real stiffness_drift;     /* [1/s], -1e3 .. 1e3: K (1 + rate t), at least 0 */

    struct {
        axt_real ratio; /* the table's inertia becomes (1 + ratio) I2, -0.999 .. 1e3 */
        axt_real time;  /* [s], 0 .. 1e9 */
    } load_change;
    struct {
        axt_real frequency;     /* [rad/s]: of the further inertia alone, the table held; > 0 */
        axt_real damping_ratio; /* [1], 0 .. 1e3; likewise */
        axt_real mass_ratio;    /* the further inertia in units of I2, on top of it; 0 .. 1e3 */
    } extra_mode;

    axt_real torque_delay;      /* [s], up to AXT_DELAY_STEPS - 2 steps */
    axt_real torque_saturation; /* [N m], 0 .. 1e6; 0: none */

    axt_wave lead_error[AXT_EFFECTS_WAVES]; /* encoder 2 reads more [rad]; in the table's angle */
    axt_eccentricity encoder_eccentricity[2];
    axt_real encoder_delay[2]; /* [s], as torque_delay */
    axt_real quantisation[2];  /* counts a turn, whole, 0 .. 2^24; 0: none */
} axt_effects;

/* Past samples that are kept for the delays. */
#ifndef AXT_DELAY_STEPS
#define AXT_DELAY_STEPS 64
#endif

/* AXT_OK when every parameter lies in the range given above for steps of `time_step` [s],
 * AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE otherwise. */
axt_status axt_effects_check(const axt_effects *effects, axt_real time_step);

#endif
