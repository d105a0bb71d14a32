/* The plant: Newmark's method for twist and rigid body.
 *
 * Twist. With q'' = T / I1 - d q' - k q, d = B / Ir, k = K / Ir, and the paper's Eqs. 4-6
 *
 *     q1  = q0 + Dt q0' + Dt^2 ((1/2 - alpha) q0'' + alpha q1'')
 *     q1' = q0' + Dt ((1 - delta) q0'' + delta q1'')
 *
 * the acceleration at the end of the step is
 *
 *     q1'' = (T1 / I1 - d p' - k p) / (1 + delta Dt d + alpha Dt^2 k)
 *
 * where p, p' are q1, q1' without their q1'' terms. In units of the step, Q = q, V = Dt q' and
 * A = alpha Dt^2 q'', most factors become pure numbers, for 1/4, 1/2 exact ones (1, 2, 2):
 *
 *     p = Q + V + (1/2 - alpha) / alpha A,   p' = V + (1 - delta) / alpha A
 *     A <- (T1 / I1 - d p' / Dt - k p) alpha Dt^2 / (1 + delta Dt d + alpha Dt^2 k)
 *     Q <- p + A,                            V <- p' + delta / alpha A
 *
 * Rigid body. With r'' = T / I the same two equations can be summed in closed form:
 *
 *     S[n] = S[n-1] + T[n]          r'[n] = Dt / I   (S[n] - (1 - delta) T[n])
 *     W[n] = W[n-1] + S[n-1]        r[n]  = Dt^2 / I (W[n] + alpha T[n] + (delta - 1/2) (S[n] -
 * T[n]))
 *
 * S and W are plain sums of torque samples: no product is rounded before it is added. Kept as
 * unevaluated sums of two numbers by Knuth's two-sum they lose nothing but the last of 48 bits
 * (float), so the axis does not creep in days of running. W is taken modulo one turn; whole turns
 * are counted. */
#include "axt_plant.h"

#include "axt_math.h"

const axt_newmark axt_newmark_trapezoidal = {.alpha = AXT_R(0.25), .delta = AXT_R(0.5)};

axt_status axt_plant_init(axt_plant *plant, const axt_axis *axis, axt_real time_step,
                          const axt_newmark *newmark) {
    axt_modal modal;
    const axt_status status = axt_axis_modal(axis, &modal);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real alpha = newmark->alpha;
    const axt_real delta = newmark->delta;
    const axt_real x = modal.wn * time_step;
    const bool step_in_range = time_step >= AXT_R(1e-7) && time_step <= AXT_R(1) && x <= AXT_R(1e3);
    const bool newmark_in_range =
        alpha >= AXT_R(0.01) && alpha <= AXT_R(1) && delta >= AXT_R(0.5) && delta <= AXT_R(1);
    /* that of the undamped axis; damping only widens it */
    const bool stable = (AXT_R(0.5) * delta - alpha) * x * x < AXT_R(1);
    if (!step_in_range || !newmark_in_range || !stable) {
        return AXT_ERROR_RANGE;
    }

    const axt_real inertia = axis->I1 + axis->I2;
    const axt_real per_reduced = AXT_R(1) / axis->I1 + AXT_R(1) / axis->I2; /* 1 / Ir */
    const axt_real dt2 = time_step * time_step;
    const axt_real force_of_torque = alpha * dt2 / axis->I1;
    const axt_real force_of_rate = alpha * time_step * axis->B * per_reduced;
    const axt_real force_of_twist = alpha * dt2 * axis->K * per_reduced;
    const axt_real gain = AXT_R(1) / (AXT_R(1) + delta / alpha * force_of_rate + force_of_twist);
    const axt_real half_turn = AXT_PI * inertia / dt2;

    *plant = (axt_plant){
        .predict_twist = (AXT_R(0.5) - alpha) / alpha,
        .predict_rate = (AXT_R(1) - delta) / alpha,
        .correct_rate = delta / alpha,
        .gain_torque = gain * force_of_torque,
        .gain_damping = gain * force_of_rate,
        .gain_stiffness = gain * force_of_twist,
        .half_turn = half_turn,
        .alpha = alpha,
        .delta = delta,
        .steps_per_second = AXT_R(1) / time_step,
        .travel_per_turn = AXT_R(0.5) / half_turn,
        .speed_unit = time_step / inertia,
        .motor_share = axis->I2 / inertia,
        .force_of_torque = force_of_torque,
        .force_of_rate = force_of_rate,
        .force_of_twist = force_of_twist,
    };
    return AXT_OK;
}

/* What r and W differ by, in units of W: alpha T + (delta - 1/2) (S - T). */
static axt_real travel_correction(const axt_plant *plant) {
    return plant->alpha * plant->torque +
           (plant->delta - AXT_R(0.5)) * (plant->impulse - plant->torque);
}

/* The largest torque is the one that would turn the axis by half a turn in one step from rest. */
static axt_status check_torque(const axt_plant *plant, axt_real torque) {
    if (axt_abs(torque) <= plant->half_turn) {
        return AXT_OK;
    }
    return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
}

