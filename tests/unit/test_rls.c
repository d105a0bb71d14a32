/* Recursive least squares, against batch least squares by Householder's QR and against the
 * recursion on the covariance itself, both in extended precision; and what must hold whatever
 * comes.
 */
#include "axt_rls.h"

#include "check.h"
#include "reference.h"

enum { N = AXT_RLS_INPUTS_MAX, M = AXT_RLS_OUTPUTS_MAX };

static const struct {
    uint32_t inputs;
    uint32_t outputs;
} shapes[] = {{5, 4}, {3, 2}, {1, 1}, {2, 4}, {4, 3}, {5, 1}, {3, 1}, {3, 4}, {2, 2}};

static axt_rls rls_of(uint32_t inputs, uint32_t outputs, double forgetting, double prior) {
    axt_rls rls;
    CHECK_EQUAL(axt_rls_init(&rls, inputs, outputs, (axt_real)forgetting, (axt_real)prior), AXT_OK);
    return rls;
}

typedef struct {
    axt_real phi[N];
    axt_real y[M];
} sample;

/* Outputs that are a linear map of the regressors, and noise. */
static void respond(uint64_t *seed, sample *s, uint32_t inputs, uint32_t outputs, double noise) {
    for (uint32_t k = 0; k < outputs; k++) {
        s->y[k] = uniform(seed, -noise, noise);
        for (uint32_t j = 0; j < inputs; j++) {
            s->y[k] += s->phi[j] * ((axt_real)(k + 1) - (axt_real)j);
        }
    }
}

static sample random_sample(uint64_t *seed, uint32_t inputs, uint32_t outputs) {
    sample s = {{0}, {0}};
    for (uint32_t j = 0; j < inputs; j++) {
        s.phi[j] = uniform(seed, -1, 1);
    }
    respond(seed, &s, inputs, outputs, 0.1);
    return s;
}

/* ---- References ----------------------------------------------------------------------------- */

enum { ROWS_MAX = 2000 };

/* Rows of an overdetermined system, regressors then outputs. */
typedef struct {
    wide row[ROWS_MAX][N + M];
    uint32_t rows;
} batch_problem;

/* The prior is n more equations: theta[j] / sqrt(prior) = 0. */
static void batch_start(batch_problem *batch, const axt_rls *rls) {
    memset(batch, 0, sizeof *batch);
    for (uint32_t j = 0; j < rls->inputs; j++) {
        batch->row[j][j] = 1 / sqrtl((wide)rls->prior);
    }
    batch->rows = rls->inputs;
}

static void batch_add(batch_problem *batch, const axt_rls *rls, const sample *s) {
    for (uint32_t j = 0; j < rls->inputs; j++) {
        batch->row[batch->rows][j] = (wide)s->phi[j];
    }
    for (uint32_t k = 0; k < rls->outputs; k++) {
        batch->row[batch->rows][rls->inputs + k] = (wide)s->y[k];
    }
    batch->rows++;
}

/* Least squares by Householder reflections; theta[output][input]. Destroys the rows. */
static void batch_solve(batch_problem *batch, const axt_rls *rls, wide theta[M][N]) {
    const uint32_t n = rls->inputs;
    const uint32_t columns = n + rls->outputs;
    for (uint32_t j = 0; j < n; j++) {
        wide norm = 0;
        for (uint32_t i = j; i < batch->rows; i++) {
            norm += batch->row[i][j] * batch->row[i][j];
        }
        norm = copysignl(sqrtl(norm), batch->row[j][j]);
        const wide corner = batch->row[j][j] + norm;
        batch->row[j][j] = corner;
        for (uint32_t c = j + 1; c < columns; c++) {
            wide dot = 0;
            for (uint32_t i = j; i < batch->rows; i++) {
                dot += batch->row[i][j] * batch->row[i][c];
            }
            for (uint32_t i = j; i < batch->rows; i++) {
                batch->row[i][c] -= batch->row[i][j] * dot / (norm * corner);
            }
        }
        batch->row[j][j] = -norm;
    }
    for (uint32_t k = 0; k < rls->outputs; k++) {
        for (uint32_t j = n; j-- > 0;) {
            wide sum = batch->row[j][n + k];
            for (uint32_t i = j + 1; i < n; i++) {
                sum -= batch->row[j][i] * theta[k][i];
            }
            theta[k][j] = sum / batch->row[j][j];
        }
    }
}

