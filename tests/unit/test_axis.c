/* The axis and its vibration, against Tables 1, 2 and 4 of the paper and against Eq. 8. */
#include "axt_axis.h"

#include "check.h"
#include "reference.h"

/* Anywhere in the documented ranges. */
static axt_axis random_axis(uint64_t *seed) {
    return (axt_axis){.I1 = log_uniform(seed, 1.1e-9, 0.9e6),
                      .I2 = log_uniform(seed, 1.1e-9, 0.9e6),
                      .B = log_uniform(seed, 1e-12, 0.9e9),
                      .K = log_uniform(seed, 1.1e-6, 0.9e12)};
}

CASE(the_paper_s_axis_vibrates_as_its_table_4_says) {
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axt_axis_paper, &modal), AXT_OK);
    CHECK_NEAR(modal.wn, 4162.6, 0.05);
    CHECK_NEAR(modal.wd, 4159.3, 0.05);
    CHECK_NEAR(modal.zeta, 3.97e-2, 0.5e-4);
}

/* The eigenvalues of Eq. 8 are the roots of s^2 (s^2 + B (1/I1 + 1/I2) s + K (1/I1 + 1/I2)). */
CASE(modal_properties_are_the_eigenvalues_of_eq_8) {
    uint64_t seed = 1;
    for (int n = 0; n < 10000; n++) {
        const axt_axis axis = random_axis(&seed);
        axt_modal modal;
        CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
        const wide wn = (wide)modal.wn;
        const wide zeta = (wide)modal.zeta;
        const wide sum = 1 / (wide)axis.I1 + 1 / (wide)axis.I2;
        const wide damping = (wide)axis.B * sum;
        const wide stiffness = (wide)axis.K * sum;
        const double tolerance = 16 * REAL_EPSILON;
        if (zeta < 0.9L) {
            const wide real = -zeta * wn;
            const wide imaginary = (wide)modal.wd;
            CHECK_NEAR((real * real - imaginary * imaginary + damping * real) / stiffness, -1,
                       tolerance);
            CHECK_NEAR((2 * real + damping) * imaginary / stiffness, 0, tolerance);
        } else {
            /* two real eigenvalues: their sum is -2 zeta wn, their product wn^2 */
            CHECK_NEAR(2 * zeta * wn / damping, 1, tolerance);
            CHECK_NEAR(wn * wn / stiffness, 1, tolerance);
        }
        CHECK((modal.wd > 0) == (modal.zeta < 1));
    }
}

CASE(an_undamped_axis_vibrates_at_its_natural_frequency) {
    axt_axis axis = axt_axis_paper;
    axis.B = 0;
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
    CHECK(modal.zeta >= 0 && modal.zeta <= 0);
    CHECK(modal.wd >= modal.wn && modal.wd <= modal.wn);
}

CASE(an_overdamped_axis_has_no_damped_frequency) {
    axt_axis axis = axt_axis_paper;
    axis.B = 1;
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
    CHECK(modal.zeta > 1);
    CHECK(modal.wd >= 0 && modal.wd <= 0);
}

CASE(an_axis_comes_back_from_its_modal_properties) {
    uint64_t seed = 2;
    for (int n = 0; n < 10000; n++) {
        const axt_axis axis = random_axis(&seed);
        axt_modal modal;
        CHECK_EQUAL(axt_axis_modal(&axis, &modal), AXT_OK);
        modal.wd = (axt_real)NAN; /* is not read */
        axt_axis back;
        CHECK_EQUAL(axt_axis_from_modal(axis.I1, axis.I2, &modal, &back), AXT_OK);
        CHECK(back.I1 >= axis.I1 && back.I1 <= axis.I1);
        CHECK(back.I2 >= axis.I2 && back.I2 <= axis.I2);
        CHECK_NEAR(back.B / axis.B, 1, 16 * REAL_EPSILON);
        CHECK_NEAR(back.K / axis.K, 1, 16 * REAL_EPSILON);
    }
}

CASE(the_limits_themselves_are_in_range) {
    const axt_axis least = {(axt_real)1e-9, (axt_real)1e-9, 0, (axt_real)1e-6};
    const axt_axis most = {(axt_real)1e6, (axt_real)1e6, (axt_real)1e9, (axt_real)1e12};
    CHECK_EQUAL(axt_axis_check(&least), AXT_OK);
    CHECK_EQUAL(axt_axis_check(&most), AXT_OK);
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&least, &modal), AXT_OK);
    CHECK_EQUAL(axt_axis_modal(&most, &modal), AXT_OK);
}

static void check_refused(const axt_axis *axis, axt_status expected) {
    axt_modal modal = {1, 2, 3};
    const axt_modal before = modal;
    CHECK_EQUAL(axt_axis_check(axis), expected);
    CHECK_EQUAL(axt_axis_modal(axis, &modal), expected);
    CHECK(UNCHANGED(modal, before));
}

/* The axis of the paper with one parameter (0 .. 3: I1, I2, B, K) replaced. */
static axt_axis with_parameter(int parameter, axt_real value) {
    axt_axis axis = axt_axis_paper;
    axt_real *const parameters[] = {&axis.I1, &axis.I2, &axis.B, &axis.K};
    *parameters[parameter] = value;
    return axis;
}

