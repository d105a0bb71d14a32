/* loop.h - lets a node live: in real time, or as fast as it goes. */
#ifndef LOOP_H
#define LOOP_H

#include <signal.h>
#include <stdbool.h>

#include "axt_node.h"
#include "bus.h"
#include "modbus_servers.h"

enum { AXT_EMULATOR_LATENESS_MAX = 10000 }; /* [us] */

/* How many wake-ups came so many microseconds late; all beyond the longest count as that. */
typedef struct {
    uint64_t wakes[AXT_EMULATOR_LATENESS_MAX + 1];
} axt_emulator_lateness;

typedef struct {
    axt_node *node;
    axt_emulator_bus *bus;
    axt_emulator_modbus *modbus;
    double period;                     /* of the node's control loop [s] */
    double wake;                       /* interval at which to wake up [s], `period` or more */
    double clock_rate;                 /* the drive's seconds in one of ours, when in real time */
    double duration;                   /* of axis time [s], 0: no end */
    const volatile sig_atomic_t *stop; /* ends the loop when it is not 0 */
    axt_emulator_lateness *lateness;   /* counted here when in real time; NULL: not counted */
} axt_emulator_loop;

/* Runs control period n at start + n x period of the drive's clock, rounded up to the next wake-up:
 * what is due is run, late or not, so that axis time and real time never part. A period that begins
 * later than the wake-up after its own is an overrun. A bus that fails is said on standard error
 * and does not stop the axis. */
void axt_emulator_run_in_real_time(const axt_emulator_loop *loop);

/* Runs control periods without waiting for anything but room for the streamed samples. */
void axt_emulator_run_simulated(const axt_emulator_loop *loop);

#endif