/* The recursion on P itself, factored anew for every sample, as axt_rls.h defines it. */
typedef struct {
    uint32_t n;
    uint32_t m;
    wide forgetting;
    wide prior;
    wide P[N][N];
    wide theta[M][N];
} covariance_rls;

static void covariance_start(covariance_rls *reference, const axt_rls *rls) {
    *reference = (covariance_rls){.n = rls->inputs,
                                  .m = rls->outputs,
                                  .forgetting = (wide)rls->forgetting,
                                  .prior = (wide)rls->prior};
    for (uint32_t j = 0; j < rls->inputs; j++) {
        reference->P[j][j] = (wide)rls->prior;
    }
}

/* P = U D U', from the last column to the first. */
static void factorise(uint32_t n, wide P[N][N], wide U[N][N], wide D[N]) {
    wide rest[N][N];
    memcpy(rest, P, sizeof rest);
    memset(U, 0, sizeof rest);
    for (uint32_t j = n; j-- > 0;) {
        D[j] = rest[j][j];
        for (uint32_t i = 0; i <= j; i++) {
            U[i][j] = rest[i][j] / D[j];
        }
        for (uint32_t i = 0; i < j; i++) {
            for (uint32_t c = 0; c < j; c++) {
                rest[i][c] -= U[i][j] * U[c][j] * D[j];
            }
        }
    }
}

static void covariance_update(covariance_rls *reference, const sample *s) {
    const uint32_t n = reference->n;
    wide U[N][N];
    wide before[N];
    wide after[N];
    wide f[N] = {0};
    wide gain[N] = {0};
    wide r = 0;
    factorise(n, reference->P, U, before);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            f[j] += U[i][j] * (wide)s->phi[i];
            gain[i] += reference->P[i][j] * (wide)s->phi[j];
        }
        r += gain[i] * (wide)s->phi[i];
    }
    for (uint32_t k = 0; k < reference->m; k++) {
        wide innovation = (wide)s->y[k];
        for (uint32_t j = 0; j < n; j++) {
            innovation -= (wide)s->phi[j] * reference->theta[k][j];
        }
        for (uint32_t j = 0; j < n; j++) {
            reference->theta[k][j] += gain[j] * innovation / (1 + r);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            reference->P[i][j] -= gain[i] * gain[j] / (1 + r);
        }
    }
    factorise(n, reference->P, U, after);
    for (uint32_t j = 0; j < n; j++) {
        const wide renewed = before[j] * f[j] * f[j];
        const wide most = (1 - reference->forgetting) * (1 - before[j] / reference->prior);
        const wide growth = before[j] * fminl(16 * renewed, most);
        for (uint32_t i = 0; i < n; i++) {
            for (uint32_t c = 0; c < n; c++) {
                reference->P[i][c] += U[i][j] * growth * U[c][j];
            }
        }
    }
}

static void check_theta(const axt_rls *rls, wide theta[M][N], double tolerance) {
    for (uint32_t k = 0; k < rls->outputs; k++) {
        for (uint32_t j = 0; j < rls->inputs; j++) {
            CHECK_NEAR((wide)rls->theta[k][j] - theta[k][j], 0, tolerance);
        }
    }
}

/* Seen against the size of P's elements. */
static void check_covariance(const axt_rls *rls, const covariance_rls *reference,
                             double tolerance) {
    for (uint32_t i = 0; i < rls->inputs; i++) {
        for (uint32_t j = 0; j < rls->inputs; j++) {
            const wide size = sqrtl(reference->P[i][i] * reference->P[j][j]);
            const wide found = (wide)axt_rls_covariance(rls, i, j);
            CHECK_NEAR((found - reference->P[i][j]) / size, 0, tolerance);
        }
    }
}

/* ---- RLS is least squares ------------------------------------------------------------------- */

