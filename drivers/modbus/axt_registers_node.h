/* axt_registers_node.h - what the registers show of a node, and the commands they give it. */
#ifndef AXT_REGISTERS_NODE_H
#define AXT_REGISTERS_NODE_H

#include "axt_node.h"
#include "axt_registers.h"

enum { AXT_REGISTERS_HISTORY_COMMAND = 256 }; /* above the codes of the CAN contract */

/* Its fields are its own business. */
typedef struct {
    axt_node *node;
    uint16_t sequence;
} axt_registers_node;

/* The port of a node, for servers that run where its background runs. `view` must live as long.
 * Cost of a snapshot: about 500 operations. A command is answered with AXT_MODBUS_BUSY while the
 * tick has still to take the last order. */
axt_registers_port axt_registers_node_port(axt_registers_node *view, axt_node *node);

#endif
