/* A step of the axis with its effects.
 *
 * The trapezoidal rule between the speeds w at its beginning and w+ = w + d at its end, with mean
 * torques over the step, for motor and table (shaft torque S, twist speed v = w1 - w2, h = Dt):
 *
 *     (I1 + h c1 / 2) d1 = h (T1 - c1 w1 - S) + P1
 *     (I2 + h c2 / 2) d2 = h (T2 - c2 w2 + S) + P2        q+ = q + h (v + v+ + k1 - k2) / 2
 *
 * c is viscous friction. k is zero but where dry friction stops an inertia within the step: its
 * speed over time then has a bend, and its mean is not that of both ends (axt_friction.h). S
 * depends on the mean twist speed; linearised where the last sweep has left it (Newton), the k
 * being those of the last sweep, S = S0 + g (d1 - d2) / 2, the two equations are a 2 x 2 system
 * whose inverse has no cancellation: of positive numbers a, b, G = h g / 2,
 *
 *     [a + G   -G ]^-1                      [b + G    G  ]
 *     [ -G   b + G]     =  1 / (ab + (a+b)G)[  G    a + G]
 *
 * Where viscous friction differs by direction, c is that of the middle of the step as the last step
 * suggests it. In a step that reverses the speed is small, and the error of second order.
 *
 * The impulses P1, P2 of dry friction are solved for one after the other (Gauss-Seidel), each
 * exactly. What one alters changes against what the other does to its speed and by no more
 * (axt_friction.h), and of that the shaft passes on only a share, so the sweeps converge. One
 * friction point on a plain shaft takes one sweep unless it stops; otherwise a few are made until
 * nothing changes. S is the change of the spring's energy over that of the twist, with the k in it,
 * and friction takes its limit times all of the way, so no step adds energy (wn h <= 1).
 *
 * The further mode, an inertia m on a spring at the table with frequency p and damping ratio z,
 * depends linearly on d2 and is eliminated: with twist y and twist speed u,
 *
 *     s = p^2 y + (p^2 h / 2 + 2 z p) u,   e = (p^2 h / 2 + 2 z p) h / 2
 *     d3 = (h s + e d2) / (1 + e)
 *
 * is the change of its speed, so the table sees an inertia m e / (1 + e) and an impulse
 * -m h s / (1 + e).
 *
 * An exact step (axt_machine_make_exact()) has the speeds of twist and rigid body at both ends as
 * they are. Of a vibration wn without damping these are linked by
 *
 *     q+ - q = x h (v + v+) / 2,   v+ - v = x h (f / Ir - wn^2 (q + q+) / 2),
 *     x = tan(wn h / 2) / (wn h / 2)
 *
 * for a force f that is held, Ir = I1 I2 / (I1 + I2): the trapezoidal rule with ways and impulses
 * `stretch` x. Impulses on the rigid body are not, so motor and table are coupled by
 * G - Ir (1 - 1 / x) instead of G, and go I2 / (I1 + I2) (x - 1) times the way of h (v + v+) / 2
 * further, the table I1 / (I1 + I2) (x - 1) times backwards. With damping x and the B to take
 * follow from trace and determinant of the exact map z of (q, v): the rule makes 1 - z over 1 + z
 * of a pole. Where the stiffness that is met on the way of a step (axt_shaft.h) is another one than
 * K, as in the play, x - 1 is taken in proportion to it: that goes with (wn h)^2. */
#include "axt_machine.h"

#include "axt_encoder.h"
#include "axt_integrator.h"
#include "axt_math.h"

enum { SWEEPS = 4 };

/* A share of the twist: about the root of what rounding is. */
static const axt_real settled = AXT_IS_DOUBLE ? AXT_R(1e-8) : AXT_R(3e-4);
static const axt_real twist_max = AXT_R(1e3);
static const axt_real exact_turn_max = AXT_R(2); /* wn h: what turns by pi seems to turn back */
static const axt_real turns_per_rad = AXT_R(1) / AXT_TWO_PI;

