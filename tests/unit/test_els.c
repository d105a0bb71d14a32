/* Extended least squares, against the plain kind where there is no noise, and against processes
 * whose noise it is made for. */
#include "axt_els.h"

#include "check.h"
#include "reference.h"

enum { N = AXT_ELS_INPUTS, M = AXT_ELS_OUTPUTS };

static axt_els els_of(double forgetting, double prior) {
    axt_els els;
    CHECK_EQUAL(axt_els_init(&els, (axt_real)forgetting, (axt_real)prior), AXT_OK);
    return els;
}

/* y[n] = a y[n-1] + b u[n-1] + b2 u[n-2] + e[n] + c e[n-1], once for each output, driven by the
 * same u. Least squares is biased: y[n-1] knows of e[n-1]. */
typedef struct {
    wide a, b, b2, c;
    wide y, e;
} process;

static const process processes[M] = {{.a = 0.8L, .b = 0.5L, .b2 = 0.2L, .c = 0.9L},
                                     {.a = 0.3L, .b = 1, .b2 = -0.4L, .c = -0.6L}};

/* Regressors of the first process; the second is not told its own past. */
typedef struct {
    process process[M];
    wide u[2];
} plant;

static plant plant_of(void) {
    return (plant){.process = {processes[0], processes[1]}};
}

static void plant_step(plant *p, uint64_t *seed, double noise, axt_real phi[M][N], axt_real y[M]) {
    for (int k = 0; k < M; k++) {
        process *q = &p->process[k];
        const wide e = (wide)noise * (wide)gaussian(seed);
        phi[k][0] = (axt_real)q->y;
        phi[k][1] = (axt_real)p->u[0];
        phi[k][2] = (axt_real)p->u[1];
        q->y = q->a * q->y + q->b * p->u[0] + q->b2 * p->u[1] + e + q->c * q->e;
        q->e = e;
        y[k] = (axt_real)q->y;
    }
    p->u[1] = p->u[0];
    p->u[0] = (wide)gaussian(seed);
}

static void check_process(const axt_rls *rls, const process *expected, double tolerance) {
    const wide value[N] = {expected->a, expected->b, expected->b2};
    for (int i = 0; i < N; i++) {
        CHECK_NEAR((wide)rls->theta[0][i] - value[i], 0, tolerance);
    }
}

/* Which of the two processes the regressors belong to; the other output then follows as it may. */
static axt_els learn(int which, double noise, int samples) {
    axt_els els = els_of(1, BY_TYPE(1e6, 1e13));
    plant p = plant_of();
    uint64_t seed = 1;
    for (int n = 0; n < samples; n++) {
        axt_real phi[M][N];
        axt_real y[M];
        plant_step(&p, &seed, noise, phi, y);
        CHECK_EQUAL(axt_els_update(&els, phi[which], y), AXT_OK);
    }
    return els;
}

CASE(parameters_and_noise_of_a_moving_average_are_found) {
    for (int k = 0; k < M; k++) {
        const axt_els els = learn(k, 0.5, 50000);
        check_process(&els.rls[k], &processes[k], 0.02);
        CHECK_NEAR((wide)els.rls[k].theta[0][N] - processes[k].c, 0, 0.03);
    }
}

CASE(plain_least_squares_is_biased_by_such_noise) {
    axt_rls rls;
    CHECK_EQUAL(axt_rls_init(&rls, N, 1, 1, (axt_real)1e6), AXT_OK);
    plant p = plant_of();
    uint64_t seed = 1;
    for (int n = 0; n < 50000; n++) {
        axt_real phi[M][N];
        axt_real y[M];
        plant_step(&p, &seed, 0.5, phi, y);
        CHECK_EQUAL(axt_rls_update(&rls, phi[0], y), AXT_OK);
    }
    CHECK((wide)rls.theta[0][0] - processes[0].a > 0.05L);
}

CASE(without_noise_it_is_exact) {
    for (int k = 0; k < M; k++) {
        const axt_els els = learn(k, 0, 1000);
        check_process(&els.rls[k], &processes[k], BY_TYPE(2e-5, 1e-12));
    }
}

