#include "axt_axis.h"

#include "axt_math.h"

/* Table 1 of the paper. */
const axt_axis axt_axis_paper = {
    .I1 = AXT_R(2.7e-5), .I2 = AXT_R(8.3e-6), .B = AXT_R(2.1e-3), .K = AXT_R(110.0)};
const axt_real axt_lead_paper = AXT_R(7.96e-4);

static bool within(axt_real value, axt_real least, axt_real most) {
    return value >= least && value <= most;
}

axt_status axt_axis_check(const axt_axis *axis) {
    if (!axt_finite(axis->I1) || !axt_finite(axis->I2) || !axt_finite(axis->B) ||
        !axt_finite(axis->K)) {
        return AXT_ERROR_NOT_FINITE;
    }
    const bool in_range =
        within(axis->I1, AXT_R(1e-9), AXT_R(1e6)) && within(axis->I2, AXT_R(1e-9), AXT_R(1e6)) &&
        within(axis->B, AXT_R(0), AXT_R(1e9)) && within(axis->K, AXT_R(1e-6), AXT_R(1e12));
    return in_range ? AXT_OK : AXT_ERROR_RANGE;
}

axt_status axt_axis_modal(const axt_axis *axis, axt_modal *modal) {
    const axt_status status = axt_axis_check(axis);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real wn = axt_sqrt(axis->K * (AXT_R(1) / axis->I1 + AXT_R(1) / axis->I2));
    const axt_real zeta = axis->B * wn / (AXT_R(2) * axis->K);
    /* (1 - zeta)(1 + zeta) keeps the digits that 1 - zeta^2 loses near zeta = 1 */
    const axt_real rest = (AXT_R(1) - zeta) * (AXT_R(1) + zeta);
    const axt_real wd = (rest > AXT_R(0)) ? wn * axt_sqrt(rest) : AXT_R(0);
    *modal = (axt_modal){.wn = wn, .wd = wd, .zeta = zeta};
    return AXT_OK;
}

axt_status axt_axis_from_modal(axt_real I1, axt_real I2, const axt_modal *modal, axt_axis *axis) {
    if (!(modal->wn > AXT_R(0))) { /* wn enters as its square and with zeta: -wn would pass */
        return AXT_ERROR_RANGE;
    }
    const axt_real reduced = AXT_R(1) / (AXT_R(1) / I1 + AXT_R(1) / I2);
    const axt_axis found = {.I1 = I1,
                            .I2 = I2,
                            .B = AXT_R(2) * modal->zeta * modal->wn * reduced,
                            .K = modal->wn * modal->wn * reduced};
    const axt_status status = axt_axis_check(&found);
    if (status == AXT_OK) {
        *axis = found;
    }
    return status;
}

axt_real axt_time_step(uint32_t N, uint32_t k, axt_real wn) {
    if (N == 0 || k == 0 || !(wn > AXT_R(0)) || !axt_finite(wn)) {
        return AXT_R(0);
    }
    return AXT_TWO_PI * (axt_real)k / ((axt_real)N * wn);
}

axt_real axt_lead_to_travel(axt_real lead, axt_real angle) {
    return lead * angle;
}
