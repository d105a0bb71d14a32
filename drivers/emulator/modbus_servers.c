#include "modbus_servers.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bus.h"

static void add_name(axt_emulator_modbus *modbus, const char *carrier, const char *where,
                     uint32_t number) {
    const size_t length = strlen(modbus->name);
    (void)snprintf(modbus->name + length, sizeof modbus->name - length, ", modbus %s %s:%lu",
                   carrier, where, (unsigned long)number);
}

static axt_modbus_server_status open_tcp(axt_emulator_modbus *modbus, axt_modbus_server *server,
                                         const char *address, uint8_t unit) {
    char host[256];
    uint16_t port;
    if (!axt_emulator_split_address(address, host, sizeof host, &port)) {
        return AXT_MODBUS_SERVER_ERROR_ADDRESS;
    }
    const bool given = host[0] != '\0';
    const axt_modbus_server_status status =
        axt_modbus_server_open_tcp(server, modbus->port.history, given ? host : NULL, port, unit);
    if (status == AXT_MODBUS_SERVER_OK) {
        add_name(modbus, "tcp", given ? host : "127.0.0.1", server->port);
    }
    return status;
}

/* DEVICE[,BITS[,PARITY]]: 19200 bit/s and even parity are the standard's defaults. */
static axt_modbus_server_status open_serial(axt_emulator_modbus *modbus, axt_modbus_server *server,
                                            const char *line, uint8_t unit) {
    char device[256];
    unsigned long bit_rate = 19200;
    char parity = 'E';
    const size_t length = strcspn(line, ",");
    if (length == 0 || length >= sizeof device) {
        return AXT_MODBUS_SERVER_ERROR_ADDRESS;
    }
    memcpy(device, line, length);
    device[length] = '\0';
    if (line[length] == ',') {
        char *end;
        bit_rate = strtoul(line + length + 1, &end, 10);
        if (end[0] == ',' && end[1] != '\0' && end[2] == '\0') {
            parity = end[1];
        } else if (end[0] != '\0') {
            return AXT_MODBUS_SERVER_ERROR_ADDRESS;
        }
    }
    const axt_modbus_server_status status = axt_modbus_server_open_serial(
        server, modbus->port.history, device, (bit_rate <= UINT32_MAX) ? (uint32_t)bit_rate : 0,
        parity, unit);
    if (status == AXT_MODBUS_SERVER_OK) {
        add_name(modbus, "rtu", device, (uint32_t)bit_rate);
    }
    return status;
}

static axt_modbus_server_status open_one(axt_emulator_modbus *modbus, const char *where,
                                         uint8_t unit) {
    axt_modbus_server *server = &modbus->server[modbus->count];
    axt_modbus_server_status status = AXT_MODBUS_SERVER_ERROR_ADDRESS;
    if (strncmp(where, "tcp:", 4) == 0) {
        status = open_tcp(modbus, server, where + 4, unit);
    } else if (strncmp(where, "rtu:", 4) == 0) {
        status = open_serial(modbus, server, where + 4, unit);
    }
    if (status == AXT_MODBUS_SERVER_OK) {
        modbus->count++;
        axt_register_exchange_run(&server->exchange, &modbus->port);
        status = axt_modbus_server_start(server);
    }
    return status;
}

bool axt_emulator_modbus_open(axt_emulator_modbus *modbus, const axt_emulator_options *options,
                              axt_node *node) {
    modbus->count = 0;
    modbus->name[0] = '\0';
    modbus->port = axt_registers_node_port(&modbus->view, node);
    for (uint32_t i = 0; i < options->modbus_count; i++) {
        const axt_modbus_server_status status = open_one(modbus, options->modbus[i], options->node);
        if (status != AXT_MODBUS_SERVER_OK) {
            (void)fprintf(stderr, "axistwin-emulator: --modbus %s: %s\n", options->modbus[i],
                          axt_modbus_server_status_string(status));
            axt_emulator_modbus_close(modbus);
            return false;
        }
    }
    return true;
}

void axt_emulator_modbus_run(axt_emulator_modbus *modbus) {
    for (uint32_t i = 0; i < modbus->count; i++) {
        axt_register_exchange_run(&modbus->server[i].exchange, &modbus->port);
    }
}

void axt_emulator_modbus_close(axt_emulator_modbus *modbus) {
    while (modbus->count > 0) {
        modbus->count--;
        axt_modbus_server_close(&modbus->server[modbus->count]);
    }
}
