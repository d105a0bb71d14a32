/* Under a constant force the speed w of an inertia follows a straight line to zero and, unless
 * friction holds it, another one on from there. With the changes over a whole step,
 *
 *     onward = change - most    while it goes on (w >= 0; the other way mirrored)
 *     back = change + most      when it has turned round
 *
 * it goes on for the whole step if w + onward > 0. Otherwise it stops after the share
 * p = w / -onward of the step, turns round if back < 0 and is then at
 *
 *     w+ = back (1 - p) = w + change + most (1 - 2 p)
 *
 * or else stays there, w+ = 0. Its mean speed is (p w + (1 - p) w+) / 2, short of the chord
 * (w + w+) / 2 by half of (1 - p) w + p w+, which is 2 p (1 - p) most if it turns round.
 *
 * w+ is continuous in the change and rises by 1 - 2 most w / onward^2 for 1, which is 0 .. 1 since
 * -onward >= w and -onward >= 2 most where it turns round, by 1 where it goes on, by 0 where it is
 * held. */
#include "axt_friction.h"

#include "axt_math.h"

axt_real axt_friction_limit(const axt_friction *friction, axt_real speed) {
    if (!(axt_abs(friction->stribeck) > AXT_R(0))) {
        return friction->coulomb;
    }
    const axt_real ratio = speed / friction->stribeck_speed;
    const axt_real square = ratio * ratio;
    const bool gone = square > AXT_R(40); /* exp(-40) is less than rounding */
    return friction->coulomb + (gone ? AXT_R(0) : friction->stribeck * axt_exp(-square));
}

axt_real axt_friction_viscous(const axt_friction *friction, axt_real speed) {
    if (speed > AXT_R(0)) {
        return friction->viscous + friction->asymmetry;
    }
    return (speed < AXT_R(0)) ? friction->viscous - friction->asymmetry : friction->viscous;
}

axt_friction_step axt_friction_slide(axt_real start, axt_real change, axt_real most) {
    const axt_real way = (start < AXT_R(0)) ? AXT_R(-1) : AXT_R(1);
    const axt_real speed = axt_abs(start);
    const axt_real onward = way * change - most;
    if (!(speed + onward <= AXT_R(0))) { /* nor is what is no number held */
        return (axt_friction_step){.change = way * onward};
    }
    const axt_real until = (speed > AXT_R(0)) ? speed / -onward : AXT_R(0); /* it stops */
    const axt_real rest = AXT_R(1) - until;
    if (way * change + most < AXT_R(0)) {
        const axt_real against = way * most;
        return (axt_friction_step){.change = axt_fma(against, rest - until, change),
                                   .bend = AXT_R(-2) * against * until * rest};
    }
    return (axt_friction_step){.change = -start, .bend = -start * rest, .held = true};
}