CASE(a_bad_parameter_is_refused_and_nothing_is_written) {
    static const double out_of_range[4][4] = {{-2.7e-5, 0, 0.99e-9, 1.01e6},
                                              {-8.3e-6, 0, 0.99e-9, 1.01e6},
                                              {-2.1e-3, -1e-30, 1.01e9, 1e30},
                                              {-110, 0, 0.99e-6, 1.01e12}};
    for (int parameter = 0; parameter < 4; parameter++) {
        for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
            const axt_axis axis = with_parameter(parameter, not_finite[i]);
            check_refused(&axis, AXT_ERROR_NOT_FINITE);
        }
        for (size_t i = 0; i < COUNT_OF(out_of_range[parameter]); i++) {
            const axt_axis axis = with_parameter(parameter, (axt_real)out_of_range[parameter][i]);
            check_refused(&axis, AXT_ERROR_RANGE);
        }
    }
}

CASE(modal_properties_that_no_axis_has_are_refused_and_nothing_is_written) {
    static const struct {
        float I1;
        float I2;
        float wn;
        float zeta;
    } bad[] = {
        {NAN, 1e-5F, 4e3F, 0.1F},     {INFINITY, 1e-5F, 4e3F, 0.1F},
        {1e-5F, NAN, 4e3F, 0.1F},     {1e-5F, INFINITY, 4e3F, 0.1F},
        {1e-5F, 1e-5F, NAN, 0.1F},    {1e-5F, 1e-5F, INFINITY, 0.1F},
        {1e-5F, 1e-5F, 4e3F, NAN},    {1e-5F, 1e-5F, 4e3F, INFINITY},
        {-1e-5F, 1e-5F, 4e3F, 0.1F},  {1e-5F, -1e-5F, 4e3F, 0.1F},
        {1e-5F, 1e-5F, -4e3F, -0.1F}, {0, 1e-5F, 4e3F, 0.1F},
        {1e-5F, 0, 4e3F, 0.1F},       {1e-5F, 1e-5F, 0, 0.1F},
        {1e-5F, 1e-5F, -4e3F, 0},     {1e-5F, 1e-5F, 4e3F, -0.1F},
        {1e-5F, 1e-5F, 1e15F, 0.1F},  {1e-10F, 1e-5F, 4e3F, 0.1F},
        {1e-5F, 1e7F, 4e3F, 0.1F},
    };
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        const axt_modal modal = {.wn = (axt_real)bad[i].wn, .zeta = (axt_real)bad[i].zeta};
        axt_axis axis = axt_axis_paper;
        const axt_axis before = axis;
        CHECK(axt_axis_from_modal((axt_real)bad[i].I1, (axt_real)bad[i].I2, &modal, &axis) < 0);
        CHECK(UNCHANGED(axis, before));
    }
}

/* Table 2. Its numbers are cut off, not rounded, so the last digit printed may be one too low. */
CASE(the_time_steps_are_those_of_table_2) {
    axt_modal modal;
    CHECK_EQUAL(axt_axis_modal(&axt_axis_paper, &modal), AXT_OK);
    CHECK_NEAR(axt_time_step(512, 10, modal.wn), 2.9481e-5, 1e-9);
    CHECK_NEAR(axt_time_step(2048, 146, modal.wn), 1.0761e-4, 1e-8);
}

CASE(the_natural_frequency_is_line_k_of_n_samples) {
    uint64_t seed = 3;
    for (int n = 0; n < 10000; n++) {
        const uint32_t N = 1 + (uint32_t)(random_bits(&seed) >> 40);
        const uint32_t k = 1 + (uint32_t)(random_bits(&seed) >> 40);
        const axt_real wn = log_uniform(&seed, 1e-3, 1e6);
        const wide turns = (wide)axt_time_step(N, k, wn) * (wide)N * (wide)wn / (2 * PI);
        CHECK_NEAR(turns / k, 1, 4 * REAL_EPSILON);
    }
}

CASE(no_time_step_follows_from_numbers_that_are_not_positive) {
    CHECK_NEAR(axt_time_step(0, 10, 4000), 0, 0);
    CHECK_NEAR(axt_time_step(512, 0, 4000), 0, 0);
    CHECK_NEAR(axt_time_step(512, 10, 0), 0, 0);
    CHECK_NEAR(axt_time_step(512, 10, -4000), 0, 0);
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        CHECK_NEAR(axt_time_step(512, 10, not_finite[i]), 0, 0);
    }
}

CASE(one_turn_of_the_paper_s_spindle_moves_the_table_5_mm) {
    CHECK_NEAR(axt_lead_to_travel(axt_lead_paper, (axt_real)(2 * PI)), 5e-3, 5e-6);
    CHECK_NEAR(axt_lead_to_travel(axt_lead_paper, -1000), -0.796, 4 * REAL_EPSILON);
}

int main(void) {
    RUN(the_paper_s_axis_vibrates_as_its_table_4_says);
    RUN(modal_properties_are_the_eigenvalues_of_eq_8);
    RUN(an_undamped_axis_vibrates_at_its_natural_frequency);
    RUN(an_overdamped_axis_has_no_damped_frequency);
    RUN(an_axis_comes_back_from_its_modal_properties);
    RUN(the_limits_themselves_are_in_range);
    RUN(a_bad_parameter_is_refused_and_nothing_is_written);
    RUN(modal_properties_that_no_axis_has_are_refused_and_nothing_is_written);
    RUN(the_time_steps_are_those_of_table_2);
    RUN(the_natural_frequency_is_line_k_of_n_samples);
    RUN(no_time_step_follows_from_numbers_that_are_not_positive);
    RUN(one_turn_of_the_paper_s_spindle_moves_the_table_5_mm);
    return REPORT();
}
