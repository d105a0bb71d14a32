/* One step of the plant, from any state within bounds and with any torque, ends within the same
 * bounds; nothing in between is infinite or not a number unless the torque is refused.
 *
 * Preconditions: half_turn and shift as axt_plant_init() makes them, for every power of two that
 * its ranges allow; gains below what their formulas cannot exceed; the state within the bounds that
 * are asserted after the call.
 *
 * gain_torque <= pi (I1 + I2) / I1 / 1024, gain_rate <= 1 / delta + (delta - 1/2) / alpha,
 * gain_twist <= 1 / alpha. An analysis by intervals needs half_turn in two pieces, since it does
 * not see that `travel` and what is taken off it are the same half_turn. */
#include <math.h>

#include "any.h"
#include "axt_plant.h"

enum { LEAST_POWER = -28, MOST_POWER = 69 }; /* of half a turn: 6e-9 .. 7e20 N m */

/* half_turn in least .. most, shift = 3 power. */
static axt_plant any_plant(float power, float least, float most) {
    const float h = 1.000001F * most;
    const float x = 2.0F * most - least;
    const float low = 0x1p-14F * power;
    axt_plant plant;
    plant.half_turn = any_float(least, most);
    plant.shift = 3.0F * power;
    plant.gain_torque = any_float(0.0F, 3.2e12F);
    plant.gain_rate = any_float(0.0F, 53.0F);
    plant.gain_twist = any_float(0.0F, 101.0F);
    plant.state.twist_ahead = any_float(-h, h);
    plant.state.rate_ahead = any_float(-2.1F * h, 2.1F * h);
    plant.state.change = any_float(-1e14F * h, 1e14F * h);
    plant.state.torque = any_float(-8.0F * power, 8.0F * power);
    plant.state.impulse = any_float(-h, h);
    plant.state.impulse_low = any_float(-low, low);
    plant.state.travel = any_float(-x, x);
    plant.state.travel_low = any_float(-low, low);
    plant.turns = Frama_C_interval(INT32_MIN, INT32_MAX);
    plant.rejected = Frama_C_unsigned_int_interval(0, UINT32_MAX);
    return plant;
}

static void prove_accepted(float power, float least, float most) {
    const float h = 1.000001F * most;
    const float x = 2.0F * most - least;
    const float low = 0x1p-14F * power;
    axt_plant plant = any_plant(power, least, most);
    (void)axt_plant_step(&plant, any_float(-8.0F * power, 8.0F * power));
    //@ assert twist_ahead: -h <= plant.state.twist_ahead <= h;
    //@ assert rate_ahead: -2.1 * h <= plant.state.rate_ahead <= 2.1 * h;
    //@ assert change: -1e14 * h <= plant.state.change <= 1e14 * h;
    //@ assert torque: -8 * power <= plant.state.torque <= 8 * power;
    //@ assert impulse: -h <= plant.state.impulse <= h;
    //@ assert impulse_low: -low <= plant.state.impulse_low <= low;
    //@ assert travel: -x <= plant.state.travel <= x;
    //@ assert travel_low: -low <= plant.state.travel_low <= low;
}

/* Torque of which no state could make something within bounds. */
static void prove_refused(float power, float torque) {
    axt_plant plant = any_plant(power, power, 2.0F * power);
    const axt_status status = axt_plant_step(&plant, torque);
    //@ assert refused: status != AXT_OK;
}

static void prove_not_finite(float torque) {
    axt_plant plant = any_plant(1.0F, 1.0F, 2.0F);
    const axt_status status = axt_plant_step(&plant, torque);
    //@ assert not_finite: status != AXT_OK;
}

int main(void) {
    prove_not_finite(INFINITY);
    prove_not_finite(-INFINITY);
    prove_not_finite(NAN);
    float power = 1.0F;
    for (int k = 0; k > LEAST_POWER; k--) {
        power *= 0.5F;
    }
    for (int k = LEAST_POWER; k <= MOST_POWER; k++) {
        prove_accepted(power, power, 1.5F * power);
        prove_accepted(power, 1.5F * power, 2.0F * power);
        prove_refused(power, any_float(8.0F * power, 3.4028234e38F));
        prove_refused(power, any_float(-3.4028234e38F, -8.0F * power));
        power *= 2.0F;
    }
    return 0;
}
