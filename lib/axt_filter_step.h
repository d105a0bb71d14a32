/* axt_filter_step.h - the step of axt_filter.h, to be taken inline. Private to lib/.
 *
 * value''' = w^3 (input - value) - 2 w^2 value' - 2 w value'', by the trapezoidal rule: each
 * integral advances by Dt / 2 times the sum of its old and new rate. With the half that is already
 * known put into the memory at the end of the step before, new = memory + Dt / 2 new rate, and the
 * next memory is new + Dt / 2 new rate. The new jerk solves the one implicit equation.
 */
#ifndef AXT_FILTER_STEP_H
#define AXT_FILTER_STEP_H

#include "axt_filter.h"
#include "axt_math.h"

AXT_UNROLLED axt_filtered filter_step(const axt_filter *filter, axt_filter_state *state,
                                      axt_real input) {
    const axt_real h = filter->half_dt;
    axt_filtered out;
    out.jerk = axt_fma(-filter->deceleration, state->acceleration,
                       axt_fma(-filter->drag, state->rate, filter->pull * (input - state->value)));
    out.acceleration = axt_fma(h, out.jerk, state->acceleration);
    out.rate = axt_fma(h, out.acceleration, state->rate);
    out.value = axt_fma(h, out.rate, state->value);
    state->acceleration = axt_fma(h, out.jerk, out.acceleration);
    state->rate = axt_fma(h, out.acceleration, out.rate);
    state->value = axt_fma(h, out.rate, out.value);
    return out;
}

#endif
