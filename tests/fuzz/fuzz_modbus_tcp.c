/* Anything at all over a TCP connection of the Linux Modbus server, before a node that runs.
 *
 * The input is what a client sends, split into segments by a length byte each. The connection and
 * libmodbus are the real ones. What must hold: the server comes to an end with the client, and a
 * client that has not turned the key changes nothing. */
#include <arpa/inet.h>
#include <pthread.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "axt_modbus_server.h"
#include "axt_registers_node.h"
#include "node_rig.h"

static axt_modbus_server server;
static rig *r;

/* The node's side, in a thread of its own as in the emulator. */
static void *run_node(void *context) {
    const struct timespec pause = {.tv_nsec = 50000};
    static axt_registers_node view;
    const axt_registers_port port = axt_registers_node_port(&view, &r->node);
    (void)context;
    for (;;) {
        rig_run(r, 1);
        rig_forget_sent(r);
        axt_register_exchange_run(&server.exchange, &port);
        (void)nanosleep(&pause, NULL);
    }
    return NULL;
}

static void start(void) {
    pthread_t thread;
    r = rig_running();
    if (axt_modbus_server_open_tcp(&server, &r->node.history, NULL, 0, RIG_ID) !=
            AXT_MODBUS_SERVER_OK ||
        pthread_create(&thread, NULL, run_node, NULL) != 0) {
        abort();
    }
    server.stop = server.listener; /* nobody stops it: it is served from here */
}

static int connect_client(void) {
    const struct sockaddr_in address = {.sin_family = AF_INET,
                                        .sin_port = htons(server.port),
                                        .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const struct linger at_once = {.l_onoff = 1, .l_linger = 0}; /* no port is left waiting */
    const int client = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (client < 0 || setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once) != 0 ||
        connect(client, (const struct sockaddr *)&address, sizeof address) != 0) {
        abort();
    }
    server.serve(&server, 1000);
    return client;
}

static void read_answers(int client) {
    uint8_t bytes[4096];
    while (recv(client, bytes, sizeof bytes, MSG_DONTWAIT) > 0) {
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (r == NULL) {
        start();
    }
    const uint32_t history = axt_history_decimation(&r->node.history);
    const int client = connect_client();
    bool unlocked = false;
    size_t at = 0;
    while (at < size && server.connected > 0) {
        size_t length = data[at];
        at++;
        if (length > size - at) {
            length = size - at;
        }
        (void)send(client, data + at, length, MSG_NOSIGNAL);
        at += length;
        if (length > 0) {
            server.serve(&server, 1000);
        }
        unlocked = unlocked || server.connections[0].registers.lock == AXT_REGISTERS_ENABLED;
        read_answers(client);
    }
    (void)shutdown(client, SHUT_WR);
    for (uint32_t i = 0; server.connected > 0; i++) {
        server.serve(&server, 1000);
        if (i > 1000) {
            abort();
        }
    }
    (void)close(client);
    if (!unlocked && axt_history_decimation(&r->node.history) != history) {
        abort();
    }
    return 0;
}
