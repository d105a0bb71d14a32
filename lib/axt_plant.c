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
 * where p, p' are q1, q1' without their q1'' terms.
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
    const bool step_in_range =
        time_step >= AXT_R(1e-7) && time_step <= AXT_R(1) && modal.wn * time_step <= AXT_R(1e3);
    const bool newmark_in_range =
        alpha >= AXT_R(0) && alpha <= AXT_R(1) && delta >= AXT_R(0.5) && delta <= AXT_R(1);
    if (!step_in_range || !newmark_in_range) {
        return AXT_ERROR_RANGE;
    }

    const axt_real inertia = axis->I1 + axis->I2;
    const axt_real per_reduced = AXT_R(1) / axis->I1 + AXT_R(1) / axis->I2; /* 1 / Ir */
    const axt_real damping = axis->B * per_reduced;
    const axt_real stiffness = axis->K * per_reduced;
    const axt_real dt2 = time_step * time_step;
    const axt_real gain =
        AXT_R(1) / (AXT_R(1) + delta * time_step * damping + alpha * dt2 * stiffness);
    const axt_real turn = AXT_TWO_PI * inertia / dt2;

    *plant = (axt_plant){
        .predict_speed = time_step,
        .predict_twist = (AXT_R(0.5) - alpha) * dt2,
        .correct_twist = alpha * dt2,
        .predict_rate = (AXT_R(1) - delta) * time_step,
        .correct_rate = delta * time_step,
        .gain_torque = gain / axis->I1,
        .gain_damping = gain * damping,
        .gain_stiffness = gain * stiffness,
        .acceleration_torque = AXT_R(1) / axis->I1,
        .acceleration_damping = damping,
        .acceleration_stiffness = stiffness,
        .alpha = alpha,
        .delta = delta,
        .turn = turn,
        .per_turn = AXT_R(1) / turn,
        .speed_unit = time_step / inertia,
        .motor_share = axis->I2 / inertia,
    };
    return AXT_OK;
}

/* What r and W differ by, in units of W: alpha T + (delta - 1/2) (S - T). */
static axt_real travel_correction(const axt_plant *plant) {
    return plant->alpha * plant->torque +
           (plant->delta - AXT_R(0.5)) * (plant->impulse - plant->torque);
}

static axt_status check_torque(axt_real torque) {
    if (axt_abs(torque) <= AXT_R(AXT_PLANT_TORQUE_MAX)) {
        return AXT_OK;
    }
    return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
}

axt_status axt_plant_set(axt_plant *plant, const axt_motion *motion, axt_real torque) {
    const axt_status status = check_torque(torque);
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
    if (!(axt_abs(impulse) < AXT_R(0.5) * plant->turn) ||
        !(axt_abs(motion->fraction) <= AXT_R(1)) || !(axt_abs(motion->fraction_low) <= AXT_R(1)) ||
        !(axt_abs(motion->twist) <= AXT_R(1e3)) || !(axt_abs(motion->twist_speed) <= AXT_R(1e9))) {
        return AXT_ERROR_RANGE;
    }

    plant->twist = motion->twist;
    plant->twist_speed = motion->twist_speed;
    plant->twist_acceleration = plant->acceleration_torque * torque -
                                plant->acceleration_damping * motion->twist_speed -
                                plant->acceleration_stiffness * motion->twist;
    plant->torque = torque;
    plant->impulse = impulse;
    plant->impulse_low = AXT_R(0);
    const axt_real body_low =
        motion->fraction_low - plant->motor_share * motion->twist / AXT_TWO_PI;
    const axt_two whole = axt_two_product(motion->fraction, plant->turn);
    const axt_two travel =
        axt_two_sum(whole.hi, whole.lo + body_low * plant->turn - travel_correction(plant));
    plant->travel = travel.hi;
    plant->travel_low = travel.lo;
    plant->turns = motion->turns;
    return AXT_OK;
}

/* Newmark's step of the twist, Eqs. 4-6 solved for the acceleration at its end. */
static void step_twist(axt_plant *plant, axt_real torque) {
    const axt_real twist = axt_fma(plant->predict_twist, plant->twist_acceleration,
                                   axt_fma(plant->predict_speed, plant->twist_speed, plant->twist));
    const axt_real rate =
        axt_fma(plant->predict_rate, plant->twist_acceleration, plant->twist_speed);
    const axt_real acceleration =
        axt_fma(-plant->gain_stiffness, twist,
                axt_fma(-plant->gain_damping, rate, plant->gain_torque * torque));
    plant->twist = axt_fma(plant->correct_twist, acceleration, twist);
    plant->twist_speed = axt_fma(plant->correct_rate, acceleration, rate);
    plant->twist_acceleration = acceleration;
}

/* W <- W + S, then S <- S + T. */
static void step_body(axt_plant *plant, axt_real torque) {
    const axt_real half_turn = AXT_R(0.5) * plant->turn;

    axt_two travel = axt_two_sum(plant->travel, plant->impulse);
    travel = axt_fast_two_sum(travel.hi, travel.lo + (plant->travel_low + plant->impulse_low));
    /* subtracting a turn is exact: both numbers lie within a factor of two of each other (Sterbenz)
     */
    if (travel.hi >= half_turn) {
        travel.hi -= plant->turn;
        plant->turns = axt_wrap_add(plant->turns, 1);
    } else if (travel.hi < -half_turn) {
        travel.hi += plant->turn;
        plant->turns = axt_wrap_add(plant->turns, -1);
    }
    plant->travel = travel.hi;
    plant->travel_low = travel.lo;

    axt_two impulse = axt_two_sum(plant->impulse, torque);
    impulse = axt_fast_two_sum(impulse.hi, impulse.lo + plant->impulse_low);
    if (axt_abs(impulse.hi) > half_turn) {
        impulse.hi = (impulse.hi > AXT_R(0)) ? half_turn : -half_turn;
        impulse.lo = AXT_R(0);
    }
    plant->impulse = impulse.hi;
    plant->impulse_low = impulse.lo;
}

axt_status axt_plant_step(axt_plant *plant, axt_real torque) {
    const axt_status status = check_torque(torque);
    if (status != AXT_OK) {
        plant->rejected++;
        return status;
    }
    step_twist(plant, torque);
    step_body(plant, torque);
    plant->torque = torque;
    return AXT_OK;
}

void axt_plant_read(const axt_plant *plant, axt_motion *motion) {
    /* fraction = travel / turn with the remainder of the division kept */
    const axt_real quotient = plant->travel * plant->per_turn;
    const axt_two back = axt_two_product(quotient, plant->turn);
    const axt_real remainder = ((plant->travel - back.hi) - back.lo) + plant->travel_low;
    const axt_real low = (remainder + travel_correction(plant)) * plant->per_turn +
                         plant->motor_share * plant->twist / AXT_TWO_PI;
    const axt_two fraction = axt_two_sum(quotient, low);

    const axt_real impulse =
        (plant->impulse - (AXT_R(1) - plant->delta) * plant->torque) + plant->impulse_low;
    motion->twist = plant->twist;
    motion->twist_speed = plant->twist_speed;
    motion->speed = plant->speed_unit * impulse + plant->motor_share * plant->twist_speed;
    motion->turns = plant->turns;
    motion->fraction = fraction.hi;
    motion->fraction_low = fraction.lo;
}
