/* modbus_load PORT CLIENTS SECONDS: reads as fast as the server answers, every client one request
 * at a time. Prints the number of reads, the seconds, and the median and 99 % quantile of the time
 * that a read took [us]. Any answer that is not the one to the request ends it with status 1. */
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "axt_clock.h"
#include "axt_register_table.h"

enum { CLIENTS_MAX = 64, COUNT = 52, ANSWER = 9 + 2 * COUNT, TIMES_MAX = 20000 };

typedef struct {
    int socket;
    uint16_t transaction;
    uint64_t asked;
} client;

static bool connect_to(client *c, uint16_t port) {
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int on = 1;
    c->socket = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    return c->socket >= 0 &&
           connect(c->socket, (const struct sockaddr *)&address, sizeof address) == 0 &&
           setsockopt(c->socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) == 0;
}

/* Reads the first registers of block State. */
static bool ask(client *c) {
    c->transaction++;
    const uint8_t request[] = {(uint8_t)(c->transaction >> 8),
                               (uint8_t)c->transaction,
                               0,
                               0,
                               0,
                               6,
                               1,
                               3,
                               0,
                               AXT_REGISTER_SEQUENCE,
                               0,
                               COUNT};
    c->asked = axt_clock_now();
    return send(c->socket, request, sizeof request, MSG_NOSIGNAL) == (ssize_t)sizeof request;
}

static bool hear(client *c) {
    uint8_t answer[ANSWER];
    return recv(c->socket, answer, sizeof answer, MSG_WAITALL) == (ssize_t)sizeof answer &&
           answer[0] == (uint8_t)(c->transaction >> 8) && answer[1] == (uint8_t)c->transaction &&
           answer[7] == 3 && answer[8] == 2 * COUNT;
}

static int later(const void *a, const void *b) {
    const uint32_t x = *(const uint32_t *)a;
    const uint32_t y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    static client clients[CLIENTS_MAX];
    static struct pollfd events[CLIENTS_MAX];
    static uint32_t times[TIMES_MAX]; /* [ns] of the last reads */
    const unsigned long count = (argc == 4) ? strtoul(argv[2], NULL, 10) : 0;
    if (count < 1 || count > CLIENTS_MAX) {
        (void)fprintf(stderr, "usage: modbus_load PORT CLIENTS SECONDS\n");
        return 2;
    }
    const uint64_t begin = axt_clock_now();
    const uint64_t end = begin + (uint64_t)(strtod(argv[3], NULL) * 1e9);
    for (unsigned long i = 0; i < count; i++) {
        if (!connect_to(&clients[i], (uint16_t)strtoul(argv[1], NULL, 10)) || !ask(&clients[i])) {
            (void)fprintf(stderr, "modbus_load: cannot connect\n");
            return 1;
        }
        events[i] = (struct pollfd){.fd = clients[i].socket, .events = POLLIN};
    }
    uint64_t reads = 0;
    while (axt_clock_now() < end) {
        (void)poll(events, count, 100);
        for (unsigned long i = 0; i < count; i++) {
            if (events[i].revents == 0) {
                continue;
            }
            const bool right = hear(&clients[i]);
            times[reads % TIMES_MAX] = (uint32_t)(axt_clock_now() - clients[i].asked);
            reads++;
            if (!right || !ask(&clients[i])) {
                (void)fprintf(stderr, "modbus_load: not the answer to the request\n");
                return 1;
            }
        }
    }
    const size_t kept = (reads < TIMES_MAX) ? reads : TIMES_MAX;
    qsort(times, kept, sizeof times[0], later);
    const size_t middle = kept / 2;
    const size_t slow = kept * 99 / 100;
    (void)printf("%llu %.6f %.3f %.3f\n", (unsigned long long)reads,
                 (double)(axt_clock_now() - begin) * 1e-9, times[middle] * 1e-3,
                 times[slow] * 1e-3);
    return 0;
}
