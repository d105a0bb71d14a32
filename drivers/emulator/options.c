#include "options.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "axt_encoder.h"
#include "axt_node.h"

static const char usage[] =
    "usage: axistwin-emulator [options]\n"
    "\n"
    "A servo axis with its drive, on a CAN bus. Decode it with axistwin.dbc.\n"
    "\n"
    "bus\n"
    "  --bus BUS             a CAN interface such as vcan0, or SLCAN: pty, pty:LINK (a symbolic\n"
    "                        link to make), tcp:[HOST:]PORT (default: pty)\n"
    "  --bit-rate BITS[,DATA]  frames take the time of a bus of BITS/s, DATA/s in the data phase\n"
    "                        of FD frames; 0: what the carrier takes (default: 1000000,5000000,\n"
    "                        but 0 with --simulated on pty and tcp)\n"
    "  --modbus WHERE        serve the registers of registers.csv, too; up to 4 times:\n"
    "                        tcp:[HOST:]PORT (default host: 127.0.0.1; port 0: any), or\n"
    "                        rtu:DEVICE[,BITS[,N|E|O]] (default: 19200,E)\n"
    "  --node ID             node id, 1 to 126 (default: 1)\n"
    "drive\n"
    "  --rate HZ             of the control loop (default: 20000), or\n"
    "  --period S            the time between two of its samples\n"
    "  --stream-rate HZ      of the live stream (default: 1000)\n"
    "  --counts MOTOR[,TABLE]  encoder counts a turn (default: 1048576)\n"
    "  --rated-torque NM     what 1000 per mille of torque means (default: 0.64)\n"
    "  --limits NM,RPM[,MIN,MAX]  torque, speed and travel of the motor, travel in turns; a host\n"
    "                        can set closer ones (default: what the wire can say, 6000, none)\n"
    "  --watchdog MS         longest time without a host's heartbeat while it has the drive\n"
    "                        enabled, 1 to 65535 (default: 400)\n"
    "  --trace-size N        samples that the trace can hold (default: 32768)\n"
    "  --surplus             the estimator looks for friction and springs to ground, too\n"
    "  --expected I1,I2,B,K  what the estimator expects, within a factor of 10\n"
    "                        (default: 5e-5,5e-6,1e-3,200)\n"
    "  --forgetting LAMBDA   of the estimator, 0.9 to 1 (default: 0.99995)\n"
    "axis\n"
    "  --axis I1,I2,B,K      kg m2, kg m2, N m s/rad, N m/rad (default: the paper's Table 1)\n"
    "  --effect EFFECT:LOCATION:PARAMETER=VALUE[,...]  what the axis does beyond Eq. 3, such as\n"
    "                        friction_coulomb:table:torque=0.01; any number of them.\n"
    "                        axistwin emulate --effects MODEL.TOML takes axis and effects from\n"
    "                        a model file\n"
    "excitation\n"
    "  --excitation LENGTH,LINES[,RMS[,SEED]]  samples a period, harmonics from 1 on, N m,\n"
    "                        0 for Schroeder's phases or the seed of random ones\n"
    "                        (default: 2048 samples, up to twice the resonance, 0.2 N m, 0)\n"
    "  --excite              operation enabled and excitation on from the start: no host is "
    "needed\n"
    "                        for that, and none watched until one takes over\n"
    "  --stream              live stream on from the start\n"
    "time\n"
    "  --simulated           as fast as it goes; the stream loses nothing: time waits for it\n"
    "  --duration S          end after this much axis time (default: go on until a signal)\n"
    "  --wake HZ             how often the process wakes up to run the control periods that are\n"
    "                        due (default: 1000). Waking up for every single period takes a\n"
    "                        tenth of a processor at 20 kHz, where 1000 a second take less than a\n"
    "                        hundredth; the axis cannot tell, for its time is counted in periods\n"
    "  --jitter FILE         write how late the wake-ups were: a histogram, lateness_us,wakes\n"
    "  --clock-error PPM     the drive's clock runs this much fast (default: 0)\n"
    "  --realtime-priority N run under SCHED_FIFO with this priority, memory locked\n"
    "\n"
    "  --help, --version\n";

