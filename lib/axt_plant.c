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
 * where p, p' are q1, q1' without their q1'' terms: what the state before predicts. Predictions are
 * kept instead of q and q', since one follows from the last in three additions. In units of the
 * step, R = Dt p', P = p - (delta - 1/2) R, A = Dt^2 q'':
 *
 *     A <- (T Dt^2 / I1 - (d Dt + (delta - 1/2) k Dt^2) R - k Dt^2 P)
 *          / (1 + delta Dt d + alpha Dt^2 k)
 *     R <- R + A
 *     P <- P + R
 *
 * and back, Dt q' = R - (1 - delta) A, q = P + (delta - 3/2) R + (1/2 + alpha - delta) A.
 *
 * Rigid body. With r'' = T / I the same two equations can be summed in closed form:
 *
 *     S[n] = S[n-1] + T[n]          r'[n] = Dt / I   (S[n] - (1 - delta) T[n])
 *     W[n] = W[n-1] + S[n-1]        r[n]  = Dt^2 / I (W[n] + alpha T[n] + (delta - 1/2) (S[n] -
 * T[n]))
 *
 * S and W are plain sums of torque samples: no product is rounded before it is added. W is taken
 * modulo one turn; whole turns are counted. Each is kept as two words. The first is a multiple of a
 * power of two, the grid, so coarse that sums up to a whole turn are exact; the second is the rest,
 * with 24 bits of its own (float). What is lost is 2^-46 of a turn, so the axis does not creep in
 * days of running. */
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
    const axt_real half_turn = AXT_PI * inertia / dt2;
    const axt_real power = axt_power_of_two(half_turn);
    const axt_real twist_unit = AXT_R(1024) / power;
    const axt_real change_of_torque = dt2 / axis->I1 / twist_unit;
    const axt_real change_of_rate = time_step * axis->B * per_reduced;
    const axt_real change_of_twist = dt2 * axis->K * per_reduced;
    const axt_real gain = AXT_R(1) / (AXT_R(1) + delta * change_of_rate + alpha * change_of_twist);
    const axt_real excess = delta - AXT_R(0.5);

    *plant = (axt_plant){
        .gain_torque = gain * change_of_torque,
        .gain_rate = gain * (change_of_rate + excess * change_of_twist),
        .gain_twist = gain * change_of_twist,
        .half_turn = half_turn,
        .shift = AXT_R(3) * power,
        .alpha = alpha,
        .excess = excess,
        .late = AXT_R(1) - delta,
        .lag = alpha - excess,
        .twist_unit = twist_unit,
        .twist_speed_unit = twist_unit / time_step,
        .travel_per_turn = AXT_R(0.5) / half_turn,
        .speed_unit = time_step / inertia,
        .motor_share = axis->I2 / inertia,
        .change_of_torque = change_of_torque,
        .change_of_rate = change_of_rate,
        .change_of_twist = change_of_twist,
    };
    return AXT_OK;
}

/* What r and W differ by, in units of W: alpha T + (delta - 1/2) (S - T). */
static axt_real travel_correction(const axt_plant *plant) {
    const axt_real before = (plant->state.impulse - plant->state.torque) + plant->state.impulse_low;
    return axt_fma(plant->excess, before, plant->alpha * plant->state.torque);
}

/* The largest torque is the one that would turn the axis by half a turn in one step from rest. */
static axt_status check_torque(const axt_plant *plant, axt_real torque) {
    if (axt_abs(torque) <= plant->half_turn) {
        return AXT_OK;
    }
    return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
}

/* x rounded to the grid: adding `shift` leaves no room for anything finer. */
static inline axt_real round_to_grid(axt_real x, axt_real shift) {
    return (x + shift) - shift;
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
    const axt_real impulse = body_speed / plant->speed_unit + plant->late * torque;
    const axt_real q = motion->twist / plant->twist_unit;
    const axt_real rate = motion->twist_speed / plant->twist_speed_unit;
    const axt_real change = plant->change_of_torque * torque - plant->change_of_rate * rate -
                            plant->change_of_twist * q;
    const axt_real rate_ahead = rate + plant->late * change;
    const axt_real twist_ahead = q + (AXT_R(1) - plant->excess) * rate_ahead - plant->lag * change;
    const axt_real twist_limit = AXT_R(1000) / plant->twist_unit;
    if (!(axt_abs(impulse) < plant->half_turn) || !(axt_abs(motion->fraction) <= AXT_R(1)) ||
        !(axt_abs(motion->fraction_low) <= AXT_R(1)) || !(axt_abs(q) <= twist_limit) ||
        !(axt_abs(rate_ahead) <= plant->half_turn) || !(axt_abs(twist_ahead) <= plant->half_turn)) {
        return AXT_ERROR_RANGE;
    }

    plant->state.twist_ahead = twist_ahead;
    plant->state.rate_ahead = rate_ahead;
    plant->state.change = change;
    plant->state.torque = torque;
    plant->state.impulse = round_to_grid(impulse, plant->shift);
    plant->state.impulse_low = impulse - plant->state.impulse;
    /* W in turns, and modulo one turn */
    const axt_real low = motion->fraction_low - plant->motor_share * motion->twist / AXT_TWO_PI -
                         travel_correction(plant) * plant->travel_per_turn;
    const axt_two turns = axt_two_sum(motion->fraction, low);
    const int32_t nearest =
        (int32_t)(turns.hi + ((turns.hi < AXT_R(0)) ? AXT_R(-0.5) : AXT_R(0.5)));
    const axt_real turn = AXT_R(2) * plant->half_turn;
    const axt_two travel = axt_two_product(turns.hi - (axt_real)nearest, turn);
    plant->state.travel = round_to_grid(travel.hi, plant->shift);
    plant->state.travel_low = (travel.hi - plant->state.travel) + (travel.lo + turns.lo * turn);
    plant->turns = axt_wrap_add(motion->turns, nearest);
    return AXT_OK;
}

