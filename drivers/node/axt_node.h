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
 *     tick -> background   ring of streamed samples, trace buffer, counters
 *     background -> tick   one order at a time, taken at the start of the next tick; a copy of the
 *                          estimator comes back as the answer to an order
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
#include "axt_encoder.h"
#include "axt_excitation.h"
#include "axt_history.h"
#include "axt_ident.h"
#include "axt_status.h"

#define AXT_NODE_FIRMWARE UINT32_C(0x00000100) /* 0.1.0 as 0x00MMmmpp */

enum {
    AXT_NODE_ID_MAX = 126,
    AXT_NODE_TRACE_MAX = 32768 /* samples that the wire's 15-bit index can number */
};

/* CiA 402 status word (0x6041): remote, voltage enabled, no quick stop, and the state. */
enum {
    AXT_NODE_SWITCHED_ON = 0x0233,       /* torque 0 */
    AXT_NODE_OPERATION_ENABLED = 0x0237, /* the excitation runs */
    AXT_NODE_LIMIT_ACTIVE = 0x0800       /* bit 11: the torque is limited at this sample */
};

/* Sequence of report page 255: how a command ended. */
typedef enum {
    AXT_NODE_DONE = 0,
    AXT_NODE_UNKNOWN_COMMAND = 1,
    AXT_NODE_OUT_OF_RANGE = 2,
    AXT_NODE_NOT_NOW = 3,
    AXT_NODE_NO_ROOM = 4
} axt_node_result;

/* Flags of report page 8. */
typedef enum {
    AXT_NODE_TRACE_IDLE = 0,
    AXT_NODE_TRACE_CAPTURING = 1, /* until the checksum is known, too */
    AXT_NODE_TRACE_READY = 2,
    AXT_NODE_TRACE_UPLOADING = 3
} axt_node_trace_state;

/* What happened at one control period. */
typedef struct {
    int32_t position[2]; /* motor and table encoder [counts] */
    int16_t torque;      /* [0.1 per mille of rated] */
    uint16_t status_word;
} axt_node_sample;

typedef struct {
    axt_node_sample sample;
    uint16_t counter; /* control periods / decimation, modulo 65536 */
} axt_node_stream_sample;

enum { AXT_NODE_FILTERS = 2 };

/* What a carrier must let through for node `id`: all that the node listens to, and little else. */
void axt_node_filters(uint8_t id, axt_can_filter filters[AXT_NODE_FILTERS]);

/* What the node stands on. */
typedef struct {
    axt_can *can;                                      /* called from the background only */
    void *axis;                                        /* handed to the next two, */
    void (*apply_torque)(void *axis, axt_real torque); /* which are called from the tick; [N m] */
    void (*read_encoders)(void *axis, int32_t position[2]); /* motor, table [counts] */
} axt_node_port;

/* Buffers belong to the caller and must live as long as the node. */
typedef struct {
    uint8_t id;                  /* 1 .. AXT_NODE_ID_MAX */
    axt_real control_period;     /* [s] */
    uint32_t stream_decimation;  /* control periods between streamed samples, 1 or more */
    uint32_t rated_torque;       /* [mN m], 1 or more */
    uint32_t counts_per_turn[2]; /* of the encoders at motor and table */
    axt_axis expected;           /* see axt_ident_config */
    axt_real forgetting;         /* likewise */
    axt_schroeder excitation;    /* settings until a host changes them */
    bool excited;                /* excitation on from the start */
    bool streaming;              /* live stream on from the start */
    axt_real *table;             /* for one period of the excitation */
    uint32_t table_size;         /* 4 or more */
    axt_node_sample *trace;
    uint32_t trace_size;          /* 1 .. AXT_NODE_TRACE_MAX */
    axt_node_stream_sample *ring; /* streamed samples on their way to the bus */
    uint32_t ring_size;           /* a power of two, 2 or more */
} axt_node_config;

/* What the background asks of the tick. */
typedef enum {
    AXT_NODE_ORDER_STREAM,   /* argument: decimation, 0 stops */
    AXT_NODE_ORDER_TORQUE,   /* argument: samples of the table to play, 0 stops */
    AXT_NODE_ORDER_TRACE,    /* argument: samples to capture, 0 stops */
    AXT_NODE_ORDER_RESET,    /* of the estimator */
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
    bool operating;
    axt_player player;
    axt_ident ident;
    uint32_t decimation; /* 0: not streaming */
    uint32_t until_next; /* control periods until the next streamed sample */
    uint16_t counter;
    axt_history history; /* may be read from any context */
    uint32_t trace_wanted;
    axt_ident ident_copy; /* read by the background once its order is taken */
    _Atomic uint32_t now; /* n modulo 2^32 */
    _Atomic uint32_t ring_head;
    _Atomic uint32_t trace_captured;
    _Atomic uint32_t order_taken;
    _Atomic uint32_t lost;     /* streamed samples that found the ring full */
    _Atomic uint32_t rejected; /* samples the estimator refused */
    _Atomic uint32_t overruns;

    /* written by the background */
    _Atomic uint32_t ring_tail;
    _Atomic uint32_t order_given;
    axt_node_order order;
    uint32_t order_argument;
    bool estimate_ordered;
    axt_schroeder excitation; /* as set by commands */
    axt_schroeder filling;    /* as being filled in */
    axt_node_excitation_state excitation_state;
    uint32_t excitation_line; /* the next one to fill in */
    uint32_t stream_decimation;
    axt_node_trace_state trace_state;
    uint32_t trace_order;   /* the order that began the capture */
    uint32_t trace_length;  /* samples asked for */
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
    bool answer_due;
    axt_can_frame answer;
    uint32_t heartbeat_time; /* when the next of each is due */
    uint32_t estimate_time;
    uint32_t state_time;
} axt_node;

/* AXT_ERROR_RANGE, _NOT_FINITE or _SIZE when the settings make no sense; `node` is then not usable.
 */
axt_status axt_node_init(axt_node *node, const axt_node_config *config, const axt_node_port *port);

/* The control interrupt. Cost: apply_torque, read_encoders, one axt_ident_counts() and about 50
 * operations; copying the estimator five times a second adds one copy of an axt_ident. */
void axt_node_tick(axt_node *node);

/* Some of the work outside the interrupt; call it again and again, at least every 10 ms. One call
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
