/* check.h - the harness of the unit tests: a program a file, named cases, checks that carry on.
 *
 *     CASE(an_axis_at_rest_stays_at_rest) {
 *         CHECK(axt_plant_init(&plant, &axis) == AXT_OK);
 *         CHECK_EQUAL(plant.counts, 0);
 *         CHECK_NEAR(plant.speed, 0.0, 1e-9);
 *     }
 *
 *     int main(void) {
 *         RUN(an_axis_at_rest_stays_at_rest);
 *         return REPORT();
 *     }
 *
 * A failing check prints file, line and values and the case goes on; a case passes when all its
 * checks do. The last line printed is `program: N passed, N failed`; the program's exit status is 1
 * when a case failed or none ran. A case that is never RUN does not compile (unused function).
 */
#ifndef CHECK_H
#define CHECK_H

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { CHECK_PRINTED_MAX = 10 }; /* of each case: a check in a loop must not fill the log */

static struct {
    const char *name; /* of the case that runs */
    int failures;     /* of its checks */
    int passed;       /* cases */
    int failed;
} check_state;

#define CASE(name) static void name(void)
#define RUN(name)  check_run(#name, name)
#define REPORT()   check_report(__BASE_FILE__)

#define CHECK(condition) check_true((condition), __FILE__, __LINE__, #condition)

/* Integers, compared and printed as long long. */
#define CHECK_EQUAL(actual, expected)                                                              \
    check_equal((long long)(actual), (long long)(expected), __FILE__, __LINE__, #actual)

/* |actual - expected| <= tolerance; never true of not-a-number. */
#define CHECK_NEAR(actual, expected, tolerance)                                                    \
    check_near((double)(actual), (double)(expected), (double)(tolerance), __FILE__, __LINE__,      \
               #actual)

static inline bool check_failed(const char *file, int line) {
    check_state.failures++;
    if (check_state.failures == CHECK_PRINTED_MAX + 1) {
        (void)fprintf(stderr, "%s:%d: %s: more failures are not printed\n", file, line,
                      check_state.name);
    }
    if (check_state.failures > CHECK_PRINTED_MAX) {
        return false;
    }
    (void)fprintf(stderr, "%s:%d: %s: ", file, line, check_state.name);
    return true;
}

static inline void check_true(bool holds, const char *file, int line, const char *text) {
    if (!holds && check_failed(file, line)) {
        (void)fprintf(stderr, "not true: %s\n", text);
    }
}

static inline void check_equal(long long actual, long long expected, const char *file, int line,
                               const char *text) {
    if (actual != expected && check_failed(file, line)) {
        (void)fprintf(stderr, "%s is %lld, expected %lld\n", text, actual, expected);
    }
}

static inline void check_near(double actual, double expected, double tolerance, const char *file,
                              int line, const char *text) {
    if (!(fabs(actual - expected) <= tolerance) && check_failed(file, line)) {
        (void)fprintf(stderr, "%s is %.17g, expected %.17g within %.3g, off by %.3g\n", text,
                      actual, expected, tolerance, actual - expected);
    }
}

static inline void check_run(const char *name, void (*body)(void)) {
    check_state.name = name;
    check_state.failures = 0;
    body();
    if (check_state.failures > 0) {
        check_state.failed++;
    } else {
        check_state.passed++;
    }
}

static inline int check_report(const char *source) {
    const char *slash = strrchr(source, '/');
    const char *name = (slash != NULL) ? slash + 1 : source;
    printf("%.*s: %d passed, %d failed\n", (int)strcspn(name, "."), name, check_state.passed,
           check_state.failed);
    return (check_state.failed > 0 || check_state.passed == 0) ? 1 : 0;
}

#endif