CASE(without_forgetting_it_is_batch_least_squares_at_every_sample_count) {
    static batch_problem batch;
    static const uint32_t counts[] = {1, 2, 3, 5, 8, 20, 100, 1500};
    for (size_t i = 0; i < COUNT_OF(shapes) * COUNT_OF(counts); i++) {
        axt_rls rls = rls_of(shapes[i / COUNT_OF(counts)].inputs,
                             shapes[i / COUNT_OF(counts)].outputs, 1, 1000);
        batch_start(&batch, &rls);
        uint64_t seed = i;
        for (uint32_t n = 0; n < counts[i % COUNT_OF(counts)]; n++) {
            const sample s = random_sample(&seed, rls.inputs, rls.outputs);
            CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
            batch_add(&batch, &rls, &s);
        }
        wide theta[M][N];
        batch_solve(&batch, &rls, theta);
        check_theta(&rls, theta, 2000 * REAL_EPSILON);
    }
}

CASE(with_forgetting_it_is_the_recursion_of_the_covariance) {
    static const double forgettings[] = {1, 0.999, 0.98, 0.9};
    for (size_t i = 0; i < COUNT_OF(shapes) * COUNT_OF(forgettings); i++) {
        axt_rls rls = rls_of(shapes[i / COUNT_OF(forgettings)].inputs,
                             shapes[i / COUNT_OF(forgettings)].outputs,
                             forgettings[i % COUNT_OF(forgettings)], 1000);
        covariance_rls reference;
        covariance_start(&reference, &rls);
        uint64_t seed = i;
        for (uint32_t n = 0; n < 2000; n++) {
            const sample s = random_sample(&seed, rls.inputs, rls.outputs);
            CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
            covariance_update(&reference, &s);
            if (n % 50 == 0) {
                check_theta(&rls, reference.theta, 2000 * REAL_EPSILON);
                check_covariance(&rls, &reference, 2000 * REAL_EPSILON);
            }
        }
    }
}

CASE(innovation_times_certainty_is_the_residual_left) {
    axt_rls rls = rls_of(5, 4, 0.99, 1000);
    uint64_t seed = 1;
    for (uint32_t n = 0; n < 1000; n++) {
        const sample s = random_sample(&seed, 5, 4);
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
        for (uint32_t k = 0; k < 4; k++) {
            wide left = (wide)s.y[k];
            for (uint32_t j = 0; j < 5; j++) {
                left -= (wide)s.phi[j] * (wide)rls.theta[k][j];
            }
            CHECK_NEAR((wide)rls.innovation[k] * (wide)rls.certainty - left, 0, 64 * REAL_EPSILON);
        }
    }
}

CASE(nearly_collinear_regressors_do_no_harm) {
    static batch_problem batch;
    axt_rls rls = rls_of(5, 4, 1, 1e6);
    batch_start(&batch, &rls);
    uint64_t seed = 2;
    for (int n = 0; n < 1900; n++) {
        sample s = random_sample(&seed, 5, 4);
        s.phi[1] = s.phi[0] + (axt_real)1e-4 * s.phi[1];
        respond(&seed, &s, 5, 4, 1e-4);
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
        CHECK(axt_rls_invariants(&rls));
        batch_add(&batch, &rls, &s);
    }
    wide theta[M][N];
    batch_solve(&batch, &rls, theta);
    for (uint32_t k = 0; k < 4; k++) {
        /* what the samples tell apart to 1, and what they tell apart to 1e-4 only */
        const wide together = (wide)rls.theta[k][0] + (wide)rls.theta[k][1];
        CHECK_NEAR(together - (theta[k][0] + theta[k][1]), 0, 2000 * REAL_EPSILON);
        CHECK_NEAR((wide)rls.theta[k][0] - theta[k][0], 0, 2000 * 1e4 * REAL_EPSILON);
        for (uint32_t j = 2; j < 5; j++) {
            CHECK_NEAR((wide)rls.theta[k][j] - theta[k][j], 0, 2000 * REAL_EPSILON);
        }
    }
}

/* ---- Invariances ---------------------------------------------------------------------------- */

