/* The state-variable filter, against its transfer function F(s) = w^3 / ((s + w)(s^2 + w s + w^2))
 * at the frequency that the trapezoidal rule makes of it, and against its response to polynomials.
 */
#include "axt_filter.h"

#include "axt_plant.h"
#include "check.h"
#include "reference.h"

static const axt_real time_step = (axt_real)5e-5;

static axt_filter filter_at(double corner_step) {
    axt_filter filter;
    CHECK_EQUAL(axt_filter_init(&filter, (axt_real)(corner_step / (double)time_step), time_step),
                AXT_OK);
    return filter;
}

/* How much of cos and -sin of `line` turns a period is in a periodic signal. */
typedef struct {
    wide real;
    wide imaginary;
} phasor;

static phasor times(phasor a, phasor b) {
    return (phasor){a.real * b.real - a.imaginary * b.imaginary,
                    a.real * b.imaginary + a.imaginary * b.real};
}

static phasor divided_by(phasor a, phasor b) {
    const wide squared = b.real * b.real + b.imaginary * b.imaginary;
    const phasor conjugate = {b.real / squared, -b.imaginary / squared};
    return times(a, conjugate);
}

/* F(j f) of corner w. */
static phasor transfer(wide w, wide f) {
    const phasor cubed = {w * w * w, 0};
    const phasor first = {w, f};
    const phasor second = {w * w - f * f, w * f};
    return divided_by(cubed, times(first, second));
}

/* Harmonics of the sample rate / PERIOD, for corners from far below to the highest allowed. */
CASE(the_frequency_response_is_that_of_the_bilinear_transform) {
    enum { PERIOD = 240, SETTLING = 20000 };
    static const double corner_steps[] = {0.02, 0.2, 1, 2.9};
    static const int lines[] = {1, 2, 7, 30, 60, 100};
    for (size_t i = 0; i < COUNT_OF(corner_steps) * COUNT_OF(lines); i++) {
        const axt_filter filter = filter_at(corner_steps[i / COUNT_OF(lines)]);
        const int line = lines[i % COUNT_OF(lines)];
        axt_filter_state state;
        axt_filter_start(&state, 1);
        phasor found[4] = {{0, 0}}; /* value, rate, acceleration, jerk */
        for (int n = 0; n < SETTLING + PERIOD; n++) {
            const wide angle = 2 * PI * (line * n % PERIOD) / PERIOD;
            const axt_filtered out = axt_filter_step(&filter, &state, (axt_real)cosl(angle));
            if (n >= SETTLING) {
                const axt_real signals[] = {out.value, out.rate, out.acceleration, out.jerk};
                for (size_t k = 0; k < COUNT_OF(found); k++) {
                    found[k].real += (wide)signals[k] * cosl(angle) * 2 / PERIOD;
                    found[k].imaginary -= (wide)signals[k] * sinl(angle) * 2 / PERIOD;
                }
            }
        }
        const wide warped = 2 / (wide)time_step * tanl(PI * line / PERIOD);
        phasor expected = transfer((wide)filter.w, warped);
        wide at_corner = 1; /* about what a signal at the corner frequency comes out as */
        for (size_t k = 0; k < COUNT_OF(found); k++) {
            const wide size = hypotl(expected.real, expected.imaginary);
            const wide off =
                hypotl(found[k].real - expected.real, found[k].imaginary - expected.imaginary);
            CHECK_NEAR(off / fmaxl(size, at_corner / 1000), 0, 64 * REAL_EPSILON);
            const phasor derivative = {0, warped};
            expected = times(expected, derivative);
            at_corner *= (wide)filter.w;
        }
    }
}

CASE(a_constant_passes_unchanged_from_the_first_sample_on) {
    const axt_filter filter = filter_at(0.2);
    axt_filter_state state;
    axt_filter_start(&state, (axt_real)0.3);
    const axt_filter_state before = state;
    for (int n = 0; n < 1000; n++) {
        const axt_filtered out = axt_filter_step(&filter, &state, (axt_real)0.3);
        CHECK_NEAR(out.value - (axt_real)0.3, 0, 0);
    }
    CHECK(UNCHANGED(state, before));
}

CASE(the_gain_at_zero_frequency_is_one) {
    const axt_filter filter = filter_at(0.2);
    axt_filter_state state;
    axt_filter_start(&state, -1);
    axt_filtered out = {0};
    for (int n = 0; n < 2000; n++) {
        out = axt_filter_step(&filter, &state, (axt_real)0.3);
    }
    const double w = (double)filter.w;
    CHECK_NEAR(out.value, 0.3, 8 * REAL_EPSILON);
    CHECK_NEAR((double)out.rate / w, 0, 64 * REAL_EPSILON);
    CHECK_NEAR((double)out.acceleration / (w * w), 0, 64 * REAL_EPSILON);
}

CASE(a_shifted_channel_is_the_channel_of_the_shifted_signal) {
    const axt_filter filter = filter_at(0.2);
    const axt_real shift = (axt_real)-0.75;
    uint64_t seed = 1;
    axt_filter_state shifted;
    axt_filter_state plain;
    axt_filter_start(&plain, 0);
    axt_filter_start(&shifted, 0);
    axt_filtered a = {0};
    axt_filtered b = {0};
    for (int n = 0; n < 1000; n++) {
        if (n == 500) {
            axt_filter_shift(&shifted, shift);
        }
        const axt_real input = uniform(&seed, -1, 1);
        a = axt_filter_step(&filter, &plain, input);
        b = axt_filter_step(&filter, &shifted, (n < 500) ? input : input + shift);
    }
    const double w = (double)filter.w;
    CHECK_NEAR(b.value - (a.value + shift), 0, 16 * REAL_EPSILON);
    CHECK_NEAR((double)(b.rate - a.rate) / w, 0, 16 * REAL_EPSILON);
    CHECK_NEAR((double)(b.acceleration - a.acceleration) / (w * w), 0, 16 * REAL_EPSILON);
    CHECK_NEAR((double)(b.jerk - a.jerk) / (w * w * w), 0, 64 * REAL_EPSILON);
}

