/* axt_can.h - a CAN bus, classical or FD, behind one small interface.
 *
 * Whatever carries the frames (SocketCAN, SLCAN on a pseudo-terminal, TCP or UART, a controller's
 * mailboxes), a user sees three functions, none of which ever waits.
 */
#ifndef AXT_CAN_H
#define AXT_CAN_H

#include <stdbool.h>
#include <stdint.h>

#define AXT_CAN_EXTENDED UINT32_C(0x80000000) /* in an id: 29 bits instead of 11 */
#define AXT_CAN_REMOTE   UINT32_C(0x40000000) /* in an id: a request, without data */

enum {
    AXT_CAN_CLASSICAL_MAX = 8, /* data bytes of a classical frame */
    AXT_CAN_DATA_MAX = 64      /* of an FD frame */
};

typedef struct {
    uint32_t id;    /* 11 bits, or 29 bits and AXT_CAN_EXTENDED; AXT_CAN_REMOTE */
    uint8_t length; /* 0 .. 8; FD: also 12, 16, 20, 24, 32, 48, 64 */
    bool fd;        /* an FD frame, its data phase at the bus's higher bit rate */
    uint8_t data[AXT_CAN_DATA_MAX];
} axt_can_frame;

/* Which frames to let through: those whose `id`, flags included, has these bits where `mask` is 1.
 */
typedef struct {
    uint32_t id;
    uint32_t mask;
} axt_can_filter;

/* Can this frame be on a bus at all: identifier and length within their ranges, no remote FD frame?
 * `fd`: the bus carries FD frames. */
bool axt_can_frame_valid(const axt_can_frame *frame, bool fd);

/* Bytes of data for a data length code of 0 to 15 (ISO 11898-1); a code of 9 or more is 8 bytes in
 * a classical frame. */
uint8_t axt_can_fd_length(uint8_t code);

/* The smallest data length code that has room for `length` bytes, 64 at most. */
uint8_t axt_can_fd_code(uint8_t length);

/* Zero is fine, negative is not. */
typedef enum {
    AXT_CAN_OK = 0,
    AXT_CAN_WOULD_BLOCK = -1,        /* nothing received yet, or no room to send: try again later */
    AXT_CAN_CLOSED = -2,             /* nobody is at the other end: a frame to send is dropped */
    AXT_CAN_ERROR_FRAME = -3,        /* not a frame that this bus can carry */
    AXT_CAN_ERROR_IO = -4,           /* the carrier failed */
    AXT_CAN_ERROR_NO_SUPPORT = -5,   /* the kernel has no CAN */
    AXT_CAN_ERROR_NO_INTERFACE = -6, /* no CAN interface of that name */
    AXT_CAN_ERROR_DOWN = -7,         /* the interface is down */
    AXT_CAN_ERROR_ADDRESS = -8,      /* not an address or path that can be used */
    AXT_CAN_ERROR_IN_USE = -9,       /* somebody else uses that address or path */
    AXT_CAN_ERROR_PERMISSION = -10   /* not allowed */
} axt_can_status;

/* One English line for a status, saying what to do where that is known; static memory. */
const char *axt_can_status_string(axt_can_status status);

/* What the controller says of itself (ISO 11898-1: error active, error passive, bus off). */
typedef enum {
    AXT_CAN_STATE_ACTIVE = 0,
    AXT_CAN_STATE_WARNING, /* an error counter has reached 96 */
    AXT_CAN_STATE_PASSIVE, /* an error counter has reached 128 */
    AXT_CAN_STATE_BUS_OFF, /* left the bus; comes back by itself */
    AXT_CAN_STATE_DOWN     /* the interface is down or gone; taken up again when it is back */
} axt_can_state;

/* One English word or two for a state; static memory. */
const char *axt_can_state_string(axt_can_state state);

/* How a bus is. Counters count from opening on, modulo 2^32. */
typedef struct {
    axt_can_state state;
    uint32_t error_frames; /* reports of the controller about errors on the bus */
    uint32_t bus_off;      /* times the controller has left the bus */
    uint32_t outages;      /* times the interface has gone down or away */
    uint32_t overflows;    /* received frames that found no room */
} axt_can_health;

/* A bus. A carrier has this as its first member and sets the functions when it is opened. Carriers
 * that have nothing to say about their health leave it at zero. */
typedef struct axt_can axt_can;
struct axt_can {
    bool fd;               /* this bus carries FD frames, too; known once it is open */
    axt_can_health health; /* written by send() and receive() */

    /* AXT_CAN_OK: the frame is on its way. AXT_CAN_WOULD_BLOCK: it is not, offer it again.
     * AXT_CAN_CLOSED: it was dropped. Any other: it was dropped and the bus has failed. */
    axt_can_status (*send)(axt_can *can, const axt_can_frame *frame);

    /* AXT_CAN_OK: `frame` is the next one. Otherwise it is unchanged. Also does what the carrier
     * has to do now and then, such as flushing and accepting a host: call it at least every few
     * milliseconds. */
    axt_can_status (*receive)(axt_can *can, axt_can_frame *frame);

    /* Gives back what opening took. */
    void (*close)(axt_can *can);
};

#endif