static bool any(axt_real x) {
    return axt_abs(x) > AXT_R(0);
}

/* The integer nearest to |x| < 2^31. */
static axt_real nearest(axt_real x) {
    return (axt_real)(int32_t)(x + ((x < AXT_R(0)) ? AXT_R(-0.5) : AXT_R(0.5)));
}

static axt_real not_negative(axt_real x) {
    return (x > AXT_R(0)) ? x : AXT_R(0);
}

static axt_real limit(axt_real x, axt_real most) {
    if (x > most) {
        return most;
    }
    return (x < -most) ? -most : x;
}

/* sin(2 pi cycle + phase) for |cycle| + |phase| / 2 pi below 2^31: by its power series within a
 * quarter of a turn, right to 2e-16 or 1e-7. Nothing in it waits or branches, where a sine that has
 * to reduce its argument by pi does both. */
static axt_real sine(axt_real cycle, axt_real phase) {
    const axt_real turns = axt_fma(phase, turns_per_rad, cycle) - AXT_R(0.25);
    const axt_real folded = AXT_R(0.25) - axt_abs(turns - nearest(turns));
    const axt_real x = AXT_TWO_PI * folded;
    const axt_real x2 = x * x;
    const axt_real x4 = x2 * x2;
    /* the terms x^3, x^7, ... and x^5, x^9, ... of the series, two sums side by side */
    axt_real odd = AXT_R(-1.0 / 39916800);   /* 11! */
    axt_real even = AXT_R(1.0 / 6227020800); /* 13! */
#if AXT_IS_DOUBLE
    odd = axt_fma(axt_fma(AXT_R(-1.0 / 121645100408832000), x4, AXT_R(-1.0 / 1307674368000)), x4,
                  odd);
    even = axt_fma(AXT_R(1.0 / 355687428096000), x4, even);
#endif
    odd = axt_fma(axt_fma(odd, x4, AXT_R(-1.0 / 5040)), x4, AXT_R(-1.0 / 6));
    even = axt_fma(axt_fma(even, x4, AXT_R(1.0 / 362880)), x4, AXT_R(1.0 / 120));
    return axt_fma(axt_fma(even, x2, odd) * x2, x, x);
}

/* ---- What there is -------------------------------------------------------------------------- */

static bool any_friction(const axt_friction *friction) {
    return any(friction->coulomb) || any(friction->viscous) || any(friction->stribeck);
}

static bool any_wave(const axt_wave waves[AXT_EFFECTS_WAVES]) {
    bool found = false;
    for (uint32_t i = 0; i < AXT_EFFECTS_WAVES; i++) {
        found = found || any(waves[i].amplitude);
    }
    return found;
}

static bool inside_the_axis(const axt_effects *effects) {
    bool found = any_wave(effects->torque_ripple) || any(effects->backlash) ||
                 any(effects->stiffness_hardening) || any(effects->stiffness_drift) ||
                 any(effects->load_change.ratio) || any(effects->extra_mode.mass_ratio);
    for (uint32_t i = 0; i < 2; i++) {
        found = found || any_friction(&effects->friction[i]) || any(effects->torque_offset[i]) ||
                any(effects->disturbance[i].amplitude);
    }
    return found;
}

static bool in_an_encoder(const axt_effects *effects) {
    bool found = any_wave(effects->lead_error);
    for (uint32_t i = 0; i < 2; i++) {
        found = found || any(effects->encoder_eccentricity[i].amplitude) ||
                any(effects->encoder_delay[i]) || any(effects->quantisation[i]);
    }
    return found;
}

static axt_delay delay_of(axt_real time, axt_real time_step) {
    const axt_real steps = time / time_step;
    const uint32_t whole = (uint32_t)steps;
    return (axt_delay){.steps = whole, .part = steps - (axt_real)whole};
}

