/* axt_paper_loops.h - more of the core called over arrays, for the studies of the paper
 * (axistwin.paper). As in axt_loops.h, each function is a loop around functions of lib/.
 */
#ifndef AXT_PAPER_LOOPS_H
#define AXT_PAPER_LOOPS_H

#include <stddef.h>

#include "axt.h"

/* Recursive least squares over n equations y = theta phi: phi[n][inputs], y[n][outputs]. After
 * every `every` of them and after the last: theta[][outputs][inputs], and in definite[] whether P
 * has been positive definite after each update so far (axt_rls_invariants()). */
axt_status axt_loop_rls(uint32_t inputs, uint32_t outputs, axt_real forgetting, axt_real prior,
                        const axt_real *phi, const axt_real *y, size_t n, size_t every,
                        axt_real *theta, uint8_t *definite, size_t *done);

/* The excitation identified back (Eq. 18): mean torque over each of the n - 1 steps. */
axt_status axt_loop_torque(const axt_axis *axis, axt_real time_step, const axt_motion *motion,
                           size_t n, axt_real *mean, size_t *done);

#endif
