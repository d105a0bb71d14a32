/* axt_response_loops.h - what an axis answers in windows of a record, for the diagnosis
 * (axistwin.diagnose). As in axt_loops.h, loops around steps of the core.
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

/* The axis with effects under torque[windows][length], each sample held until the next, in
 * `substeps` steps from one to the next. Each window begins anew: at times[windows] [s], from which
 * on what drifts and turns has gone on, and in the state starts[windows], a further mode in that of
 * modes[windows][2], twist and speed as axt_machine_set_mode() has them.
 * angles[2][windows][length] of motor and table are counted from where the motor was at the start
 * of the window, without the errors of the encoders; speeds likewise. Steps are exact ones. Fails
 * as axt_machine_init(), axt_machine_make_exact(), axt_machine_set() and axt_machine_set_mode(),
 * also when a stiffness has drifted to nothing. */
axt_status axt_loop_windows(const axt_axis *axis, const axt_effects *effects, axt_real time_step,
                            uint32_t substeps, const axt_real *times, const axt_motion *starts,
                            const axt_real *modes, const axt_real *torque, size_t windows,
                            size_t length, axt_real *angles, axt_real *speeds);

#endif
