/* From rows to parameters: any axis, by Eq. 3, there and back. */
#include "axt_rows.h"

#include "check.h"
#include "reference.h"

/* Rows of q'' and r'' = theta1'' - share q'' on q, q', T, from Eq. 3. */
static axt_rows rows_of(const axt_axis *axis, wide share) {
    const wide per_motor = 1 / (wide)axis->I1;
    const wide per_reduced = per_motor + 1 / (wide)axis->I2;
    const wide twist[3] = {-(wide)axis->K * per_reduced, -(wide)axis->B * per_reduced, per_motor};
    const wide motor[3] = {-(wide)axis->K * per_motor, -(wide)axis->B * per_motor, per_motor};
    axt_rows rows;
    for (int i = 0; i < 3; i++) {
        rows.twist[i] = (axt_real)twist[i];
        rows.body[i] = (axt_real)(motor[i] - share * twist[i]);
    }
    return rows;
}

static void check_axis(const axt_axis *found, const axt_axis *expected, double tolerance) {
    CHECK_NEAR((wide)found->I1 / (wide)expected->I1, 1, tolerance);
    CHECK_NEAR((wide)found->I2 / (wide)expected->I2, 1, tolerance);
    CHECK_NEAR((wide)found->B / (wide)expected->B, 1, tolerance);
    CHECK_NEAR((wide)found->K / (wide)expected->K, 1, tolerance);
}

/* Table and motor row differ by rounding when the table is much the lighter, so inertias are kept
 * within a factor of thirty. */
CASE(the_rows_of_any_axis_give_the_axis_whatever_the_share) {
    uint64_t seed = 1;
    for (int n = 0; n < 10000; n++) {
        axt_axis axis = {.I1 = log_uniform(&seed, 1e-7, 1e4),
                         .B = log_uniform(&seed, 1e-6, 1e6),
                         .K = log_uniform(&seed, 1e-3, 1e8)};
        axis.I2 = axis.I1 * log_uniform(&seed, 1 / 30.0, 30);
        const axt_real share = uniform(&seed, 0, 1);
        const axt_rows rows = rows_of(&axis, (wide)share);
        axt_axis found;
        CHECK_EQUAL(axt_axis_from_rows(&rows, share, &found), AXT_OK);
        check_axis(&found, &axis, 200 * REAL_EPSILON);
    }
}

CASE(the_paper_s_axis_comes_back) {
    const wide inertia = (wide)axt_axis_paper.I1 + (wide)axt_axis_paper.I2;
    const axt_real share = (axt_real)((wide)axt_axis_paper.I2 / inertia);
    const axt_rows rows = rows_of(&axt_axis_paper, (wide)share);
    axt_axis found;
    CHECK_EQUAL(axt_axis_from_rows(&rows, share, &found), AXT_OK);
    check_axis(&found, &axt_axis_paper, 20 * REAL_EPSILON);
}

CASE(an_axis_without_damping_is_one) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    const axt_rows rows = rows_of(&axis, 0);
    axt_axis found;
    CHECK_EQUAL(axt_axis_from_rows(&rows, 0, &found), AXT_OK);
    CHECK_NEAR(found.B, 0, 0);
}

CASE(what_is_no_axis_is_refused_and_nothing_is_written) {
    axt_axis found = {.I1 = 1, .I2 = 2, .B = 3, .K = 4};
    const axt_axis before = found;
    static const struct {
        int entry;
        double factor;
    } bad[] = {{0, -1}, {0, 0.2 /* negative I2 */},    {0, 0}, {1, -1 /* negative B */}, {2, -1},
               {2, 0},  {2, 1e6 /* I1 out of range */}};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        axt_rows rows = rows_of(&axt_axis_paper, 0);
        rows.twist[bad[i].entry] *= (axt_real)bad[i].factor;
        CHECK_EQUAL(axt_axis_from_rows(&rows, 0, &found), AXT_ERROR_NO_DATA);
        CHECK(UNCHANGED(found, before));
    }
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        for (int entry = 0; entry < 3; entry++) {
            axt_rows rows = rows_of(&axt_axis_paper, 0);
            rows.twist[entry] = not_finite[i];
            CHECK_EQUAL(axt_axis_from_rows(&rows, 0, &found), AXT_ERROR_NO_DATA);
            CHECK(UNCHANGED(found, before));
        }
        axt_rows rows = rows_of(&axt_axis_paper, 0);
        rows.body[0] = not_finite[i];
        CHECK_EQUAL(axt_axis_from_rows(&rows, 0, &found), AXT_ERROR_NO_DATA);
        CHECK(UNCHANGED(found, before));
    }
    const axt_rows none = {{0}, {0}};
    CHECK_EQUAL(axt_axis_from_rows(&none, 0, &found), AXT_ERROR_NO_DATA);
    CHECK(UNCHANGED(found, before));
}

int main(void) {
    RUN(the_rows_of_any_axis_give_the_axis_whatever_the_share);
    RUN(the_paper_s_axis_comes_back);
    RUN(an_axis_without_damping_is_one);
    RUN(what_is_no_axis_is_refused_and_nothing_is_written);
    return REPORT();
}