CASE(outputs_do_not_know_of_each_other) {
    static const uint32_t order[M] = {2, 0, 3, 1};
    axt_rls all = rls_of(5, 4, 0.99, 1000);
    axt_rls permuted = all;
    axt_rls single[M];
    for (uint32_t k = 0; k < M; k++) {
        single[k] = rls_of(5, 1, 0.99, 1000);
    }
    uint64_t seed = 3;
    for (int n = 0; n < 1000; n++) {
        const sample s = random_sample(&seed, 5, 4);
        axt_real y[M];
        for (uint32_t k = 0; k < M; k++) {
            y[k] = s.y[order[k]];
            CHECK_EQUAL(axt_rls_update(&single[k], s.phi, &s.y[k]), AXT_OK);
        }
        CHECK_EQUAL(axt_rls_update(&all, s.phi, s.y), AXT_OK);
        CHECK_EQUAL(axt_rls_update(&permuted, s.phi, y), AXT_OK);
    }
    CHECK(UNCHANGED(permuted.factor, all.factor));
    for (uint32_t k = 0; k < M; k++) {
        CHECK(UNCHANGED(permuted.theta[k], all.theta[order[k]]));
        CHECK(UNCHANGED(single[k].theta[0], all.theta[k]));
        CHECK(UNCHANGED(single[k].factor, all.factor));
    }
}

CASE(scaling_by_powers_of_two_changes_no_bit) {
    const axt_real input_scale = 64;
    const axt_real output_scale = (axt_real)0.125;
    axt_rls plain = rls_of(5, 4, 0.99, 65536);
    axt_rls scaled = rls_of(5, 4, 0.99, 65536.0 / (64 * 64));
    uint64_t seed = 4;
    for (int n = 0; n < 1000; n++) {
        const sample s = random_sample(&seed, 5, 4);
        sample t = s;
        for (uint32_t j = 0; j < 5; j++) {
            t.phi[j] *= input_scale;
        }
        for (uint32_t k = 0; k < 4; k++) {
            t.y[k] *= output_scale;
        }
        CHECK_EQUAL(axt_rls_update(&plain, s.phi, s.y), AXT_OK);
        CHECK_EQUAL(axt_rls_update(&scaled, t.phi, t.y), AXT_OK);
        for (uint32_t k = 0; k < 4; k++) {
            for (uint32_t j = 0; j < 5; j++) {
                scaled.theta[k][j] *= input_scale / output_scale; /* back, to compare ... */
            }
            CHECK(UNCHANGED(scaled.theta[k], plain.theta[k]));
            for (uint32_t j = 0; j < 5; j++) {
                scaled.theta[k][j] /= input_scale / output_scale; /* ... and there again: exact */
            }
        }
    }
}

CASE(a_negative_signal_has_the_same_parameters) {
    axt_rls plain = rls_of(5, 4, 0.99, 1000);
    axt_rls negative = plain;
    uint64_t seed = 5;
    for (int n = 0; n < 1000; n++) {
        sample s = random_sample(&seed, 5, 4);
        CHECK_EQUAL(axt_rls_update(&plain, s.phi, s.y), AXT_OK);
        for (uint32_t j = 0; j < 5; j++) {
            s.phi[j] = -s.phi[j];
        }
        for (uint32_t k = 0; k < 4; k++) {
            s.y[k] = -s.y[k];
        }
        CHECK_EQUAL(axt_rls_update(&negative, s.phi, s.y), AXT_OK);
    }
    CHECK(UNCHANGED(negative.theta, plain.theta));
    CHECK(UNCHANGED(negative.factor, plain.factor));
}

/* ---- Forgetting ----------------------------------------------------------------------------- */

