/* How much an estimate scatters, against noise whose colour is known: the spectrum at frequency
 * zero of white scores is the sum of their squares, that of differenced ones nothing. */
#include "axt_scatter.h"

#include "check.h"
#include "reference.h"

enum { LENGTH = 64 };

static axt_scatter scatter_of(uint32_t inputs, uint32_t length) {
    axt_scatter scatter;
    CHECK_EQUAL(axt_scatter_init(&scatter, inputs, length), AXT_OK);
    return scatter;
}

/* Element (row, column) of M: 3/2 of the sum. */
static double element_of(const axt_scatter *scatter, uint32_t row, uint32_t column) {
    return 1.5 * (double)scatter->sum[column * (column + 1) / 2 + row];
}

typedef enum { WHITE, DIFFERENCED } colour;

/* The regressors are white; the two rows have residuals of sizes 1 and 2 that are correlated by a
 * half. Returns the scatter after so many samples and puts what they are expected to add up to for
 * white noise into `sum`: of phi phi'. */
static axt_scatter fed(uint32_t inputs, uint32_t samples, colour noise, uint64_t seed,
                       double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX]) {
    axt_scatter scatter = scatter_of(inputs, LENGTH);
    axt_real last[2] = {0, 0};
    memset(sum, 0, sizeof(double[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX]));
    for (uint32_t n = 0; n < samples; n++) {
        axt_real phi[AXT_RLS_INPUTS_MAX];
        for (uint32_t i = 0; i < inputs; i++) {
            /* for differences to cancel, the regressors have to be steady */
            phi[i] = (noise == WHITE) ? (axt_real)(i + 1) * gaussian(&seed) : (axt_real)(i + 1);
        }
        const axt_real first = gaussian(&seed);
        const axt_real fresh[2] = {first, first + (axt_real)1.7320508 * gaussian(&seed)};
        axt_real residual[2];
        for (int row = 0; row < 2; row++) {
            residual[row] = (noise == WHITE) ? fresh[row] : fresh[row] - last[row];
            last[row] = fresh[row];
        }
        for (uint32_t i = 0; i < inputs; i++) {
            for (uint32_t j = 0; j < inputs; j++) {
                sum[i][j] += (double)phi[i] * (double)phi[j];
            }
        }
        axt_scatter_add(&scatter, phi, residual);
    }
    return scatter;
}

/* Covariance of the two residuals. */
static const double residual_covariance[2][2] = {{1, 1}, {1, 4}};

CASE(of_white_scores_it_is_the_sum_of_their_squares) {
    const uint32_t samples = 3000 * LENGTH; /* below the number of windows that are halved */
    for (uint32_t inputs = 1; inputs <= AXT_RLS_INPUTS_MAX; inputs++) {
        double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX];
        const axt_scatter scatter = fed(inputs, samples, WHITE, inputs, sum);
        CHECK_EQUAL(scatter.windows, samples / LENGTH - 2); /* the last one is not yet added */
        for (uint32_t column = 0; column < 2 * inputs; column++) {
            for (uint32_t row = 0; row <= column; row++) {
                const uint32_t i = row % inputs;
                const uint32_t j = column % inputs;
                const double size = sqrt(sum[i][i] * sum[j][j]) * 2;
                const double covariance = residual_covariance[row / inputs][column / inputs];
                /* 3000 windows: each element scatters by about 3 % */
                CHECK_NEAR(element_of(&scatter, row, column) / size, covariance * sum[i][j] / size,
                           0.1);
            }
        }
        for (uint32_t i = 0; i < inputs; i++) {
            CHECK_NEAR((double)scatter.seen[i] / sum[i][i], 1, 1e-3);
        }
    }
}

CASE(of_differenced_scores_next_to_nothing_is_left) {
    double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX];
    const axt_scatter scatter = fed(3, 1000 * LENGTH, DIFFERENCED, 1, sum);
    for (uint32_t k = 0; k < 6; k++) {
        const double variance = residual_covariance[k / 3][k / 3];
        /* a triangle turns the difference into its slope: 3/2 (2 / length^2) of what white noise
         * would leave */
        CHECK_NEAR(element_of(&scatter, k, k) / (variance * sum[k % 3][k % 3]),
                   3.0 / (LENGTH * LENGTH), 0.6 / (LENGTH * LENGTH));
    }
}

CASE(when_all_is_halved_nothing_changes_in_expectation) {
    enum { WINDOWS = 4096 };
    double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX];
    const axt_scatter full = fed(2, (WINDOWS + 1) * LENGTH, WHITE, 3, sum);
    const axt_scatter before = fed(2, (WINDOWS + 2) * LENGTH, WHITE, 3, sum);
    CHECK_EQUAL(before.windows, WINDOWS);
    const axt_scatter after = fed(2, (WINDOWS + 3) * LENGTH, WHITE, 3, sum);
    CHECK_EQUAL(after.windows, WINDOWS / 2 + 1);
    const axt_scatter later = fed(2, 3 * WINDOWS * LENGTH, WHITE, 3, sum);
    CHECK(later.windows > WINDOWS / 2 && later.windows <= WINDOWS);
    for (uint32_t k = 0; k < 4; k++) {
        const double whole = element_of(&before, k, k) / before.windows;
        CHECK_NEAR(element_of(&after, k, k) / after.windows / whole, 1, 2.0 / WINDOWS * 20);
        CHECK_NEAR(element_of(&later, k, k) / later.windows / whole, 1, 0.1);
        CHECK_NEAR((double)after.seen[k % 2] / after.windows * WINDOWS / (double)full.seen[k % 2],
                   1, 0.01);
    }
}

