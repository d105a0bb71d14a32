/* options.h - the emulator's command line. */
#ifndef OPTIONS_H
#define OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_axis.h"
#include "axt_can_pace.h"
#include "axt_excitation.h"
#include "axt_guard.h"
#include "axt_ident.h"
#include "effects.h"

enum { AXT_EMULATOR_MODBUS_MAX = 4 }; /* servers */

typedef struct {
    const char *bus;             /* INTERFACE, pty, pty:LINK or tcp:[HOST:]PORT */
    axt_can_bit_rates bit_rates; /* of the bus; nominal 0: as fast as the carrier */
    /* tcp:[HOST:]PORT or rtu:DEVICE[,BITS[,PARITY]] each */
    const char *modbus[AXT_EMULATOR_MODBUS_MAX];
    uint32_t modbus_count;
    uint8_t node;
    double period;              /* of the control loop [s] */
    uint32_t stream_decimation; /* control periods between streamed samples */
    axt_axis axis;              /* what is emulated */
    axt_emulator_effects effects;
    axt_ident_form form; /* of the estimator */
    axt_axis expected;   /* what it starts from */
    axt_real forgetting;
    uint32_t counts_per_turn[2]; /* motor, table */
    uint32_t rated_torque;       /* [mN m] */
    axt_limits limits;
    uint16_t host_timeout; /* [ms] */
    axt_schroeder excitation;
    bool excited;
    bool streaming;
    uint32_t trace_size; /* [samples] */
    bool simulated;
    double duration;       /* of axis time [s], 0: until a signal */
    double wake;           /* interval of the loop [s] */
    const char *jitter;    /* file for the histogram of late wake-ups, or NULL */
    double clock_rate;     /* the drive's seconds in one of ours */
    int realtime_priority; /* 1 .. 99, 0: none */
} axt_emulator_options;

enum { AXT_EMULATOR_TABLE_SIZE = 32768 }; /* samples of an excitation's period */

typedef enum {
    AXT_EMULATOR_RUN,   /* `options` is complete */
    AXT_EMULATOR_EXIT,  /* help or version has been printed */
    AXT_EMULATOR_MISUSE /* one line on standard error says what is wrong */
} axt_emulator_todo;

axt_emulator_todo axt_emulator_read_options(int argc, char **argv, axt_emulator_options *options);

#endif
