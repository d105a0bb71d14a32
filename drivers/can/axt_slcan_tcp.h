/* axt_slcan_tcp.h - SLCAN over TCP, as serial device servers offer it (Linux).
 *
 * A server for one host at a time: while one is connected, another is turned away at once; when it
 * has gone, the next one may come.
 */
#ifndef AXT_SLCAN_TCP_H
#define AXT_SLCAN_TCP_H

#include "axt_slcan_link.h"

typedef struct {
    axt_slcan_link link; /* use link.can */
    int listener;
    int host; /* connected, or -1 */
    uint16_t port;
} axt_slcan_tcp;

/* Listens on `address` (NULL: 127.0.0.1, reached from this machine only) and `port` (0: any free
 * one; read it from the struct). AXT_CAN_ERROR_ADDRESS: not an address of this machine;
 * AXT_CAN_ERROR_IN_USE, AXT_CAN_ERROR_PERMISSION, AXT_CAN_ERROR_IO. Nothing is left open then. */
axt_can_status axt_slcan_tcp_open(axt_slcan_tcp *tcp, const char *address, uint16_t port);

#endif