axt_status axt_machine_init(axt_machine *machine, const axt_axis *axis, axt_real time_step,
                            axt_torque_course course, const axt_effects *effects) {
    axt_plant plant;
    axt_status status = axt_plant_init(&plant, axis, time_step, &axt_newmark_trapezoidal);
    if (status == AXT_OK) {
        status = axt_effects_check(effects, time_step);
    }
    if (status != AXT_OK) {
        return status;
    }
    const axt_real p = effects->extra_mode.frequency;
    const axt_real pull = p * p;
    const axt_real drag =
        AXT_R(0.5) * time_step * pull + AXT_R(2) * effects->extra_mode.damping_ratio * p;
    const axt_real e = AXT_R(0.5) * time_step * drag;
    *machine = (axt_machine){
        .plant = plant,
        .effects = *effects,
        .axis = *axis,
        .time_step = time_step,
        .speed_max = AXT_PI / time_step,
        .course = course,
        .ideal = course == AXT_TORQUE_LINEAR && !inside_the_axis(effects),
        .delays = any(effects->torque_delay) || any(effects->encoder_delay[0]) ||
                  any(effects->encoder_delay[1]),
        .encodes = in_an_encoder(effects),
        .torque_delay = delay_of(effects->torque_delay, time_step),
        .encoder_delay = {delay_of(effects->encoder_delay[0], time_step),
                          delay_of(effects->encoder_delay[1], time_step)},
        .cycles_per_step = {effects->disturbance[0].frequency * time_step * turns_per_rad,
                            effects->disturbance[1].frequency * time_step * turns_per_rad},
        .load_step = effects->load_change.time / time_step,
        .mode_pull = pull,
        .mode_drag = drag,
        .mode_share = e / (AXT_R(1) + e),
        .mode_inertia = effects->extra_mode.mass_ratio * axis->I2,
    };
    return AXT_OK;
}

axt_status axt_machine_make_exact(axt_machine *machine) {
    const axt_axis *axis = &machine->axis;
    const axt_real h = machine->time_step;
    const axt_real reduced = axis->I1 * axis->I2 / (axis->I1 + axis->I2);
    const axt_real stiffness = axis->K / reduced;
    if (machine->course != AXT_TORQUE_HELD || machine->exact ||
        !(stiffness * h * h <= exact_turn_max * exact_turn_max)) {
        return AXT_ERROR_RANGE;
    }
    axt_exact_map map;
    const axt_status status = axt_exact_map_init(&map, axis->B / reduced, stiffness, h);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real trace = map.a[0][0] + map.a[1][1];
    const axt_real determinant = map.a[0][0] * map.a[1][1] - map.a[0][1] * map.a[1][0];
    const axt_real both = AXT_R(4) + AXT_R(2) * trace + determinant;
    machine->exact = true;
    const axt_real x = AXT_R(2) / h * axt_sqrt(determinant / (both * stiffness));
    machine->stretch = x - AXT_R(1);
    machine->stretched[0] = axis->I2 / (axis->I1 + axis->I2) * machine->stretch;
    machine->stretched[1] = axis->I1 / (axis->I1 + axis->I2) * machine->stretch;
    machine->eased = reduced * (AXT_R(1) - AXT_R(1) / x);
    machine->compliance = AXT_R(1) / axis->K;
    machine->axis.B = reduced * AXT_R(-4) * (trace + determinant) / (h * both * x);
    return AXT_OK;
}

/* ---- The past ------------------------------------------------------------------------------- */

static uint32_t ago(const axt_past *past, uint32_t steps) {
    return (past->newest + AXT_DELAY_STEPS - steps) % AXT_DELAY_STEPS;
}

static void remember_torque(axt_past *past, axt_real torque) {
    past->newest = (past->newest + 1) % AXT_DELAY_STEPS;
    past->torque[past->newest] = torque;
}

static axt_real torque_ago(const axt_past *past, axt_delay delay) {
    const axt_real later = past->torque[ago(past, delay.steps)];
    const axt_real earlier = past->torque[ago(past, delay.steps + 1)];
    return axt_fma(delay.part, earlier - later, later);
}