axt_status axt_plant_set(axt_plant *plant, const axt_motion *motion, axt_real torque) {
    const axt_status status = check_torque(plant, torque);
    if (status != AXT_OK) {
        return status;
    }
    if (!axt_finite(motion->twist) || !axt_finite(motion->twist_speed) ||
        !axt_finite(motion->speed) || !axt_finite(motion->fraction) ||
        !axt_finite(motion->fraction_low)) {
        return AXT_ERROR_NOT_FINITE;
    }
    const axt_real body_speed = motion->speed - plant->motor_share * motion->twist_speed;
    const axt_real impulse = body_speed / plant->speed_unit + (AXT_R(1) - plant->delta) * torque;
    if (!(axt_abs(impulse) < plant->half_turn) || !(axt_abs(motion->fraction) <= AXT_R(1)) ||
        !(axt_abs(motion->fraction_low) <= AXT_R(1)) || !(axt_abs(motion->twist) <= AXT_R(1e3)) ||
        !(axt_abs(motion->twist_speed) <= AXT_R(1e9))) {
        return AXT_ERROR_RANGE;
    }

    plant->twist = motion->twist;
    plant->twist_rate = motion->twist_speed / plant->steps_per_second;
    plant->twist_force = plant->force_of_torque * torque -
                         plant->force_of_rate * plant->twist_rate -
                         plant->force_of_twist * motion->twist;
    plant->torque = torque;
    plant->impulse = impulse;
    plant->impulse_low = AXT_R(0);
    const axt_real body_low =
        motion->fraction_low - plant->motor_share * motion->twist / AXT_TWO_PI;
    const axt_two whole = axt_two_product(motion->fraction, AXT_R(2) * plant->half_turn);
    const axt_two travel = axt_two_sum(
        whole.hi, whole.lo + body_low * (AXT_R(2) * plant->half_turn) - travel_correction(plant));
    plant->travel = travel.hi;
    plant->travel_low = travel.lo;
    plant->turns = motion->turns;
    return AXT_OK;
}

static void step_twist(axt_plant *plant, axt_real torque) {
    const axt_real force = plant->twist_force;
    const axt_real twist = axt_fma(plant->predict_twist, force, plant->twist + plant->twist_rate);
    const axt_real rate = axt_fma(plant->predict_rate, force, plant->twist_rate);
    const axt_real next = axt_fma(-plant->gain_stiffness, twist,
                                  axt_fma(-plant->gain_damping, rate, plant->gain_torque * torque));
    plant->twist = twist + next;
    plant->twist_rate = axt_fma(plant->correct_rate, next, rate);
    plant->twist_force = next;
}

/* Brings `travel` back within half a turn of zero: once a turn. The subtraction is exact, as travel
 * and turn lie within a factor of two of each other (Sterbenz). */
static void wrap_travel(axt_plant *plant, axt_two *travel) {
    const axt_real half_turn = plant->half_turn;
    if (travel->hi > half_turn) {
        travel->hi -= half_turn + half_turn;
        plant->turns = axt_wrap_add(plant->turns, 1);
    } else if (travel->hi < -half_turn) {
        travel->hi += half_turn + half_turn;
        plant->turns = axt_wrap_add(plant->turns, -1);
    }
}

/* At half a turn a step the speed saturates, unless it is the torque that is none. */
static axt_status limit_impulse(axt_plant *plant, axt_real torque, axt_two *impulse) {
    const axt_status status = check_torque(plant, torque);
    if (status == AXT_OK) {
        impulse->hi = (impulse->hi > AXT_R(0)) ? plant->half_turn : -plant->half_turn;
        impulse->lo = AXT_R(0);
    } else {
        plant->rejected++;
    }
    return status;
}

axt_status axt_plant_step(axt_plant *plant, axt_real torque) {
    /* W <- W + S */
    axt_two travel = axt_two_sum(plant->travel, plant->impulse);
    travel = axt_fast_two_sum(travel.hi, travel.lo + (plant->travel_low + plant->impulse_low));
    /* S <- S + T */
    axt_two impulse = axt_two_sum(plant->impulse, torque);
    impulse = axt_fast_two_sum(impulse.hi, impulse.lo + plant->impulse_low);

    /* one comparison for all that is out of the ordinary, not-a-number included */
    if (!(axt_abs(travel.hi) + axt_abs(impulse.hi) <= plant->half_turn)) {
        if (!(axt_abs(impulse.hi) <= plant->half_turn)) {
            const axt_status status = limit_impulse(plant, torque, &impulse);
            if (status != AXT_OK) {
                return status;
            }
        }
        wrap_travel(plant, &travel);
    }
    plant->travel = travel.hi;
    plant->travel_low = travel.lo;
    plant->impulse = impulse.hi;
    plant->impulse_low = impulse.lo;
    step_twist(plant, torque);
    plant->torque = torque;
    return AXT_OK;
}

void axt_plant_read(const axt_plant *plant, axt_motion *motion) {
    /* fraction = travel / turn with the remainder of the division kept */
    const axt_real quotient = plant->travel * plant->travel_per_turn;
    const axt_two back = axt_two_product(quotient, AXT_R(2) * plant->half_turn);
    const axt_real remainder = ((plant->travel - back.hi) - back.lo) + plant->travel_low;
    const axt_real low = (remainder + travel_correction(plant)) * plant->travel_per_turn +
                         plant->motor_share * plant->twist / AXT_TWO_PI;
    const axt_two fraction = axt_two_sum(quotient, low);

    const axt_real impulse =
        (plant->impulse - (AXT_R(1) - plant->delta) * plant->torque) + plant->impulse_low;
    motion->twist = plant->twist;
    motion->twist_speed = plant->twist_rate * plant->steps_per_second;
    motion->speed = plant->speed_unit * impulse + plant->motor_share * motion->twist_speed;
    motion->turns = plant->turns;
    motion->fraction = fraction.hi;
    motion->fraction_low = fraction.lo;
}