/* Ends a step: a turn, when there is one, goes from `travel` to `turns`. */
AXT_UNROLLED void settle(axt_plant *plant, axt_plant_state *next) {
    const axt_real half_turn = plant->half_turn;
    if (axt_abs(next->travel) > half_turn) {
        int32_t turns = plant->turns;
        if (next->travel > AXT_R(0)) { /* exact on the grid */
            next->travel = (next->travel - half_turn) - half_turn;
            turns = axt_wrap_add(turns, 1);
        } else {
            next->travel = (next->travel + half_turn) + half_turn;
            turns = axt_wrap_add(turns, -1);
        }
        plant->turns = turns;
    }
    plant->state = *next;
}

static axt_real limit(axt_real x, axt_real most) {
    if (x > most) {
        return most;
    }
    return (x < -most) ? -most : x;
}

/* Where something exceeds half a turn the rest saturates. */
static inline void saturate(axt_plant_state *next, axt_real half_turn, axt_real shift) {
    next->rate_ahead = limit(next->rate_ahead, half_turn);
    next->twist_ahead = limit(next->twist_ahead, half_turn);
    if (axt_abs(next->impulse) > half_turn) {
        next->impulse = limit(next->impulse, round_to_grid(half_turn, shift));
        next->impulse_low = AXT_R(0);
    }
}

axt_status axt_plant_step(axt_plant *plant, axt_real torque) {
    const axt_plant_state last = plant->state;
    const axt_real shift = plant->shift;
    axt_plant_state next;
    next.torque = torque;

    next.change = axt_fma(-plant->gain_twist, last.twist_ahead,
                          axt_fma(-plant->gain_rate, last.rate_ahead, plant->gain_torque * torque));
    next.rate_ahead = last.rate_ahead + next.change;
    next.twist_ahead = last.twist_ahead + next.rate_ahead;

    const axt_real rest = last.travel_low + last.impulse_low;
    const axt_real carry = round_to_grid(rest, shift);
    next.travel = (last.travel + last.impulse) + carry;
    next.travel_low = rest - carry;

    const axt_real whole = round_to_grid(torque + last.impulse_low, shift);
    next.impulse = last.impulse + whole;
    next.impulse_low = (torque - whole) + last.impulse_low;

    /* One comparison for all that is out of the ordinary, not-a-number included. It bounds R, too,
     * which is the difference of two P, and the torque, the difference of two S. */
    if (!(axt_abs(next.impulse) + axt_abs(next.twist_ahead) <= plant->half_turn)) {
        if (!(axt_abs(torque) <= plant->half_turn)) {
            plant->rejected++;
            return axt_finite(torque) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
        }
        saturate(&next, plant->half_turn, shift);
    }
    settle(plant, &next);
    return AXT_OK;
}

void axt_plant_read(const axt_plant *plant, axt_motion *motion) {
    const axt_real rate = axt_fma(-plant->late, plant->state.change, plant->state.rate_ahead);
    const axt_real predicted =
        axt_fma(plant->excess, plant->state.rate_ahead, plant->state.twist_ahead);
    const axt_real twist =
        axt_fma(plant->lag, plant->state.change, predicted - plant->state.rate_ahead);
    motion->twist = plant->twist_unit * twist;
    motion->twist_speed = plant->twist_speed_unit * rate;

    /* fraction = travel / turn with the remainder of the division kept */
    const axt_real quotient = plant->state.travel * plant->travel_per_turn;
    const axt_two back = axt_two_product(quotient, AXT_R(2) * plant->half_turn);
    const axt_real remainder =
        ((plant->state.travel - back.hi) - back.lo) + plant->state.travel_low;
    const axt_real low = (remainder + travel_correction(plant)) * plant->travel_per_turn +
                         plant->motor_share * motion->twist / AXT_TWO_PI;
    const axt_two fraction = axt_two_sum(quotient, low);
    motion->turns = plant->turns;
    motion->fraction = fraction.hi;
    motion->fraction_low = fraction.lo;

    const axt_real impulse =
        (plant->state.impulse - plant->late * plant->state.torque) + plant->state.impulse_low;
    motion->speed = plant->speed_unit * impulse + plant->motor_share * motion->twist_speed;
}
