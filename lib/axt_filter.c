#include "axt_filter.h"

#include "axt_filter_step.h"
#include "axt_math.h"

axt_status axt_filter_init(axt_filter *filter, axt_real corner, axt_real time_step) {
    const axt_real h = AXT_R(0.5) * time_step;
    const axt_real g = corner * h;
    const axt_real cube = corner * corner * corner;
    if (!(corner > AXT_R(0)) || !(time_step > AXT_R(0)) || !(g <= AXT_R(1.5)) ||
        !axt_finite(cube)) {
        return AXT_ERROR_RANGE;
    }
    const axt_real gain = AXT_R(1) / (AXT_R(1) + g * (AXT_R(2) + g * (AXT_R(2) + g)));
    *filter = (axt_filter){
        .w = corner,
        .half_dt = h,
        .pull = gain * cube,
        .drag = gain * corner * corner * (AXT_R(2) + g),
        .deceleration = gain * corner * (AXT_R(2) + g * (AXT_R(2) + g)),
    };
    return AXT_OK;
}

void axt_filter_start(axt_filter_state *state, axt_real value) {
    *state = (axt_filter_state){.value = value};
}

axt_filtered axt_filter_step(const axt_filter *filter, axt_filter_state *state, axt_real input) {
    return filter_step(filter, state, input);
}

void axt_filter_shift(axt_filter_state *state, axt_real shift) {
    state->value += shift;
}
