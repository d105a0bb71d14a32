/* axt_node.h - the drive's side of the wire: control interrupt, live stream, trace, commands.
 *
 * Portable and without a heap: the Linux emulator and the firmware run this same node, each with a
 * port of its own. Time is counted in control periods and nothing else.
 *
 * Two callers. axt_node_tick() is the control interrupt: its cost does not depend on what the bus
 * does. axt_node_background() is the main loop: everything that talks, and everything that takes
 * long, in bounded pieces. The tick may interrupt the background anywhere, or run on another core.
 * What they share has one writer each and is handed over with acquire and release:
 *
 *     tick -> background   status, ring of streamed samples, trace, counters
 *     background -> tick   the host's heartbeats, counted, and one order at a time, taken at the
 *                          start of the next tick; a copy of the estimator comes back as the answer
 *                          to an order
 *
 * The drive is CiA 402's state machine, and the tick is where it lives: torque acts in operation
 * enabled alone, within limits that are checked at every sample, and only while a host is heard.
 *
 * At control period n the torque T[n] is applied and then the encoders are read: (n, T[n],
 * positions[n]) is the sample that is learned from, streamed and traced. Torque is quantised to the
 * wire's 0.1 per mille of rated before it is applied, so that what is sent is what acted.
 */
#ifndef AXT_NODE_H
#define AXT_NODE_H

#include <stdatomic.h>
#include <stdbool.h>

#include "axt_axis.h"
#include "axt_can.h"
#include "axt_cia402.h"
#include "axt_contract.h"
#include "axt_encoder.h"
#include "axt_excitation.h"
#include "axt_guard.h"
#include "axt_history.h"
#include "axt_ident.h"
#include "axt_monitor.h"
#include "axt_status.h"
#include "axt_trace.h"

#define AXT_NODE_FIRMWARE UINT32_C(0x00000100) /* 0.1.0 as 0x00MMmmpp */

enum {
    AXT_NODE_ID_MAX = 126,
    AXT_NODE_TRACE_MAX = 32768 /* samples that the wire's 15-bit index can number */
};

/* Bits of CiA 402's status word (0x6041) beside the state. */
enum {
    AXT_NODE_VOLTAGE_ENABLED = 0x0010, /* always: the emulated axis has no mains to lose */
    AXT_NODE_WARNING = 0x0080,         /* the drift alarm */
    AXT_NODE_EXCITED = 0x0100,         /* the excitation plays */
    AXT_NODE_REMOTE = 0x0200,          /* a host has the drive under its control */
    AXT_NODE_LIMITED = 0x0800          /* the torque is limited at this sample */
};

/* How a command or a control word ended. */
typedef enum {
    AXT_NODE_DONE = AXT_CONTRACT_RESULT_DONE,
    AXT_NODE_UNKNOWN_COMMAND = AXT_CONTRACT_RESULT_UNKNOWN_COMMAND,
    AXT_NODE_OUT_OF_RANGE = AXT_CONTRACT_RESULT_OUT_OF_RANGE,
    AXT_NODE_NOT_NOW = AXT_CONTRACT_RESULT_NOT_NOW,
    AXT_NODE_NO_ROOM = AXT_CONTRACT_RESULT_NO_ROOM,
    AXT_NODE_NOT_ENABLED = AXT_CONTRACT_RESULT_NOT_ENABLED,
    AXT_NODE_NOT_WHILE_ENABLED = AXT_CONTRACT_RESULT_NOT_WHILE_ENABLED,
    AXT_NODE_NO_TRANSITION = AXT_CONTRACT_RESULT_NO_TRANSITION,
    AXT_NODE_NO_HOST_HEARTBEAT = AXT_CONTRACT_RESULT_NO_HOST_HEARTBEAT,
    AXT_NODE_NO_FD = AXT_CONTRACT_RESULT_NO_FD
} axt_node_result;

/* Flags of report page 8. */
typedef enum {
    AXT_NODE_TRACE_IDLE = AXT_CONTRACT_TRACE_STATE_IDLE,
    AXT_NODE_TRACE_CAPTURING = AXT_CONTRACT_TRACE_STATE_CAPTURING, /* until the checksum is known */
    AXT_NODE_TRACE_READY = AXT_CONTRACT_TRACE_STATE_READY,
    AXT_NODE_TRACE_UPLOADING = AXT_CONTRACT_TRACE_STATE_UPLOADING,
    AXT_NODE_TRACE_ARMED = AXT_CONTRACT_TRACE_STATE_ARMED /* waiting for the trigger */
} axt_node_trace_state;

/* A sample on its way to the bus, alone or as one of a group that goes in one frame. */
typedef struct {
    axt_node_sample sample;
    uint16_t counter; /* control periods / decimation, modulo 65536 */
    uint16_t group;   /* samples of its frame: 1, or AXT_NODE_GROUP_FD for all of a group */
} axt_node_stream_sample;

