#include "axt_modbus_server.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

enum { POLL_MS = 500 }; /* how often locks, half requests and lost devices are looked after */

const char *axt_modbus_server_status_string(axt_modbus_server_status status) {
    switch (status) {
    case AXT_MODBUS_SERVER_OK:
        return "no error";
    case AXT_MODBUS_SERVER_ERROR_ADDRESS:
        return "no such address or device, or a bit rate that it does not have";
    case AXT_MODBUS_SERVER_ERROR_IN_USE:
        return "somebody else uses it";
    case AXT_MODBUS_SERVER_ERROR_PERMISSION:
        return "permission denied";
    case AXT_MODBUS_SERVER_ERROR_SYSTEM:
        return "the system has no room for it";
    }
    return "unknown status";
}

axt_modbus_server_status axt_modbus_server_status_of_errno(void) {
    switch (errno) {
    case EADDRINUSE:
    case EBUSY:
        return AXT_MODBUS_SERVER_ERROR_IN_USE;
    case EACCES:
    case EPERM:
        return AXT_MODBUS_SERVER_ERROR_PERMISSION;
    case ENOMEM:
    case EMFILE:
    case ENFILE:
    case EAGAIN:
        return AXT_MODBUS_SERVER_ERROR_SYSTEM;
    default:
        return AXT_MODBUS_SERVER_ERROR_ADDRESS;
    }
}

static uint64_t now(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * UINT64_C(1000000) + (uint64_t)time.tv_nsec / 1000;
}

uint32_t axt_modbus_server_microseconds(void) {
    return (uint32_t)now();
}

uint32_t axt_modbus_server_milliseconds(void) {
    return (uint32_t)(now() / 1000);
}

bool axt_modbus_server_answer(axt_modbus_server *server, axt_registers_client *client,
                              const uint8_t *frame, uint32_t function, uint32_t length,
                              bool answered) {
    const axt_registers_port port = axt_register_exchange_port(&server->exchange);
    axt_modbus_request request;
    axt_modbus_exception exception =
        axt_modbus_parse(frame + function, length - function, &request);
    if (exception == AXT_MODBUS_OK) {
        exception = axt_registers_serve(&port, client, &request, axt_modbus_server_microseconds(),
                                        server->registers);
    }
    if (!answered) {
        return true;
    }
    if (exception != AXT_MODBUS_OK) {
        return modbus_reply_exception(server->modbus, frame, exception) > 0;
    }
    /* What libmodbus writes into these registers is what they hold already, or is overwritten by
     * the next snapshot. */
    modbus_mapping_t mapping = {
        .nb_registers = AXT_REGISTER_END,
        .tab_registers = server->registers,
        .nb_input_registers = AXT_REGISTER_END,
        .tab_input_registers = server->registers,
    };
    const uint32_t checksum = (uint32_t)modbus_get_header_length(server->modbus) == 1 ? 2 : 0;
    return modbus_reply(server->modbus, frame, (int)(length + checksum), &mapping) > 0;
}

static bool is_to_stop(const axt_modbus_server *server) {
    struct pollfd event = {.fd = server->stop, .events = POLLIN};
    return poll(&event, 1, 0) > 0;
}

static void *serve(void *context) {
    axt_modbus_server *server = context;
    while (!is_to_stop(server)) {
        server->serve(server, POLL_MS);
    }
    return NULL;
}

/* Signals are for the thread that runs the node, and so is its priority. */
static int start_thread(axt_modbus_server *server) {
    pthread_attr_t attributes;
    const struct sched_param ordinary = {.sched_priority = 0};
    sigset_t all;
    sigset_t before;
    (void)pthread_attr_init(&attributes);
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &ordinary);
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    const int failed = pthread_create(&server->thread, &attributes, serve, server);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    (void)pthread_attr_destroy(&attributes);
    return failed;
}

axt_modbus_server_status axt_modbus_server_start(axt_modbus_server *server) {
    server->stop = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (server->stop < 0) {
        return AXT_MODBUS_SERVER_ERROR_SYSTEM;
    }
    server->running = start_thread(server) == 0;
    if (!server->running) {
        (void)close(server->stop);
        return AXT_MODBUS_SERVER_ERROR_SYSTEM;
    }
    return AXT_MODBUS_SERVER_OK;
}

void axt_modbus_server_close(axt_modbus_server *server) {
    if (server->running) {
        (void)eventfd_write(server->stop, 1);
        (void)pthread_join(server->thread, NULL);
        (void)close(server->stop);
    }
    server->hang_up(server);
    modbus_free(server->modbus);
}
