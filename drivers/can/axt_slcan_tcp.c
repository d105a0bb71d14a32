#include "axt_slcan_tcp.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "axt_clock.h"

enum { NOBODY = -1, BACKLOG = 4 };

/* Takes a waiting host, or turns it away when there is one already. */
static void welcome(axt_slcan_tcp *tcp) {
    const int guest = accept4(tcp->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (guest < 0) {
        return;
    }
    if (tcp->host != NOBODY) {
        (void)close(guest);
        return;
    }
    /* a frame must not wait for the next one to fill a segment */
    const int on = 1;
    (void)setsockopt(guest, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    tcp->host = guest;
}

static int32_t farewell(axt_slcan_tcp *tcp) {
    (void)close(tcp->host);
    tcp->host = NOBODY;
    return AXT_CAN_CLOSED;
}

static int32_t tcp_read(void *context, char *bytes, uint32_t size) {
    axt_slcan_tcp *tcp = context;
    welcome(tcp);
    if (tcp->host == NOBODY) {
        return AXT_CAN_CLOSED;
    }
    const ssize_t got = recv(tcp->host, bytes, size, 0);
    if (got > 0) {
        return (int32_t)got;
    }
    return (got < 0 && (errno == EAGAIN || errno == EINTR)) ? 0 : farewell(tcp);
}

static int32_t tcp_write(void *context, const char *bytes, uint32_t size) {
    axt_slcan_tcp *tcp = context;
    if (tcp->host == NOBODY) {
        return AXT_CAN_CLOSED;
    }
    const ssize_t taken = send(tcp->host, bytes, size, MSG_NOSIGNAL);
    if (taken >= 0) {
        return (int32_t)taken;
    }
    return (errno == EAGAIN || errno == EINTR) ? 0 : farewell(tcp);
}

static uint32_t tcp_milliseconds(void *context) {
    (void)context;
    return (uint32_t)(axt_clock_now() / 1000000);
}

static void tcp_close(axt_can *can) {
    axt_slcan_tcp *tcp = (axt_slcan_tcp *)can;
    if (tcp->host != NOBODY) {
        (void)close(tcp->host);
    }
    (void)close(tcp->listener);
}

static axt_can_status status_of_errno(void) {
    switch (errno) {
    case EADDRINUSE:
        return AXT_CAN_ERROR_IN_USE;
    case EACCES:
        return AXT_CAN_ERROR_PERMISSION;
    case EADDRNOTAVAIL:
    case EAFNOSUPPORT:
        return AXT_CAN_ERROR_ADDRESS;
    default:
        return AXT_CAN_ERROR_IO;
    }
}

/* A socket that listens on the address, or -1 with errno set. */
static int listen_on(const struct addrinfo *where) {
    const int listener = socket(where->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (listener < 0) {
        return -1;
    }
    /* a port whose last connection is still fading away can be used again */
    const int on = 1;
    (void)setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(listener, where->ai_addr, where->ai_addrlen) != 0 || listen(listener, BACKLOG) != 0) {
        const int why = errno;
        (void)close(listener);
        errno = why;
        return -1;
    }
    return listener;
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

axt_can_status axt_slcan_tcp_open(axt_slcan_tcp *tcp, const char *address, uint16_t port) {
    char service[8];
    (void)snprintf(service, sizeof service, "%u", (unsigned)port);
    const struct addrinfo wanted = {.ai_socktype = SOCK_STREAM,
                                    .ai_flags = AI_PASSIVE | AI_NUMERICSERV};
    struct addrinfo *where = NULL;
    if (getaddrinfo((address != NULL) ? address : "127.0.0.1", service, &wanted, &where) != 0) {
        return AXT_CAN_ERROR_ADDRESS;
    }
    const int listener = listen_on(where);
    const axt_can_status status = (listener < 0) ? status_of_errno() : AXT_CAN_OK;
    freeaddrinfo(where);
    if (status != AXT_CAN_OK) {
        return status;
    }
    memset(tcp, 0, sizeof *tcp);
    tcp->listener = listener;
    tcp->host = NOBODY;
    tcp->port = port_of(listener);
    const axt_slcan_carrier carrier = {
        .read = tcp_read, .write = tcp_write, .milliseconds = tcp_milliseconds, .context = tcp};
    axt_slcan_link_init(&tcp->link, &carrier);
    tcp->link.can.close = tcp_close;
    return AXT_CAN_OK;
}
