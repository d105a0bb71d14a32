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

/* ---- Held torque ------------------------------------------------------------------------------
 */

/* What quotients and means of x'' + d x' + k x = f / I1 obey when the torque is held over h. From
 * X[n+1] - X[n] = E X[n] + A^-1 E [0, f] and N = 2/h E (2 + E)^-1 it is N X + N A^-1 [0, f]; of
 * positions alone, N's characteristic polynomial, and the same at rest. */
static void held_row(wide k, wide d, wide per_I1, wide h, axt_rows_kind kind, axt_real row[3]) {
    wide E[2][2];
    exponential_less_one(d, k, h, E);
    const wide sum[2][2] = {{2 + E[0][0], E[0][1]}, {E[1][0], 2 + E[1][1]}};
    const wide scale = 2 / h / (sum[0][0] * sum[1][1] - sum[0][1] * sum[1][0]);
    const wide inverse[2][2] = {{sum[1][1] * scale, -sum[0][1] * scale},
                                {-sum[1][0] * scale, sum[0][0] * scale}};
    wide N[2][2];
    for (int i = 0; i < 4; i++) {
        N[i / 2][i % 2] = E[i / 2][0] * inverse[0][i % 2] + E[i / 2][1] * inverse[1][i % 2];
    }
    const wide determinant = N[0][0] * N[1][1] - N[0][1] * N[1][0];
    if (kind == AXT_ROWS_OF_SPEEDS) {
        row[0] = (axt_real)N[1][0];
        row[1] = (axt_real)N[1][1];
        row[2] = (axt_real)(-N[1][0] * per_I1 / k); /* A^-1 [0, 1] = [-1 / k, 0] */
    } else {
        row[0] = (axt_real)-determinant;
        row[1] = (axt_real)(N[0][0] + N[1][1]);
        row[2] = (axt_real)(determinant * per_I1 / k);
    }
}

static const axt_rows_kind kinds[] = {AXT_ROWS_OF_SPEEDS, AXT_ROWS_OF_POSITIONS};

/* Right, or no answer at all: where damping is beyond critical and the step long, the rows hardly
 * depend on it any more. */
CASE(rows_of_held_torque_give_those_of_the_axis) {
    static const double dampings[] = {0, 1e-4, 0.04, 0.3, 0.7, 0.999, 1, 1.001, 1.5, 3};
    static const double steps[] = {0.01, 0.1, 0.3, 0.4479, 0.8, 1, 1.5};
    const wide wn = 4162.6L;
    const wide per_I1 = 37000;
    for (size_t n = 0; n < COUNT_OF(dampings) * COUNT_OF(steps) * COUNT_OF(kinds); n++) {
        const double zeta = dampings[n % COUNT_OF(dampings)];
        const double x = steps[n / COUNT_OF(dampings) % COUNT_OF(steps)];
        const axt_rows_kind kind = kinds[n / COUNT_OF(dampings) / COUNT_OF(steps)];
        const axt_real h = (axt_real)(x / (double)wn);
        const wide damping = 2 * (wide)zeta * wn;
        axt_rows rows = {.body = {1, 2, 3}};
        held_row(wn * wn, damping, per_I1, (wide)h, kind, rows.twist);
        rows.twist[1] = (zeta > 0) ? rows.twist[1] : 0;
        const axt_rows given = rows;
        axt_real factor[3] = {7, 8, 9};
        const axt_status status = axt_rows_from_held(&rows, kind, h, factor);
        CHECK(status == AXT_OK || (status == AXT_ERROR_NO_DATA && zeta * x > 0.75));
        if (status != AXT_OK) {
            CHECK(UNCHANGED(rows, given));
            CHECK(factor[0] == 7 && factor[1] == 8 && factor[2] == 9);
            continue;
        }
        CHECK_NEAR((wide)rows.twist[0] / (wn * wn), -1, 20 * REAL_EPSILON);
        CHECK_NEAR((wide)rows.twist[1] / wn, -2 * zeta, 20 * REAL_EPSILON * (1 + 2 * zeta));
        CHECK_NEAR((wide)rows.twist[2] / per_I1, 1, 20 * REAL_EPSILON);
        for (int i = 0; i < 3; i++) {
            CHECK_NEAR(rows.twist[i] - factor[i] * given.twist[i], 0,
                       2 * REAL_EPSILON * fabs((double)rows.twist[i]));
            CHECK_NEAR((wide)rows.body[i] / (wide)given.body[i] / (wide)factor[i], 1,
                       2 * REAL_EPSILON);
        }
    }
}

CASE(rows_that_no_axis_under_held_torque_has_are_refused_and_nothing_is_written) {
    const axt_real h = (axt_real)1e-4;
    for (size_t n = 0; n < COUNT_OF(kinds); n++) {
        axt_rows good = {.body = {1, 2, 3}};
        held_row(1e7L, 300, 37000, (wide)h, kinds[n], good.twist);
        for (int entry = 0; entry < 2; entry++) {
            const axt_real bad[] = {-good.twist[entry], not_finite[0], not_finite[1], not_finite[2],
                                    (axt_real)-1e30};
            for (size_t i = 0; i < COUNT_OF(bad); i++) {
                axt_rows rows = good;
                rows.twist[entry] = bad[i];
                const axt_rows before = rows;
                axt_real factor[3] = {7, 8, 9};
                CHECK_EQUAL(axt_rows_from_held(&rows, kinds[n], h, factor), AXT_ERROR_NO_DATA);
                CHECK(UNCHANGED(rows, before));
                CHECK(factor[0] == 7 && factor[1] == 8 && factor[2] == 9);
            }
        }
    }
}

int main(void) {
    RUN(the_rows_of_any_axis_give_the_axis_whatever_the_share);
    RUN(the_paper_s_axis_comes_back);
    RUN(an_axis_without_damping_is_one);
    RUN(what_is_no_axis_is_refused_and_nothing_is_written);
    RUN(rows_of_held_torque_give_those_of_the_axis);
    RUN(rows_that_no_axis_under_held_torque_has_are_refused_and_nothing_is_written);
    return REPORT();
}
