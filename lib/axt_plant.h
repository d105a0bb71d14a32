/* axt_plant.h - the axis of Eq. 3 integrated by Newmark's method (Eqs. 4-6), step by step.
 *
 * The equations are split into the twist q = theta1 - theta2, which stays small, and the rigid body
 * r = (I1 theta1 + I2 theta2) / (I1 + I2), which travels without bound:
 *
 *     q'' + (B / Ir) q' + (K / Ir) q = T / I1,   Ir = I1 I2 / (I1 + I2)
 *     r'' = T / (I1 + I2)
 *
 * Newmark's method is linear, so it commutes with this change of coordinates. The twist then keeps
 * all its digits in float32 wherever the axis stands, and the rigid body is a double sum of the
 * torque samples, kept without rounding error (see axt_plant.c) and modulo one turn.
 */
#ifndef AXT_PLANT_H
#define AXT_PLANT_H

#include "axt_axis.h"
#include "axt_real.h"
#include "axt_status.h"

/* Newmark's alpha (of the displacement) and delta (of the speed), Eqs. 4-6.
 * 1/4, 1/2: the trapezoidal rule, unconditionally stable and without numerical damping. */
typedef struct {
    axt_real alpha; /* 1/100 .. 1 */
    axt_real delta; /* 1/2 .. 1 */
} axt_newmark;

extern const axt_newmark axt_newmark_trapezoidal; /* 1/4, 1/2 */

/* Where the axis is and how it moves, seen from the motor: the table is one twist behind it. The
 * motor's angle is 2 pi (turns + fraction + fraction_low) [rad]. */
typedef struct {
    axt_real twist;        /* theta1 - theta2 [rad] */
    axt_real twist_speed;  /* [rad/s] */
    axt_real speed;        /* of the motor [rad/s] */
    int32_t turns;         /* whole turns of the motor, wrapping around */
    axt_real fraction;     /* of a turn, about -1/2 .. 1/2 */
    axt_real fraction_low; /* digits of the fraction beyond the number type */
} axt_motion;

/* What a step changes: see axt_plant.c. The twist's are in units of `twist_unit`. */
typedef struct {
    axt_real twist_ahead; /* P */
    axt_real rate_ahead;  /* R */
    axt_real change;      /* A */
    axt_real torque;      /* [N m] */
    axt_real impulse;     /* sum of the torque samples, two words [N m] */
    axt_real impulse_low;
    axt_real travel; /* sum of those sums modulo one turn, two words [N m] */
    axt_real travel_low;
} axt_plant_state;

/* The plant. Its fields are its own business; read it with axt_plant_read(). */
typedef struct {
    /* one step: see axt_plant.c */
    axt_real gain_torque;
    axt_real gain_rate;
    axt_real gain_twist;
    axt_real half_turn; /* half a turn in units of `travel` [N m]: the limit of what follows */
    axt_real shift;     /* adding it rounds to the grid of `impulse` and `travel` */
    axt_plant_state state;
    int32_t turns;
    uint32_t rejected; /* torque samples refused, wrapping around */
    /* reading the state back */
    axt_real alpha;
    axt_real excess;           /* delta - 1/2 */
    axt_real late;             /* 1 - delta */
    axt_real lag;              /* 1/2 + alpha - delta */
    axt_real twist_unit;       /* [rad] */
    axt_real twist_speed_unit; /* [rad/s] */
    axt_real travel_per_turn;  /* 1 / (2 half_turn) */
    axt_real speed_unit;       /* rigid-body speed for 1 of `impulse` [rad/s] */
    axt_real motor_share;      /* I2 / (I1 + I2): the motor's share of the twist */
    /* equilibrium, for the initial acceleration: Dt^2 q'' for 1 of each */
    axt_real change_of_torque;
    axt_real change_of_rate;
    axt_real change_of_twist;
} axt_plant;

/* The axis at rest at angle 0 with torque 0 acting: everything is zero.
 * `time_step` [s]: 1e-7 .. 1, wn Dt <= 1e3 and, where alpha < delta / 2, below the method's limit
 * of stability, (wn Dt)^2 (delta / 2 - alpha) < 1. Fails as axt_axis_check(), or with
 * AXT_ERROR_RANGE; `plant` is then unchanged. Cost: a dozen divisions. */
axt_status axt_plant_init(axt_plant *plant, const axt_axis *axis, axt_real time_step,
                          const axt_newmark *newmark);

/* Puts the plant into the state `motion` with `torque` [N m] acting; the acceleration follows from
 * equilibrium (Eq. 3). AXT_ERROR_NOT_FINITE or AXT_ERROR_RANGE (torque as for axt_plant_step(),
 * speed of half a turn a step or more, a twist beyond 1000 rad or as much in one step) leave the
 * plant as it was. */
axt_status axt_plant_set(axt_plant *plant, const axt_motion *motion, axt_real torque);

/* One step of Newmark's method: `torque` [N m] is the torque at the end of the step, varying
 * linearly from the last one. Cost: 3 multiply-adds and 14 additions, two comparisons, no division;
 * a few operations more in the steps in which the axis passes half a turn. AXT_ERROR_NOT_FINITE, or
 * AXT_ERROR_RANGE for a torque that in one step would take a resting axis to more than half a turn
 * a step: counted in `rejected`, and the plant does not move. Below that the speed of the rigid
 * body saturates at half a turn a step, and the twist between 1024 and 2048 rad. */
axt_status axt_plant_step(axt_plant *plant, axt_real torque);

/* The present motion. Cost: about 25 operations. */
void axt_plant_read(const axt_plant *plant, axt_motion *motion);

#endif
