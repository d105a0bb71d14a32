/* axt_hardware.h - the axis' side of a drive, as four functions: whoever brings the firmware to
 * real hardware writes these and nothing else of the axis.
 *
 * The hardware of this source (axt_emulated_hardware.c) is the emulated axis. docs/porting.md has
 * the same for a power stage and two encoders.
 */
#ifndef AXT_HARDWARE_H
#define AXT_HARDWARE_H

#include "axt_node.h"
#include "axt_status.h"

/* What the drive is built of, and what is known of its axis. */
typedef struct {
    axt_real control_period;     /* [s] */
    uint32_t rated_torque;       /* [mN m] */
    uint32_t counts_per_turn[2]; /* motor, table */
    axt_hold hold;               /* how the torque goes on from one control period to the next */
    axt_axis expected;           /* within a factor of 10 */
} axt_hardware_traits;

typedef struct {
    const axt_hardware_traits *traits;
    void *axis; /* handed to the functions */

    /* Once, before the control interrupt runs: everything ready, no torque. */
    axt_status (*start)(void *axis);

    /* The control interrupt: `torque` [N m] acts from now on. */
    void (*apply_torque)(void *axis, axt_real torque);

    /* The control interrupt, next: both encoders as they stand, read at one instant; motor, table
     * [counts]. A value that cannot be read is left as it is. */
    void (*read_encoders)(void *axis, int32_t position[2]);

    /* No torque, whatever state everything is in: called when a fault has stopped the firmware, on
     * a small stack and with nothing to rely on but the hardware's own registers. */
    void (*shut_off)(void *axis);

    /* Of an emulated axis, NULL where it is a real one; see axt_node_port. */
    axt_node_result (*axis_command)(void *axis, const struct axt_contract_command_t *command);
    void (*restart_axis)(void *axis);
} axt_hardware;

/* The hardware that this firmware is linked with. */
extern const axt_hardware axt_hardware_here;

#endif
