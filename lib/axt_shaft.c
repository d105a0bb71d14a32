/* With z0 and z1 the twists beyond the play at both ends of the step, D = time_step rate the change
 * of the twist and V = stiffness z^2 / 2 + hardening z^4 / 4 the energy of the spring,
 *
 *     (V1 - V0) / D = share k (z0 + z1) / 2,   share = (z1 - z0) / D,
 *                                              k = stiffness + hardening (z0^2 + z1^2) / 2
 *
 * and the torque rises by share (stiffness + hardening (z0^2 + z0 z1 + z1^2)) for a twist of 1.
 * share is 1 on one flank, 0 in the play, and the part of the way in contact in between. */
#include "axt_shaft.h"

#include "axt_math.h"

static axt_real beyond(axt_real twist, axt_real play) {
    if (twist > play) {
        return twist - play;
    }
    return (twist < -play) ? twist + play : AXT_R(0);
}

static axt_real not_negative(axt_real x) {
    return (x > AXT_R(0)) ? x : AXT_R(0);
}

axt_shaft_torque axt_shaft_mean(const axt_shaft *shaft, axt_real twist, axt_real rate,
                                axt_real time_step) {
    const axt_real change = time_step * rate;
    const axt_real z0 = beyond(twist, shaft->play);
    const axt_real z1 = beyond(twist + change, shaft->play);
    const axt_real half = AXT_R(0.5) * shaft->hardening;
    const axt_real squares = z0 * z0 + z1 * z1;
    const axt_real k = not_negative(shaft->stiffness + half * squares);
    const axt_real mean = AXT_R(0.5) * (z0 + z1);
    const axt_real stiffness =
        not_negative(shaft->stiffness + shaft->hardening * (squares + z0 * z1));

    if (!(shaft->play > AXT_R(0)) || z0 * z1 > AXT_R(0)) { /* in contact all the time */
        const axt_real rise = not_negative(AXT_R(0.5) * k + shaft->hardening * z1 * mean);
        return (axt_shaft_torque){.torque = k * mean + shaft->damping * rate,
                                  .slope = rise * time_step + shaft->damping,
                                  .stiffness = stiffness};
    }
    if (!(axt_abs(z1 - z0) > AXT_R(0))) { /* in the play all the time */
        return (axt_shaft_torque){0};
    }
    const axt_real share = (z1 - z0) / change;
    const axt_real spring = share * k * mean;
    /* derivative of a mean over a way that grows: what is at its end less the mean */
    const axt_real at_end = (shaft->stiffness + shaft->hardening * z1 * z1) * z1;
    const axt_real rise = not_negative((at_end - spring) / change);
    const bool ends_in_contact = axt_abs(z1) > AXT_R(0);
    return (axt_shaft_torque){.torque = spring + shaft->damping * share * rate,
                              .slope =
                                  rise * time_step + (ends_in_contact ? shaft->damping : AXT_R(0)),
                              .stiffness = share * stiffness};
}
