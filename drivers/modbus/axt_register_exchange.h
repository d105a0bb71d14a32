/* axt_register_exchange.h - the registers handed from the thread that runs the node to one that
 * serves them (Linux).
 *
 * Neither waits for a lock. The node's side writes snapshots into one of three images while the
 * server reads another; they swap by exchanging an index, so the node's side never waits at all. A
 * command goes the other way, one at a time: the server waits for it, and takes it back when nobody
 * comes for it.
 */
#ifndef AXT_REGISTER_EXCHANGE_H
#define AXT_REGISTER_EXCHANGE_H

#include <stdatomic.h>

#include "axt_registers.h"

/* Its fields are its own business. */
typedef struct {
    const axt_history *history;
    uint16_t image[3][AXT_REGISTER_END];
    atomic_uint middle; /* the image that neither side uses now, and whether it is new */
    unsigned back;      /* the image of the node's side */
    unsigned front;     /* that of the server's side */

    atomic_bool heard; /* the host */

    atomic_int state; /* of the command */
    uint32_t code;
    uint32_t argument;
    uint16_t result;
    axt_modbus_exception exception;
} axt_register_exchange;

/* `history` is the node's. */
void axt_register_exchange_init(axt_register_exchange *exchange, const axt_history *history);

/* The node's side, again and again: shows what `node` shows now and carries out what was asked for.
 * Never waits. A command that `node` answers with AXT_MODBUS_BUSY is tried again the next time. */
void axt_register_exchange_run(axt_register_exchange *exchange, const axt_registers_port *node);

/* The server's side. A snapshot is the newest that is there; a command takes until the node's side
 * comes by, AXT_MODBUS_BUSY if it does not within 100 ms, and has then not been carried out. */
axt_registers_port axt_register_exchange_port(axt_register_exchange *exchange);

#endif
