/* axt_estimator_loops.h - the estimators beside axt_ident called over arrays: equations first, so
 * that every estimator is given the same ones. As in axt_loops.h, each function is a loop around
 * one function of lib/.
 */
#ifndef AXT_ESTIMATOR_LOOPS_H
#define AXT_ESTIMATOR_LOOPS_H

#include <stddef.h>

#include "axt.h"

/* The equations of the short form (3x2) that n samples give, `count` of them: phi[][3], y[][2], and
 * sample[], at which each was complete. */
axt_status axt_loop_equations_motion(axt_regressor *regressor, const axt_motion *motion,
                                     const axt_real *torque, size_t n, axt_real *phi, axt_real *y,
                                     int64_t *sample, size_t *count);
axt_status axt_loop_equations_counts(axt_regressor *regressor, const int32_t *motor,
                                     const int32_t *table, const axt_real *torque, size_t n,
                                     axt_real *phi, axt_real *y, int64_t *sample, size_t *count);

/* Extended least squares over n equations. After every `every` of them and after the last,
 * theta[][2][3]. What is refused is counted in `rejected`. */
axt_status axt_loop_els(axt_real forgetting, axt_real prior, const axt_real *phi, const axt_real *y,
                        size_t n, size_t every, axt_real *theta, uint32_t *rejected);

/* Instrumental variables, the instruments the regressors `delay` equations earlier; the first
 * `delay` equations serve as instruments only. Otherwise as axt_loop_els(). */
axt_status axt_loop_iv(axt_real forgetting, axt_real prior, const axt_real *phi, const axt_real *y,
                       size_t n, size_t delay, size_t every, axt_real *theta, uint32_t *rejected);

#endif
