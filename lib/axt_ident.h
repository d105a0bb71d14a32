/* axt_ident.h - the parameters of a running axis, identified while it runs: regressors
 * (axt_regressor.h), recursive least squares (axt_rls.h), what their rows say (axt_rows.h), and how
 * far that can be relied on (axt_scatter.h).
 *
 * Samples are numbered. One that is not newer than the last, that is not a number, or that the axis
 * cannot have reached is refused and counted, and changes nothing else; a number that is left out
 * is a gap, across which nothing is learned. So a refused sample leaves a gap of its own behind.
 */
#ifndef AXT_IDENT_H
#define AXT_IDENT_H

#include "axt_axis.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_regressor.h"
#include "axt_rls.h"
#include "axt_scatter.h"
#include "axt_status.h"

/* Bits of axt_estimate.valid; all set: AXT_VALID_ALL. */
enum { AXT_VALID_I1 = 1, AXT_VALID_I2 = 2, AXT_VALID_B = 4, AXT_VALID_K = 8, AXT_VALID_ALL = 15 };

/* What the ideal axis has not: a coefficient, its standard error, and their ratio. |t| is above
 * 1.96 in one of twenty cases, above 3.29 in one of a thousand, when it has none. */
typedef struct {
    axt_real value;
    axt_real error;
    axt_real t;
} axt_surplus;

typedef struct {
    axt_axis axis;         /* I1, I2, B, K */
    axt_modal modal;       /* wn, wd, zeta */
    axt_axis axis_error;   /* standard errors of I1, I2, B, K */
    axt_modal modal_error; /* standard errors of wn, wd, zeta */
    axt_surplus friction;  /* viscous, motor and table to ground [N m s/rad]; 5x4 only, else 0 */
    axt_surplus spring;    /* motor and table to ground [N m/rad], gravity included; likewise */
    uint32_t valid;        /* which of I1, I2, B, K can be relied on; modal values need all */
    uint32_t samples;      /* learned from so far */
} axt_estimate;

/* They only grow, and stop at their ends. */
typedef struct {
    uint32_t not_finite; /* samples refused because they were no numbers, */
    uint32_t range;      /* far beyond what `expected` and `torque` allow, */
    uint32_t repeated;   /* not newer than the last one, */
    uint32_t jumped;     /* or further from it than the axis can go */
    uint32_t gaps;       /* places where numbers were left out */
} axt_ident_counters;

/* The last samples, to judge the next one by. Counts are of motor and table; speeds are those of
 * the motor and of the twist. */
typedef struct {
    uint32_t next;  /* number of the sample to come */
    uint32_t known; /* samples since the start or the last gap, up to two */
    int32_t count[2];
    int32_t step[2];
    int32_t change_max[2]; /* of a step in a sample [counts] */
    axt_real speed[2];
    axt_real speed_change_max[2]; /* in a sample [rad/s] */
} axt_ident_guard;

/* Fields are its own business, the counters excepted; read it with axt_ident_result(). */
typedef struct {
    axt_ident_guard guard;
    axt_regressor regressor;
    axt_equation equation; /* the last one learned from */
    axt_rls rls;
    axt_scatter scatter;
    axt_ident_counters counters;
    uint32_t samples; /* learned from since the last reset, saturating */
} axt_ident;

/* AXT_ERROR_RANGE / _NOT_FINITE when the settings make no sense; `ident` is then unchanged. */
axt_status axt_ident_init(axt_ident *ident, const axt_ident_config *config);

/* Forgets what was learned; settings and counters stay. */
void axt_ident_reset(axt_ident *ident);

/* Sample `number` with measured speeds: the motion and the torque [N m] of the same instant.
 * AXT_OK: learned from, `equation` is what it said. AXT_ERROR_NO_DATA: taken, but it says nothing
 * yet, or the axis stands still. AXT_ERROR_REPEATED, _JUMP, _NOT_FINITE, _RANGE: refused and
 * counted. AXT_ERROR_RANGE, not counted, when the settings say encoders. Cost: one RLS update and
 * about 70 operations. */
axt_status axt_ident_motion(axt_ident *ident, uint32_t number, const axt_motion *motion,
                            axt_real torque);

/* Sample `number` from encoders alone: counts of motor and table and the torque of the same
 * instant. Answers as axt_ident_motion(); AXT_ERROR_RANGE when the settings say speeds. Cost: one
 * RLS update and about 100 operations. */
axt_status axt_ident_counts(axt_ident *ident, uint32_t number, int32_t motor, int32_t table,
                            axt_real torque);

/* The present answer. AXT_ERROR_NO_DATA (with the flags cleared and zeros) before it means
 * anything. Standard errors take some 300 to 2000 samples; until then they are zero and no flag is
 * set. Cost: about 2000 operations: not for the interrupt. */
axt_status axt_ident_result(const axt_ident *ident, axt_estimate *estimate);

#endif
