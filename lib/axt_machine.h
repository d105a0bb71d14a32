/* axt_machine.h - the axis as it is: the plant of Eq. 3 with everything that axt_effects.h adds.
 *
 *     I1 theta1'' + friction1 + shaft = torque + ripple + offset1 + disturbance1
 *     I2 theta2'' + friction2 - shaft + mode = offset2 + disturbance2
 *
 * The command goes through delay and saturation to the motor; both angles come through delay, lead
 * error, eccentricity and quantisation from the encoders. Without effects inside the axis it is
 * axt_plant, bit for bit and at its cost. With them the same trapezoidal rule (Newmark's 1/4, 1/2)
 * is solved for the speeds of motor and table, which friction can hold at exactly zero; see
 * axt_machine.c. Whoever simulates with few steps can have them exact (axt_machine_make_exact()).
 */
#ifndef AXT_MACHINE_H
#define AXT_MACHINE_H

#include "axt_axis.h"
#include "axt_effects.h"
#include "axt_plant.h"
#include "axt_real.h"
#include "axt_shaft.h"
#include "axt_status.h"

/* How the torque goes on between two samples. */
typedef enum {
    AXT_TORQUE_LINEAR = 0, /* straight from one to the next, as in axt_plant */
    AXT_TORQUE_HELD = 1    /* each until the next: what a drive does */
} axt_torque_course;

/* A time as whole steps and a part of one. */
typedef struct {
    uint32_t steps;
    axt_real part;
} axt_delay;

/* A reading of the machine's past: index 0 is the present. */
typedef struct {
    axt_real torque[AXT_DELAY_STEPS];
    axt_motion motion[AXT_DELAY_STEPS];
    uint32_t newest;
} axt_past;

/* The machine. Its fields are its own business; read it with axt_machine_read() and
 * axt_machine_measure(). */
typedef struct {
    axt_plant plant; /* the axis where it is ideal, and its limits */
    axt_effects effects;
    axt_axis axis;
    axt_real time_step;
    axt_real speed_max; /* half a turn a step */
    axt_torque_course course;
    bool exact;   /* steps are those of axt_machine_make_exact() */
    bool ideal;   /* inside the axis there is nothing but Eq. 3 */
    bool delays;  /* there are some */
    bool encodes; /* there is an error of an encoder */
    axt_delay torque_delay;
    axt_delay encoder_delay[2];
    axt_real cycles_per_step[2]; /* of the disturbances, at most half a cycle */
    axt_real load_step;          /* at which the load changes */
    /* the further mode: see axt_machine.c */
    axt_real mode_pull;
    axt_real mode_drag;
    axt_real mode_share;
    axt_real mode_inertia;
    /* all 0 for the trapezoidal rule: see axt_machine.c */
    axt_real stretch;      /* more way that the twist goes in a step */
    axt_real stretched[2]; /* of that motor and table go */
    axt_real eased;        /* of the coupling of motor and table [kg m2] */
    axt_real compliance;   /* of the shaft [rad/(N m)] */
    /* state where the axis is not ideal */
    axt_motion motion;        /* turns, fraction and twist; its speeds are those below */
    axt_real speed[2];        /* of motor and table [rad/s] */
    axt_real speed_change[2]; /* in the last step */
    axt_real speed_low[2];    /* digits beyond the number type */
    axt_real mode_twist;      /* table less further inertia [rad] */
    axt_real mode_speed;      /* [rad/s] */
    axt_real torque;          /* delivered at the end of the last step [N m] */
    axt_real cycle[2];        /* of the disturbances: their periods passed, modulo 1 */
    axt_real cycle_low[2];
    uint32_t steps; /* since the start, saturating (60 hours at 20 kHz) */
    axt_past past;
    uint32_t rejected; /* torque samples refused, wrapping around */
} axt_machine;

/* The machine at rest at angle 0 with torque 0. Fails as axt_plant_init() and axt_effects_check();
 * `machine` is then unchanged. With play, hardening or dry friction, wn Dt should be at most 1:
 * beyond that their equations may not be solved in the sweeps there are, and though everything
 * stays bounded it is not the axis meant. */
axt_status axt_machine_init(axt_machine *machine, const axt_axis *axis, axt_real time_step,
                            axt_torque_course course, const axt_effects *effects);

/* Makes the steps of a machine with AXT_TORQUE_HELD those of the axis itself where the trapezoidal
 * rule makes the vibration of the shaft a little slower: with its own frequency and damping, and
 * without damping exact as long as nothing acts but torque. Dry friction then goes by the torque of
 * the shaft as it changes within a step, the vibration by the stiffness that it meets there: dry
 * friction, play and hardening leave errors of third order. Viscous friction goes by the mean
 * speed; a further mode, a load that has changed and what else depends on the motion are still of
 * second order, and energy is no longer kept to the last digit. To be called after
 * axt_machine_init(). AXT_ERROR_RANGE for a torque that is not held, for wn Dt above 2, and for a
 * machine that is exact already: it is then as it was. Cost: about 1500 operations; a step then
 * takes 30 more, and a sweep or two more where friction holds. */
axt_status axt_machine_make_exact(axt_machine *machine);

/* Puts the machine into the state `motion` with `torque` acting, time 0; before that it moved at
 * these speeds. Fails as axt_plant_set(), and the machine is then as it was. */
axt_status axt_machine_set(axt_machine *machine, const axt_motion *motion, axt_real torque);

/* Puts the further mode into a state, after axt_machine_set(), which has it at rest against the
 * table: `twist` [rad] of the table less the further inertia, `speed` [rad/s] likewise. Without a
 * further mode that is ignored. AXT_ERROR_NOT_FINITE; AXT_ERROR_RANGE beyond 1000 rad or a turn a
 * step: the machine is then as it was. */
axt_status axt_machine_set_mode(axt_machine *machine, axt_real twist, axt_real speed);

/* One step; `torque` [N m] is the command at its end. Cost: that of axt_plant_step() when the axis
 * is ideal, otherwise about 150 operations, 80 more for each further sweep (4 at most), 30 for each
 * wave and disturbance, and an exponential for each Stribeck effect. Fails as axt_plant_step():
 * counted, nothing moves. Speeds saturate at half a turn a step, the twist at 1000 rad. */
axt_status axt_machine_step(axt_machine *machine, axt_real torque);

/* The present motion, as it is. */
void axt_machine_read(const axt_machine *machine, axt_motion *motion);

/* The present motion as the encoders show it: what axt_encoder_read() makes counts of. Speeds are
 * those of the axis, late by the delay of the encoder. Cost: without errors of encoders that of
 * axt_machine_read(), otherwise about 200 operations and 30 for each wave and eccentricity. */
void axt_machine_measure(const axt_machine *machine, axt_motion *motion);

#endif
