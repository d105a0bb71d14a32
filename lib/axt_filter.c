#include "axt_filter.h"

#include "axt_math.h"

axt_status axt_filter_init(axt_filter *filter, axt_real corner, axt_real time_step) {
    const axt_real g = AXT_R(0.5) * corner * time_step;
    if (!(corner > AXT_R(0)) || !(time_step > AXT_R(0)) || !(g <= AXT_R(1.5)) ||
        !axt_finite(corner * corner * corner)) {
        return AXT_ERROR_RANGE;
    }
    *filter = (axt_filter){
        .half_dt = AXT_R(0.5) * time_step,
        .w = corner,
        .w2 = AXT_R(2) * corner * corner,
        .w3 = corner * corner * corner,
        .gain = AXT_R(1) / (AXT_R(1) + g * (AXT_R(2) + g * (AXT_R(2) + g))),
    };
    return AXT_OK;
}

void axt_filter_start(axt_filter_state *state, axt_real value) {
    *state = (axt_filter_state){.value = value};
}

/* value''' = w^3 (input - value) - 2 w^2 value' - 2 w value'', by the trapezoidal rule: each
 * integral advances by Dt / 2 times the sum of its old and new rate. The new jerk solves the one
 * implicit equation; what does not depend on it is gathered first. */
void axt_filter_step(const axt_filter *filter, axt_filter_state *state, axt_real input) {
    const axt_real h = filter->half_dt;
    const axt_real acceleration = axt_fma(h, state->jerk, state->acceleration);
    const axt_real rate = axt_fma(h, state->acceleration + acceleration, state->rate);
    const axt_real value = axt_fma(h, state->rate + rate, state->value);
    const axt_real pull = filter->w3 * (input - value);
    const axt_real drag = axt_fma(filter->w2, rate, (AXT_R(2) * filter->w) * acceleration);
    const axt_real jerk = filter->gain * (pull - drag);
    state->jerk = jerk;
    state->acceleration = axt_fma(h, jerk, acceleration);
    state->rate = axt_fma(h * h, jerk, rate);
    state->value = axt_fma(h * h * h, jerk, value);
}

void axt_filter_shift(axt_filter_state *state, axt_real shift) {
    state->value += shift;
}
