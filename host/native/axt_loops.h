/* axt_loops.h - the core called over arrays, so that Python does not loop sample by sample.
 *
 * Each function is a loop around one function of lib/ and nothing else. A failing one leaves in
 * `done` how many samples were dealt with: the next one is the culprit.
 */
#ifndef AXT_LOOPS_H
#define AXT_LOOPS_H

#include <stddef.h>

#include "axt.h"

/* Motion at n samples of the torque: the first is `start` with torque[0] acting, then one step
 * each. */
axt_status axt_loop_simulate(const axt_axis *axis, axt_real time_step, const axt_newmark *newmark,
                             const axt_motion *start, const axt_real *torque, size_t n,
                             axt_motion *motion, size_t *done);

/* As axt_loop_simulate(), of an axis with effects as its encoders show it. `time_step` [s] is that
 * of the samples, with `substeps` steps of the machine in between. */
axt_status axt_loop_simulate_effects(const axt_axis *axis, axt_real time_step,
                                     axt_torque_course course, const axt_effects *effects,
                                     uint32_t substeps, const axt_motion *start,
                                     const axt_real *torque, size_t n, axt_motion *motion,
                                     size_t *done);

/* As axt_loop_simulate(), by any of the methods of axt_integrator.h. */
axt_status axt_loop_integrate(axt_method method, const axt_axis *axis, axt_real time_step,
                              const axt_motion *start, const axt_real *torque, size_t n,
                              axt_motion *motion, size_t *done);

/* Reading of one encoder at n motions. */
axt_status axt_loop_read_encoder(uint32_t counts_per_turn, axt_encoder_place place,
                                 const axt_motion *motion, size_t n, int32_t *counts, size_t *done);

/* Identification from n samples. gap[i] not 0: sample i does not follow sample i - 1 by one time
 * step. An estimate is taken after every `every` samples and after the last: ceil(n / every) of
 * them. Samples that are refused are counted in `rejected`. */
axt_status axt_loop_ident_motion(const axt_ident_config *config, const axt_motion *motion,
                                 const axt_real *torque, const uint8_t *gap, size_t n, size_t every,
                                 axt_estimate *estimates, uint32_t *rejected);
axt_status axt_loop_ident_counts(const axt_ident_config *config, const int32_t *motor,
                                 const int32_t *table, const axt_real *torque, const uint8_t *gap,
                                 size_t n, size_t every, axt_estimate *estimates,
                                 uint32_t *rejected);

#endif
