/* axt_encoder.h - angles as encoder counts and back.
 *
 * A count is a 32-bit integer that wraps around, as a drive's position register does: the
 * difference of two counts, taken modulo 2^32, is right however often the register has wrapped.
 */
#ifndef AXT_ENCODER_H
#define AXT_ENCODER_H

#include "axt_plant.h"
#include "axt_real.h"
#include "axt_status.h"

#define AXT_ENCODER_COUNTS_MAX 16777216 /* 2^24: exact in float32 */

/* Where an encoder sits on the axis. */
typedef enum { AXT_ENCODER_MOTOR = 0, AXT_ENCODER_TABLE = 1 } axt_encoder_place;

/* The reading of an encoder with `counts_per_turn` (1 .. 2^24) while the axis is at `motion`: the
 * nearest count, turns included, however far the axis has travelled: to 1e-6 counts at the motor,
 * and at the table to the rounding of the twist. Cost: about 30 operations. AXT_ERROR_RANGE or
 * AXT_ERROR_NOT_FINITE leave `count` unchanged. */
axt_status axt_encoder_read(uint32_t counts_per_turn, const axt_motion *motion,
                            axt_encoder_place place, int32_t *count);

/* later - earlier, modulo 2^32. */
int32_t axt_encoder_difference(int32_t later, int32_t earlier);

/* A number of counts as an angle [rad]. counts_per_turn is not 0. */
axt_real axt_encoder_angle(uint32_t counts_per_turn, int32_t counts);

#endif
