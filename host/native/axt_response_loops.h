/* axt_response_loops.h - what a linear oscillator answers in windows of a record, for the diagnosis
 * (axistwin.diagnose). As in axt_loops.h, a loop around the exact step of axt_integrator.h.
 */
#ifndef AXT_RESPONSE_LOOPS_H
#define AXT_RESPONSE_LOOPS_H

#include <stddef.h>

#include "axt.h"

/* x'' + damping x' + stiffness x = force over windows of `length` samples each. From each sample to
 * the next the force is linear between first[windows][length] and last[windows][length], so that it
 * may jump at the samples. Each window begins anew with position and speed start[windows][2].
 * AXT_ERROR_RANGE as axt_exact_map_init(). */
axt_status axt_loop_respond(axt_real damping, axt_real stiffness, axt_real time_step,
                            const axt_real *first, const axt_real *last, const axt_real *start,
                            size_t windows, size_t length, axt_real *position, axt_real *speed);

#endif
