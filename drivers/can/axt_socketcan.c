#include "axt_socketcan.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <stdbool.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "axt_can_netlink.h"
#include "axt_clock.h"

_Static_assert(AXT_CAN_EXTENDED == CAN_EFF_FLAG && AXT_CAN_REMOTE == CAN_RTR_FLAG,
               "identifiers carry the kernel's own flags");

#define MILLISECOND UINT64_C(1000000) /* [ns] */

static const uint64_t retry_interval = 100 * MILLISECOND;
static const uint64_t back_off_first = 100 * MILLISECOND;
static const uint64_t back_off_longest = 10000 * MILLISECOND;

enum {
    CLOSED = -1,
    RECEIVE_BUFFER = 4 << 20, /* the kernel counts some 0.8 KiB a frame */
    ERRORS_PER_CALL = 64      /* error frames read while looking for a frame */
};

static axt_can_status status_of_errno(void) {
    switch (errno) {
    case EAGAIN:
    case EINTR:
    case ENOBUFS: /* the interface's queue is full */
        return AXT_CAN_WOULD_BLOCK;
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT:
        return AXT_CAN_ERROR_NO_SUPPORT;
    case ENODEV:
    case ENXIO:
        return AXT_CAN_ERROR_NO_INTERFACE;
    case ENETDOWN:
        return AXT_CAN_ERROR_DOWN;
    case EPERM:
    case EACCES:
        return AXT_CAN_ERROR_PERMISSION;
    default:
        return AXT_CAN_ERROR_IO;
    }
}

/* ---- Opening ----------------------------------------------------------------------------------
 */

/* What sockets need to know of an interface. */
typedef struct {
    int number;
    bool fd;
} interface_properties;

/* Finds the interface, which is there and up. Asked for its number by SIOCGIFINDEX, the
 * kernel would look for a module when there is no such interface, which takes a tenth of a second;
 * it does not when the socket is tied to the interface. */
static axt_can_status find_interface(int descriptor, const char *interface,
                                     interface_properties *found) {
    struct ifreq request = {0};
    memcpy(request.ifr_name, interface, strlen(interface));
    socklen_t size = sizeof found->number;
    if (setsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, request.ifr_name,
                   (socklen_t)strlen(interface)) != 0 ||
        getsockopt(descriptor, SOL_SOCKET, SO_BINDTOIFINDEX, &found->number, &size) != 0 ||
        ioctl(descriptor, SIOCGIFMTU, &request) != 0) {
        return status_of_errno();
    }
    found->fd = request.ifr_mtu == CANFD_MTU;
    if (ioctl(descriptor, SIOCGIFFLAGS, &request) != 0) {
        return status_of_errno();
    }
    return ((request.ifr_flags & IFF_UP) != 0) ? AXT_CAN_OK : AXT_CAN_ERROR_DOWN;
}

/* Beyond the limit for all only who administers the net may go. */
static void enlarge_receive_buffer(int descriptor) {
    const int size = RECEIVE_BUFFER;
    if (setsockopt(descriptor, SOL_SOCKET, SO_RCVBUFFORCE, &size, sizeof size) != 0) {
        (void)setsockopt(descriptor, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
    }
}

/* False with errno set when the kernel refuses. */
static bool choose_frames(int descriptor, const axt_socketcan *port) {
    struct can_filter filters[AXT_SOCKETCAN_FILTERS_MAX] = {0};
    for (uint32_t i = 0; i < port->filter_count; i++) {
        filters[i] = (struct can_filter){port->filters[i].id, port->filters[i].mask};
    }
    const int on = 1;
    const can_err_mask_t all_errors = CAN_ERR_MASK;
    const socklen_t size = (socklen_t)(port->filter_count * sizeof filters[0]);
    return setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) == 0 &&
           setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &all_errors,
                      sizeof all_errors) == 0 &&
           setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, filters, size) == 0 &&
           setsockopt(descriptor, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on) == 0;
}

