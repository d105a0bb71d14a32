/* axt_modbus_server.h - the registers served over TCP or a serial line by libmodbus (Linux).
 *
 * A server is a thread of its own; the thread that runs the node meets it in an exchange and never
 * waits for it. libmodbus opens the line and writes the answers. It does not read: every request is
 * taken in and checked here first, because libmodbus 3.1.6 (Debian 12) waits for the rest of half a
 * request while other clients stand in line, selects on descriptors beyond FD_SETSIZE, sleeps half
 * a second over a request with an impossible count, and copies what a request's length says into an
 * answer of fixed size.
 */
#ifndef AXT_MODBUS_SERVER_H
#define AXT_MODBUS_SERVER_H

#include <modbus/modbus.h>
#include <pthread.h>

#include "axt_modbus_line.h"
#include "axt_register_exchange.h"

enum { AXT_MODBUS_CLIENTS = 32, AXT_MODBUS_TCP_FRAME_MAX = AXT_MODBUS_PDU_MAX + 7 };

/* Zero is fine, negative is not. */
typedef enum {
    AXT_MODBUS_SERVER_OK = 0,
    AXT_MODBUS_SERVER_ERROR_ADDRESS = -1, /* not an address, device or bit rate that can be used */
    AXT_MODBUS_SERVER_ERROR_IN_USE = -2,
    AXT_MODBUS_SERVER_ERROR_PERMISSION = -3,
    AXT_MODBUS_SERVER_ERROR_SYSTEM = -4 /* out of memory, descriptors or threads */
} axt_modbus_server_status;

/* One English line for a status; static memory. */
const char *axt_modbus_server_status_string(axt_modbus_server_status status);

/* A TCP connection. */
typedef struct {
    int socket;
    uint32_t length; /* of the request so far */
    uint8_t bytes[AXT_MODBUS_TCP_FRAME_MAX];
    uint32_t begun; /* when it began [ms] */
    uint32_t heard; /* when something last came [ms] */
    axt_registers_client registers;
} axt_modbus_connection;

/* A server. Must not move once it is open. Its fields are its own business. */
typedef struct axt_modbus_server axt_modbus_server;
struct axt_modbus_server {
    axt_register_exchange exchange;
    uint8_t unit;
    modbus_t *modbus;
    void (*serve)(axt_modbus_server *server, int timeout); /* what has come, or comes within [ms] */
    void (*hang_up)(axt_modbus_server *server);
    uint16_t registers[AXT_REGISTER_END];
    int stop; /* an event that ends the thread */
    pthread_t thread;
    bool running;

    /* over TCP */
    int listener;
    uint16_t port;
    axt_modbus_connection connections[AXT_MODBUS_CLIENTS];
    uint32_t connected;

    /* on a serial line */
    bool open;
    axt_modbus_line line;
    axt_registers_client client;
};

/* Listens on host (a name or number, NULL: loopback) and port (0: any that is free, see
 * server->port). With AXT_MODBUS_CLIENTS connected, one more takes the place of the one that has
 * been silent longest. */
axt_modbus_server_status axt_modbus_server_open_tcp(axt_modbus_server *server,
                                                    const axt_history *history, const char *host,
                                                    uint16_t port, uint8_t unit);

/* Opens a serial port or the end of a pseudo-terminal: 8 data bits, `parity` N, E or O. A device
 * that goes away is opened again when it is back. */
axt_modbus_server_status axt_modbus_server_open_serial(axt_modbus_server *server,
                                                       const axt_history *history,
                                                       const char *device, uint32_t bit_rate,
                                                       char parity, uint8_t unit);

/* Begins to serve, in a thread of ordinary priority. Run the exchange once before: clients find
 * what it shows. */
axt_modbus_server_status axt_modbus_server_start(axt_modbus_server *server);

/* Ends the thread and closes everything. */
void axt_modbus_server_close(axt_modbus_server *server);

/* ---- Private to drivers/modbus ---- */

axt_modbus_server_status axt_modbus_server_status_of_errno(void);

/* Time of the monotonic clock, modulo 2^32: [us] and [ms]. */
uint32_t axt_modbus_server_microseconds(void);
uint32_t axt_modbus_server_milliseconds(void);

/* Carries out the request of a client in frame[0 .. length - 1], whose function is at `function`,
 * and answers it where `answered`. False when the answer could not be sent. */
bool axt_modbus_server_answer(axt_modbus_server *server, axt_registers_client *client,
                              const uint8_t *frame, uint32_t function, uint32_t length,
                              bool answered);

#endif