enum {
    BUS = 256,
    BIT_RATE,
    MODBUS,
    NODE,
    RATE,
    PERIOD,
    STREAM_RATE,
    COUNTS,
    RATED_TORQUE,
    LIMITS,
    WATCHDOG,
    TRACE_SIZE,
    EXPECTED,
    SURPLUS,
    FORGETTING,
    AXIS,
    EFFECT,
    EXCITATION,
    EXCITE,
    STREAM,
    SIMULATED,
    DURATION,
    WAKE,
    JITTER,
    CLOCK_ERROR,
    REALTIME_PRIORITY,
    HELP,
    VERSION
};

static const struct option long_options[] = {
    {"bus", required_argument, NULL, BUS},
    {"bit-rate", required_argument, NULL, BIT_RATE},
    {"modbus", required_argument, NULL, MODBUS},
    {"node", required_argument, NULL, NODE},
    {"rate", required_argument, NULL, RATE},
    {"period", required_argument, NULL, PERIOD},
    {"stream-rate", required_argument, NULL, STREAM_RATE},
    {"counts", required_argument, NULL, COUNTS},
    {"rated-torque", required_argument, NULL, RATED_TORQUE},
    {"limits", required_argument, NULL, LIMITS},
    {"watchdog", required_argument, NULL, WATCHDOG},
    {"trace-size", required_argument, NULL, TRACE_SIZE},
    {"expected", required_argument, NULL, EXPECTED},
    {"surplus", no_argument, NULL, SURPLUS},
    {"forgetting", required_argument, NULL, FORGETTING},
    {"axis", required_argument, NULL, AXIS},
    {"effect", required_argument, NULL, EFFECT},
    {"excitation", required_argument, NULL, EXCITATION},
    {"excite", no_argument, NULL, EXCITE},
    {"stream", no_argument, NULL, STREAM},
    {"simulated", no_argument, NULL, SIMULATED},
    {"duration", required_argument, NULL, DURATION},
    {"wake", required_argument, NULL, WAKE},
    {"jitter", required_argument, NULL, JITTER},
    {"clock-error", required_argument, NULL, CLOCK_ERROR},
    {"realtime-priority", required_argument, NULL, REALTIME_PRIORITY},
    {"help", no_argument, NULL, HELP},
    {"version", no_argument, NULL, VERSION},
    {NULL, 0, NULL, 0},
};

enum { NUMBERS_MAX = 4, BIT_RATE_MAX = 1000000000 };

/* Numbers separated by commas. Returns how many, 0 when the text is anything else. */
static unsigned read_numbers(const char *text, double numbers[NUMBERS_MAX]) {
    for (unsigned count = 0; count < NUMBERS_MAX; count++) {
        char *end;
        numbers[count] = strtod(text, &end);
        if (end == text || !isfinite(numbers[count])) {
            return 0;
        }
        if (*end == '\0') {
            return count + 1;
        }
        if (*end != ',') {
            return 0;
        }
        text = end + 1;
    }
    return 0;
}

static bool complain(const char *option, const char *wanted) {
    (void)fprintf(stderr, "axistwin-emulator: --%s wants %s\n", option, wanted);
    return false;
}

/* One number within lowest .. highest. */
static bool read_number(const char *option, const char *text, double lowest, double highest,
                        double *number) {
    double numbers[NUMBERS_MAX];
    if (read_numbers(text, numbers) != 1 || numbers[0] < lowest || numbers[0] > highest) {
        char wanted[80];
        (void)snprintf(wanted, sizeof wanted, "a number from %g to %g", lowest, highest);
        return complain(option, wanted);
    }
    *number = numbers[0];
    return true;
}

/* A whole number from 0 to 2^32 - 1. */
static bool whole(double number) {
    return number >= 0 && number <= (double)UINT32_MAX && floor(number) == number;
}

