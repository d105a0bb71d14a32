/* The impulse of dry friction over a step from speed w to w+ is
 *
 *     P = -limit (sign(w+) + sign(w + w+)) / 2
 *
 * the mean of what the end speed and the mean speed say. The first makes the inertia stop at
 * exactly zero, the second forbids to push it further than the mean speed's zero, so that the work
 * of the step, P (w + w+) / 2, is never positive. P falls with w+ in two steps, at 0 and at -w, so
 * w+ = free + compliance P has one solution, a clamp at one of the two. */
#include "axt_friction.h"

#include "axt_math.h"

axt_real axt_friction_limit(const axt_friction *friction, axt_real speed) {
    if (!(friction->stribeck > AXT_R(0))) {
        return friction->coulomb;
    }
    const axt_real ratio = speed / friction->stribeck_speed;
    const axt_real square = ratio * ratio;
    const bool gone = square > AXT_R(40); /* exp(-40) is less than rounding */
    return friction->coulomb + (gone ? AXT_R(0) : friction->stribeck * axt_exp(-square));
}

axt_friction_end axt_friction_step(axt_real start, axt_real free, axt_real compliance,
                                   axt_real limit) {
    const axt_real lower = (start > AXT_R(0)) ? -start : AXT_R(0);
    const axt_real upper = (start < AXT_R(0)) ? -start : AXT_R(0);
    if (free > upper) {
        const axt_real slid = free - compliance * limit;
        return (slid > upper)
                   ? (axt_friction_end){.impulse = -limit, .speed = slid}
                   : (axt_friction_end){(upper - free) / compliance, upper, .held = true};
    }
    if (free < lower) {
        const axt_real slid = free + compliance * limit;
        return (slid < lower)
                   ? (axt_friction_end){.impulse = limit, .speed = slid}
                   : (axt_friction_end){(lower - free) / compliance, lower, .held = true};
    }
    return (axt_friction_end){.speed = free};
}
