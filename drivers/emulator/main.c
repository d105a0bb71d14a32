/* axistwin-emulator: an axis and its drive as one Linux process.
 *
 * The drive is the same portable node as in the firmware; its port is the emulated axis and a CAN
 * carrier. Exit status: 0 fine, 2 usage, 3 bus or system.
 */
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include "axt_emulated_axis.h"
#include "axt_node.h"
#include "bus.h"
#include "loop.h"
#include "modbus_servers.h"
#include "options.h"

enum { EXIT_FINE = 0, EXIT_USAGE = 2, EXIT_BUS = 3 };

enum { RING_SIZE = 4096 }; /* 4 s of live stream at 1 kHz while the host is busy */

static volatile sig_atomic_t stop;

static void on_signal(int number) {
    (void)number;
    stop = 1;
}

static void catch_signals(void) {
    struct sigaction action = {.sa_handler = on_signal};
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    action.sa_handler = SIG_IGN; /* a reader of our output that has gone is no reason to die */
    (void)sigaction(SIGPIPE, &action, NULL);
}

static bool become_realtime(int priority) {
    const struct sched_param parameters = {.sched_priority = priority};
    if (sched_setscheduler(0, SCHED_FIFO, &parameters) == 0 &&
        mlockall(MCL_CURRENT | MCL_FUTURE) == 0) {
        return true;
    }
    (void)fprintf(stderr, "axistwin-emulator: --realtime-priority %d: %s\n", priority,
                  strerror(errno));
    return false;
}

static axt_status start_node(const axt_emulator_options *options, axt_emulated_axis *axis,
                             axt_can *can, axt_node *node) {
    static axt_real table[AXT_EMULATOR_TABLE_SIZE];
    static axt_node_sample trace[AXT_NODE_TRACE_MAX];
    static axt_node_stream_sample ring[RING_SIZE];
    static axt_history_slot history[RING_SIZE];
    const axt_node_config config = {
        .id = options->node,
        .control_period = (axt_real)options->period,
        .stream_decimation = options->stream_decimation,
        .rated_torque = options->rated_torque,
        .counts_per_turn = {options->counts_per_turn[0], options->counts_per_turn[1]},
        .form = options->form,
        .expected = options->expected,
        .forgetting = options->forgetting,
        .limits = options->limits,
        .host_timeout = options->host_timeout,
        .excitation = options->excitation,
        .excited = options->excited,
        .streaming = options->streaming,
        .table = table,
        .table_size = AXT_EMULATOR_TABLE_SIZE,
        .trace = trace,
        .trace_size = options->trace_size,
        .ring = ring,
        .ring_size = RING_SIZE,
        .history = history,
        .history_size = RING_SIZE,
    };
    const axt_node_port port = {
        .can = can,
        .axis = axis,
        .apply_torque = axt_emulated_axis_apply_torque,
        .read_encoders = axt_emulated_axis_read_encoders,
        .axis_command = axt_emulated_axis_command,
        .restart_axis = axt_emulated_axis_restart,
    };
    axt_status status =
        axt_emulated_axis_init(axis, &options->axis, config.control_period, config.counts_per_turn);
    if (status == AXT_OK) {
        status = axt_emulated_axis_set_effects(axis, &options->effects.effects);
    }
    return (status == AXT_OK) ? axt_node_init(node, &config, &port) : status;
}

/* False when the file cannot be written. */
static bool write_jitter(const char *path, const axt_emulator_lateness *lateness) {
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        return false;
    }
    (void)fprintf(file, "lateness_us,wakes\n");
    for (unsigned i = 0; i <= AXT_EMULATOR_LATENESS_MAX; i++) {
        if (lateness->wakes[i] > 0) {
            (void)fprintf(file, "%u,%llu\n", i, (unsigned long long)lateness->wakes[i]);
        }
    }
    return fclose(file) == 0;
}

static int run(const axt_emulator_options *options, axt_node *node, axt_emulator_bus *bus,
               axt_emulator_modbus *modbus) {
    static axt_emulator_lateness lateness;
    const axt_emulator_loop loop = {
        .node = node,
        .bus = bus,
        .modbus = modbus,
        .period = options->period,
        .wake = options->wake,
        .clock_rate = options->clock_rate,
        .duration = options->duration,
        .stop = &stop,
        .lateness = (options->jitter != NULL) ? &lateness : NULL,
    };
    (void)printf("axistwin-emulator: node %u on %s, %.6g Hz, stream %.6g Hz, %s%s\n",
                 (unsigned)options->node, bus->name, 1.0 / options->period,
                 1.0 / (options->period * options->stream_decimation),
                 options->simulated ? "simulated time" : "real time", modbus->name);
    (void)fflush(stdout);

    if (options->simulated) {
        axt_emulator_run_simulated(&loop);
    } else {
        axt_emulator_run_in_real_time(&loop);
    }
    axt_node_stop(node);
    const axt_can_health *health = &bus->can->health;
    (void)printf("axistwin-emulator: ended after %.6g s: %llu samples, %lu overruns, %lu lost, %lu "
                 "rejected; bus: %lu error frames, %lu times bus off, %lu outages, %lu overflows\n",
                 (double)node->n * options->period, (unsigned long long)node->n,
                 (unsigned long)node->overruns, (unsigned long)node->lost,
                 (unsigned long)node->rejected, (unsigned long)health->error_frames,
                 (unsigned long)health->bus_off, (unsigned long)health->outages,
                 (unsigned long)health->overflows);
    if (options->jitter != NULL && !write_jitter(options->jitter, &lateness)) {
        (void)fprintf(stderr, "axistwin-emulator: cannot write %s: %s\n", options->jitter,
                      strerror(errno));
        return EXIT_BUS;
    }
    return EXIT_FINE;
}

int main(int argc, char **argv) {
    static axt_emulator_bus bus;
    static axt_emulator_modbus modbus;
    static axt_emulated_axis axis;
    static axt_node node;
    axt_emulator_options options;
    const axt_emulator_todo todo = axt_emulator_read_options(argc, argv, &options);
    if (todo != AXT_EMULATOR_RUN) {
        return (todo == AXT_EMULATOR_EXIT) ? EXIT_FINE : EXIT_USAGE;
    }
    catch_signals();
    (void)prctl(PR_SET_TIMERSLACK, 1UL); /* [ns]; by default timers may be 50 us late */
    if (options.realtime_priority > 0 && !become_realtime(options.realtime_priority)) {
        return EXIT_BUS;
    }
    const axt_can_status opened =
        axt_emulator_bus_open(&bus, options.bus, options.node, &options.bit_rates);
    if (opened != AXT_CAN_OK) {
        (void)fprintf(stderr, "axistwin-emulator: bus %s: %s\n", options.bus,
                      axt_can_status_string(opened));
        return EXIT_BUS;
    }
    const axt_status status = start_node(&options, &axis, bus.can, &node);
    int result = EXIT_USAGE;
    if (status == AXT_OK) {
        result = EXIT_BUS;
        if (axt_emulator_modbus_open(&modbus, &options, &node)) {
            result = run(&options, &node, &bus, &modbus);
            axt_emulator_modbus_close(&modbus);
        }
    } else {
        (void)fprintf(
            stderr,
            "axistwin-emulator: axis, effects, period and encoders do not go together: %s\n",
            axt_status_string(status));
    }
    bus.can->close(bus.can);
    return result;
}