/* Brings the fraction back to half a turn: `motion` is less than a turn from there. */
static void wrap(axt_motion *motion) {
    if (motion->fraction > AXT_R(0.5)) {
        motion->fraction -= AXT_R(1);
        motion->turns = axt_wrap_add(motion->turns, 1);
    } else if (motion->fraction < AXT_R(-0.5)) {
        motion->fraction += AXT_R(1);
        motion->turns = axt_wrap_add(motion->turns, -1);
    }
}

static void advance(axt_motion *motion, axt_real fraction) {
    const axt_two sum = axt_two_sum(motion->fraction, fraction + motion->fraction_low);
    motion->fraction = sum.hi;
    motion->fraction_low = sum.lo;
    wrap(motion);
}

/* A past of motion at the present speeds under the present torque. */
static void remember_steady(axt_machine *machine, const axt_motion *present, axt_real torque) {
    axt_motion motion = *present;
    machine->past.newest = 0;
    for (uint32_t i = 0; i < AXT_DELAY_STEPS; i++) {
        const uint32_t at = ago(&machine->past, i);
        machine->past.torque[at] = torque;
        machine->past.motion[at] = motion;
        motion.twist -= machine->time_step * motion.twist_speed;
        advance(&motion, -motion.speed * machine->time_step * turns_per_rad);
    }
}

/* ---- State ---------------------------------------------------------------------------------- */

static axt_real delivered(const axt_machine *machine, axt_real torque) {
    const axt_real most = machine->effects.torque_saturation;
    return any(most) ? limit(torque, most) : torque;
}

axt_status axt_machine_set(axt_machine *machine, const axt_motion *motion, axt_real torque) {
    const axt_status status = axt_plant_set(&machine->plant, motion, delivered(machine, torque));
    if (status != AXT_OK) {
        return status;
    }
    machine->motion = *motion;
    wrap(&machine->motion);
    machine->speed[0] = motion->speed;
    machine->speed[1] = motion->speed - motion->twist_speed;
    for (uint32_t i = 0; i < 2; i++) {
        machine->speed_low[i] = AXT_R(0);
        machine->speed_change[i] = AXT_R(0);
        machine->cycle[i] = AXT_R(0);
        machine->cycle_low[i] = AXT_R(0);
    }
    machine->mode_twist = AXT_R(0);
    machine->mode_speed = AXT_R(0);
    machine->torque = delivered(machine, torque);
    machine->steps = 0;
    if (machine->delays) {
        remember_steady(machine, motion, torque);
    }
    return AXT_OK;
}

axt_status axt_machine_set_mode(axt_machine *machine, axt_real twist, axt_real speed) {
    if (!axt_finite(twist) || !axt_finite(speed)) {
        return AXT_ERROR_NOT_FINITE;
    }
    if (!(axt_abs(twist) <= twist_max) || !(axt_abs(speed) <= AXT_R(2) * machine->speed_max)) {
        return AXT_ERROR_RANGE;
    }
    machine->mode_twist = twist;
    machine->mode_speed = speed;
    return AXT_OK;
}

void axt_machine_read(const axt_machine *machine, axt_motion *motion) {
    if (machine->ideal) {
        axt_plant_read(&machine->plant, motion);
        return;
    }
    *motion = machine->motion;
    motion->speed = machine->speed[0];
    motion->twist_speed =
        (machine->speed[0] - machine->speed[1]) + (machine->speed_low[0] - machine->speed_low[1]);
}

/* ---- Waves ---------------------------------------------------------------------------------- */

/* The sum of the waves at `fraction` of a turn and that many whole ones. */
static axt_real waves(const axt_wave wave[AXT_EFFECTS_WAVES], axt_real fraction, int32_t turns) {
    axt_real sum = AXT_R(0);
    for (uint32_t i = 0; i < AXT_EFFECTS_WAVES; i++) {
        if (!any(wave[i].amplitude)) {
            continue;
        }
        const axt_two within = axt_two_product(wave[i].periods, fraction);
        axt_real cycle = (within.hi - nearest(within.hi)) + within.lo;
        const axt_real part = wave[i].periods - nearest(wave[i].periods);
        if (any(part)) { /* whole periods a turn say the same in every turn */
            const axt_two before = axt_two_product(part, (axt_real)turns);
            cycle += (before.hi - nearest(before.hi)) + before.lo;
        }
        sum += wave[i].amplitude * sine(cycle, wave[i].phase);
    }
    return sum;
}

