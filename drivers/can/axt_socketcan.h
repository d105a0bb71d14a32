/* axt_socketcan.h - a CAN interface of the Linux kernel. */
#ifndef AXT_SOCKETCAN_H
#define AXT_SOCKETCAN_H

#include "axt_can.h"

typedef struct {
    axt_can can;
    int socket;
} axt_socketcan;

/* Opens `interface` (such as vcan0) for sending anything and receiving the data frames with the 11
 * bit identifier `id` only, so that the kernel keeps all others away from this process.
 * AXT_CAN_ERROR_NO_SUPPORT, _NO_INTERFACE, _DOWN, _PERMISSION or _IO; nothing is left open then. */
axt_can_status axt_socketcan_open(axt_socketcan *port, const char *interface, uint32_t id);

#endif
