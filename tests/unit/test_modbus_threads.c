/* The two places where registers pass between contexts, each side in a thread of its own: the
 * history that the tick writes over while others read it, and the exchange between the node's
 * thread and a server's. */
#include <pthread.h>
#include <time.h>

#include "axt_history.h"
#include "axt_register_exchange.h"
#include "check.h"

enum { READS = 20000, COMMANDS = 200, MOST = 19 };

static atomic_bool done;

static void nap(void) {
    const struct timespec moment = {.tv_nsec = 1000};
    (void)nanosleep(&moment, NULL);
}

/* Every word of a sample depends on its control period in all bits. */
static axt_history_sample sample_at(uint32_t n) {
    const uint32_t mixed = (n + 1) * UINT32_C(2654435761);
    return (axt_history_sample){.n = n,
                                .position = {(int32_t)mixed, (int32_t)~mixed},
                                .torque = (int16_t)(uint16_t)(mixed >> 3),
                                .status_word = (uint16_t)(mixed >> 7)};
}

static bool same(const axt_history_sample *a, const axt_history_sample *b) {
    return a->n == b->n && a->position[0] == b->position[0] && a->position[1] == b->position[1] &&
           a->torque == b->torque && a->status_word == b->status_word;
}

static void *tick(void *history) {
    for (uint32_t n = 0; !done; n++) {
        const axt_history_sample sample = sample_at(n);
        axt_history_take(history, &sample);
        if (n % 16 == 0) {
            nap();
        }
    }
    return NULL;
}

/* Samples that are not what they were, or not evenly spaced. */
static uint32_t torn(const axt_history_sample *samples, uint32_t count) {
    uint32_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        const axt_history_sample expected = sample_at(samples[i].n);
        found += same(&samples[i], &expected) ? 0 : 1;
        found += (i > 1 && samples[i].n - samples[i - 1].n != samples[1].n - samples[0].n) ? 1 : 0;
    }
    return found;
}

CASE(samples_of_the_history_are_whole_and_evenly_spaced) {
    static axt_history history;
    static axt_history_slot slots[32];
    static axt_history_sample samples[MOST];
    pthread_t thread;
    uint32_t wrong = 0;
    uint32_t found = 0;
    uint32_t next = 0;
    done = false;
    axt_history_init(&history, slots, 32, 1);
    CHECK_EQUAL(pthread_create(&thread, NULL, tick, &history), 0);
    while (axt_history_newest(&history, samples, MOST) < MOST) {
        nap();
    }
    for (uint32_t read = 0; read < READS; read++) {
        axt_history_set_decimation(&history, 1 + read / 1000 % 3);
        wrong += torn(samples, axt_history_newest(&history, samples, MOST));
        const uint32_t count = axt_history_from(&history, next, samples, MOST);
        wrong += torn(samples, count);
        if (count > 0) {
            wrong += (samples[0].n < next) ? 1 : 0;
            next = samples[count - 1].n + 1;
            found++;
        }
    }
    done = true;
    CHECK_EQUAL(pthread_join(thread, NULL), 0);
    CHECK_EQUAL(wrong, 0);
    CHECK(found > 0);
}

/* A node whose registers are all its number of snapshots, and whose commands add up. */
typedef struct {
    uint16_t shown;
    uint32_t sum;
    uint32_t heard;
    uint32_t busy; /* times that the next command is put off */
    axt_registers_port port;
    axt_register_exchange exchange;
} counting;

static void show(void *context, uint16_t registers[AXT_REGISTER_END]) {
    counting *c = context;
    c->shown++;
    for (uint32_t i = 0; i < AXT_REGISTER_END; i++) {
        registers[i] = c->shown;
    }
}

static void beat(void *context) {
    counting *c = context;
    c->heard++;
}

static axt_modbus_exception add(void *context, uint32_t code, uint32_t argument, uint16_t *result) {
    counting *c = context;
    if (c->busy > 0) {
        c->busy--;
        return AXT_MODBUS_BUSY;
    }
    c->sum += argument;
    c->busy = argument % 3;
    *result = (uint16_t)code;
    return AXT_MODBUS_OK;
}

static void *run_node(void *context) {
    counting *c = context;
    while (!done) {
        axt_register_exchange_run(&c->exchange, &c->port);
        nap();
    }
    return NULL;
}

CASE(snapshots_and_commands_pass_whole_between_threads) {
    static counting c;
    static uint16_t registers[AXT_REGISTER_END];
    pthread_t thread;
    uint32_t torn = 0;
    uint16_t last = 0;
    uint32_t sum = 0;
    c.port =
        (axt_registers_port){.context = &c, .snapshot = show, .hear_host = beat, .command = add};
    done = false;
    axt_register_exchange_init(&c.exchange, NULL);
    axt_register_exchange_run(&c.exchange, &c.port);
    const axt_registers_port server = axt_register_exchange_port(&c.exchange);
    CHECK_EQUAL(pthread_create(&thread, NULL, run_node, &c), 0);
    for (uint32_t read = 0; read < READS; read++) {
        server.snapshot(server.context, registers);
        for (uint32_t i = 0; i < AXT_REGISTER_END; i++) {
            torn += (registers[i] == registers[0]) ? 0 : 1;
        }
        torn += ((uint16_t)(registers[0] - last) > UINT16_MAX / 2) ? 1 : 0; /* back in time */
        last = registers[0];
    }
    for (uint32_t i = 0; i < COMMANDS; i++) {
        uint16_t result = 0;
        server.hear_host(server.context);
        CHECK_EQUAL(server.command(server.context, (uint16_t)i, i, &result), AXT_MODBUS_OK);
        CHECK_EQUAL(result, i);
        sum += i;
    }
    done = true;
    CHECK_EQUAL(pthread_join(thread, NULL), 0);
    CHECK_EQUAL(torn, 0);
    CHECK_EQUAL(c.sum, sum);
    CHECK(c.heard > 0 && c.heard <= COMMANDS);
}

CASE(a_command_that_nobody_comes_for_is_taken_back) {
    static counting c;
    c.port = (axt_registers_port){.context = &c, .snapshot = show, .command = add};
    axt_register_exchange_init(&c.exchange, NULL);
    const axt_registers_port server = axt_register_exchange_port(&c.exchange);
    uint16_t result = 0;
    CHECK_EQUAL(server.command(server.context, 1, 1, &result), AXT_MODBUS_BUSY);
    CHECK_EQUAL(result, AXT_REGISTERS_NOT_NOW);
    axt_register_exchange_run(&c.exchange, &c.port);
    CHECK_EQUAL(c.sum, 0);
}

int main(void) {
    RUN(samples_of_the_history_are_whole_and_evenly_spaced);
    RUN(snapshots_and_commands_pass_whole_between_threads);
    RUN(a_command_that_nobody_comes_for_is_taken_back);
    return REPORT();
}