/* The disturbance at the middle of the step that begins now; the cycle is moved on to its end. */
static axt_real disturbance(axt_machine *machine, uint32_t place) {
    const axt_disturbance *d = &machine->effects.disturbance[place];
    if (!any(d->amplitude)) {
        return AXT_R(0);
    }
    const axt_real step = machine->cycles_per_step[place];
    const axt_real middle = machine->cycle[place] + AXT_R(0.5) * step;
    const axt_two next = axt_two_sum(machine->cycle[place], step + machine->cycle_low[place]);
    machine->cycle[place] = next.hi - nearest(next.hi);
    machine->cycle_low[place] = next.lo;
    return d->amplitude * sine(middle, d->phase);
}

/* ---- The step ------------------------------------------------------------------------------- */

/* What a step is made of: constant while its equations are solved. */
typedef struct {
    axt_shaft shaft;
    axt_real twist_speed;
    axt_real inertia[2]; /* with viscous friction and the further mode: a, b */
    axt_real impulse[2]; /* of all but shaft and dry friction [N m s] */
    axt_real drag[2];    /* impulse of viscous friction for a speed of 1 [kg m2] */
    axt_real dry[2];     /* limit of the impulse of dry friction [N m s] */
    bool plain;          /* a straight line for a shaft, and at most one dry friction */
} step_terms;

/* The part of the step that lies after the change of the load. */
static axt_real part_loaded(const axt_machine *machine) {
    const axt_real since = ((axt_real)machine->steps - machine->load_step) + AXT_R(1);
    return not_negative((since < AXT_R(1)) ? since : AXT_R(1));
}

static void find_terms(axt_machine *machine, axt_real torque, step_terms *terms) {
    const axt_effects *effects = &machine->effects;
    const axt_real h = machine->time_step;
    const axt_real time = ((axt_real)machine->steps + AXT_R(0.5)) * h;
    /* if the speed goes on changing as it does */
    const axt_real to_middle = axt_fma(AXT_R(0.25), machine->speed_change[0], machine->speed[0]);
    const axt_real middle = AXT_R(0.5) * h * turns_per_rad * to_middle;
    const axt_real ripple =
        waves(effects->torque_ripple, machine->motion.fraction + middle, machine->motion.turns);
    const axt_real pull =
        machine->mode_inertia * (AXT_R(1) - machine->mode_share) *
        axt_fma(machine->mode_pull, machine->mode_twist, machine->mode_drag * machine->mode_speed);
    const axt_real load = AXT_R(1) + effects->load_change.ratio * part_loaded(machine);
    const axt_real acting[2] = {torque + ripple, -pull};
    const axt_real inertia[2] = {machine->axis.I1, machine->axis.I2 * load +
                                                       machine->mode_inertia * machine->mode_share};

    terms->shaft.stiffness =
        machine->axis.K * not_negative(AXT_R(1) + effects->stiffness_drift * time);
    terms->shaft.damping = machine->axis.B;
    terms->shaft.hardening = effects->stiffness_hardening;
    terms->shaft.play = AXT_R(0.5) * effects->backlash;
    terms->twist_speed =
        (machine->speed[0] - machine->speed[1]) + (machine->speed_low[0] - machine->speed_low[1]);
    uint32_t dry = 0;
    for (uint32_t i = 0; i < 2; i++) {
        const axt_friction *friction = &effects->friction[i];
        const axt_real grown = not_negative(AXT_R(1) + friction->drift * time);
        /* in the middle of the step, if the speed goes on changing as it does */
        const axt_real speed = machine->speed[i] + AXT_R(0.5) * machine->speed_change[i];
        const axt_real viscous = axt_friction_viscous(friction, speed) * grown;
        terms->drag[i] = h * viscous;
        terms->inertia[i] = inertia[i] + AXT_R(0.5) * terms->drag[i];
        terms->impulse[i] = h * (acting[i] + effects->torque_offset[i] + disturbance(machine, i)) -
                            terms->drag[i] * machine->speed[i];
        terms->dry[i] = h * grown * axt_friction_limit(friction, speed);
        dry += any(terms->dry[i]);
    }
    terms->plain = !any(terms->shaft.hardening) && !any(terms->shaft.play) && dry < 2;
}

