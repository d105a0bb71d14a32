/* modbus_plain: a server as libmodbus' documentation has it, to compare with: select() over all
 * clients, modbus_receive(), modbus_reply() from a table that does not change. Prints its port. */
#include <errno.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

enum { REGISTERS = 128, BACKLOG = 16 };

static int most(int a, int b) {
    return (a > b) ? a : b;
}

int main(void) {
    modbus_t *modbus = modbus_new_tcp_pi("127.0.0.1", "0");
    modbus_mapping_t *mapping = modbus_mapping_new(0, 0, REGISTERS, REGISTERS);
    const int listener = (modbus != NULL) ? modbus_tcp_pi_listen(modbus, BACKLOG) : -1;
    if (mapping == NULL || listener < 0) {
        (void)fprintf(stderr, "modbus_plain: %s\n", modbus_strerror(errno));
        return 1;
    }
    struct sockaddr_in bound = {0};
    socklen_t size = sizeof bound;
    (void)getsockname(listener, (struct sockaddr *)&bound, &size);
    (void)printf("%u\n", (unsigned)ntohs(bound.sin_port));
    (void)fflush(stdout);
    fd_set all;
    FD_ZERO(&all);
    FD_SET(listener, &all);
    int last = listener;
    for (;;) {
        fd_set ready = all;
        if (select(last + 1, &ready, NULL, NULL, NULL) < 0) {
            return 1;
        }
        for (int socket = 0; socket <= last; socket++) {
            if (!FD_ISSET(socket, &ready)) {
                continue;
            }
            if (socket == listener) {
                const int guest = accept(listener, NULL, NULL);
                const int on = 1;
                (void)setsockopt(guest, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
                FD_SET(guest, &all);
                last = most(last, guest);
                continue;
            }
            uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
            (void)modbus_set_socket(modbus, socket);
            const int length = modbus_receive(modbus, request);
            if (length > 0) {
                (void)modbus_reply(modbus, request, length, mapping);
            } else {
                (void)close(socket);
                FD_CLR(socket, &all);
            }
        }
    }
}
