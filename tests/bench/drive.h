/* drive.h - a servo drive as it uses the core: an axis emulated and identified in the control
 * interrupt. What the programs of the bench have in common.
 */
#ifndef DRIVE_H
#define DRIVE_H

#include "axt.h"

/* The paper's first setting: a period of 512 samples whose line 10 is the natural frequency. */
enum { DRIVE_PERIOD = 512, DRIVE_LINE = 10, DRIVE_COUNTS = 1 << 20 };

/* The torque that shakes the axis: rms and the size that identification is told [N m]. */
#define DRIVE_TORQUE 0.2F

typedef struct {
    axt_player excitation;
    axt_plant plant;
    axt_ident ident;
    int32_t count[2]; /* encoders at motor and table */
    uint32_t number;  /* of the next sample */
    uint32_t faults;  /* calls that failed */
} drive;

/* The time step of the paper's first setting [s]. */
axt_real drive_time_step(void);

/* One period of Schroeder's multisine, 2 DRIVE_LINE lines, DRIVE_TORQUE rms. */
void drive_fill_excitation(axt_real table[DRIVE_PERIOD]);

/* The paper's axis to be identified with this form and forgetting factor, from encoders or from
 * motion with speeds. */
axt_ident_config drive_ident_config(axt_ident_form form, axt_real forgetting, bool encoders);

/* The paper's axis turning at `speed` [rad/s] under this excitation, to be identified in the 3x2
 * form from encoders. */
axt_status drive_init(drive *d, const axt_real *table, axt_real speed);

/* Both steps, excitation and encoders: the emulated axis and recursive least squares on what its
 * encoders show. */
void drive_control_tick(drive *d);

/* The same with all that axt_ident adds: guards, counters and what standard errors take. */
void drive_identifying_tick(drive *d);

#endif