/* How the speeds of motor and table change, and whether friction holds them. */
typedef struct {
    axt_real change[2];
    axt_real bend[2]; /* k1, k2 */
    bool held[2];
    axt_real stretched; /* 1 of an exact step with the stiffness of the axis on all of its way */
} step_speeds;

static void solve(const axt_machine *machine, const step_terms *terms, step_speeds *found) {
    const axt_real h = machine->time_step;
    const axt_real a = terms->inertia[0];
    const axt_real b = terms->inertia[1];
    const axt_real v = terms->twist_speed;
    const axt_real twist = machine->motion.twist;
    axt_real stopped[2] = {AXT_R(0), AXT_R(0)}; /* changes of speed by dry friction [rad/s] */
    axt_real bend = AXT_R(0);                   /* of the twist speed: half of k1 - k2 */
    axt_real rate = v;
    found->stretched = machine->compliance * terms->shaft.stiffness;
    for (uint32_t sweep = 0; sweep < SWEEPS; sweep++) {
        const axt_real way = h * axt_fma(machine->stretch, found->stretched, AXT_R(1));
        const axt_shaft_torque shaft = axt_shaft_mean(&terms->shaft, twist, rate, way);
        found->stretched = machine->compliance * shaft.stiffness;
        const axt_real through = h * axt_fma(shaft.slope, v + bend - rate, shaft.torque);
        const axt_real coupling =
            axt_fma(AXT_R(0.5) * h, shaft.slope, -machine->eased * found->stretched);
        const axt_real scale = AXT_R(1) / (a * b + (a + b) * coupling);
        const axt_real compliance[2] = {(b + coupling) * scale, (a + coupling) * scale};
        /* what an impulse at the other end does here, for 1 that it does there */
        const axt_real share[2] = {coupling / (a + coupling), coupling / (b + coupling)};
        const axt_real further = found->stretched * rate;
        const axt_real more[2] = {machine->stretched[0] * further,
                                  -machine->stretched[1] * further};
        const axt_real impulse[2] = {terms->impulse[0] - through - terms->drag[0] * more[0],
                                     terms->impulse[1] + through - terms->drag[1] * more[1]};
        const axt_real sum = coupling * scale * (impulse[0] + impulse[1]);
        const axt_real smooth[2] = {axt_fma(b * scale, impulse[0], sum),
                                    axt_fma(a * scale, impulse[1], sum)};

        /* half the impulse by which the shaft's torque rises: of its mean by half of the slope */
        const axt_real rise =
            machine->exact ? h * (shaft.slope * rate - terms->shaft.damping * v) : AXT_R(0);
        const axt_real trend[2] = {-rise * compliance[0], rise * compliance[1]};

        for (uint32_t i = 0; i < 2; i++) {
            const axt_real free = axt_fma(share[i], stopped[1 - i], smooth[i]);
            const axt_friction_step slid = axt_friction_slide(machine->speed[i], free, trend[i],
                                                              compliance[i] * terms->dry[i]);
            found->held[i] = slid.held && any(terms->dry[i]);
            found->change[i] = slid.change;
            found->bend[i] = slid.bend;
            stopped[i] = slid.change - free;
        }
        if (!found->held[0]) { /* the table's friction has changed since */
            found->change[0] = smooth[0] + stopped[0] + share[0] * stopped[1];
        }
        const axt_real last = rate;
        bend = AXT_R(0.5) * (found->bend[0] - found->bend[1]);
        rate = axt_fma(AXT_R(0.5), found->change[0] - found->change[1], v + bend);
        /* the next sweep would change the square of this, or a share of it as small */
        const axt_real size = axt_fma(h, axt_abs(rate), axt_abs(twist));
        const bool changes = h * axt_abs(rate - last) > settled * size;
        if ((terms->plain && !any(bend)) || !changes) {
            break;
        }
    }
}

