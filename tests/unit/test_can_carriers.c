/* The two carriers of SLCAN on Linux, each against a host of the kind it is made for: a process
 * that opens a terminal, a client that connects. Hosts come, go, and die. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "axt_slcan_pty.h"
#include "axt_slcan_tcp.h"
#include "check.h"

/* Serves the bus until it has a frame or 200 ms have passed. */
static axt_can_status serve(axt_can *can, axt_can_frame *frame) {
    axt_can_status status = AXT_CAN_WOULD_BLOCK;
    for (int i = 0; i < 200 && status != AXT_CAN_OK; i++) {
        status = can->receive(can, frame);
        (void)poll(NULL, 0, (status == AXT_CAN_OK) ? 0 : 1);
    }
    return status;
}

static void say(int host, const char *text) {
    CHECK_EQUAL(write(host, text, strlen(text)), strlen(text));
}

/* Serves the bus until the host has received `text`; false when that takes longer than a second. */
static bool hears(axt_can *can, int host, const char *text) {
    char received[256];
    size_t length = 0;
    for (int i = 0; i < 1000 && length < strlen(text); i++) {
        axt_can_frame frame;
        (void)can->receive(can, &frame);
        struct pollfd ready = {.fd = host, .events = POLLIN};
        if (poll(&ready, 1, 1) > 0) {
            const ssize_t got = read(host, received + length, sizeof received - length);
            length += (got > 0) ? (size_t)got : 0;
        }
    }
    const bool same = length == strlen(text) && memcmp(received, text, length) == 0;
    if (!same) {
        (void)fprintf(stderr, "host hears '%.*s'\n", (int)length, received);
    }
    return same;
}

/* What any host does: open the channel, receive a frame, send one. */
static void check_session(axt_can *can, int host) {
    const axt_can_frame sent = {.id = 0x181, .length = 3, .data = {0x0D, 0x0A, 0x03}};
    axt_can_frame received = {0};
    CHECK_EQUAL(can->send(can, &sent), AXT_CAN_CLOSED);
    say(host, "S8\rO\r");
    CHECK(hears(can, host, "\r\r"));
    CHECK_EQUAL(can->send(can, &sent), AXT_CAN_OK);
    CHECK(hears(can, host, "t18130D0A03\r"));
    say(host, "t2012A55A\r");
    CHECK_EQUAL(serve(can, &received), AXT_CAN_OK);
    CHECK_EQUAL(received.id, 0x201);
    CHECK_EQUAL(received.data[1], 0x5A);
    CHECK(hears(can, host, "z\r"));
}

static int open_terminal(const char *path) {
    const int host = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    CHECK(host >= 0);
    return host;
}

CASE(a_terminal_serves_one_host_after_the_other) {
    static axt_slcan_pty pty;
    axt_can *can = &pty.link.can;
    axt_can_frame frame;
    CHECK_EQUAL(axt_slcan_pty_open(&pty, NULL), AXT_CAN_OK);
    CHECK_EQUAL(can->receive(can, &frame), AXT_CAN_CLOSED);
    for (int i = 0; i < 3; i++) { /* a host that does not set the terminal raw, and just leaves */
        const int host = open_terminal(pty.path);
        check_session(can, host);
        (void)close(host);
        CHECK_EQUAL(serve(can, &frame), AXT_CAN_CLOSED);
    }
    can->close(can);
}

/* Full to the brim with frames that nobody reads, then the host is killed. */
CASE(a_host_that_dies_without_reading_leaves_nothing_to_the_next) {
    static axt_slcan_pty pty;
    axt_can *can = &pty.link.can;
    const axt_can_frame sent = {.id = 0x181, .length = 8};
    axt_can_frame received;
    CHECK_EQUAL(axt_slcan_pty_open(&pty, NULL), AXT_CAN_OK);
    int host = open_terminal(pty.path);
    say(host, "O\r");
    CHECK_EQUAL(serve(can, &received), AXT_CAN_WOULD_BLOCK);
    uint32_t accepted = 0;
    while (can->send(can, &sent) == AXT_CAN_OK) {
        accepted++;
    }
    CHECK(accepted > 100);
    CHECK_EQUAL(can->send(can, &sent), AXT_CAN_WOULD_BLOCK);
    (void)close(host);
    CHECK_EQUAL(can->send(can, &sent), AXT_CAN_CLOSED); /* seen even when nothing is received */
    CHECK_EQUAL(serve(can, &received), AXT_CAN_CLOSED);
    host = open_terminal(pty.path);
    check_session(can, host);
    (void)close(host);
    can->close(can);
}