CASE(it_follows_a_change_when_it_forgets_and_does_not_when_it_does_not) {
    axt_rls forgets = rls_of(5, 4, 0.99, 1000);
    axt_rls remembers = rls_of(5, 4, 1, 1000);
    uint64_t seed = 6;
    for (int n = 0; n < 4000; n++) {
        sample s = random_sample(&seed, 5, 4);
        if (n >= 2000) { /* the parameters double */
            for (uint32_t k = 0; k < 4; k++) {
                s.y[k] *= 2;
            }
        }
        CHECK_EQUAL(axt_rls_update(&forgets, s.phi, s.y), AXT_OK);
        CHECK_EQUAL(axt_rls_update(&remembers, s.phi, s.y), AXT_OK);
    }
    for (uint32_t k = 0; k < 4; k++) {
        CHECK_NEAR(forgets.theta[k][0], 2 * (k + 1), 0.1);
        CHECK_NEAR(remembers.theta[k][0], 1.5 * (k + 1), 0.1);
    }
}

CASE(what_no_sample_renews_is_not_forgotten) {
    axt_rls rls = rls_of(5, 4, 0.99, 1000);
    uint64_t seed = 7;
    for (int n = 0; n < 2000; n++) {
        const sample s = random_sample(&seed, 5, 4);
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
    }
    const axt_rls before = rls;
    for (int n = 0; n < 100000; n++) {
        sample s = random_sample(&seed, 5, 4);
        for (uint32_t j = 1; j < 5; j++) { /* only the first regressor moves */
            s.phi[j] = 0;
        }
        for (uint32_t k = 0; k < 4; k++) {
            s.y[k] = s.phi[0] * (axt_real)(k + 1);
        }
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
    }
    for (uint32_t k = 0; k < 4; k++) {
        CHECK_NEAR(rls.theta[k][0], k + 1, 100 * REAL_EPSILON);
        for (uint32_t j = 1; j < 5; j++) {
            /* the others move with the first one as they are correlated with it, and no further */
            CHECK_NEAR(rls.theta[k][j], before.theta[k][j], 0.05);
        }
    }
    for (uint32_t j = 1; j < 5; j++) {
        CHECK_NEAR(axt_rls_covariance(&rls, j, j) / axt_rls_covariance(&before, j, j), 1, 0.2);
    }
}

/* A million samples at standstill: of nothing, and of the noise of a few counts. */
CASE(a_standstill_neither_blows_up_nor_forgets) {
    static const double noises[] = {0, 1e-4};
    for (size_t i = 0; i < COUNT_OF(noises); i++) {
        axt_rls rls = rls_of(5, 4, 0.995, 1e6);
        uint64_t seed = 8;
        for (int n = 0; n < 2000; n++) {
            const sample s = random_sample(&seed, 5, 4);
            CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
        }
        const axt_rls before = rls;
        for (int n = 0; n < 1000000 / SHORTENED; n++) {
            sample s = {{0}, {0}};
            for (uint32_t j = 0; j < 5; j++) {
                s.phi[j] = uniform(&seed, -1, 1) * (axt_real)noises[i];
            }
            for (uint32_t k = 0; k < 4; k++) {
                s.y[k] = uniform(&seed, -1, 1) * (axt_real)noises[i];
            }
            CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
        }
        CHECK(axt_rls_invariants(&rls));
        for (uint32_t k = 0; k < 4; k++) {
            for (uint32_t j = 0; j < 5; j++) {
                CHECK_NEAR(rls.theta[k][j], before.theta[k][j], 10 * noises[i]);
            }
        }
        for (uint32_t j = 0; j < 5; j++) {
            CHECK_NEAR(axt_rls_covariance(&rls, j, j) / axt_rls_covariance(&before, j, j), 1, 0.01);
        }
    }
}

/* ---- Whatever comes ------------------------------------------------------------------------- */

CASE(a_bad_sample_changes_nothing_but_the_counter) {
    static const double bad[] = {(double)NAN, (double)INFINITY, (double)-INFINITY, 1e30, -1e30};
    axt_rls rls = rls_of(5, 4, 0.99, 1000);
    uint64_t seed = 9;
    for (int n = 0; n < 100; n++) {
        const sample s = random_sample(&seed, 5, 4);
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
    }
    axt_rls expected = rls;
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        for (uint32_t place = 0; place < 9; place++) {
            sample s = random_sample(&seed, 5, 4);
            if (place < 5) {
                s.phi[place] = (axt_real)bad[i];
            } else {
                s.y[place - 5] = (axt_real)bad[i];
            }
            const axt_status status = axt_rls_update(&rls, s.phi, s.y);
            CHECK(status == AXT_ERROR_NOT_FINITE ||
                  (status == AXT_ERROR_RANGE && isfinite(bad[i])));
            expected.rejected++;
            CHECK(UNCHANGED(rls, expected));
        }
    }
}