static bool bounded(const step_speeds *speeds) {
    return axt_finite(speeds->change[0]) && axt_finite(speeds->change[1]);
}

static void move(axt_machine *machine, const step_speeds *speeds, axt_real twist_speed) {
    const axt_real half = AXT_R(0.5) * machine->time_step;
    const axt_real before[2] = {machine->speed[0], machine->speed[1]};
    for (uint32_t i = 0; i < 2; i++) {
        axt_two speed = {before[i] + speeds->change[i], AXT_R(0)}; /* held: no digits are lost */
        if (!speeds->held[i]) {
            speed = axt_two_sum(before[i], speeds->change[i] + machine->speed_low[i]);
        }
        machine->speed[i] = limit(speed.hi, machine->speed_max);
        machine->speed_low[i] = speed.lo;
        machine->speed_change[i] = machine->speed[i] - before[i];
    }
    const axt_real rate =
        (machine->speed[0] - machine->speed[1]) + (machine->speed_low[0] - machine->speed_low[1]);
    const axt_real twisted = twist_speed + rate + (speeds->bend[0] - speeds->bend[1]);
    const axt_real further = speeds->stretched * twisted;
    machine->motion.twist =
        limit(axt_fma(half, axt_fma(machine->stretch, further, twisted), machine->motion.twist),
              twist_max);
    const axt_real turned = before[0] + machine->speed[0] + speeds->bend[0];
    advance(&machine->motion,
            half * turns_per_rad * axt_fma(machine->stretched[0], further, turned));

    if (any(machine->mode_inertia)) {
        const axt_real pull = axt_fma(machine->mode_pull, machine->mode_twist,
                                      machine->mode_drag * machine->mode_speed);
        const axt_real own = machine->time_step * (AXT_R(1) - machine->mode_share) * pull;
        const axt_real change = speeds->change[1] * (AXT_R(1) - machine->mode_share) - own;
        const axt_real mode_speed =
            limit(machine->mode_speed + change, AXT_R(2) * machine->speed_max);
        machine->mode_twist = limit(
            axt_fma(half, machine->mode_speed + mode_speed + speeds->bend[1], machine->mode_twist),
            twist_max);
        machine->mode_speed = mode_speed;
    }
}

static axt_status step_with_effects(axt_machine *machine, axt_real torque) {
    const axt_real mean = (machine->course == AXT_TORQUE_HELD)
                              ? machine->torque
                              : AXT_R(0.5) * (machine->torque + torque);
    step_terms terms;
    step_speeds speeds;
    find_terms(machine, mean, &terms);
    solve(machine, &terms, &speeds);
    machine->torque = torque;
    if (machine->steps < UINT32_MAX) {
        machine->steps++;
    }
    if (!bounded(&speeds)) {
        return AXT_ERROR_RANGE;
    }
    move(machine, &speeds, terms.twist_speed);
    return AXT_OK;
}

axt_status axt_machine_step(axt_machine *machine, axt_real torque) {
    axt_real command = torque;
    if (!(axt_abs(torque) <= machine->plant.half_turn)) { /* the plant's own limit */
        machine->rejected++;
        return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
    }
    if (machine->delays) {
        remember_torque(&machine->past, torque);
        command = torque_ago(&machine->past, machine->torque_delay);
    }
    command = delivered(machine, command);
    const axt_status status = machine->ideal ? axt_plant_step(&machine->plant, command)
                                             : step_with_effects(machine, command);
    machine->rejected += (status != AXT_OK);
    if (machine->delays) {
        axt_machine_read(machine, &machine->past.motion[machine->past.newest]);
    }
    return status;
}

/* ---- Encoders ------------------------------------------------------------------------------- */

