/* axt_emulated_axis.h - an axis, ideal or with effects, and its two encoders in the place of a real
 * one.
 *
 * What a node's port needs of an axis: apply a torque, read the encoders.
 */
#ifndef AXT_EMULATED_AXIS_H
#define AXT_EMULATED_AXIS_H

#include "axt_encoder.h"
#include "axt_machine.h"
#include "axt_node.h"

typedef struct {
    axt_machine machine;
    uint32_t counts_per_turn[2]; /* encoders at motor and table */
    /* from the next restart on, as commands have set it */
    axt_axis next_axis;
    axt_effects next_effects;
    uint32_t selected; /* argument of the last EffectSelect */
} axt_emulated_axis;

/* An ideal axis at rest at angle 0. Fails as axt_plant_init(), and with AXT_ERROR_RANGE for counts
 * a turn outside 1 .. 2^24. */
axt_status axt_emulated_axis_init(axt_emulated_axis *emulated, const axt_axis *axis,
                                  axt_real time_step, const uint32_t counts_per_turn[2]);

/* The same axis with `effects`, at rest at angle 0 again. Fails as axt_effects_check(); the axis is
 * then as it was. */
axt_status axt_emulated_axis_set_effects(axt_emulated_axis *emulated, const axt_effects *effects);

/* A command of the contract, from EffectSelect to AxisRestart: sets what the axis is to be after
 * the next restart, and for AxisRestart says whether that is an axis. Nothing else is a command to
 * an axis. Called from the background. `axis` is an axt_emulated_axis. */
axt_node_result axt_emulated_axis_command(void *axis, const struct axt_contract_command_t *command);

/* The axis begins anew, at rest at angle 0, as the commands have set it. Called from the tick, once
 * AxisRestart was found to be possible. Cost: that of axt_machine_init(). */
void axt_emulated_axis_restart(void *axis);

/* Moves the axis on by one control period, at the end of which `torque` [N m] acts. `axis` is an
 * axt_emulated_axis. Cost: that of axt_machine_step(). */
void axt_emulated_axis_apply_torque(void *axis, axt_real torque);

/* Reads both encoders. A place they cannot show (beyond any servo's reach) leaves `position` as it
 * is. Cost: that of axt_machine_measure() and about 60 operations. */
void axt_emulated_axis_read_encoders(void *axis, int32_t position[2]);

#endif
