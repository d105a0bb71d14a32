/* axt_registers.h - the registers of the register table (docs/registers.md) behind Modbus requests.
 *
 * The one place where a request meets the table: every server, of the firmware as of Linux, hands
 * its requests in here. What can be read comes as one snapshot of all registers, so the values of
 * an answer are of one moment. What can be written belongs to the client that has written it:
 * where it reads in the history, and commands, after the write key.
 */
#ifndef AXT_REGISTERS_H
#define AXT_REGISTERS_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_history.h"
#include "axt_modbus.h"
#include "axt_register_table.h"

enum {
    AXT_REGISTERS_KEY_FIRST = 0x4158, /* what WriteKey wants to see, one after the other */
    AXT_REGISTERS_KEY_SECOND = 0x5457
};
enum { AXT_REGISTERS_CONTROL = 0x10000 }; /* argument: control word, and torque in the low half */
enum { AXT_REGISTERS_NOT_NOW = 3 };       /* of register Result: what AXT_MODBUS_BUSY goes with */
/* Writing is enabled this long after a write [us]. */
#define AXT_REGISTERS_ENABLED_US UINT32_C(10000000)

/* What the registers show and do: the node, or another thread's way to it. */
typedef struct {
    const axt_history *history; /* of the node; may be read from any thread */
    void *context;              /* handed to the next three */
    /* Fills in what is the same for all clients, as it is now, and 0 elsewhere. */
    void (*snapshot)(void *context, uint16_t registers[AXT_REGISTER_END]);
    /* A host that may give commands has been heard. */
    void (*hear_host)(void *context);
    /* Carries out a command: a code of the table, or AXT_REGISTERS_CONTROL. AXT_MODBUS_OK;
     * _ILLEGAL_VALUE or _REFUSED; _BUSY when it may be tried again at once. `result` is what
     * register Result shows then. */
    axt_modbus_exception (*command)(void *context, uint32_t code, uint32_t argument,
                                    uint16_t *result);
} axt_registers_port;

typedef enum {
    AXT_REGISTERS_LOCKED = 0,
    AXT_REGISTERS_KEY_IN, /* the first key has been written */
    AXT_REGISTERS_ENABLED
} axt_registers_lock;

/* A client: a connection, or all that is on a serial line. Zero is a new one. */
typedef struct {
    uint16_t written[AXT_REGISTER_WRITABLE_COUNT]; /* last, as it reads them back */
    uint16_t result;
    axt_registers_lock lock;
    uint32_t since; /* the last write [us] */
} axt_registers_client;

/* Locks a client that has not written for AXT_REGISTERS_ENABLED_US. `now` [us] is the time of any
 * clock modulo 2^32; call this every few seconds at least, so that it cannot come round. */
void axt_registers_expire(axt_registers_client *client, uint32_t now);

/* Carries out a request that axt_modbus_parse() has understood. With AXT_MODBUS_OK and something to
 * be read, `registers` are those that this client sees, all of one snapshot. Fails with
 * _ILLEGAL_ADDRESS for registers that are not there, cannot be written or are locked, and as the
 * port's command; then nothing but the lock, and Result, has changed. Cost: one snapshot, or one
 * command. */
axt_modbus_exception axt_registers_serve(const axt_registers_port *port,
                                         axt_registers_client *client,
                                         const axt_modbus_request *request, uint32_t now,
                                         uint16_t registers[AXT_REGISTER_END]);

/* ---- For those who fill in a snapshot: values of 32 bits, the more significant register first ---
 */

void axt_registers_put_uint32(uint16_t *registers, uint32_t address, uint32_t value);
void axt_registers_put_int32(uint16_t *registers, uint32_t address, int32_t value);
void axt_registers_put_float(uint16_t *registers, uint32_t address, float value);

#endif