static axt_can_status set_up(axt_socketcan *port, int descriptor) {
    interface_properties found = {0};
    const axt_can_status status = find_interface(descriptor, port->interface, &found);
    if (status != AXT_CAN_OK) {
        return status;
    }
    enlarge_receive_buffer(descriptor);
    const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = found.number};
    if (!choose_frames(descriptor, port) ||
        bind(descriptor, (const struct sockaddr *)&address, sizeof address) != 0) {
        return status_of_errno();
    }
    port->can.fd = found.fd;
    return AXT_CAN_OK;
}

static axt_can_status connect_to_bus(axt_socketcan *port) {
    const int descriptor = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (descriptor < 0) {
        return status_of_errno();
    }
    const axt_can_status status = set_up(port, descriptor);
    if (status != AXT_CAN_OK) {
        (void)close(descriptor);
        return status;
    }
    port->socket = descriptor;
    port->dropped = 0;
    port->can.health.state = AXT_CAN_STATE_ACTIVE;
    return AXT_CAN_OK;
}

/* ---- Leaving the bus and coming back ----------------------------------------------------------
 */

static void interface_lost(axt_socketcan *port) {
    (void)close(port->socket);
    port->socket = CLOSED;
    port->can.health.state = AXT_CAN_STATE_DOWN;
    port->can.health.outages++;
    port->retry = axt_clock_now() + retry_interval;
}

static void bus_off(axt_socketcan *port) {
    axt_can_health *health = &port->can.health;
    if (health->state == AXT_CAN_STATE_BUS_OFF) {
        return;
    }
    const uint64_t now = axt_clock_now();
    if (now - port->restarted > back_off_longest) {
        port->back_off = back_off_first;
    }
    health->state = AXT_CAN_STATE_BUS_OFF;
    health->bus_off++;
    port->retry = now + port->back_off;
    port->back_off *= 2;
    if (port->back_off > back_off_longest) {
        port->back_off = back_off_longest;
    }
}

static void back_on_bus(axt_socketcan *port) {
    port->can.health.state = AXT_CAN_STATE_ACTIVE;
    port->restarted = axt_clock_now();
}

/* Does what the state asks for, once its time has come. */
static void recover(axt_socketcan *port) {
    const axt_can_state state = port->can.health.state;
    if (state < AXT_CAN_STATE_BUS_OFF || axt_clock_now() < port->retry) {
        return;
    }
    if (state == AXT_CAN_STATE_DOWN) {
        port->retry += retry_interval;
        (void)connect_to_bus(port); /* else: next time */
    } else {
        (void)axt_can_netlink_restart(port->interface); /* refused: the kernel does it by itself */
        back_on_bus(port);
    }
}