CASE(the_counters_stop_at_their_ends) {
    axt_rls rls = rls_of(1, 1, 1, 1e15);
    const axt_real large = (axt_real)1e8;
    for (uint32_t n = 0; n < 3; n++) {
        rls.rejected = UINT32_MAX - 1 + n / 2;
        rls.restarts = rls.rejected;
        CHECK(axt_rls_update(&rls, &large, &not_finite[0]) != AXT_OK);
        CHECK(axt_rls_update(&rls, &large, &large) != AXT_OK);
        CHECK_EQUAL(rls.rejected, UINT32_MAX);
        CHECK_EQUAL(rls.restarts, UINT32_MAX);
    }
}

CASE(a_sample_beyond_all_bounds_starts_the_covariance_again) {
    axt_rls rls = rls_of(3, 2, 1, 1e15);
    const axt_real y[2] = {1, 2};
    const axt_real unit[3] = {1, 1, 1};
    const axt_real large[3] = {(axt_real)1e8, 0, 0}; /* phi' P phi of 1e31 */
    CHECK_EQUAL(axt_rls_update(&rls, unit, y), AXT_OK);
    const axt_rls before = rls;
    axt_rls fresh = rls_of(3, 2, 1, 1e15);
    rls.factor[0] = rls.prior;
    CHECK_EQUAL(axt_rls_update(&rls, large, y), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(rls.theta, before.theta));
    CHECK(UNCHANGED(rls.factor, fresh.factor));
    CHECK_EQUAL(rls.restarts, 1);
    CHECK_EQUAL(rls.rejected, 0);
}

static bool finite_covariance(const axt_rls *rls) {
    bool finite = true;
    for (uint32_t i = 0; i < rls->inputs; i++) {
        for (uint32_t j = 0; j < rls->inputs; j++) {
            finite = finite && isfinite(axt_rls_covariance(rls, i, j));
        }
    }
    return finite;
}

/* Within about twelve decades of `largest`, of either sign; now and then zero or any bits at all.
 */
static axt_real any_number(uint64_t *seed, double largest) {
    const uint64_t bits = random_bits(seed);
    axt_real number = log_uniform(seed, largest * 1e-12, largest);
    if (bits % 16 == 0) {
        memcpy(&number, &bits, sizeof number);
    }
    number = (bits % 8 == 1) ? (axt_real)0 : number;
    return ((bits >> 32) % 2 == 0) ? number : -number;
}

/* New samples, repeated regressors, any prior, any forgetting. */
CASE(the_invariants_hold_after_any_sample) {
    uint64_t seed = 10;
    uint32_t taken = 0;
    uint32_t refused = 0;
    for (int run = 0; run < 300; run++) {
        axt_rls rls = rls_of(shapes[(size_t)run % COUNT_OF(shapes)].inputs,
                             shapes[(size_t)run % COUNT_OF(shapes)].outputs,
                             (double)uniform(&seed, 0.9, 1), (double)log_uniform(&seed, 1.1, 9e14));
        const double largest = (double)log_uniform(&seed, 1e-3, 1e9);
        sample s = random_sample(&seed, rls.inputs, rls.outputs);
        for (int n = 0; n < 1000; n++) {
            const bool repeat = random_bits(&seed) % 4 == 0;
            for (uint32_t j = 0; !repeat && j < rls.inputs; j++) {
                s.phi[j] = any_number(&seed, largest);
            }
            for (uint32_t k = 0; k < rls.outputs; k++) {
                s.y[k] = any_number(&seed, largest);
            }
            taken += (axt_rls_update(&rls, s.phi, s.y) == AXT_OK) ? 1U : 0U;
            CHECK(axt_rls_invariants(&rls));
            CHECK(finite_covariance(&rls));
        }
        refused += rls.rejected + rls.restarts;
    }
    CHECK_EQUAL(taken + refused, 300000);
    CHECK(taken > 100000 && refused > 10000);
}

