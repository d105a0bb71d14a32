/* modbus_servers.h - the Modbus servers that the command line asks for. */
#ifndef MODBUS_SERVERS_H
#define MODBUS_SERVERS_H

#include <stdbool.h>

#include "axt_modbus_server.h"
#include "axt_registers_node.h"
#include "options.h"

typedef struct {
    axt_modbus_server server[AXT_EMULATOR_MODBUS_MAX];
    uint32_t count;
    axt_registers_node view;
    axt_registers_port port;
    char name[300]; /* for people: ", modbus tcp 127.0.0.1:1502" for each */
} axt_emulator_modbus;

/* Opens and starts what the options ask for. False after one line on standard error when that is
 * not possible; nothing is then open. The struct must not move. */
bool axt_emulator_modbus_open(axt_emulator_modbus *modbus, const axt_emulator_options *options,
                              axt_node *node);

/* Shows the servers what the node is, and carries out what their clients ask for. Call it where the
 * node's background is called. Never waits. */
void axt_emulator_modbus_run(axt_emulator_modbus *modbus);

void axt_emulator_modbus_close(axt_emulator_modbus *modbus);

#endif