enum { AXT_NODE_GROUP_FD = 6 };

enum { AXT_NODE_FILTERS = 2 };

/* What a carrier must let through for node `id`: all that the node listens to, and little else. */
void axt_node_filters(uint8_t id, axt_can_filter filters[AXT_NODE_FILTERS]);

/* What the node stands on. `axis` is handed to all functions below it. */
typedef struct {
    axt_can *can; /* called from the background only */
    void *axis;
    /* called from the tick */
    void (*apply_torque)(void *axis, axt_real torque);      /* [N m] */
    void (*read_encoders)(void *axis, int32_t position[2]); /* motor, table [counts] */
    /* of an emulated axis (axt_emulated_axis.h), NULL where it is a real one: takes the commands
     * that the node does not know, from the background; ... */
    axt_node_result (*axis_command)(void *axis, const struct axt_contract_command_t *command);
    void (*restart_axis)(void *axis); /* ... an AxisRestart that was DONE is then due in the tick */
} axt_node_port;

/* Buffers belong to the caller and must live as long as the node. */
typedef struct {
    uint8_t id;                  /* 1 .. AXT_NODE_ID_MAX */
    axt_real control_period;     /* [s] */
    uint32_t stream_decimation;  /* control periods between streamed samples, 1 or more */
    uint32_t rated_torque;       /* [mN m], 1 or more */
    uint32_t counts_per_turn[2]; /* of the encoders at motor and table */
    axt_ident_form form;         /* see axt_ident_config */
    axt_hold hold;               /* likewise: AXT_HOLD_ZERO where the axis is a real one */
    axt_axis expected;           /* likewise */
    axt_real forgetting;         /* likewise */
    axt_schroeder excitation;    /* settings until a host changes them */
    axt_limits limits;           /* what the axis stands; a host may set less */
    uint16_t host_timeout;       /* longest time to go on without its heartbeat, 1 or more [ms] */
    uint16_t error_code;         /* ErrorCode of the fault to start in, 0: none */
    int32_t error_cause;         /* its Cause */
    bool excited;        /* operation enabled and excitation on from the start, by no host */
    bool streaming;      /* live stream on from the start */
    axt_real *table;     /* for one period of the excitation */
    uint32_t table_size; /* 4 or more */
    axt_node_sample *trace;
    uint32_t trace_size;          /* 1 .. AXT_NODE_TRACE_MAX */
    axt_node_stream_sample *ring; /* streamed samples on their way to the bus */
    uint32_t ring_size;           /* a power of two, 2 or more; 8 or more to stream on CAN FD */
    axt_history_slot *history;    /* newest samples for a host that asks (Modbus) */
    uint32_t history_size;        /* a power of two; 0: none are kept */
} axt_node_config;

/* What the background asks of the tick. */
typedef enum {
    AXT_NODE_ORDER_CONTROL,  /* argument: Control frame; leaves how it ended in order_result */
    AXT_NODE_ORDER_STREAM,   /* argument: decimation, 0 stops; see stream_group */
    AXT_NODE_ORDER_TORQUE,   /* argument: samples of the table to play, 0 stops */
    AXT_NODE_ORDER_TRACE,    /* argument: 0 stops, else see trace_settings */
    AXT_NODE_ORDER_LIMITS,   /* see limits and host_timeout */
    AXT_NODE_ORDER_WATCH,    /* see new_monitor */
    AXT_NODE_ORDER_RESET,    /* of the estimator */
    AXT_NODE_ORDER_RESTART,  /* of an emulated axis */
    AXT_NODE_ORDER_ESTIMATE, /* copy the estimator for the background */
} axt_node_order;

/* Where the excitation is on its way from settings to torque. */
typedef enum {
    AXT_NODE_EXCITATION_OFF,
    AXT_NODE_EXCITATION_FILLING,
    AXT_NODE_EXCITATION_ON
} axt_node_excitation_state;