/* P = 1 / sum phi^2 for a steady regressor: the variance of its entry is that of a mean. */
CASE(the_variance_of_a_mean_is_that_of_the_noise_over_the_samples) {
    enum { SAMPLES = 2000 * LENGTH };
    uint64_t seed = 4;
    axt_rls rls;
    axt_scatter scatter = scatter_of(1, LENGTH);
    CHECK_EQUAL(axt_rls_init(&rls, 1, 2, 1, (axt_real)1e6), AXT_OK);
    for (uint32_t n = 0; n < SAMPLES; n++) {
        const axt_real phi = 1;
        const axt_real y[2] = {3 + gaussian(&seed), 5 + 2 * gaussian(&seed)};
        CHECK_EQUAL(axt_rls_update(&rls, &phi, y), AXT_OK);
        const axt_real residual[2] = {rls.innovation[0] * rls.certainty,
                                      rls.innovation[1] * rls.certainty};
        axt_scatter_add(&scatter, &phi, residual);
    }
    axt_real first[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{1}, {0}};
    axt_real both[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{10}, {1}};
    CHECK_NEAR((double)axt_scatter_variance(&scatter, &rls, 1, first) * SAMPLES, 1, 0.1);
    CHECK_NEAR((double)axt_scatter_variance(&scatter, &rls, (axt_real)0.5, first) * SAMPLES, 0.5,
               0.05);
    CHECK_NEAR((double)axt_scatter_variance(&scatter, &rls, 1, both) * SAMPLES, 104, 10.4);
}

CASE(too_few_windows_say_so) {
    double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX];
    axt_rls rls;
    axt_real gradient[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{1, 1, 1}, {1, 1, 1}};
    CHECK_EQUAL(axt_rls_init(&rls, 3, 2, 1, 100), AXT_OK);
    for (uint32_t halves = 0; halves < 10; halves++) {
        /* a window is two halves, and takes a third to be added; then three parameters and two */
        const axt_scatter scatter = fed(3, halves * LENGTH, WHITE, 5, sum);
        CHECK_EQUAL(axt_scatter_known(&scatter), halves >= 7);
        const axt_real variance = axt_scatter_variance(&scatter, &rls, 1, gradient);
        CHECK((halves >= 7) ? variance > 0 : variance < 0);
    }
}

/* A regressor that was never seen has no share to be scaled by. */
CASE(a_regressor_that_was_always_zero_does_no_harm) {
    axt_rls rls;
    axt_scatter scatter = scatter_of(2, LENGTH);
    CHECK_EQUAL(axt_rls_init(&rls, 2, 2, 1, 100), AXT_OK);
    uint64_t seed = 6;
    for (uint32_t n = 0; n < 20 * LENGTH; n++) {
        const axt_real phi[2] = {1, 0};
        const axt_real y[2] = {gaussian(&seed), gaussian(&seed)};
        CHECK_EQUAL(axt_rls_update(&rls, phi, y), AXT_OK);
        axt_scatter_add(&scatter, phi, y);
    }
    axt_real gradient[AXT_SCATTER_ROWS][AXT_RLS_INPUTS_MAX] = {{1, 1}, {1, 1}};
    const axt_real variance = axt_scatter_variance(&scatter, &rls, 1, gradient);
    CHECK(variance > 0 && isfinite((double)variance));
}

CASE(after_a_reset_all_begins_anew) {
    double sum[AXT_RLS_INPUTS_MAX][AXT_RLS_INPUTS_MAX];
    axt_scatter scatter = fed(4, 20 * LENGTH + 7, WHITE, 7, sum);
    const axt_scatter fresh = scatter_of(4, LENGTH);
    axt_scatter_reset(&scatter);
    CHECK(UNCHANGED(scatter, fresh));
}

CASE(shapes_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_scatter scatter = scatter_of(3, LENGTH);
    const axt_scatter before = scatter;
    CHECK_EQUAL(axt_scatter_init(&scatter, 0, LENGTH), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_scatter_init(&scatter, AXT_RLS_INPUTS_MAX + 1, LENGTH), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_scatter_init(&scatter, 3, AXT_SCATTER_LENGTH_MIN - 1), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(scatter, before));
    CHECK_EQUAL(axt_scatter_init(&scatter, 3, AXT_SCATTER_LENGTH_MIN), AXT_OK);
}

int main(void) {
    RUN(of_white_scores_it_is_the_sum_of_their_squares);
    RUN(of_differenced_scores_next_to_nothing_is_left);
    RUN(when_all_is_halved_nothing_changes_in_expectation);
    RUN(the_variance_of_a_mean_is_that_of_the_noise_over_the_samples);
    RUN(too_few_windows_say_so);
    RUN(a_regressor_that_was_always_zero_does_no_harm);
    RUN(after_a_reset_all_begins_anew);
    RUN(shapes_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
