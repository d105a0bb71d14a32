/* Instrumental variables, against the normal equations sum(z phi') theta = sum(z y') solved in
 * extended precision, and against what they are for. */
#include "axt_iv.h"

#include "check.h"
#include "reference.h"

enum { N = AXT_IV_INPUTS, M = AXT_IV_OUTPUTS };

static axt_iv iv_of(double forgetting, double prior) {
    axt_iv iv;
    CHECK_EQUAL(axt_iv_init(&iv, (axt_real)forgetting, (axt_real)prior), AXT_OK);
    return iv;
}

typedef struct {
    axt_real phi[N];
    axt_real z[N];
    axt_real y[M];
} sample;

static const wide true_theta[M][N] = {{0.5L, -1.2L, 2}, {1.5L, 0.3L, -0.7L}};

/* Regressors and instruments are the same signal, each with noise of its own; the outputs belong to
 * the signal. */
static sample noisy_sample(uint64_t *seed, double regressor_noise, double instrument_noise) {
    sample s;
    wide signal[N];
    for (int i = 0; i < N; i++) {
        signal[i] = (wide)gaussian(seed);
        s.phi[i] = (axt_real)(signal[i] + (wide)regressor_noise * (wide)gaussian(seed));
        s.z[i] = (axt_real)(signal[i] + (wide)instrument_noise * (wide)gaussian(seed));
    }
    for (int k = 0; k < M; k++) {
        wide sum = 0;
        for (int i = 0; i < N; i++) {
            sum += true_theta[k][i] * signal[i];
        }
        s.y[k] = (axt_real)(sum + 0.05L * (wide)gaussian(seed));
    }
    return s;
}

/* Normal equations with exponential forgetting; they start as 1 / prior times one. */
typedef struct {
    wide matrix[N][N];
    wide right[N][M];
} normal_equations;

static normal_equations normal_start(wide prior) {
    normal_equations normal = {.right = {{0}}};
    for (int i = 0; i < N; i++) {
        normal.matrix[i][i] = 1 / prior;
    }
    return normal;
}

static void normal_add(normal_equations *normal, wide forgetting, const sample *s) {
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) {
            normal->matrix[i][j] =
                forgetting * normal->matrix[i][j] + (wide)s->z[i] * (wide)s->phi[j];
        }
        for (int k = 0; k < M; k++) {
            normal->right[i][k] = forgetting * normal->right[i][k] + (wide)s->z[i] * (wide)s->y[k];
        }
    }
}

static wide determinant(wide a[N][N]) {
    return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
           a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
           a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
}

/* By Cramer's rule. */
static void normal_solve(const normal_equations *normal, wide theta[M][N]) {
    wide matrix[N][N];
    memcpy(matrix, normal->matrix, sizeof matrix);
    const wide whole = determinant(matrix);
    for (int k = 0; k < M; k++) {
        for (int j = 0; j < N; j++) {
            for (int i = 0; i < N; i++) {
                matrix[i][j] = normal->right[i][k];
            }
            theta[k][j] = determinant(matrix) / whole;
            for (int i = 0; i < N; i++) {
                matrix[i][j] = normal->matrix[i][j];
            }
        }
    }
}

CASE(it_solves_the_normal_equations_at_every_sample) {
    static const double forgetting[] = {1, 0.99, 0.95};
    for (size_t f = 0; f < COUNT_OF(forgetting); f++) {
        uint64_t seed = 1;
        axt_iv iv = iv_of(forgetting[f], 100);
        normal_equations normal = normal_start(100);
        for (int n = 0; n < 2000; n++) {
            const sample s = noisy_sample(&seed, 0.1, 0.1);
            CHECK_EQUAL(axt_iv_update(&iv, s.phi, s.z, s.y), AXT_OK);
            normal_add(&normal, (wide)iv.forgetting, &s);
            wide theta[M][N];
            normal_solve(&normal, theta);
            for (int k = 0; k < M; k++) {
                for (int i = 0; i < N; i++) {
                    CHECK_NEAR((wide)iv.theta[k][i] - theta[k][i], 0, BY_TYPE(2e-4, 1e-12));
                }
            }
        }
        CHECK_EQUAL(iv.updates, 2000);
        CHECK_EQUAL(iv.rejected, 0);
    }
}

static wide largest_error(const axt_iv *iv) {
    wide largest = 0;
    for (int k = 0; k < M; k++) {
        for (int i = 0; i < N; i++) {
            largest = fmaxl(largest, fabsl((wide)iv->theta[k][i] - true_theta[k][i]));
        }
    }
    return largest;
}

/* Noise of variance v on regressors of variance 1 makes least squares, whose instruments are the
 * regressors themselves, too small by v / (1 + v). */
CASE(noise_on_the_regressors_biases_least_squares_and_not_this) {
    uint64_t seed = 2;
    axt_iv instrumental = iv_of(1, 1e6);
    axt_iv least_squares = iv_of(1, 1e6);
    for (int n = 0; n < 100000; n++) {
        const sample s = noisy_sample(&seed, 0.5, 0.5);
        CHECK_EQUAL(axt_iv_update(&instrumental, s.phi, s.z, s.y), AXT_OK);
        CHECK_EQUAL(axt_iv_update(&least_squares, s.phi, s.phi, s.y), AXT_OK);
    }
    CHECK_NEAR(largest_error(&instrumental), 0, 0.03);
    CHECK_NEAR(largest_error(&least_squares), 2 * 0.25 / 1.25, 0.03);
}