static bool read_integer(const char *option, const char *text, uint32_t lowest, uint32_t highest,
                         uint32_t *integer) {
    double numbers[NUMBERS_MAX];
    if (read_numbers(text, numbers) != 1 || !whole(numbers[0]) || numbers[0] < lowest ||
        numbers[0] > highest) {
        char wanted[80];
        (void)snprintf(wanted, sizeof wanted, "a whole number from %u to %u", lowest, highest);
        return complain(option, wanted);
    }
    *integer = (uint32_t)numbers[0];
    return true;
}

static bool read_axis(const char *option, const char *text, axt_axis *axis) {
    double numbers[NUMBERS_MAX];
    if (read_numbers(text, numbers) != 4) {
        return complain(option, "four numbers I1,I2,B,K");
    }
    const axt_axis found = {.I1 = (axt_real)numbers[0],
                            .I2 = (axt_real)numbers[1],
                            .B = (axt_real)numbers[2],
                            .K = (axt_real)numbers[3]};
    if (axt_axis_check(&found) != AXT_OK) {
        return complain(option, "I1 and I2 from 1e-9 to 1e6, B from 0 to 1e9, K from 1e-6 to 1e12");
    }
    *axis = found;
    return true;
}

static bool read_counts(const char *option, const char *text, uint32_t counts[2]) {
    double numbers[NUMBERS_MAX];
    const unsigned count = read_numbers(text, numbers);
    bool fine = count == 1 || count == 2;
    for (unsigned i = 0; fine && i < count; i++) {
        fine = whole(numbers[i]) && numbers[i] >= 1 && numbers[i] <= AXT_ENCODER_COUNTS_MAX;
    }
    if (!fine) {
        return complain(option, "one or two whole numbers from 1 to 16777216");
    }
    counts[0] = (uint32_t)numbers[0];
    counts[1] = (uint32_t)numbers[count - 1];
    return true;
}

static bool read_bit_rates(const char *option, const char *text, axt_can_bit_rates *rates) {
    double numbers[NUMBERS_MAX];
    const unsigned count = read_numbers(text, numbers);
    const bool data_given = count == 2;
    if ((count != 1 && !data_given) || !whole(numbers[0]) || numbers[0] > BIT_RATE_MAX ||
        (data_given && (!whole(numbers[1]) || numbers[1] < 1 || numbers[1] > BIT_RATE_MAX))) {
        return complain(option, "one or two whole numbers up to 1000000000, the second 1 or more");
    }
    rates->nominal = (uint32_t)numbers[0];
    rates->data = data_given ? (uint32_t)numbers[1] : rates->data;
    return true;
}

/* What depends on other options, and is worked out when all are known. */
typedef struct {
    double stream_rate; /* [Hz] */
    double wake_rate;   /* [Hz] */
    double torque;      /* limits: [N m], */
    double speed;       /* [1/min], */
    double travel[2];   /* [turns] */
} derived_options;

static bool read_limits(const char *option, const char *text, derived_options *derived) {
    double n[NUMBERS_MAX];
    const unsigned count = read_numbers(text, n);
    if ((count != 2 && count != 4) || n[0] < 0 || n[1] < 1 || n[1] > 1e6 ||
        (count == 4 && n[2] > n[3])) {
        return complain(option, "NM,RPM[,MIN,MAX]: a torque of 0 or more, a speed from 1 to 1e6, "
                                "and two positions in turns");
    }
    derived->torque = n[0];
    derived->speed = n[1];
    if (count == 4) {
        derived->travel[0] = n[2];
        derived->travel[1] = n[3];
    }
    return true;
}

static bool read_excitation(const char *option, const char *text, axt_schroeder *excitation) {
    double numbers[NUMBERS_MAX];
    const unsigned count = read_numbers(text, numbers);
    if (count < 2 || !whole(numbers[0]) || !whole(numbers[1]) ||
        (count > 3 && !whole(numbers[3]))) {
        return complain(option, "LENGTH,LINES[,RMS[,SEED]]");
    }
    excitation->length = (uint32_t)numbers[0];
    excitation->lines = (uint32_t)numbers[1];
    if (count > 2) {
        excitation->rms = (axt_real)numbers[2];
    }
    if (count > 3) {
        excitation->seed = (uint32_t)numbers[3];
    }
    if (excitation->length > AXT_EMULATOR_TABLE_SIZE || axt_schroeder_check(excitation) != AXT_OK) {
        return complain(option, "a length from 4 to 32768, lines from 1 to below half of that and "
                                "an rms of 0 or more");
    }
    return true;
}

