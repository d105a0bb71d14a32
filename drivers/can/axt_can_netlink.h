/* axt_can_netlink.h - what only rtnetlink can do to a CAN interface (Linux). */
#ifndef AXT_CAN_NETLINK_H
#define AXT_CAN_NETLINK_H

#include "axt_can.h"

/* Restarts the controller of `interface` after bus-off, as `ip link set NAME type can restart`.
 * AXT_CAN_ERROR_PERMISSION: without the right to administer the net; AXT_CAN_ERROR_NO_INTERFACE;
 * AXT_CAN_ERROR_IO: not bus off, restarted by the kernel itself, or not a controller (vcan). */
axt_can_status axt_can_netlink_restart(const char *interface);

#endif