static void controller_state(axt_socketcan *port, uint8_t what) {
    axt_can_health *health = &port->can.health;
    if ((what & CAN_ERR_CRTL_RX_OVERFLOW) != 0) {
        health->overflows++;
    }
    if ((what & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
        health->state = AXT_CAN_STATE_PASSIVE;
    } else if ((what & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
        health->state = AXT_CAN_STATE_WARNING;
    } else if ((what & CAN_ERR_CRTL_ACTIVE) != 0) {
        health->state = AXT_CAN_STATE_ACTIVE;
    }
}

static void take_error(axt_socketcan *port, const struct canfd_frame *error) {
    port->can.health.error_frames++;
    if ((error->can_id & CAN_ERR_BUSOFF) != 0) {
        bus_off(port);
    } else if ((error->can_id & CAN_ERR_RESTARTED) != 0) {
        back_on_bus(port);
    } else if ((error->can_id & CAN_ERR_CRTL) != 0 &&
               port->can.health.state != AXT_CAN_STATE_BUS_OFF) {
        controller_state(port, error->data[1]);
    }
}

/* ---- Sending and receiving --------------------------------------------------------------------
 */

/* AXT_CAN_WOULD_BLOCK instead of what ends the connection, which is taken up again later. */
static axt_can_status survive(axt_socketcan *port, axt_can_status status) {
    if (status >= AXT_CAN_ERROR_FRAME) {
        return status;
    }
    interface_lost(port);
    return AXT_CAN_WOULD_BLOCK;
}

static axt_can_status socketcan_send(axt_can *can, const axt_can_frame *frame) {
    axt_socketcan *port = (axt_socketcan *)can;
    if (!axt_can_frame_valid(frame, can->fd)) {
        return AXT_CAN_ERROR_FRAME;
    }
    if (can->health.state >= AXT_CAN_STATE_BUS_OFF) {
        return AXT_CAN_WOULD_BLOCK;
    }
    struct canfd_frame raw = {.can_id = frame->id, .len = frame->length};
    raw.flags = frame->fd ? CANFD_BRS : 0;
    memcpy(raw.data, frame->data, frame->length);
    const size_t size = frame->fd ? CANFD_MTU : CAN_MTU; /* the shorter one begins like it */
    if (write(port->socket, &raw, size) == (ssize_t)size) {
        return AXT_CAN_OK;
    }
    const bool not_for_this_interface = errno == EINVAL;
    return survive(port, not_for_this_interface ? AXT_CAN_ERROR_FRAME : status_of_errno());
}

/* The kernel's count of frames that found this socket's buffer full comes with the next one. */
static void count_dropped(axt_socketcan *port, struct msghdr *message) {
    for (struct cmsghdr *control = CMSG_FIRSTHDR(message); control != NULL;
         control = CMSG_NXTHDR(message, control)) {
        if (control->cmsg_level == SOL_SOCKET && control->cmsg_type == SO_RXQ_OVFL) {
            uint32_t dropped;
            memcpy(&dropped, CMSG_DATA(control), sizeof dropped);
            port->can.health.overflows += dropped - port->dropped;
            port->dropped = dropped;
        }
    }
}

/* `fd` says which kind of frame it is. */
static axt_can_status read_socket(axt_socketcan *port, struct canfd_frame *raw, bool *fd) {
    _Alignas(struct cmsghdr) char control[CMSG_SPACE(sizeof(uint32_t))];
    struct iovec data = {.iov_base = raw, .iov_len = sizeof *raw};
    struct msghdr message = {.msg_iov = &data,
                             .msg_iovlen = 1,
                             .msg_control = control,
                             .msg_controllen = sizeof control};
    const ssize_t got = recvmsg(port->socket, &message, 0);
    if (got < 0) {
        return survive(port, status_of_errno());
    }
    count_dropped(port, &message);
    *fd = got == CANFD_MTU;
    const size_t most = *fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
    return ((*fd || got == CAN_MTU) && raw->len <= most) ? AXT_CAN_OK : AXT_CAN_ERROR_FRAME;
}

static axt_can_status socketcan_receive(axt_can *can, axt_can_frame *frame) {
    axt_socketcan *port = (axt_socketcan *)can;
    recover(port);
    for (int i = 0; i < ERRORS_PER_CALL && port->socket != CLOSED; i++) {
        struct canfd_frame raw;
        bool fd = false;
        const axt_can_status status = read_socket(port, &raw, &fd);
        if (status != AXT_CAN_OK) {
            return status;
        }
        if ((raw.can_id & CAN_ERR_FLAG) != 0) {
            take_error(port, &raw);
            continue;
        }
        *frame = (axt_can_frame){.id = raw.can_id, .length = raw.len, .fd = fd};
        memcpy(frame->data, raw.data, raw.len);
        return AXT_CAN_OK;
    }
    return AXT_CAN_WOULD_BLOCK;
}

static void socketcan_close(axt_can *can) {
    const axt_socketcan *port = (const axt_socketcan *)can;
    if (port->socket != CLOSED) {
        (void)close(port->socket);
    }
}

axt_can_status axt_socketcan_open(axt_socketcan *port, const char *interface,
                                  const axt_can_filter *filters, uint32_t filter_count) {
    if (strlen(interface) >= sizeof port->interface) {
        return AXT_CAN_ERROR_NO_INTERFACE;
    }
    *port = (axt_socketcan){
        .can = {.send = socketcan_send, .receive = socketcan_receive, .close = socketcan_close},
        .filter_count = filter_count,
        .socket = CLOSED,
        .back_off = back_off_first,
    };
    memcpy(port->interface, interface, strlen(interface) + 1);
    memcpy(port->filters, filters, filter_count * sizeof *filters);
    return connect_to_bus(port);
}
