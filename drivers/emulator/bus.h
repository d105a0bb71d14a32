/* bus.h - the bus that the command line asks for. */
#ifndef BUS_H
#define BUS_H

#include <stdbool.h>
#include <stddef.h>

#include "axt_can.h"
#include "axt_can_pace.h"
#include "axt_slcan_pty.h"
#include "axt_slcan_tcp.h"
#include "axt_socketcan.h"

/* Splits [HOST:]PORT; an IPv6 address stands in brackets. `host` is empty when there is none. */
bool axt_emulator_split_address(const char *text, char *host, size_t size, uint16_t *port);

typedef struct {
    union {
        axt_socketcan socketcan;
        axt_slcan_pty pty;
        axt_slcan_tcp tcp;
    } carrier;
    axt_can_pace pace;
    axt_can *can;   /* use this */
    bool paced;     /* tell `pace` that time passes */
    char name[300]; /* for people: "pty /dev/pts/5" */
} axt_emulator_bus;

/* Opens `bus`: INTERFACE, pty, pty:LINK or tcp:[HOST:]PORT. `node` is the id of the node that will
 * use it, `rates` the speed to emulate (nominal 0: none). Fails as the carrier does. The struct
 * must not move. */
axt_can_status axt_emulator_bus_open(axt_emulator_bus *opened, const char *bus, uint8_t node,
                                     const axt_can_bit_rates *rates);

#endif