CASE(reset_forgets_all_but_the_settings_and_the_counters) {
    axt_rls fresh = rls_of(3, 2, 0.99, 1000);
    axt_rls rls = fresh;
    uint64_t seed = 11;
    for (int n = 0; n < 100; n++) {
        const sample s = random_sample(&seed, 3, 2);
        CHECK_EQUAL(axt_rls_update(&rls, s.phi, s.y), AXT_OK);
    }
    CHECK(axt_rls_update(&rls, not_finite, not_finite) != AXT_OK);
    axt_rls_reset(&rls);
    fresh.rejected = 1;
    CHECK(UNCHANGED(rls, fresh));
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_rls rls = rls_of(3, 2, 0.99, 1000);
    const axt_rls before = rls;
    static const struct {
        uint32_t inputs;
        uint32_t outputs;
        float forgetting;
        float prior;
    } bad[] = {
        {0, 2, 1, 100},     {6, 2, 1, 100},          {UINT32_MAX, 2, 1, 100}, {3, 0, 1, 100},
        {3, 5, 1, 100},     {3, UINT32_MAX, 1, 100}, {3, 2, 0.89F, 100},      {3, 2, 1.001F, 100},
        {3, 2, -1, 100},    {3, 2, NAN, 100},        {3, 2, INFINITY, 100},   {3, 2, 1, 0.99F},
        {3, 2, 1, 1.1e15F}, {3, 2, 1, -100},         {3, 2, 1, NAN},          {3, 2, 1, INFINITY}};
    for (size_t i = 0; i < COUNT_OF(bad); i++) {
        CHECK_EQUAL(axt_rls_init(&rls, bad[i].inputs, bad[i].outputs, (axt_real)bad[i].forgetting,
                                 (axt_real)bad[i].prior),
                    AXT_ERROR_RANGE);
    }
    CHECK(UNCHANGED(rls, before));
    CHECK_EQUAL(axt_rls_init(&rls, 1, 1, (axt_real)0.9, 1), AXT_OK);
    CHECK_EQUAL(axt_rls_init(&rls, 5, 4, 1, (axt_real)1e15), AXT_OK);
}

CASE(elements_outside_the_covariance_are_zero) {
    const axt_rls rls = rls_of(3, 2, 1, 1000);
    CHECK_NEAR(axt_rls_covariance(&rls, 2, 2), 1000, 0);
    CHECK_NEAR(axt_rls_covariance(&rls, 3, 0), 0, 0);
    CHECK_NEAR(axt_rls_covariance(&rls, 0, 3), 0, 0);
    CHECK_NEAR(axt_rls_covariance(&rls, UINT32_MAX, UINT32_MAX), 0, 0);
}

CASE(a_damaged_state_is_recognised) {
    const axt_rls fine = rls_of(5, 4, 0.99, 1000);
    CHECK(axt_rls_invariants(&fine));
    for (size_t i = 0; i < COUNT_OF(fine.factor); i++) {
        axt_rls rls = fine;
        rls.factor[i] = not_finite[0];
        CHECK(!axt_rls_invariants(&rls));
    }
    for (uint32_t k = 0; k < M; k++) {
        axt_rls rls = fine;
        rls.innovation[k] = not_finite[1];
        CHECK(!axt_rls_invariants(&rls));
        for (uint32_t j = 0; j < N; j++) {
            rls = fine;
            rls.theta[k][j] = not_finite[2];
            CHECK(!axt_rls_invariants(&rls));
        }
    }
    axt_rls rls = fine;
    rls.factor[0] = -1;
    CHECK(!axt_rls_invariants(&rls));
    rls = fine;
    rls.inputs = 6;
    CHECK(!axt_rls_invariants(&rls));
    rls = fine;
    rls.inputs = 0;
    CHECK(!axt_rls_invariants(&rls));
    for (uint8_t outputs = 0; outputs <= 5; outputs += 5) {
        rls = fine;
        rls.outputs = outputs;
        CHECK(!axt_rls_invariants(&rls));
    }
    for (int forgetting = 0; forgetting <= 2; forgetting += 2) {
        rls = fine;
        rls.forgetting = (axt_real)forgetting;
        CHECK(!axt_rls_invariants(&rls));
    }
    rls = fine;
    rls.factor[0] = 1001; /* above its start */
    CHECK(!axt_rls_invariants(&rls));
}

