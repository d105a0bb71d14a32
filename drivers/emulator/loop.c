#include "loop.h"

#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <time.h>

#include "axt_clock.h"

#define NANO UINT64_C(1000000000)

enum { SIMULATED_BATCH = 64, NO_ROOM_NANOSECONDS = 100000 };

/* Control periods that begin by `time` [s]; the first begins at 0. */
static uint64_t begun_by(const axt_emulator_loop *loop, double time) {
    return (time >= 0) ? (uint64_t)(time / loop->period) + 1 : 0;
}

static uint64_t total_periods(const axt_emulator_loop *loop) {
    return (loop->duration > 0) ? (uint64_t)llround(loop->duration / loop->period) : UINT64_MAX;
}

static uint64_t smaller(uint64_t a, uint64_t b) {
    return (a < b) ? a : b;
}

static void sleep_until(uint64_t moment) {
    const struct timespec then = {.tv_sec = (time_t)(moment / NANO),
                                  .tv_nsec = (long)(moment % NANO)};
    (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &then, NULL); /* a signal may end it */
}

/* What one call of the background leaves to the next. */
typedef struct {
    uint64_t time; /* of the call [ns] */
    const char *complaint;
} conversation;

static conversation begin_conversation(void) {
    return (conversation){.time = axt_clock_now()};
}

/* What is wrong with the bus; NULL when it works. */
static const char *complaint(const axt_can *can, axt_can_status status) {
    if (status != AXT_CAN_OK && status != AXT_CAN_WOULD_BLOCK && status != AXT_CAN_CLOSED) {
        return axt_can_status_string(status);
    }
    const bool working = can->health.state < AXT_CAN_STATE_BUS_OFF;
    return working ? NULL : axt_can_state_string(can->health.state);
}

/* The background, after telling the bus how much time has passed since the last call. Says when the
 * bus fails and when it is back; the control loop goes on either way. */
static void talk(const axt_emulator_loop *loop, conversation *last) {
    axt_emulator_bus *bus = loop->bus;
    const uint64_t now = axt_clock_now();
    if (bus->paced) {
        axt_can_pace_elapse(&bus->pace, now - last->time);
    }
    last->time = now;
    const char *wrong = complaint(bus->can, axt_node_background(loop->node));
    axt_emulator_modbus_run(loop->modbus);
    if (wrong != last->complaint) {
        (void)fprintf(stderr, "axistwin-emulator: bus %s: %s\n", bus->name,
                      (wrong != NULL) ? wrong : "works again");
        last->complaint = wrong;
    }
}

static void wait_until(const axt_emulator_loop *loop, uint64_t moment) {
    sleep_until(moment);
    const uint64_t now = axt_clock_now();
    if (loop->lateness != NULL && now >= moment) { /* else: a signal has ended the sleep */
        const uint64_t late = smaller((now - moment) / 1000, AXT_EMULATOR_LATENESS_MAX);
        loop->lateness->wakes[late]++;
    }
}

void axt_emulator_run_in_real_time(const axt_emulator_loop *loop) {
    const uint64_t total = total_periods(loop);
    const uint64_t batch = (uint64_t)ceil(loop->wake / loop->period) + 1;
    const uint64_t start = axt_clock_now();
    conversation last = begin_conversation();
    uint64_t done = 0;
    while (done < total && *loop->stop == 0) {
        const double elapsed = (double)(axt_clock_now() - start) * 1e-9 * loop->clock_rate;
        const double wakes = floor(elapsed / loop->wake);
        const uint64_t due = smaller(begun_by(loop, elapsed), total);
        const uint64_t late = begun_by(loop, (wakes - 1) * loop->wake);
        /* in batches, so that the bus is served while a delay is made up for */
        const uint64_t until = smaller(due, done + batch);
        if (late > done) {
            axt_node_overrun(loop->node, (uint32_t)(smaller(late, until) - done));
        }
        while (done < until) {
            axt_node_tick(loop->node);
            done++;
        }
        talk(loop, &last);
        if (done == due) {
            wait_until(loop, start + (uint64_t)((wakes + 1) * loop->wake / loop->clock_rate * 1e9));
        }
    }
}

void axt_emulator_run_simulated(const axt_emulator_loop *loop) {
    const uint64_t total = total_periods(loop);
    conversation last = begin_conversation();
    uint64_t done = 0;
    while (done < total && *loop->stop == 0) {
        const uint64_t until = smaller(done + SIMULATED_BATCH, total);
        while (done < until && axt_node_has_room(loop->node)) {
            axt_node_tick(loop->node);
            done++;
        }
        talk(loop, &last);
        if (!axt_node_has_room(loop->node)) {
            sleep_until(axt_clock_now() + NO_ROOM_NANOSECONDS);
        }
    }
}
