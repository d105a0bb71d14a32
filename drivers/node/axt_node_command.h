/* axt_node_command.h - what a host may ask for. Private to the node. */
#ifndef AXT_NODE_COMMAND_H
#define AXT_NODE_COMMAND_H

#include "axt_can.h"
#include "axt_node.h"

/* Carries out a frame that came with the node's command identifier. Needs the way to the tick to be
 * free (axt_node_can_order()). A frame shorter than a command is out of range. */
axt_node_result axt_node_execute(axt_node *node, const axt_can_frame *frame);

/* ---- Offered to it by axt_node.c ---- */

/* Has the tick taken the last order? If so, what it wrote before is visible here. */
bool axt_node_can_order(const axt_node *node);

/* Is operation enabled? */
bool axt_node_enabled(const axt_node *node);

/* Hands an order to the tick, which must have taken the last one. */
void axt_node_order_tick(axt_node *node, axt_node_order order, uint32_t argument);

/* Hands a control word and a set-point [0.1 per mille of rated] to the tick, which must have taken
 * the last order. A refusal is reported on the bus. */
void axt_node_order_control(axt_node *node, uint16_t control_word, int16_t target_torque);

/* The host that has the drive under its control has been heard. */
void axt_node_hear_host(axt_node *node);

/* Changes the state of the trace, and lets the bus know. */
void axt_node_set_trace_state(axt_node *node, axt_node_trace_state state);

#endif
