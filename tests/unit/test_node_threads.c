/* Tick and background at the same time, each in a thread of its own: what one hands over, the other
 * must find whole. The axis is a formula here, so that every sample can be checked by itself. */
#include <pthread.h>
#include <time.h>

#include "axt_contract.h"
#include "axt_crc32.h"
#include "axt_node.h"
#include "check.h"

enum {
    ID = 1,
    TRACE = 500,
    RING = 64,
    TABLE = 256,
    UPLOADS = 10,       /* ends the test */
    CALLS_MAX = 1000000 /* so does this, without success */
};

static atomic_bool done;

/* Positions that depend on the control period in every bit. */
static int32_t position_at(uint32_t n, uint32_t encoder) {
    const uint32_t mixed = (n + 1) * UINT32_C(2654435761);
    return (int32_t)((encoder == 0) ? mixed : ~mixed);
}

typedef struct {
    axt_can can;
    uint32_t n;        /* control periods of the axis */
    uint32_t samples;  /* streamed, as received */
    uint32_t lost;     /* by the counter */
    uint32_t torn;     /* frames that are no sample of this axis */
    uint32_t answers;  /* received */
    uint32_t faults;   /* emergencies with an error */
    uint32_t calls;    /* of the bus, for something to receive */
    uint32_t commands; /* sent */
    uint32_t captures; /* asked for */
    uint32_t uploads;  /* received to the end */
    uint32_t checksum; /* of the trace being received */
    uint32_t expected_checksum;
    uint32_t trace_start; /* control period of the trace's first sample */
    bool has_counter;
    uint16_t counter;
    axt_node_trace_state trace_state;
} bench;

static void apply_torque(void *axis, axt_real torque) {
    (void)axis;
    (void)torque;
}

static void read_encoders(void *axis, int32_t position[2]) {
    bench *b = axis;
    position[0] = position_at(b->n, 0);
    position[1] = position_at(b->n, 1);
    b->n++;
}

static void hear_sample(bench *b, uint16_t counter, int32_t position) {
    b->torn += (((uint32_t)position * UINT32_C(244002641) - 1 - counter) & 0xFFFF) != 0
                   ? 1
                   : 0; /* 244002641 x 2654435761 is 1 modulo 2^32 */
    if (b->has_counter) {
        b->lost += (uint16_t)(counter - b->counter - 1);
    }
    b->has_counter = true;
    b->counter = counter;
    b->samples++;
}

static void hear_motor(bench *b, const axt_can_frame *frame) {
    struct axt_contract_motor_t motor;
    (void)axt_contract_motor_unpack(&motor, frame->data, frame->length);
    hear_sample(b, motor.counter, motor.position);
}

static void hear_samples(bench *b, const axt_can_frame *frame) {
    struct axt_contract_samples_t samples;
    (void)axt_contract_samples_unpack(&samples, frame->data, frame->length);
    const int32_t position[] = {samples.motor_position0, samples.motor_position1,
                                samples.motor_position2, samples.motor_position3,
                                samples.motor_position4, samples.motor_position5};
    for (uint32_t i = 0; i < sizeof position / sizeof position[0]; i++) {
        hear_sample(b, (uint16_t)(samples.counter + i), position[i]);
    }
}

static void hear_trace(bench *b, const axt_can_frame *frame) {
    struct axt_contract_trace_t trace = {0};
    (void)axt_contract_trace_unpack(&trace, frame->data, frame->length);
    if (trace.index == 0 && trace.channel == 0) {
        b->checksum = 0;
        b->trace_start = (uint32_t)trace.motor_position * UINT32_C(244002641) - 1;
    }
    b->checksum = axt_crc32(b->checksum, frame->data, frame->length);
    const int32_t position = (trace.channel == 0) ? trace.motor_position : trace.table_position;
    b->torn += (position != position_at(b->trace_start + trace.index, trace.channel)) ? 1 : 0;
    if (trace.index == TRACE - 1 && trace.channel == 1) {
        b->uploads++;
        b->torn += (b->checksum == b->expected_checksum) ? 0 : 1;
    }
}

static void hear_report(bench *b, const axt_can_frame *frame) {
    struct axt_contract_report_t report = {0};
    (void)axt_contract_report_unpack(&report, frame->data, frame->length);
    switch (report.page) {
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CAPTURED_CHOICE:
        b->trace_state = (axt_node_trace_state)report.flags;
        break;
    case AXT_CONTRACT_REPORT_PAGE_TRACE_CHECKSUM_CHOICE:
        b->expected_checksum = report.trace_checksum;
        break;
    case AXT_CONTRACT_REPORT_PAGE_ANSWER_CHOICE:
        b->answers++;
        break;
    default:
        break;
    }
}

static axt_can_status hear(axt_can *can, const axt_can_frame *frame) {
    bench *b = (bench *)can;
    switch (frame->id - ID) {
    case AXT_CONTRACT_MOTOR_FRAME_ID:
        hear_motor(b, frame);
        break;
    case AXT_CONTRACT_SAMPLES_FRAME_ID:
        hear_samples(b, frame);
        break;
    case AXT_CONTRACT_EMERGENCY_FRAME_ID:
        b->faults += (frame->data[1] != 0) ? 1 : 0;
        break;
    case AXT_CONTRACT_TRACE_FRAME_ID:
        hear_trace(b, frame);
        break;
    case AXT_CONTRACT_REPORT_FRAME_ID:
        hear_report(b, frame);
        break;
    default:
        break;
    }
    return AXT_CAN_OK;
}

/* The host's heartbeat, and control words that enable operation, or reset the fault that the random
 * positions of this axis soon bring. */
