/* axt_socketcan.h - a CAN interface of the Linux kernel.
 *
 * Once it is open no failure is final. Sending and receiving then answer AXT_CAN_WOULD_BLOCK, so
 * that nothing is thrown away meanwhile, and `can.health` says what is the matter:
 *
 *     bus off         nothing is sent for a back-off of 100 ms; then the controller is restarted
 *                     (unless the kernel does that itself, see restart-ms of ip-link(8)). Each
 *                     further bus-off doubles the back-off, up to 10 s; 10 s without one set it
 *                     back to 100 ms.
 *     down or gone    the interface is looked for by its name every 100 ms
 *
 * Restarting and opening wait for the kernel's lock of network settings. Linux 5.7 or later, or an
 * older one with the right to use raw sockets (CAP_NET_RAW).
 */
#ifndef AXT_SOCKETCAN_H
#define AXT_SOCKETCAN_H

#include <net/if.h>

#include "axt_can.h"

enum { AXT_SOCKETCAN_FILTERS_MAX = 4 };

typedef struct {
    axt_can can;
    char interface[IF_NAMESIZE];
    axt_can_filter filters[AXT_SOCKETCAN_FILTERS_MAX];
    uint32_t filter_count;
    int socket;         /* -1 while the interface is down or gone */
    uint32_t dropped;   /* frames that this socket had no room for, as the kernel counts them */
    uint64_t retry;     /* when to restart or open again [ns], in the states that ask for it */
    uint64_t back_off;  /* after the next bus-off [ns] */
    uint64_t restarted; /* after the last one [ns] */
} axt_socketcan;

/* Opens `interface` (such as vcan0) for sending anything and receiving what one of 1 ..
 * AXT_SOCKETCAN_FILTERS_MAX filters lets through, so that the kernel keeps all else away from this
 * process. `can.fd` says whether the interface carries FD frames. The kernel is asked for room for
 * 4 MiB of received frames; without the right to administer the net it gives what net.core.rmem_max
 * allows. AXT_CAN_ERROR_NO_SUPPORT, _NO_INTERFACE, _DOWN, _PERMISSION or _IO; nothing is left open
 * then. */
axt_can_status axt_socketcan_open(axt_socketcan *port, const char *interface,
                                  const axt_can_filter *filters, uint32_t filter_count);

#endif
