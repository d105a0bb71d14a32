#include "axt_register_exchange.h"

#include <string.h>
#include <time.h>

enum { FRESH = 4, INDEX = 3 };             /* bits of `middle` */
enum { IDLE, GIVEN, TAKEN, DONE };         /* states of the command */
enum { NAP_NS = 100000, NAPS_MAX = 1000 }; /* the server waits 100 ms for a command */

void axt_register_exchange_init(axt_register_exchange *exchange, const axt_history *history) {
    exchange->history = history;
    memset(exchange->image, 0, sizeof exchange->image);
    exchange->back = 0;
    exchange->front = 1;
    atomic_init(&exchange->middle, 2);
    atomic_init(&exchange->heard, false);
    atomic_init(&exchange->state, IDLE);
}

static void show(axt_register_exchange *exchange, const axt_registers_port *node) {
    node->snapshot(node->context, exchange->image[exchange->back]);
    const unsigned offered = exchange->back | FRESH;
    exchange->back =
        atomic_exchange_explicit(&exchange->middle, offered, memory_order_acq_rel) & INDEX;
}

static bool take_command(axt_register_exchange *exchange) {
    int state = GIVEN;
    return atomic_compare_exchange_strong_explicit(&exchange->state, &state, TAKEN,
                                                   memory_order_acquire, memory_order_relaxed);
}

void axt_register_exchange_run(axt_register_exchange *exchange, const axt_registers_port *node) {
    if (atomic_exchange_explicit(&exchange->heard, false, memory_order_relaxed)) {
        node->hear_host(node->context);
    }
    const bool asked = take_command(exchange);
    if (asked) {
        exchange->exception =
            node->command(node->context, exchange->code, exchange->argument, &exchange->result);
    }
    show(exchange, node);
    if (asked) { /* only now: who hears that it is done finds it in the snapshot */
        const int state = (exchange->exception == AXT_MODBUS_BUSY) ? GIVEN : DONE;
        atomic_store_explicit(&exchange->state, state, memory_order_release);
    }
}

static void snapshot(void *context, uint16_t registers[AXT_REGISTER_END]) {
    axt_register_exchange *exchange = context;
    if ((atomic_load_explicit(&exchange->middle, memory_order_relaxed) & FRESH) != 0) {
        exchange->front =
            atomic_exchange_explicit(&exchange->middle, exchange->front, memory_order_acq_rel) &
            INDEX;
    }
    memcpy(registers, exchange->image[exchange->front], sizeof exchange->image[0]);
}

static void hear_host(void *context) {
    axt_register_exchange *exchange = context;
    atomic_store_explicit(&exchange->heard, true, memory_order_relaxed);
}

static void nap(void) {
    const struct timespec moment = {.tv_nsec = NAP_NS};
    (void)nanosleep(&moment, NULL);
}

static bool is_done(const axt_register_exchange *exchange) {
    return atomic_load_explicit(&exchange->state, memory_order_acquire) == DONE;
}

/* Takes the command back, unless the node's side is at it: that takes no time worth speaking of. */
static bool take_back(axt_register_exchange *exchange) {
    int state = GIVEN;
    return atomic_compare_exchange_strong_explicit(&exchange->state, &state, IDLE,
                                                   memory_order_acquire, memory_order_relaxed);
}

static axt_modbus_exception command(void *context, uint32_t code, uint32_t argument,
                                    uint16_t *result) {
    axt_register_exchange *exchange = context;
    exchange->code = code;
    exchange->argument = argument;
    atomic_store_explicit(&exchange->state, GIVEN, memory_order_release);
    for (unsigned naps = 0; !is_done(exchange); naps++) {
        if (naps >= NAPS_MAX && take_back(exchange)) {
            *result = AXT_REGISTERS_NOT_NOW;
            return AXT_MODBUS_BUSY;
        }
        nap();
    }
    *result = exchange->result;
    const axt_modbus_exception exception = exchange->exception;
    atomic_store_explicit(&exchange->state, IDLE, memory_order_relaxed);
    return exception;
}

axt_registers_port axt_register_exchange_port(axt_register_exchange *exchange) {
    return (axt_registers_port){.history = exchange->history,
                                .context = exchange,
                                .snapshot = snapshot,
                                .hear_host = hear_host,
                                .command = command};
}
