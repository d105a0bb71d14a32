#include "axt_rows.h"

#include "axt_math.h"

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
