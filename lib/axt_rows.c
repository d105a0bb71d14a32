#include "axt_rows.h"

#include "axt_integrator.h"
#include "axt_math.h"

enum { ROUNDS_MAX = 60 };

/* Of the parameters from round to round, relative, when they have settled. */
#define CHANGE_MAX (AXT_R(8) * AXT_EPSILON)

axt_status axt_axis_from_rows(const axt_rows *rows, axt_real share, axt_axis *axis) {
    const axt_real motor_q = rows->body[0] + share * rows->twist[0];
    const axt_real table_q = motor_q - rows->twist[0];
    axt_axis found;
    found.I1 = AXT_R(1) / rows->twist[2];
    found.K = -motor_q * found.I1;
    found.I2 = found.K / table_q;
    found.B = -rows->twist[1] * (found.I1 * found.I2 / (found.I1 + found.I2));
    if (axt_axis_check(&found) != AXT_OK) {
        return AXT_ERROR_NO_DATA;
    }
    *axis = found;
    return AXT_OK;
}

/* The row of q'' that held torque makes of x'' + damping x' + stiffness x = f, but for the torque.
 * With F = 1 + E the exact map, N = (2 / Dt) E (2 + E)^-1. */
static axt_status held_row(axt_real stiffness, axt_real damping, axt_rows_kind kind,
                           axt_real time_step, axt_real row[2]) {
    axt_exact_map map;
    const axt_status status = axt_exact_map_init(&map, damping, stiffness, time_step);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real trace = map.a[0][0] + map.a[1][1];
    const axt_real determinant = map.a[0][0] * map.a[1][1] - map.a[0][1] * map.a[1][0];
    const axt_real per_half_step = AXT_R(2) / time_step;
    const axt_real scale = per_half_step / (AXT_R(4) + AXT_R(2) * trace + determinant);
    if (kind == AXT_ROWS_OF_SPEEDS) {
        row[0] = scale * AXT_R(2) * map.a[1][0];
        row[1] = scale * (AXT_R(2) * map.a[1][1] + determinant);
    } else {
        row[0] = -scale * per_half_step * determinant;
        row[1] = scale * AXT_R(2) * (trace + determinant);
    }
    return AXT_OK;
}

/* What `entry` has to be multiplied with to give -parameter; an axis without damping has neither.
 */
static axt_real factor_of(axt_real parameter, axt_real entry) {
    return (parameter > AXT_R(0)) ? -parameter / entry : AXT_R(1);
}

axt_status axt_rows_from_held(axt_rows *rows, axt_rows_kind kind, axt_real time_step,
                              axt_real factor[3]) {
    axt_real stiffness = -rows->twist[0];
    axt_real damping = -rows->twist[1];
    axt_real by[2] = {AXT_R(1), AXT_R(1)};
    axt_real change = AXT_R(1);
    for (uint32_t round = 0; round < ROUNDS_MAX && change > CHANGE_MAX; round++) {
        axt_real row[2];
        if (held_row(stiffness, damping, kind, time_step, row) != AXT_OK) {
            return AXT_ERROR_NO_DATA;
        }
        by[0] = factor_of(stiffness, row[0]);
        by[1] = factor_of(damping, row[1]);
        const axt_real k = -rows->twist[0] * by[0];
        const axt_real d = -rows->twist[1] * by[1];
        change = axt_abs(k / stiffness - AXT_R(1)) + axt_abs(d - damping) / axt_sqrt(stiffness);
        stiffness = k;
        damping = d;
    }
    if (!(change <= CHANGE_MAX)) {
        return AXT_ERROR_NO_DATA;
    }
    /* the torque's entry goes with that of the twist: at rest nothing depends on the hold */
    const axt_real found[3] = {by[0], by[1], by[0]};
    for (uint32_t i = 0; i < 3; i++) {
        factor[i] = found[i];
        rows->twist[i] *= found[i];
        rows->body[i] *= found[i];
    }
    return AXT_OK;
}
