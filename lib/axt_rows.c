#include "axt_rows.h"

#include "axt_integrator.h"
#include "axt_math.h"

enum { ROUNDS_MAX = 30 };

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

/* x'' + d x' + k x = force / I1 */
typedef struct {
    axt_real k;
    axt_real d;
    axt_real per_I1;
} oscillator;

/* The first row of N = (2 / Dt) (F + 1)^-1 (F - 1) = a 1 + b A, where F - 1 is the exact map. */
static axt_status first_row(const oscillator *o, axt_real time_step, axt_real *a, axt_real *b) {
    axt_exact_map map;
    const axt_status status = axt_exact_map_init(&map, o->d, o->k, time_step);
    if (status != AXT_OK) {
        return status;
    }
    const axt_real m11 = map.a[0][0] + AXT_R(2); /* F + 1 */
    const axt_real m22 = map.a[1][1] + AXT_R(2);
    const axt_real m12 = map.a[0][1];
    const axt_real m21 = map.a[1][0];
    const axt_real scale = AXT_R(2) / (time_step * (m11 * m22 - m12 * m21));
    *a = scale * (m22 * map.a[0][0] - m12 * m21);
    *b = scale * (m22 * m12 - m12 * map.a[1][1]);
    return AXT_OK;
}

/* The oscillator of a row when N is a 1 + b A. */
static oscillator solve(const axt_real row[3], axt_rows_kind kind, axt_real a, axt_real b) {
    if (kind == AXT_ROWS_OF_SPEEDS) {
        return (oscillator){.k = -row[0] / b, .d = (a - row[1]) / b, .per_I1 = row[2] / b};
    }
    const axt_real determinant = -row[0];
    const axt_real d = (AXT_R(2) * a - row[1]) / b;
    const axt_real k = (determinant - a * a + a * b * d) / (b * b);
    return (oscillator){.k = k, .d = d, .per_I1 = k * row[2] / determinant};
}

axt_status axt_rows_from_held(axt_rows *rows, axt_rows_kind kind, axt_real time_step,
                              axt_real factor[3]) {
    oscillator now = solve(rows->twist, kind, AXT_R(0), AXT_R(1));
    axt_real change = AXT_REAL_MAX;
    for (uint32_t round = 0; round < ROUNDS_MAX && change > AXT_EPSILON * now.k; round++) {
        axt_real a;
        axt_real b;
        if (first_row(&now, time_step, &a, &b) != AXT_OK) {
            return AXT_ERROR_NO_DATA;
        }
        const oscillator next = solve(rows->twist, kind, a, b);
        change = axt_abs(next.k - now.k) + axt_abs(next.d - now.d) * axt_sqrt(axt_abs(next.k));
        now = next;
    }
    const axt_real found[3] = {-now.k, -now.d, now.per_I1};
    for (uint32_t i = 0; i < 3; i++) {
        factor[i] = found[i] / rows->twist[i];
        rows->twist[i] = found[i];
        rows->body[i] *= factor[i];
    }
    return AXT_OK;
}
