#include "bus.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "axt_node.h"

bool axt_emulator_split_address(const char *text, char *host, size_t size, uint16_t *port) {
    const char *colon = strrchr(text, ':');
    const char *digits = (colon != NULL) ? colon + 1 : text;
    size_t length = (colon != NULL) ? (size_t)(colon - text) : 0;
    if (length >= 2 && text[0] == '[' && text[length - 1] == ']') {
        text++;
        length -= 2;
    }
    char *end;
    const unsigned long number = strtoul(digits, &end, 10);
    if (*digits < '0' || *digits > '9' || *end != '\0' || number > UINT16_MAX || length >= size) {
        return false;
    }
    memcpy(host, text, length);
    host[length] = '\0';
    *port = (uint16_t)number;
    return true;
}

static axt_can_status open_pty(axt_emulator_bus *opened, const char *alias) {
    axt_slcan_pty *pty = &opened->carrier.pty;
    const axt_can_status status = axt_slcan_pty_open(pty, alias);
    if (status == AXT_CAN_OK) {
        opened->can = &pty->link.can;
        (void)snprintf(opened->name, sizeof opened->name, "pty %s", pty->path);
    }
    return status;
}

static axt_can_status open_tcp(axt_emulator_bus *opened, const char *address) {
    axt_slcan_tcp *tcp = &opened->carrier.tcp;
    char host[256];
    uint16_t port;
    if (!axt_emulator_split_address(address, host, sizeof host, &port)) {
        return AXT_CAN_ERROR_ADDRESS;
    }
    const axt_can_status status = axt_slcan_tcp_open(tcp, (host[0] != '\0') ? host : NULL, port);
    if (status == AXT_CAN_OK) {
        opened->can = &tcp->link.can;
        (void)snprintf(opened->name, sizeof opened->name, "tcp %s:%u",
                       (host[0] != '\0') ? host : "127.0.0.1", (unsigned)tcp->port);
    }
    return status;
}

static axt_can_status open_socketcan(axt_emulator_bus *opened, const char *interface,
                                     uint8_t node) {
    axt_socketcan *port = &opened->carrier.socketcan;
    axt_can_filter filters[AXT_NODE_FILTERS];
    axt_node_filters(node, filters);
    const axt_can_status status = axt_socketcan_open(port, interface, filters, AXT_NODE_FILTERS);
    if (status == AXT_CAN_OK) {
        opened->can = &port->can;
        (void)snprintf(opened->name, sizeof opened->name, "socketcan %s", interface);
    }
    return status;
}

axt_can_status axt_emulator_bus_open(axt_emulator_bus *opened, const char *bus, uint8_t node,
                                     const axt_can_bit_rates *rates) {
    axt_can_status status;
    if (strcmp(bus, "pty") == 0) {
        status = open_pty(opened, NULL);
    } else if (strncmp(bus, "pty:", 4) == 0) {
        status = open_pty(opened, bus + 4);
    } else if (strncmp(bus, "tcp:", 4) == 0) {
        status = open_tcp(opened, bus + 4);
    } else {
        status = open_socketcan(opened, bus, node);
    }
    opened->paced = status == AXT_CAN_OK && rates->nominal > 0;
    if (opened->paced) {
        axt_can_pace_init(&opened->pace, opened->can, rates);
        opened->can = &opened->pace.can;
    }
    return status;
}