static axt_real angle_between(const axt_motion *from, const axt_motion *to, uint32_t place) {
    const axt_real turns = (axt_real)axt_wrap_add(to->turns, -from->turns);
    const axt_real motor = AXT_TWO_PI * ((turns + (to->fraction - from->fraction)) +
                                         (to->fraction_low - from->fraction_low));
    return (place == AXT_ENCODER_TABLE) ? motor - (to->twist - from->twist) : motor;
}

static axt_real speed_of(const axt_motion *motion, uint32_t place) {
    return (place == AXT_ENCODER_TABLE) ? motion->speed - motion->twist_speed : motion->speed;
}

/* How far the axis was from where it is now [rad], and its speed then: between two steps a cubic
 * through both positions with both speeds (Hermite's). */
static axt_real angle_ago(const axt_machine *machine, uint32_t place, axt_real *speed) {
    const axt_past *past = &machine->past;
    const axt_delay delay = machine->encoder_delay[place];
    const axt_motion *later = &past->motion[ago(past, delay.steps)];
    const axt_motion *earlier = &past->motion[ago(past, delay.steps + 1)];
    const axt_real back = angle_between(later, earlier, place);
    const axt_real slope[2] = {-machine->time_step * speed_of(later, place),
                               -machine->time_step * speed_of(earlier, place)};
    const axt_real square = AXT_R(3) * back - AXT_R(2) * slope[0] - slope[1];
    const axt_real cube = slope[0] + slope[1] - AXT_R(2) * back;
    *speed = axt_fma(delay.part, speed_of(earlier, place) - speed_of(later, place),
                     speed_of(later, place));
    return angle_between(&past->motion[past->newest], later, place) +
           delay.part * axt_fma(delay.part, axt_fma(delay.part, cube, square), slope[0]);
}

/* The nearest multiple of 1 / counts, to the digits of two numbers. */
static axt_two quantise(axt_two fraction, axt_real counts) {
    if (!any(counts)) {
        return fraction;
    }
    const axt_two scaled = axt_two_product(counts, fraction.hi);
    const axt_real whole = nearest(scaled.hi);
    const axt_real count =
        whole + nearest((scaled.hi - whole) + (scaled.lo + counts * fraction.lo));
    const axt_real quotient = count / counts;
    const axt_two back = axt_two_product(quotient, counts);
    return (axt_two){quotient, ((count - back.hi) - back.lo) / counts};
}

void axt_machine_measure(const axt_machine *machine, axt_motion *motion) {
    axt_machine_read(machine, motion);
    if (!machine->encodes) {
        return;
    }
    const axt_effects *effects = &machine->effects;
    axt_two reading[2];
    axt_real speed[2];
    for (uint32_t i = 0; i < 2; i++) {
        axt_real late = AXT_R(0); /* [rad] */
        speed[i] = speed_of(motion, i);
        if (any(effects->encoder_delay[i])) {
            late = angle_ago(machine, i, &speed[i]);
        }
        const axt_real behind = (i == AXT_ENCODER_TABLE) ? late - motion->twist : late;
        const axt_two seen =
            axt_two_sum(motion->fraction, motion->fraction_low + behind * turns_per_rad);
        axt_real error = AXT_R(0);
        if (any(effects->encoder_eccentricity[i].amplitude)) {
            error = effects->encoder_eccentricity[i].amplitude *
                    sine(seen.hi, effects->encoder_eccentricity[i].phase);
        }
        if (i == AXT_ENCODER_TABLE) {
            error += waves(effects->lead_error, seen.hi, motion->turns);
        }
        const axt_two shown = axt_two_sum(seen.hi, seen.lo + error * turns_per_rad);
        reading[i] = quantise(shown, effects->quantisation[i]);
    }
    motion->fraction = reading[0].hi;
    motion->fraction_low = reading[0].lo;
    motion->twist =
        AXT_TWO_PI * ((reading[0].hi - reading[1].hi) + (reading[0].lo - reading[1].lo));
    motion->speed = speed[0];
    motion->twist_speed = speed[0] - speed[1];
}
