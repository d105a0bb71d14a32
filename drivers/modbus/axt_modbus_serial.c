/* Modbus RTU on a serial port of Linux. */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#include "axt_modbus_rtu.h"
#include "axt_modbus_server.h"

enum { FUNCTION = 1, LUMP = 256, SILENCE_MS = 50 /* how often silence is looked for */ };

/* libmodbus takes any other number for 9600. */
static bool is_bit_rate(uint32_t bit_rate) {
    static const uint32_t known[] = {1200,  2400,   4800,   9600,   19200, 38400,
                                     57600, 115200, 230400, 460800, 921600};
    for (uint32_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (known[i] == bit_rate) {
            return true;
        }
    }
    return false;
}

static void answer_frames(axt_modbus_server *server) {
    uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX];
    uint32_t length = axt_modbus_line_frame(&server->line, axt_modbus_server_microseconds(), frame);
    while (length > 0) {
        const bool broadcast = frame[0] == AXT_MODBUS_BROADCAST;
        const bool request = (frame[FUNCTION] & AXT_MODBUS_EXCEPTION_BIT) == 0;
        if (request && (broadcast || frame[0] == server->unit)) {
            /* an answer that finds no room is lost, as on a cable that is not there */
            (void)axt_modbus_server_answer(server, &server->client, frame, FUNCTION, length,
                                           !broadcast);
        }
        length = axt_modbus_line_frame(&server->line, axt_modbus_server_microseconds(), frame);
    }
}

/* True when something has come on the line, or the line has gone. */
static bool wait(const axt_modbus_server *server, int timeout) {
    struct pollfd events[] = {
        {.fd = server->stop, .events = POLLIN},
        {.fd = modbus_get_socket(server->modbus), .events = POLLIN},
    };
    (void)poll(events, server->open ? 2 : 1, server->open ? SILENCE_MS : timeout);
    return server->open && events[1].revents != 0;
}

/* Takes what has come. False when the device has gone: nothing came after all. */
static bool listen_to_line(axt_modbus_server *server) {
    uint8_t lump[LUMP];
    const ssize_t got = read(modbus_get_socket(server->modbus), lump, sizeof lump);
    const uint32_t now = axt_modbus_server_microseconds();
    for (ssize_t i = 0; i < got; i++) {
        axt_modbus_line_receive(&server->line, lump[i], now);
        answer_frames(server);
    }
    return got > 0 || (got < 0 && (errno == EAGAIN || errno == EINTR));
}

static void serve(axt_modbus_server *server, int timeout) {
    const bool heard = wait(server, timeout);
    axt_registers_expire(&server->client, axt_modbus_server_microseconds());
    if (!server->open) {
        server->open = modbus_connect(server->modbus) == 0;
    } else if (heard && !listen_to_line(server)) {
        modbus_close(server->modbus);
        server->open = false;
    }
    answer_frames(server); /* one that silence has ended */
}

static void hang_up(axt_modbus_server *server) {
    if (server->open) {
        modbus_close(server->modbus);
    }
}

axt_modbus_server_status axt_modbus_server_open_serial(axt_modbus_server *server,
                                                       const axt_history *history,
                                                       const char *device, uint32_t bit_rate,
                                                       char parity, uint8_t unit) {
    if (!is_bit_rate(bit_rate) || strchr("NEO", parity) == NULL) {
        return AXT_MODBUS_SERVER_ERROR_ADDRESS;
    }
    memset(server, 0, sizeof *server);
    axt_register_exchange_init(&server->exchange, history);
    axt_modbus_line_init(&server->line, bit_rate, true);
    server->unit = unit;
    server->serve = serve;
    server->hang_up = hang_up;
    /* without parity there is a second stop bit: every character has 11 bits */
    server->modbus = modbus_new_rtu(device, (int)bit_rate, parity, 8, (parity == 'N') ? 2 : 1);
    if (server->modbus == NULL) {
        return axt_modbus_server_status_of_errno();
    }
    if (modbus_connect(server->modbus) != 0) {
        const axt_modbus_server_status status = axt_modbus_server_status_of_errno();
        modbus_free(server->modbus);
        return status;
    }
    server->open = true;
    return AXT_MODBUS_SERVER_OK;
}