static bool read_one(int option, axt_emulator_options *options, derived_options *derived) {
    const char *text = optarg;
    double number = 0;
    uint32_t integer = 0;
    bool fine = true;
    switch (option) {
    case BUS:
        options->bus = text;
        fine =
            text[0] != '\0' || complain("bus", "a CAN interface, pty, pty:LINK or tcp:[HOST:]PORT");
        break;
    case BIT_RATE:
        fine = read_bit_rates("bit-rate", text, &options->bit_rates);
        break;
    case MODBUS:
        fine = options->modbus_count < AXT_EMULATOR_MODBUS_MAX ||
               complain("modbus", "to be given at most 4 times");
        if (fine) {
            options->modbus[options->modbus_count] = text;
            options->modbus_count++;
        }
        break;
    case NODE:
        fine = read_integer("node", text, 1, AXT_NODE_ID_MAX, &integer);
        options->node = (uint8_t)integer;
        break;
    case RATE:
        fine = read_number("rate", text, 1, 1e6, &number);
        options->period = 1.0 / number;
        break;
    case PERIOD:
        fine = read_number("period", text, 1e-6, 1, &options->period);
        break;
    case STREAM_RATE:
        fine = read_number("stream-rate", text, 1e-3, 1e6, &derived->stream_rate);
        break;
    case COUNTS:
        fine = read_counts("counts", text, options->counts_per_turn);
        break;
    case RATED_TORQUE:
        fine = read_number("rated-torque", text, 1e-3, 1e6, &number);
        options->rated_torque = (uint32_t)lround(number * 1e3);
        break;
    case LIMITS:
        fine = read_limits("limits", text, derived);
        break;
    case WATCHDOG:
        fine = read_integer("watchdog", text, 1, UINT16_MAX, &integer);
        options->host_timeout = (uint16_t)integer;
        break;
    case TRACE_SIZE:
        fine = read_integer("trace-size", text, 1, AXT_NODE_TRACE_MAX, &options->trace_size);
        break;
    case EXPECTED:
        fine = read_axis("expected", text, &options->expected);
        break;
    case SURPLUS:
        options->form = AXT_IDENT_5X4;
        break;
    case FORGETTING:
        fine = read_number("forgetting", text, 0.9, 1, &number);
        options->forgetting = (axt_real)number;
        break;
    case AXIS:
        fine = read_axis("axis", text, &options->axis);
        break;
    case EFFECT:
        fine = axt_emulator_add_effect(text, &options->effects);
        break;
    case EXCITATION:
        fine = read_excitation("excitation", text, &options->excitation);
        break;
    case EXCITE:
        options->excited = true;
        break;
    case STREAM:
        options->streaming = true;
        break;
    case SIMULATED:
        options->simulated = true;
        break;
    case DURATION:
        fine = read_number("duration", text, 1e-6, 1e9, &options->duration);
        break;
    case WAKE:
        fine = read_number("wake", text, 1, 1e6, &derived->wake_rate);
        break;
    case JITTER:
        options->jitter = text;
        break;
    case CLOCK_ERROR:
        fine = read_number("clock-error", text, -1e5, 1e5, &number);
        options->clock_rate = 1.0 + number * 1e-6;
        break;
    case REALTIME_PRIORITY:
        fine = read_integer("realtime-priority", text, 1, 99, &integer);
        options->realtime_priority = (int)integer;
        break;
    default: /* getopt has said what is wrong */
        fine = false;
        break;
    }
    return fine;
}

/* As many harmonics as reach twice the axis' natural frequency: the paper's 2 k of k. */
static uint32_t lines_for(const axt_emulator_options *options) {
    axt_modal modal;
    if (axt_axis_modal(&options->axis, &modal) != AXT_OK) {
        return 1;
    }
    const double k = (double)modal.wn * options->period * (double)options->excitation.length /
                     (2.0 * 3.14159265358979323846);
    const double most = (double)options->excitation.length / 2.0 - 1.0;
    const double lines = fmin(round(2.0 * k), most);
    return (lines >= 1.0) ? (uint32_t)lines : 1;
}

