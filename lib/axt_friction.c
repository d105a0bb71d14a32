/* In a step, time t in steps, the force would change the speed w of an inertia at the rate
 * c + q (2 t - 1), c being the change and q the trend. Friction of the limit m brings it to rest
 * after the share p,
 *
 *     w + (c - m) p - q p (1 - p) = 0    if w + c - m <= 0    (w >= 0; the other way mirrored)
 *
 * and holds it up to the share r, from which on the force is beyond the limit and drives it to the
 * side s, 1 or -1: p where it turns round at once, 1 where it is held. What friction does, -m up to
 * p, -c - q (2 t - 1) up to r and -s m from there, has the sum
 *
 *     -m (p + s (1 - r)) - (r - p) (c - q (1 - p - r))
 *
 * and, not acting in the middle, moves the mean speed away from that of both ends by half of
 *
 *     m (s R - P) + c (P - R) + 4/3 q ((r - 1/2)^3 - (p - 1/2)^3),   P = p (1 - p), R = r (1 - r)
 *
 * Without a trend these are m (1 - 2 p) and -2 m P where it turns round. The speed at the end is
 * then continuous in the change and rises for 1 by 1 - 2 m w / (c - m)^2 where it turns round,
 * which is 0 .. 1 since m - c is w and 2 m at least, by 1 where it goes on, 0 where it is held. */
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

static axt_real within(axt_real x, axt_real least, axt_real most) {
    const axt_real no_more = (x < most) ? x : most;
    return (no_more > least) ? no_more : least;
}

static axt_real sign(axt_real x) {
    return (x < AXT_R(0)) ? AXT_R(-1) : AXT_R(1);
}

static axt_real cube(axt_real x) {
    return x * x * x;
}

/* p; of the two roots the one between 0 and 1, without a difference of like numbers. */
static axt_real share_to_rest(axt_real speed, axt_real onward, axt_real trend) {
    if (!(speed > AXT_R(0))) {
        return AXT_R(0);
    }
    if (!(axt_abs(trend) > AXT_R(0))) {
        return speed / -onward;
    }
    const axt_real fall = trend - onward;
    const axt_real square = fall * fall - AXT_R(4) * trend * speed;
    const axt_real root = (square > AXT_R(0)) ? axt_sqrt(square) : AXT_R(0);
    return within(AXT_R(2) * speed / (fall + root), AXT_R(0), AXT_R(1));
}

axt_friction_step axt_friction_slide(axt_real start, axt_real change, axt_real trend,
                                     axt_real most) {
    const axt_real way = sign(start);
    const axt_real w = axt_abs(start);
    const axt_real c = way * change;
    const axt_real q = way * trend;
    const axt_real onward = c - most;
    if (w > AXT_R(0) && !(w + onward <= AXT_R(0))) { /* nor is what is no number held */
        return (axt_friction_step){.change = way * onward};
    }
    const axt_real p = share_to_rest(w, onward, q);
    const axt_real at_rest = axt_fma(q, AXT_R(2) * p - AXT_R(1), c);
    const axt_real at_end = c + q;
    axt_real r = p;
    axt_real s = sign(at_rest);
    bool held = false;
    if (axt_abs(at_rest) <= most) {
        s = sign(at_end);
        held = !(axt_abs(at_end) > most);
        r = held ? AXT_R(1) : within(AXT_R(0.5) + AXT_R(0.5) * (s * most - c) / q, p, AXT_R(1));
    }
    const axt_real sum = most * (p + s * (AXT_R(1) - r)) + (r - p) * (c - q * (AXT_R(1) - p - r));
    const axt_real P = p * (AXT_R(1) - p);
    const axt_real R = r * (AXT_R(1) - r);
    const axt_real bend = most * (s * R - P) + c * (P - R) +
                          AXT_R(4.0 / 3) * q * (cube(r - AXT_R(0.5)) - cube(p - AXT_R(0.5)));
    return (axt_friction_step){
        .change = held ? -start : way * (c - sum), .bend = way * bend, .held = held};
}