/* ---- Information ------------------------------------------------------------------------------
 */

/* Inverse of the n x n matrix in `a`, by Gauss and Jordan with pivots. */
static void invert(wide a[N][N], uint32_t n, wide inverse[N][N]) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            inverse[i][j] = (i == j) ? 1 : 0;
        }
    }
    for (uint32_t k = 0; k < n; k++) {
        const wide pivot = a[k][k]; /* not zero: the matrix is positive definite */
        for (uint32_t j = 0; j < n; j++) {
            a[k][j] /= pivot;
            inverse[k][j] /= pivot;
        }
        for (uint32_t i = 0; i < n; i++) {
            const wide share = (i == k) ? 0 : a[i][k];
            for (uint32_t j = 0; j < n; j++) {
                a[i][j] -= share * a[k][j];
                inverse[i][j] -= share * inverse[k][j];
            }
        }
    }
}

CASE(information_is_the_diagonal_of_the_inverse) {
    uint64_t seed = 20;
    for (uint32_t n = 1; n <= N; n++) {
        for (int run = 0; run < 50; run++) {
            axt_rls rls = rls_of(n, 1, 1, 100);
            for (uint32_t k = 0; k < 3 * n; k++) {
                axt_real phi[N];
                const axt_real y = 0;
                for (uint32_t i = 0; i < n; i++) {
                    phi[i] = gaussian(&seed);
                }
                CHECK_EQUAL(axt_rls_update(&rls, phi, &y), AXT_OK);
            }
            wide factors[N][N]; /* P = U D U', of the very factors */
            wide inverse[N][N];
            for (uint32_t i = 0; i < n; i++) {
                for (uint32_t j = 0; j < n; j++) {
                    factors[i][j] = 0;
                    for (uint32_t k = (i > j) ? i : j; k < n; k++) {
                        const axt_real *column = &rls.factor[k * (k + 1) / 2];
                        const wide left = (i == k) ? 1 : (wide)column[i];
                        const wide right = (j == k) ? 1 : (wide)column[j];
                        factors[i][j] += left * right * (wide)column[k];
                    }
                }
            }
            invert(factors, n, inverse);
            for (uint32_t i = 0; i < n; i++) {
                CHECK_NEAR((wide)axt_rls_information(&rls, i) / inverse[i][i], 1,
                           1000 * REAL_EPSILON);
            }
            CHECK_NEAR(axt_rls_information(&rls, n), 0, 0);
        }
    }
}

int main(void) {
    RUN(without_forgetting_it_is_batch_least_squares_at_every_sample_count);
    RUN(with_forgetting_it_is_the_recursion_of_the_covariance);
    RUN(innovation_times_certainty_is_the_residual_left);
    RUN(nearly_collinear_regressors_do_no_harm);
    RUN(outputs_do_not_know_of_each_other);
    RUN(scaling_by_powers_of_two_changes_no_bit);
    RUN(a_negative_signal_has_the_same_parameters);
    RUN(it_follows_a_change_when_it_forgets_and_does_not_when_it_does_not);
    RUN(what_no_sample_renews_is_not_forgotten);
    RUN(a_standstill_neither_blows_up_nor_forgets);
    RUN(a_bad_sample_changes_nothing_but_the_counter);
    RUN(the_counters_stop_at_their_ends);
    RUN(a_sample_beyond_all_bounds_starts_the_covariance_again);
    RUN(the_invariants_hold_after_any_sample);
    RUN(reset_forgets_all_but_the_settings_and_the_counters);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    RUN(elements_outside_the_covariance_are_zero);
    RUN(a_damaged_state_is_recognised);
    RUN(information_is_the_diagonal_of_the_inverse);
    say_if_shortened("test_rls");
    return REPORT();
}