/* Counts of the motor encoder at a position, as far as 32 bits go. */
static int32_t counts_at(const axt_emulator_options *options, double turns) {
    const double counts = round(turns * (double)options->counts_per_turn[AXT_ENCODER_MOTOR]);
    return (int32_t)fmin(fmax(counts, (double)INT32_MIN), (double)INT32_MAX);
}

static axt_limits limits_of(const axt_emulator_options *options, const derived_options *derived) {
    const double per_mille = derived->torque * 1e6 / (double)options->rated_torque;
    return (axt_limits){
        .torque = (uint16_t)fmin(round(10.0 * per_mille), (double)INT16_MAX),
        .speed = (uint32_t)derived->speed,
        .travel_min = counts_at(options, derived->travel[0]),
        .travel_max = counts_at(options, derived->travel[1]),
    };
}

static void derive(axt_emulator_options *options, const derived_options *derived) {
    const double decimation = round(1.0 / (options->period * derived->stream_rate));
    options->stream_decimation = (decimation >= 1.0) ? (uint32_t)decimation : 1;
    options->wake = fmax(1.0 / derived->wake_rate, options->period);
    options->limits = limits_of(options, derived);
    if (options->excitation.lines == 0) {
        options->excitation.lines = lines_for(options);
    }
    const bool slcan =
        strncmp(options->bus, "pty", 3) == 0 || strncmp(options->bus, "tcp:", 4) == 0;
    if (options->bit_rates.nominal == UINT32_MAX) {
        options->bit_rates.nominal = (options->simulated && slcan) ? 0 : 1000000;
    }
}

axt_emulator_todo axt_emulator_read_options(int argc, char **argv, axt_emulator_options *options) {
    derived_options derived = {.stream_rate = 1000,
                               .wake_rate = 1000,
                               .torque = HUGE_VAL,
                               .speed = 6000,
                               .travel = {-HUGE_VAL, HUGE_VAL}};
    *options = (axt_emulator_options){
        .bus = "pty",
        .bit_rates = {.nominal = UINT32_MAX /* not given */, .data = 5000000},
        .node = 1,
        .period = 1.0 / 20000,
        .axis = axt_axis_paper,
        .expected = {.I1 = (axt_real)5e-5, .I2 = (axt_real)5e-6, .B = (axt_real)1e-3, .K = 200},
        .clock_rate = 1.0,
        .forgetting = (axt_real)(1.0 - 1.0 / 20000),
        .counts_per_turn = {1048576, 1048576},
        .rated_torque = 640,
        .host_timeout = 400,
        .excitation = {.length = 2048, .first = 1, .stride = 1, .rms = (axt_real)0.2},
        .trace_size = AXT_NODE_TRACE_MAX,
    };
    for (;;) {
        const int option = getopt_long(argc, argv, "", long_options, NULL);
        if (option == -1) {
            break;
        }
        if (option == HELP) {
            (void)fputs(usage, stdout);
            return AXT_EMULATOR_EXIT;
        }
        if (option == VERSION) {
            (void)printf("axistwin-emulator %u.%u.%u\n", (unsigned)(AXT_NODE_FIRMWARE >> 16),
                         (unsigned)(AXT_NODE_FIRMWARE >> 8 & 0xFF),
                         (unsigned)(AXT_NODE_FIRMWARE & 0xFF));
            return AXT_EMULATOR_EXIT;
        }
        if (!read_one(option, options, &derived)) {
            return AXT_EMULATOR_MISUSE;
        }
    }
    if (optind < argc) {
        (void)fprintf(stderr, "axistwin-emulator: '%s' is not an option; --help lists them\n",
                      argv[optind]);
        return AXT_EMULATOR_MISUSE;
    }
    derive(options, &derived);
    return AXT_EMULATOR_RUN;
}