/* y - theta' [phi, last residual] with theta after the update. */
CASE(the_residual_is_what_the_update_leaves) {
    axt_els els = els_of(0.99, 1e6);
    CHECK_NEAR(els.residual[0], 0, 0);
    CHECK_NEAR(els.residual[1], 0, 0);
    plant p = plant_of();
    uint64_t seed = 2;
    for (int n = 0; n < 500; n++) {
        axt_real phi[M][N];
        axt_real y[M];
        plant_step(&p, &seed, 0.3, phi, y);
        const axt_real last[M] = {els.residual[0], els.residual[1]};
        CHECK_EQUAL(axt_els_update(&els, phi[0], y), AXT_OK);
        for (int k = 0; k < M; k++) {
            const axt_real *theta = els.rls[k].theta[0];
            wide left = (wide)y[k] - (wide)theta[N] * (wide)last[k];
            for (int i = 0; i < N; i++) {
                left -= (wide)theta[i] * (wide)phi[0][i];
            }
            CHECK_NEAR((wide)els.residual[k] - left, 0, BY_TYPE(5e-6, 1e-14));
        }
    }
}

CASE(the_outputs_do_not_know_of_each_other) {
    axt_els both = els_of(0.99, 1e6);
    axt_els alone = els_of(0.99, 1e6);
    plant p = plant_of();
    uint64_t seed = 3;
    for (int n = 0; n < 500; n++) {
        axt_real phi[M][N];
        axt_real y[M];
        plant_step(&p, &seed, 0.3, phi, y);
        CHECK_EQUAL(axt_els_update(&both, phi[0], y), AXT_OK);
        y[1] = 0;
        CHECK_EQUAL(axt_els_update(&alone, phi[0], y), AXT_OK);
        CHECK(same_bytes(&both.rls[0], &alone.rls[0], sizeof both.rls[0]));
        CHECK(same_bytes(&both.residual[0], &alone.residual[0], sizeof both.residual[0]));
    }
}

CASE(a_bad_sample_changes_nothing_but_its_counter) {
    axt_els els = els_of(0.99, 1e6);
    plant p = plant_of();
    uint64_t seed = 4;
    axt_real phi[M][N];
    axt_real y[M];
    for (int n = 0; n < 100; n++) {
        plant_step(&p, &seed, 0.3, phi, y);
        CHECK_EQUAL(axt_els_update(&els, phi[0], y), AXT_OK);
    }
    axt_els expected = els;
    for (size_t b = 0; b < COUNT_OF(not_finite); b++) {
        for (int place = 0; place < N + M; place++) {
            axt_real bad_phi[N] = {1, 1, 1};
            axt_real bad_y[M] = {1, 1};
            *((place < N) ? &bad_phi[place] : &bad_y[place - N]) = not_finite[b];
            CHECK_EQUAL(axt_els_update(&els, bad_phi, bad_y), AXT_ERROR_NOT_FINITE);
            expected.rls[(place == N + 1) ? 1 : 0].rejected++;
            CHECK(UNCHANGED(els, expected));
        }
    }
}

CASE(settings_that_make_no_sense_are_refused_and_nothing_is_written) {
    axt_els els = els_of(0.95, 7);
    const axt_els before = els;
    CHECK_EQUAL(axt_els_init(&els, (axt_real)0.89, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_els_init(&els, (axt_real)1.01, 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_els_init(&els, 1, (axt_real)0.99), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_els_init(&els, 1, (axt_real)1.01e15), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_els_init(&els, not_finite[0], 1), AXT_ERROR_RANGE);
    CHECK_EQUAL(axt_els_init(&els, 1, not_finite[0]), AXT_ERROR_RANGE);
    CHECK(UNCHANGED(els, before));
}

int main(void) {
    RUN(parameters_and_noise_of_a_moving_average_are_found);
    RUN(plain_least_squares_is_biased_by_such_noise);
    RUN(without_noise_it_is_exact);
    RUN(the_residual_is_what_the_update_leaves);
    RUN(the_outputs_do_not_know_of_each_other);
    RUN(a_bad_sample_changes_nothing_but_its_counter);
    RUN(settings_that_make_no_sense_are_refused_and_nothing_is_written);
    return REPORT();
}