/* The node. Its fields are its own business; counters may be read at any time. */
typedef struct {
    axt_node_config config;
    axt_node_port port;
    axt_real torque_unit; /* 0.1 per mille of rated [N m] */

    /* written by the tick */
    uint64_t n; /* control periods since the start */
    axt_cia402_state state;
    uint16_t control_word; /* the last one */
    uint16_t error_code;   /* of the fault, 0: none */
    int32_t error_cause;   /* see Emergency of the contract */
    bool remote;           /* a host has the drive under its control */
    bool excited;          /* the excitation plays */
    int16_t target_torque; /* set-point [0.1 per mille of rated] */
    axt_guard guard;
    axt_player player;
    axt_ident ident;
    axt_monitor monitor;
    uint32_t heartbeats_seen;
    uint32_t patience_max; /* control periods to go on without a heartbeat, and ... */
    uint32_t patience;     /* ... how many of these are left */
    uint32_t decimation;   /* 0: not streaming */
    uint32_t until_next;   /* control periods until the next streamed sample */
    uint16_t counter;
    uint16_t group;   /* samples that go in one frame, and ... */
    uint16_t grouped; /* ... how many are in the ring ahead of its head, or ... */
    uint16_t skipped; /* ... how many are left of a group that found no room */
    axt_trace trace;
    axt_history history;  /* may be read from any context */
    axt_ident ident_copy; /* read by the background once its order is taken */
    axt_node_result order_result;
    _Atomic uint32_t now; /* n modulo 2^32 */
    _Atomic uint32_t ring_head;
    _Atomic uint32_t captured; /* samples of the trace; top bit: it has been triggered */
    _Atomic uint32_t status;   /* status word and error code */
    _Atomic uint32_t order_taken;
    _Atomic uint32_t lost;     /* streamed samples that found the ring full */
    _Atomic uint32_t rejected; /* samples the estimator refused */
    _Atomic uint32_t limited;  /* samples with limited torque */
    _Atomic uint32_t faults;
    _Atomic uint32_t
        drift; /* state of the monitor, its reasons from bit 8, alarms from bit 16 on */
    _Atomic uint32_t overruns;

    /* written by the background */
    _Atomic uint32_t ring_tail;
    _Atomic uint32_t heartbeats; /* of the host, counted */
    _Atomic uint32_t order_given;
    axt_node_order order;
    uint32_t order_argument;
    bool estimate_ordered;
    axt_monitor new_monitor;  /* to take the place of the tick's */
    bool control_ordered;     /* a Control frame, and how it ended is not known yet */
    uint32_t control;         /* that frame, packed */
    uint32_t reported;        /* status that the bus knows of */
    axt_limits limits;        /* as set by commands */
    uint16_t host_timeout;    /* likewise [ms] */
    uint8_t host_id;          /* likewise: the node id whose heartbeat is listened to */
    axt_schroeder excitation; /* as set by commands */
    axt_schroeder filling;    /* as being filled in */
    axt_node_excitation_state excitation_state;
    uint32_t excitation_line; /* the next one to fill in */
    uint32_t stream_decimation;
    uint16_t stream_group;
    axt_trace_settings trigger;        /* as set by commands */
    axt_trace_settings trace_settings; /* of the trace that is there, or being captured */
    axt_node_trace_state trace_state;
    uint32_t trace_order;   /* the order that began the capture */
    uint32_t trace_checked; /* samples in the checksum so far */
    uint32_t trace_checksum;
    uint32_t upload_frame; /* the next one: 2 x index + channel */
    bool half_sent;        /* the motor half of the ring's oldest sample is on its way */
    bool announced;        /* boot-up has been sent */
    bool heartbeat_due;
    bool streaming;
    uint64_t pages; /* report pages waiting to be sent, bit = page */
    uint16_t state_sequence;
    uint16_t estimate_sequence;
    axt_estimate estimate;
    axt_ident_counters ident_counters; /* at the time of the estimate */
    uint32_t refused;                  /* commands and control words */
    uint32_t bus_offs;                 /* of the bus' health, as far as reported */
    bool answer_due;
    bool refusal_due;
    bool emergency_due;
    axt_can_frame answer;
    axt_can_frame refusal;
    axt_can_frame emergency;
    uint32_t heartbeat_time; /* when the next of each is due */
    uint32_t estimate_time;
    uint32_t state_time;
} axt_node;

/* AXT_ERROR_RANGE, _NOT_FINITE or _SIZE when the settings make no sense; `node` is then not usable.
 */
axt_status axt_node_init(axt_node *node, const axt_node_config *config, const axt_node_port *port);

/* The control interrupt. Cost: apply_torque, read_encoders, one axt_ident_counts() and about 120
 * operations; copying the estimator five times a second adds one copy of an axt_ident. */
void axt_node_tick(axt_node *node);

/* Some of the work outside the interrupt; call it again and again, at least every 10 ms: the host's
 * heartbeat is noticed here. One call
 * sends and receives a few dozen frames at most, and fills in one line of the excitation: as many
 * cosines as the period has samples. AXT_CAN_OK, or what a bus that has failed answered; the node
 * goes on, and so may the caller. */
axt_can_status axt_node_background(axt_node *node);

/* Control periods began late: counts them. Call it where the tick is called. */
void axt_node_overrun(axt_node *node, uint32_t periods);

/* Is there room for one more streamed sample? For simulated time, which can wait for it. */
bool axt_node_has_room(const axt_node *node);

/* The end, once neither tick nor background will be called again: torque 0, and a last heartbeat
 * that says so. */
void axt_node_stop(axt_node *node);

/* Torque [N m] as the wire carries it: the nearest multiple of `unit` [N m], limited to 16 bits.
 * Not-a-number is 0. `limited` says whether the limit acted. */
int16_t axt_node_quantise_torque(axt_real torque, axt_real unit, bool *limited);

#endif
