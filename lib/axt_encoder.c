#include "axt_encoder.h"

#include "axt_math.h"

axt_status axt_encoder_read(uint32_t counts_per_turn, const axt_motion *motion,
                            axt_encoder_place place, int32_t *count) {
    if (counts_per_turn < 1 || counts_per_turn > AXT_ENCODER_COUNTS_MAX) {
        return AXT_ERROR_RANGE;
    }
    const axt_real scale = (axt_real)counts_per_turn;
    const axt_two whole = axt_two_product(scale, motion->fraction);
    if (!(axt_abs(whole.hi) < AXT_R(1073741824))) {
        return axt_finite(whole.hi) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
    }
    const int32_t truncated = (int32_t)whole.hi;
    axt_real rest = (whole.hi - (axt_real)truncated) + whole.lo + scale * motion->fraction_low;
    if (place == AXT_ENCODER_TABLE) {
        rest -= scale * motion->twist / AXT_TWO_PI;
    }
    if (!(axt_abs(rest) < AXT_R(1073741824))) {
        return axt_finite(rest) ? AXT_ERROR_RANGE : AXT_ERROR_NOT_FINITE;
    }
    /* nearest integer; a conversion truncates towards zero */
    const int32_t near = (int32_t)(rest + ((rest < AXT_R(0)) ? AXT_R(-0.5) : AXT_R(0.5)));
    const uint32_t turns = (uint32_t)motion->turns * counts_per_turn;
    *count = (int32_t)(turns + (uint32_t)truncated + (uint32_t)near);
    return AXT_OK;
}

int32_t axt_encoder_difference(int32_t later, int32_t earlier) {
    return axt_wrap_sub(later, earlier);
}

axt_real axt_encoder_angle(uint32_t counts_per_turn, int32_t counts) {
    return (axt_real)counts * (AXT_TWO_PI / (axt_real)counts_per_turn);
}