CASE(it_follows_a_change_when_it_forgets) {
    uint64_t seed = 3;
    axt_iv iv = iv_of(0.99, 1e6);
    for (int n = 0; n < 4000; n++) {
        sample s = noisy_sample(&seed, 0, 0);
        if (n < 2000) {
            for (int k = 0; k < M; k++) {
                s.y[k] = -s.y[k];
            }
        }
        CHECK_EQUAL(axt_iv_update(&iv, s.phi, s.z, s.y), AXT_OK);
    }
    CHECK_NEAR(largest_error(&iv), 0, 0.05);
}

CASE(a_bad_sample_changes_nothing_but_the_counter) {
    uint64_t seed = 4;
    axt_iv iv = iv_of(0.99, 1e6);
    for (int n = 0; n < 100; n++) {
        const sample s = noisy_sample(&seed, 0.1, 0.1);
        CHECK_EQUAL(axt_iv_update(&iv, s.phi, s.z, s.y), AXT_OK);
    }
    axt_iv expected = iv;
    const axt_real bad[] = {not_finite[0], not_finite[1], not_finite[2], (axt_real)1.001e6,
                            (axt_real)-1.001e6};
    for (size_t b = 0; b < COUNT_OF(bad); b++) {
        for (int place = 0; place < 2 * N + M; place++) {
            sample s = noisy_sample(&seed, 0.1, 0.1);
            if (place < N) {
                s.phi[place] = bad[b];
            } else if (place < 2 * N) {
                s.z[place - N] = bad[b];
            } else {
                s.y[place - 2 * N] = bad[b];
            }
            CHECK_EQUAL(axt_iv_update(&iv, s.phi, s.z, s.y),
                        (b < 3) ? AXT_ERROR_NOT_FINITE : AXT_ERROR_RANGE);
            expected.rejected++;
            CHECK(UNCHANGED(iv, expected));
        }
    }
}

/* lambda + phi' P z = 0: the update would divide by it. */
CASE(instruments_that_point_away_from_the_regressors_are_refused) {
    axt_iv iv = iv_of(1, 1);
    const axt_real phi[N] = {1, 0, 0};
    const axt_real against[N] = {-1, 0, 0};
    const axt_real y[M] = {1, 1};
    axt_iv expected = iv;
    expected.rejected = 1;
    CHECK_EQUAL(axt_iv_update(&iv, phi, against, y), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(iv, expected));
    const axt_real nearly[N] = {(axt_real)-0.995, 0, 0};
    expected.rejected = 2;
    CHECK_EQUAL(axt_iv_update(&iv, phi, nearly, y), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(iv, expected));
    const axt_real enough[N] = {(axt_real)-0.985, 0, 0};
    CHECK_EQUAL(axt_iv_update(&iv, phi, enough, y), AXT_OK);
}

CASE(samples_up_to_a_million_are_taken) {
    axt_iv iv = iv_of(0.9, 1e15);
    const axt_real large[N] = {(axt_real)1e6, (axt_real)-1e6, (axt_real)1e6};
    CHECK_EQUAL(axt_iv_update(&iv, large, large, large), AXT_OK);
}

CASE(the_counters_stop_at_their_ends) {
    axt_iv iv = iv_of(1, 1);
    const axt_real one[N] = {1, 1, 1};
    const axt_real bad[N] = {1, not_finite[0], 1};
    iv.updates = UINT32_MAX;
    iv.rejected = UINT32_MAX;
    CHECK_EQUAL(axt_iv_update(&iv, one, one, one), AXT_OK);
    CHECK_EQUAL(axt_iv_update(&iv, bad, one, one), AXT_ERROR_NOT_FINITE);
    CHECK_EQUAL(iv.updates, UINT32_MAX);
    CHECK_EQUAL(iv.rejected, UINT32_MAX);
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_iv iv = iv_of(0.95, 7);
    const axt_iv before = iv;
    const struct {
        double forgetting;
        double prior;
    } bad[] = {{0.89, 1}, {1.01, 1}, {1, 0.99}, {1, 1.01e15}, {-1, 1}, {1, -1}};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_iv_init(&iv, (axt_real)bad[i].forgetting, (axt_real)bad[i].prior),
                    AXT_ERROR_RANGE);
        CHECK(UNCHANGED(iv, before));
    }
    for (size_t i = 0; i < COUNT_OF(not_finite); i++) {
        CHECK_EQUAL(axt_iv_init(&iv, not_finite[i], 1), AXT_ERROR_RANGE);
        CHECK_EQUAL(axt_iv_init(&iv, 1, not_finite[i]), AXT_ERROR_RANGE);
        CHECK(UNCHANGED(iv, before));
    }
}

int main(void) {
    RUN(it_solves_the_normal_equations_at_every_sample);
    RUN(noise_on_the_regressors_biases_least_squares_and_not_this);
    RUN(it_follows_a_change_when_it_forgets);
    RUN(a_bad_sample_changes_nothing_but_the_counter);
    RUN(instruments_that_point_away_from_the_regressors_are_refused);
    RUN(samples_up_to_a_million_are_taken);
    RUN(the_counters_stop_at_their_ends);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