CASE(the_alias_of_a_terminal_is_a_link_that_comes_and_goes) {
    static axt_slcan_pty pty;
    char folder[] = "/tmp/axt-XXXXXX";
    CHECK(mkdtemp(folder) != NULL);
    char alias[64];
    char target[64] = {0};
    (void)snprintf(alias, sizeof alias, "%s/can", folder);
    for (int i = 0; i < 2; i++) { /* the second time over one that was left behind */
        CHECK_EQUAL(axt_slcan_pty_open(&pty, alias), AXT_CAN_OK);
        CHECK(readlink(alias, target, sizeof target - 1) > 0);
        CHECK(strcmp(target, pty.path) == 0);
        const int host = open_terminal(alias);
        check_session(&pty.link.can, host);
        (void)close(host);
        pty.link.can.close(&pty.link.can);
        struct stat found;
        CHECK(lstat(alias, &found) != 0);
        CHECK_EQUAL(symlink("/dev/pts/nothing", alias), 0);
    }
    CHECK_EQUAL(unlink(alias), 0);

    const int file = open(alias, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    CHECK(file >= 0);
    CHECK_EQUAL(axt_slcan_pty_open(&pty, alias), AXT_CAN_ERROR_IN_USE);
    CHECK_EQUAL(fcntl(file, F_GETFD), FD_CLOEXEC); /* it is still there */
    (void)close(file);
    CHECK_EQUAL(unlink(alias), 0);
    CHECK_EQUAL(rmdir(folder), 0);
    CHECK_EQUAL(axt_slcan_pty_open(&pty, alias), AXT_CAN_ERROR_ADDRESS); /* no such folder */
}

static int connect_to(uint16_t port) {
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr = {htonl(INADDR_LOOPBACK)}};
    const int host = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    CHECK(host >= 0);
    CHECK_EQUAL(connect(host, (const struct sockaddr *)&address, sizeof address), 0);
    return host;
}

CASE(a_server_serves_one_host_after_the_other) {
    static axt_slcan_tcp tcp;
    axt_can *can = &tcp.link.can;
    axt_can_frame frame;
    CHECK_EQUAL(axt_slcan_tcp_open(&tcp, NULL, 0), AXT_CAN_OK);
    CHECK(tcp.port > 0);
    CHECK_EQUAL(can->receive(can, &frame), AXT_CAN_CLOSED);
    for (int i = 0; i < 3; i++) {
        const int host = connect_to(tcp.port);
        check_session(can, host);
        if (i == 1) { /* die without a farewell: a reset */
            const struct linger abrupt = {.l_onoff = 1};
            CHECK_EQUAL(setsockopt(host, SOL_SOCKET, SO_LINGER, &abrupt, sizeof abrupt), 0);
        }
        (void)close(host);
        CHECK_EQUAL(serve(can, &frame), AXT_CAN_CLOSED);
    }
    can->close(can);
}

CASE(a_second_host_is_turned_away) {
    static axt_slcan_tcp tcp;
    axt_can *can = &tcp.link.can;
    axt_can_frame frame;
    CHECK_EQUAL(axt_slcan_tcp_open(&tcp, "127.0.0.1", 0), AXT_CAN_OK);
    const int first = connect_to(tcp.port);
    check_session(can, first);
    const int second = connect_to(tcp.port);
    (void)serve(can, &frame);
    struct pollfd turned_away = {.fd = second, .events = POLLIN};
    char byte;
    CHECK_EQUAL(poll(&turned_away, 1, 1000), 1);
    CHECK_EQUAL(read(second, &byte, 1), 0);
    say(first, "V\r");
    CHECK(hears(can, first, "V1010\r"));
    (void)close(first);
    (void)close(second);
    (void)serve(can, &frame);
    const int third = connect_to(tcp.port);
    check_session(can, third);
    (void)close(third);
    can->close(can);
}

CASE(a_host_that_does_not_read_blocks_and_then_is_missed) {
    static axt_slcan_tcp tcp;
    axt_can *can = &tcp.link.can;
    const axt_can_frame sent = {.id = 0x181, .length = 8};
    axt_can_frame frame;
    CHECK_EQUAL(axt_slcan_tcp_open(&tcp, NULL, 0), AXT_CAN_OK);
    const int host = connect_to(tcp.port);
    say(host, "O\r");
    CHECK(hears(can, host, "\r"));
    axt_can_status status = AXT_CAN_OK;
    for (uint32_t i = 0; i < 10000000 && status == AXT_CAN_OK; i++) {
        status = can->send(can, &sent);
    }
    CHECK_EQUAL(status, AXT_CAN_WOULD_BLOCK);
    (void)close(host);
    CHECK_EQUAL(serve(can, &frame), AXT_CAN_CLOSED);
    CHECK_EQUAL(can->send(can, &sent), AXT_CAN_CLOSED);
    can->close(can);
}

CASE(addresses_that_cannot_be_used_are_told_apart) {
    static axt_slcan_tcp tcp;
    static axt_slcan_tcp again;
    CHECK_EQUAL(axt_slcan_tcp_open(&tcp, NULL, 0), AXT_CAN_OK);
    CHECK_EQUAL(axt_slcan_tcp_open(&again, NULL, tcp.port), AXT_CAN_ERROR_IN_USE);
    CHECK_EQUAL(axt_slcan_tcp_open(&again, "192.0.2.1", 0), AXT_CAN_ERROR_ADDRESS);
    CHECK_EQUAL(axt_slcan_tcp_open(&again, "not a host", 0), AXT_CAN_ERROR_ADDRESS);
    tcp.link.can.close(&tcp.link.can);
}

int main(void) {
    RUN(a_terminal_serves_one_host_after_the_other);
    RUN(a_host_that_dies_without_reading_leaves_nothing_to_the_next);
    RUN(the_alias_of_a_terminal_is_a_link_that_comes_and_goes);
    RUN(a_server_serves_one_host_after_the_other);
    RUN(a_second_host_is_turned_away);
    RUN(a_host_that_does_not_read_blocks_and_then_is_missed);
    RUN(addresses_that_cannot_be_used_are_told_apart);
    return REPORT();
}
