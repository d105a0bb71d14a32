/* modbus_rtu_node DEVICE: a node as a microcontroller has it, with the portable Modbus RTU server
 * on a serial port: bytes one by one as its interrupt would bring them, the main loop once a
 * millisecond.
 *
 * The line is not eager, so it is silence that ends a request, as on a microcontroller. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "axt_clock.h"
#include "axt_modbus_rtu.h"
#include "axt_registers_node.h"
#include "node_rig.h"

enum { PERIOD_US = 100, BIT_RATE = 115200 };

static volatile sig_atomic_t stop;

static void on_signal(int number) {
    (void)number;
    stop = 1;
}

static uint32_t microseconds(void) {
    return (uint32_t)(axt_clock_now() / 1000);
}

static int open_device(const char *path) {
    const int device = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    struct termios raw;
    if (device < 0 || tcgetattr(device, &raw) != 0) {
        return -1;
    }
    cfmakeraw(&raw);
    return (tcsetattr(device, TCSANOW, &raw) == 0) ? device : -1;
}

static void receive(axt_modbus_rtu *rtu, int device) {
    uint8_t lump[256];
    const ssize_t got = read(device, lump, sizeof lump);
    for (ssize_t i = 0; i < got; i++) {
        axt_modbus_rtu_receive(rtu, lump[i], microseconds());
    }
}

static void run(rig *r, axt_modbus_rtu *rtu, int device) {
    const struct timespec pause = {.tv_nsec = 1000000};
    uint32_t done = microseconds();
    while (stop == 0) {
        uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX];
        for (; microseconds() - done >= PERIOD_US; done += PERIOD_US) {
            rig_run(r, 1);
        }
        rig_forget_sent(r);
        receive(rtu, device);
        const uint32_t length = axt_modbus_rtu_poll(rtu, microseconds(), answer);
        if (length > 0 && write(device, answer, length) < 0) {
            (void)fprintf(stderr, "modbus_rtu_node: %s\n", strerror(errno));
        }
        (void)nanosleep(&pause, NULL);
    }
}

int main(int argc, char **argv) {
    static axt_registers_node view;
    static axt_modbus_rtu rtu;
    const int device = (argc == 2) ? open_device(argv[1]) : -1;
    if (device < 0) {
        (void)fprintf(stderr, "modbus_rtu_node: cannot open the device\n");
        return 1;
    }
    (void)signal(SIGTERM, on_signal);
    rig *r = rig_running();
    const axt_registers_port port = axt_registers_node_port(&view, &r->node);
    axt_modbus_rtu_init(&rtu, &port, RIG_ID, BIT_RATE, false);
    (void)printf("modbus_rtu_node: unit %d\n", RIG_ID);
    (void)fflush(stdout);
    run(r, &rtu, device);
    free(r);
    (void)close(device);
    return 0;
}
