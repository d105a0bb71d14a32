/* Modbus over TCP: connections, and requests cut out of what comes in (Messaging on TCP/IP V1.0b).
 */
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "axt_modbus_server.h"

enum {
    BACKLOG = 16,
    KEEPALIVE_S = 10,
    UNIT = 6, /* place of the unit id; before it transaction, protocol, length */
    FUNCTION = 7,
    ANY_UNIT = 255,        /* what the standard advises for a server that is no gateway */
    HALF_REQUEST_MS = 1000 /* a client that takes longer over one request is cut off */
};

static void drop(axt_modbus_server *server, uint32_t i) {
    (void)close(server->connections[i].socket);
    server->connected--;
    server->connections[i] = server->connections[server->connected];
}

static void drop_most_silent(axt_modbus_server *server) {
    const uint32_t now = axt_modbus_server_milliseconds();
    uint32_t found = 0;
    for (uint32_t i = 1; i < server->connected; i++) {
        if (now - server->connections[i].heard > now - server->connections[found].heard) {
            found = i;
        }
    }
    drop(server, found);
}

static void welcome(axt_modbus_server *server) {
    const int guest = accept4(server->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (guest < 0) {
        return;
    }
    /* an answer must not wait for more to send; a client whose machine is gone is found out */
    const int on = 1;
    (void)setsockopt(guest, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    const int idle = KEEPALIVE_S;
    (void)setsockopt(guest, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    (void)setsockopt(guest, IPPROTO_TCP, TCP_KEEPIDLE, &idle, sizeof idle);
    (void)setsockopt(guest, IPPROTO_TCP, TCP_KEEPINTVL, &idle, sizeof idle);
    if (server->connected == AXT_MODBUS_CLIENTS) {
        drop_most_silent(server);
    }
    server->connections[server->connected] =
        (axt_modbus_connection){.socket = guest, .heard = axt_modbus_server_milliseconds()};
    server->connected++;
}

/* Length of the request that the bytes begin with, 0 when it is not there yet, or -1 when this is
 * not Modbus: nobody knows where the next request would begin. */
static int request_length(const axt_modbus_connection *connection) {
    const uint8_t *bytes = connection->bytes;
    if (connection->length < UNIT) {
        return 0;
    }
    const uint32_t rest = (uint32_t)bytes[4] << 8 | bytes[5]; /* unit id and PDU */
    if (bytes[2] != 0 || bytes[3] != 0 || rest < 2 || rest > 1 + AXT_MODBUS_PDU_MAX) {
        return -1;
    }
    return (connection->length >= UNIT + rest) ? (int)(UNIT + rest) : 0;
}

/* False when this client is better cut off. */
static bool answer(axt_modbus_server *server, axt_modbus_connection *connection, uint32_t length) {
    const uint8_t *bytes = connection->bytes;
    if ((bytes[FUNCTION] & AXT_MODBUS_EXCEPTION_BIT) != 0) {
        return false; /* libmodbus would make a proper answer of it, and it is no request */
    }
    if (modbus_set_socket(server->modbus, connection->socket) != 0) {
        return false;
    }
    if (bytes[UNIT] != server->unit && bytes[UNIT] != 0 && bytes[UNIT] != ANY_UNIT) {
        return modbus_reply_exception(server->modbus, bytes, AXT_MODBUS_NO_TARGET) > 0;
    }
    return axt_modbus_server_answer(server, &connection->registers, bytes, FUNCTION, length, true);
}

/* Takes what has come and answers the requests that are complete. False when the client has gone,
 * or does not read its answers, or does not speak Modbus. */
static bool serve_connection(axt_modbus_server *server, axt_modbus_connection *connection) {
    const ssize_t got = recv(connection->socket, connection->bytes + connection->length,
                             sizeof connection->bytes - connection->length, 0);
    if (got <= 0) {
        return got < 0 && (errno == EAGAIN || errno == EINTR);
    }
    const uint32_t now = axt_modbus_server_milliseconds();
    connection->begun = (connection->length > 0) ? connection->begun : now;
    connection->heard = now;
    connection->length += (uint32_t)got;
    int length = request_length(connection);
    while (length > 0) {
        if (!answer(server, connection, (uint32_t)length)) {
            return false;
        }
        connection->length -= (uint32_t)length;
        memmove(connection->bytes, connection->bytes + length, connection->length);
        connection->begun = now;
        length = request_length(connection);
    }
    return length == 0;
}

static bool is_stuck(const axt_modbus_connection *connection) {
    return connection->length > 0 &&
           axt_modbus_server_milliseconds() - connection->begun > HALF_REQUEST_MS;
}

static void serve(axt_modbus_server *server, int timeout) {
    struct pollfd events[AXT_MODBUS_CLIENTS + 2];
    const uint32_t connected = server->connected;
    for (uint32_t i = 0; i < connected; i++) {
        events[i] = (struct pollfd){.fd = server->connections[i].socket, .events = POLLIN};
    }
    events[connected] = (struct pollfd){.fd = server->listener, .events = POLLIN};
    events[connected + 1] = (struct pollfd){.fd = server->stop, .events = POLLIN};
    if (poll(events, connected + 2, timeout) < 0) {
        return;
    }
    for (uint32_t i = connected; i > 0; i--) { /* down: dropping one moves the last one here */
        axt_modbus_connection *connection = &server->connections[i - 1];
        axt_registers_expire(&connection->registers, axt_modbus_server_microseconds());
        const bool fine = events[i - 1].revents == 0 || serve_connection(server, connection);
        if (!fine || is_stuck(connection)) {
            drop(server, i - 1);
        }
    }
    if (events[connected].revents != 0) {
        welcome(server);
    }
}

static void hang_up(axt_modbus_server *server) {
    while (server->connected > 0) {
        drop(server, 0);
    }
    (void)close(server->listener);
}

static uint16_t port_of(int listener) {
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
    } bound = {0};
    socklen_t size = sizeof bound;
    (void)getsockname(listener, &bound.any, &size);
    return ntohs((bound.any.sa_family == AF_INET6) ? bound.v6.sin6_port : bound.v4.sin_port);
}

axt_modbus_server_status axt_modbus_server_open_tcp(axt_modbus_server *server,
                                                    const axt_history *history, const char *host,
                                                    uint16_t port, uint8_t unit) {
    char service[8];
    (void)snprintf(service, sizeof service, "%u", (unsigned)port);
    memset(server, 0, sizeof *server);
    axt_register_exchange_init(&server->exchange, history);
    server->unit = unit;
    server->serve = serve;
    server->hang_up = hang_up;
    server->modbus = modbus_new_tcp_pi((host != NULL) ? host : "127.0.0.1", service);
    if (server->modbus == NULL) {
        return axt_modbus_server_status_of_errno();
    }
    server->listener = modbus_tcp_pi_listen(server->modbus, BACKLOG);
    if (server->listener < 0) {
        const axt_modbus_server_status status = axt_modbus_server_status_of_errno();
        modbus_free(server->modbus);
        return status;
    }
    (void)fcntl(server->listener, F_SETFL, O_NONBLOCK);
    server->port = port_of(server->listener);
    return AXT_MODBUS_SERVER_OK;
}
