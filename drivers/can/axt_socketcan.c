#include "axt_socketcan.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

_Static_assert(AXT_CAN_EXTENDED == CAN_EFF_FLAG && AXT_CAN_REMOTE == CAN_RTR_FLAG,
               "identifiers carry the kernel's own flags");

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

static axt_can_status socketcan_send(axt_can *can, const axt_can_frame *frame) {
    const axt_socketcan *port = (const axt_socketcan *)can;
    if (frame->length > AXT_CAN_DATA_MAX) {
        return AXT_CAN_ERROR_FRAME;
    }
    struct can_frame raw = {.can_id = frame->id, .can_dlc = frame->length};
    memcpy(raw.data, frame->data, frame->length);
    return (write(port->socket, &raw, sizeof raw) == (ssize_t)sizeof raw) ? AXT_CAN_OK
                                                                          : status_of_errno();
}

static axt_can_status socketcan_receive(axt_can *can, axt_can_frame *frame) {
    const axt_socketcan *port = (const axt_socketcan *)can;
    struct can_frame raw;
    const ssize_t got = read(port->socket, &raw, sizeof raw);
    if (got < 0) {
        return status_of_errno();
    }
    if (got != (ssize_t)sizeof raw || raw.can_dlc > AXT_CAN_DATA_MAX) {
        return AXT_CAN_ERROR_FRAME;
    }
    *frame = (axt_can_frame){.id = raw.can_id, .length = raw.can_dlc};
    memcpy(frame->data, raw.data, raw.can_dlc);
    return AXT_CAN_OK;
}

static void socketcan_close(axt_can *can) {
    (void)close(((const axt_socketcan *)can)->socket);
}

/* The number of the interface, which is there, up, and a CAN interface as far as a name tells. */
static axt_can_status find_interface(int descriptor, const char *interface, int *number) {
    struct ifreq request = {0};
    if (strlen(interface) >= sizeof request.ifr_name) {
        return AXT_CAN_ERROR_NO_INTERFACE;
    }
    memcpy(request.ifr_name, interface, strlen(interface));
    if (ioctl(descriptor, SIOCGIFINDEX, &request) != 0) {
        return status_of_errno();
    }
    *number = request.ifr_ifindex;
    if (ioctl(descriptor, SIOCGIFFLAGS, &request) != 0) {
        return status_of_errno();
    }
    return ((request.ifr_flags & IFF_UP) != 0) ? AXT_CAN_OK : AXT_CAN_ERROR_DOWN;
}

static axt_can_status set_up(int descriptor, const char *interface, uint32_t id) {
    int number = 0;
    const axt_can_status status = find_interface(descriptor, interface, &number);
    if (status != AXT_CAN_OK) {
        return status;
    }
    const struct can_filter filter = {.can_id = id,
                                      .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
    const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = number};
    if (setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) != 0 ||
        bind(descriptor, (const struct sockaddr *)&address, sizeof address) != 0) {
        return status_of_errno();
    }
    return AXT_CAN_OK;
}

axt_can_status axt_socketcan_open(axt_socketcan *port, const char *interface, uint32_t id) {
    const int descriptor = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (descriptor < 0) {
        return status_of_errno();
    }
    const axt_can_status status = set_up(descriptor, interface, id);
    if (status != AXT_CAN_OK) {
        (void)close(descriptor);
        return status;
    }
    *port = (axt_socketcan){
        .can = {.send = socketcan_send, .receive = socketcan_receive, .close = socketcan_close},
        .socket = descriptor,
    };
    return AXT_CAN_OK;
}