static bool say_control(bench *b, axt_can_frame *frame) {
    static const uint8_t words[] = {
        AXT_CONTRACT_CONTROL_CONTROL_WORD_DISABLE_VOLTAGE_CHOICE,
        AXT_CONTRACT_CONTROL_CONTROL_WORD_FAULT_RESET_CHOICE,
        AXT_CONTRACT_CONTROL_CONTROL_WORD_SHUTDOWN_CHOICE,
        AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE,
    };
    b->calls++;
    if (b->calls % 8 == 0) {
        *frame = (axt_can_frame){
            .id = AXT_CONTRACT_HEARTBEAT_FRAME_ID + AXT_CONTRACT_HOST_ID, .length = 1, .data = {5}};
    } else if (b->calls % 8 == 4) {
        *frame = (axt_can_frame){.id = AXT_CONTRACT_CONTROL_FRAME_ID + ID,
                                 .length = 4,
                                 .data = {words[b->calls / 8 % sizeof words]}};
    }
    return b->calls % 4 == 0;
}

/* Captures and uploads one trace after the other, and changes excitation and stream in between. */
static axt_can_status say(axt_can *can, axt_can_frame *frame) {
    static const uint8_t codes[] = {
        AXT_CONTRACT_COMMAND_CODE_EXCITATION_ON_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_ESTIMATOR_RESET_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_EXCITATION_SEED_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_DRIFT_WATCH_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_STREAM_START_FD_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_STREAM_START_CHOICE,
        AXT_CONTRACT_COMMAND_CODE_EXCITATION_OFF_CHOICE,
    };
    bench *b = (bench *)can;
    if (say_control(b, frame)) {
        return AXT_CAN_OK;
    }
    if (b->commands > b->answers) {
        return AXT_CAN_WOULD_BLOCK;
    }
    *frame = (axt_can_frame){.id = AXT_CONTRACT_COMMAND_FRAME_ID + ID, .length = 8};
    const bool still =
        b->trace_state == AXT_NODE_TRACE_IDLE || b->trace_state == AXT_NODE_TRACE_READY;
    if (still && b->captures == b->uploads) {
        frame->data[0] = AXT_CONTRACT_COMMAND_CODE_TRACE_ARM_CHOICE;
        frame->data[4] = TRACE & 0xFF;
        frame->data[5] = TRACE >> 8;
        b->trace_state = AXT_NODE_TRACE_CAPTURING;
        b->captures++;
    } else if (still) {
        frame->data[0] = AXT_CONTRACT_COMMAND_CODE_TRACE_UPLOAD_CHOICE;
        b->trace_state = AXT_NODE_TRACE_UPLOADING;
    } else {
        frame->data[0] = codes[b->commands % sizeof codes];
        const bool seed = frame->data[0] == AXT_CONTRACT_COMMAND_CODE_EXCITATION_SEED_CHOICE;
        frame->data[4] = seed ? (uint8_t)b->commands : 0;
    }
    b->commands++;
    return AXT_CAN_OK;
}

static void hang_up(axt_can *can) {
    (void)can;
}

/* Gives the other thread its turn where there is one core only. */
static void nap(void) {
    const struct timespec moment = {.tv_nsec = 1000};
    (void)nanosleep(&moment, NULL);
}

static void *control(void *argument) {
    axt_node *node = argument;
    while (!done) {
        for (uint32_t i = 0; i < RING / 2; i++) {
            axt_node_tick(node);
        }
        nap();
    }
    return NULL;
}

CASE(samples_traces_and_orders_pass_whole_between_threads) {
    static axt_node node;
    static axt_real table[TABLE];
    static axt_node_sample trace[TRACE];
    static axt_node_stream_sample ring[RING];
    bench b = {.can = {.fd = true, .send = hear, .receive = say, .close = hang_up}};
    const axt_node_config config = {
        .id = ID,
        .control_period = (axt_real)1e-4,
        .stream_decimation = 1,
        .rated_torque = 640,
        .counts_per_turn = {1048576, 1048576},
        .expected = axt_axis_paper,
        .forgetting = 1,
        /* positions all over the place are outside now and then, but not always */
        .limits = {.torque = 32767,
                   .speed = 76000000,
                   .travel_min = -2130000000,
                   .travel_max = 2130000000},
        .host_timeout = 400,
        .excitation = {.length = TABLE, .first = 1, .stride = 1, .lines = 4, .rms = 1},
        .streaming = true,
        .table = table,
        .table_size = TABLE,
        .trace = trace,
        .trace_size = TRACE,
        .ring = ring,
        .ring_size = RING,
    };
    const axt_node_port port = {
        .can = &b.can, .axis = &b, .apply_torque = apply_torque, .read_encoders = read_encoders};
    CHECK_EQUAL(axt_node_init(&node, &config, &port), AXT_OK);

    pthread_t thread;
    CHECK_EQUAL(pthread_create(&thread, NULL, control, &node), 0);
    for (uint32_t calls = 0; b.uploads < UPLOADS && calls < CALLS_MAX; calls++) {
        (void)axt_node_background(&node);
        nap();
    }
    done = true;
    CHECK_EQUAL(pthread_join(thread, NULL), 0);
    for (uint32_t calls = 0; calls < RING; calls++) { /* what is still in the ring */
        (void)axt_node_background(&node);
    }
    CHECK_EQUAL(b.uploads, UPLOADS);
    CHECK_EQUAL(b.torn, 0);
    CHECK_EQUAL(b.samples + node.lost + node.grouped, b.n);
    CHECK(b.faults > 0 && b.faults <= node.faults);
    CHECK(b.lost <= node.lost); /* the counter shows all but those after the last sample heard */
    CHECK(b.answers > 2 * UPLOADS && b.commands - b.answers <= 1);
}

int main(void) {
    RUN(samples_traces_and_orders_pass_whole_between_threads);
    return REPORT();
}
