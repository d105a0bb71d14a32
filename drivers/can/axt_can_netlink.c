#include "axt_can_netlink.h"

#include <errno.h>
#include <linux/can/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* RTM_NEWLINK { IFLA_LINKINFO { IFLA_INFO_KIND "can", IFLA_INFO_DATA { IFLA_CAN_RESTART 1 } } } */
typedef struct {
    struct nlmsghdr header;
    struct ifinfomsg link;
    struct rtattr info;
    struct rtattr kind;
    char kind_name[4]; /* "can" and its end: a multiple of four, so that nothing needs padding */
    struct rtattr data;
    struct rtattr restart;
    uint32_t on;
} restart_request;

_Static_assert(sizeof(restart_request) == NLMSG_LENGTH(sizeof(struct ifinfomsg)) +
                                              4 * sizeof(struct rtattr) + 4 + sizeof(uint32_t),
               "netlink attributes follow each other without a gap");

typedef struct {
    struct nlmsghdr header;
    struct nlmsgerr error;
} acknowledgement;

static axt_can_status status_of(int error) {
    switch (error) {
    case 0:
        return AXT_CAN_OK;
    case EPERM:
        return AXT_CAN_ERROR_PERMISSION;
    case ENODEV:
        return AXT_CAN_ERROR_NO_INTERFACE;
    default:
        return AXT_CAN_ERROR_IO;
    }
}

static axt_can_status ask(int netlink, unsigned int index) {
    const uint16_t head = sizeof(struct rtattr);
    const restart_request request = {
        .header = {.nlmsg_len = sizeof request,
                   .nlmsg_type = RTM_NEWLINK,
                   .nlmsg_flags = NLM_F_REQUEST | NLM_F_ACK},
        .link = {.ifi_family = AF_UNSPEC, .ifi_index = (int)index},
        .info = {.rta_len = (uint16_t)(4 * head + 8), .rta_type = IFLA_LINKINFO},
        .kind = {.rta_len = (uint16_t)(head + 4), .rta_type = IFLA_INFO_KIND},
        .kind_name = "can",
        .data = {.rta_len = (uint16_t)(2 * head + 4), .rta_type = IFLA_INFO_DATA},
        .restart = {.rta_len = (uint16_t)(head + 4), .rta_type = IFLA_CAN_RESTART},
        .on = 1,
    };
    acknowledgement answer = {0};
    /* the kernel has answered when send() returns */
    if (send(netlink, &request, sizeof request, 0) != (ssize_t)sizeof request ||
        recv(netlink, &answer, sizeof answer, MSG_DONTWAIT) < (ssize_t)sizeof answer ||
        answer.header.nlmsg_type != NLMSG_ERROR) {
        return AXT_CAN_ERROR_IO;
    }
    return status_of(-answer.error.error);
}

axt_can_status axt_can_netlink_restart(const char *interface) {
    const unsigned int index = if_nametoindex(interface);
    if (index == 0) {
        return AXT_CAN_ERROR_NO_INTERFACE;
    }
    const int netlink = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (netlink < 0) {
        return AXT_CAN_ERROR_IO;
    }
    const axt_can_status status = ask(netlink, index);
    (void)close(netlink);
    return status;
}