/* F(s) = 1 - 2 s/w + 2 s^2/w^2 - ..., and the trapezoidal rule integrates straight lines exactly:
 * t^2/2 comes out as t^2/2 - 2 t/w + 2/w^2 at every sample once the start is forgotten. */
CASE(a_parabola_comes_out_with_its_exact_rate_and_acceleration) {
    enum { SAMPLES = 400 };
    const axt_filter filter = filter_at(0.5);
    const wide w = (wide)filter.w;
    axt_filter_state state;
    axt_filter_start(&state, 0);
    for (int n = 0; n < SAMPLES; n++) {
        const wide t = n * (wide)time_step;
        const axt_filtered out = axt_filter_step(&filter, &state, (axt_real)(t * t / 2));
        if (n > SAMPLES / 2) {
            const wide span = SAMPLES * (wide)time_step;
            const double rounding = 4 * REAL_EPSILON * (double)(span * span * w * w);
            CHECK_NEAR((wide)out.value / (t * t / 2 - 2 * t / w + 2 / (w * w)), 1,
                       16 * REAL_EPSILON);
            CHECK_NEAR(((wide)out.rate - (t - 2 / w)) * w, 0, rounding);
            CHECK_NEAR(out.acceleration, 1, rounding);
            CHECK_NEAR((wide)out.jerk / w, 0, rounding);
        }
    }
}

CASE(a_ramp_comes_out_with_its_exact_rate) {
    const axt_filter filter = filter_at(0.5);
    const wide w = (wide)filter.w;
    axt_filter_state state;
    axt_filter_start(&state, 0);
    for (int n = 0; n < 400; n++) {
        const wide t = n * (wide)time_step;
        const axt_filtered out = axt_filter_step(&filter, &state, (axt_real)t);
        if (n > 200) {
            const double rounding = 4 * REAL_EPSILON * 400 * 0.5;
            CHECK_NEAR((wide)out.value / (t - 2 / w), 1, 16 * REAL_EPSILON);
            CHECK_NEAR(out.rate, 1, rounding);
            CHECK_NEAR((wide)out.acceleration / w, 0, rounding);
        }
    }
}

/* What the filter is for: the equation of motion holds between filtered channels of the plant. */
CASE(filtered_samples_of_the_plant_obey_its_equation_of_motion) {
    const wide per_reduced = 1 / (wide)axt_axis_paper.I1 + 1 / (wide)axt_axis_paper.I2;
    const wide damping = (wide)axt_axis_paper.B * per_reduced;
    const wide stiffness = (wide)axt_axis_paper.K * per_reduced;
    axt_plant plant;
    CHECK_EQUAL(axt_plant_init(&plant, &axt_axis_paper, time_step, &axt_newmark_trapezoidal),
                AXT_OK);
    const axt_filter filter = filter_at(0.2);
    axt_filter_state twist;
    axt_filter_state torque;
    axt_filter_start(&twist, 0);
    axt_filter_start(&torque, 0);
    uint64_t seed = 2;
    for (int n = 0; n < 20000; n++) {
        const axt_real sample = uniform(&seed, -1, 1);
        CHECK_EQUAL(axt_plant_step(&plant, sample), AXT_OK);
        axt_motion motion;
        axt_plant_read(&plant, &motion);
        const axt_filtered q = axt_filter_step(&filter, &twist, motion.twist);
        const axt_filtered t = axt_filter_step(&filter, &torque, sample);
        const wide drive = (wide)t.value / (wide)axt_axis_paper.I1;
        const wide residual =
            (wide)q.acceleration + damping * (wide)q.rate + stiffness * (wide)q.value - drive;
        CHECK_NEAR(residual * (wide)axt_axis_paper.I1, 0, 256 * REAL_EPSILON);
    }
}

CASE(settings_that_make_no_sense_are_refused_and_the_filter_stays) {
    axt_filter filter = filter_at(0.2);
    const axt_filter before = filter;
    const struct {
        float corner;
        float time_step;
    } bad[] = {{0, 1e-4F},        {-1000, 1e-4F},     {1000, 0},       {1000, -1e-4F},
               {-1000, -1e-4F},   {30001, 1e-4F},     {1e30F, 1e-38F}, {NAN, 1e-4F},
               {INFINITY, 1e-4F}, {-INFINITY, 1e-4F}, {1000, NAN},     {1000, INFINITY}};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        if (sizeof(axt_real) == sizeof(float) || bad[i].corner < 1e29F) {
            CHECK_EQUAL(
                axt_filter_init(&filter, (axt_real)bad[i].corner, (axt_real)bad[i].time_step),
                AXT_ERROR_RANGE);
        }
    }
    CHECK(UNCHANGED(filter, before));
    CHECK_EQUAL(axt_filter_init(&filter, 3, 1), AXT_OK);
}

int main(void) {
    RUN(the_frequency_response_is_that_of_the_bilinear_transform);
    RUN(a_constant_passes_unchanged_from_the_first_sample_on);
    RUN(the_gain_at_zero_frequency_is_one);
    RUN(a_shifted_channel_is_the_channel_of_the_shifted_signal);
    RUN(a_ramp_comes_out_with_its_exact_rate);
    RUN(a_parabola_comes_out_with_its_exact_rate_and_acceleration);
    RUN(filtered_samples_of_the_plant_obey_its_equation_of_motion);
    RUN(settings_that_make_no_sense_are_refused_and_the_filter_stays);
    return REPORT();
}
