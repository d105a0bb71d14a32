/* The impulse of dry friction over a step from speed w to w+ is
 *
 *     P = -limit (sign(w+) + sign(w + w+)) / 2
 *
 * the mean of what the end speed and the mean speed say. The first makes the inertia stop at
 * exactly zero, the second forbids to push it further than the mean speed's zero, so that the work
 * of the step, P (w + w+) / 2, is never positive. P falls with w+ in two steps, at 0 and at -w, so
 * w+ = free + P / inertia has one solution, a clamp at one of the two. */
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

static axt_real least(axt_real a, axt_real b) {
    return (a < b) ? a : b;
}

static axt_real largest(axt_real a, axt_real b) {
    return (a > b) ? a : b;
}

axt_friction_step axt_friction_slide(axt_real start, axt_real change, axt_real most) {
    const axt_real lower = least(-start, AXT_R(-2) * start); /* as changes: to 0 and to -w */
    const axt_real upper = largest(-start, AXT_R(-2) * start);
    const axt_real slowed = largest(change - most, least(change, upper)); /* moving forwards */
    const axt_real slid = least(slowed + most, largest(slowed, lower));
    return (axt_friction_step){.change = slid, .held = slid == upper || slid == lower};
}
