/* Requests, registers and the serial line, against a node that runs. Frames are written out by hand
 * from the standard's own figures (application protocol V1.1b3, serial line V1.02). */
#include "axt_modbus_rtu.h"
#include "axt_registers_node.h"
#include "check.h"
#include "node_rig.h"

enum { NOW = 1000000, SILENCE = 2000 }; /* [us] */

enum { ARGUMENT = AXT_REGISTER_ARGUMENT & 0xFF, KEY = AXT_REGISTER_WRITE_KEY & 0xFF };
_Static_assert(AXT_REGISTER_WRITABLE_FIRST >> 8 == 1, "requests below have 1 for the high byte");

typedef struct {
    rig *r;
    axt_registers_node view;
    axt_registers_port port;
    axt_registers_client client;
    axt_modbus_rtu rtu;
    uint32_t now;
    uint16_t registers[AXT_REGISTER_END];
    uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX];
    uint32_t length;
} bench;

static bench *bench_new(void) {
    static bench b;
    b = (bench){.r = rig_running(), .now = NOW};
    b.port = axt_registers_node_port(&b.view, &b.r->node);
    axt_modbus_rtu_init(&b.rtu, &b.port, RIG_ID, 115200, false);
    return &b;
}

static void bench_end(bench *b) {
    free(b->r);
}

/* A PDU, as if over TCP. */
static axt_modbus_exception ask(bench *b, const uint8_t *pdu, uint32_t length) {
    axt_modbus_request request;
    axt_modbus_exception exception = axt_modbus_parse(pdu, length, &request);
    if (exception == AXT_MODBUS_OK) {
        exception = axt_registers_serve(&b->port, &b->client, &request, b->now, b->registers);
    }
    b->length = axt_modbus_answer(&request, exception, b->registers, b->answer);
    return exception;
}

#define ASK(b, ...)                                                                                \
    ask(b, (const uint8_t[]){__VA_ARGS__}, (uint32_t)sizeof((const uint8_t[]){__VA_ARGS__}))

static axt_modbus_exception write_one(bench *b, uint16_t address, uint16_t value) {
    return ASK(b, 6, (uint8_t)(address >> 8), (uint8_t)address, (uint8_t)(value >> 8),
               (uint8_t)value);
}

static uint32_t read_uint32(bench *b, uint16_t address) {
    CHECK_EQUAL(ASK(b, 3, (uint8_t)(address >> 8), (uint8_t)address, 0, 2), AXT_MODBUS_OK);
    CHECK_EQUAL(b->length, 6);
    return (uint32_t)b->answer[2] << 24 | (uint32_t)b->answer[3] << 16 |
           (uint32_t)b->answer[4] << 8 | b->answer[5];
}

static uint16_t read_uint16(bench *b, uint16_t address) {
    CHECK_EQUAL(ASK(b, 4, (uint8_t)(address >> 8), (uint8_t)address, 0, 1), AXT_MODBUS_OK);
    return (uint16_t)(b->answer[2] << 8 | b->answer[3]);
}

static void unlock(bench *b) {
    CHECK_EQUAL(write_one(b, AXT_REGISTER_WRITE_KEY, 0x4158), AXT_MODBUS_OK);
    CHECK_EQUAL(write_one(b, AXT_REGISTER_WRITE_KEY, 0x5457), AXT_MODBUS_OK);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_WRITE_ENABLED), 1);
}

/* Argument and code in one request of function 16. */
static axt_modbus_exception command(bench *b, uint16_t code, uint32_t argument) {
    rig_run(b->r, 2); /* whatever was ordered before has been taken */
    return ASK(b, 16, 1, ARGUMENT, 0, 3, 6, (uint8_t)(argument >> 24), (uint8_t)(argument >> 16),
               (uint8_t)(argument >> 8), (uint8_t)argument, (uint8_t)(code >> 8), (uint8_t)code);
}

CASE(the_identity_is_that_of_the_node_the_more_significant_register_first) {
    bench *b = bench_new();
    CHECK_EQUAL(read_uint32(b, 0), 0x41585457);
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_TEST_FLOAT), 0x40490FDB);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_NODE_ID), RIG_ID);
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_RATED_TORQUE), rig_rated);
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_CONTROL_PERIOD), bits_of((float)rig_period));
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_MOTOR_RESOLUTION), 1048576);
    bench_end(b);
}

CASE(only_what_is_listed_can_be_read) {
    bench *b = bench_new();
    /* the last register of a block is there, the one after it is not */
    for (uint32_t i = 0; i < AXT_REGISTER_BLOCKS; i++) {
        const axt_register_block block = axt_register_blocks[i];
        const uint32_t end = (uint32_t)block.first + block.count;
        CHECK_EQUAL(
            ASK(b, 3, (uint8_t)(block.first >> 8), (uint8_t)block.first, 0, (uint8_t)block.count),
            AXT_MODBUS_OK);
        CHECK_EQUAL(b->length, 2 + 2 * block.count);
        CHECK_EQUAL(ASK(b, 3, (uint8_t)(end >> 8), (uint8_t)end, 0, 1), AXT_MODBUS_ILLEGAL_ADDRESS);
        CHECK_EQUAL(ASK(b, 3, (uint8_t)((end - 1) >> 8), (uint8_t)(end - 1), 0, 2),
                    AXT_MODBUS_ILLEGAL_ADDRESS);
    }
    CHECK_EQUAL(ASK(b, 3, 0xFF, 0xFF, 0, 125), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK_EQUAL(b->length, 2);
    CHECK_EQUAL(b->answer[0], 0x83);
    CHECK_EQUAL(b->answer[1], 2);
    bench_end(b);
}

CASE(counts_and_lengths_that_cannot_be_are_refused) {
    bench *b = bench_new();
    unlock(b);
    const axt_modbus_exception value = AXT_MODBUS_ILLEGAL_VALUE;
    CHECK_EQUAL(ASK(b, 3, 0, 0, 0, 0), value);
    CHECK_EQUAL(ASK(b, 3, 0, 0, 0, 126), value);
    CHECK_EQUAL(ASK(b, 3, 0, 0, 0xFF, 0xFF), value);
    CHECK_EQUAL(ASK(b, 3, 0, 0, 0), value);
    CHECK_EQUAL(ASK(b, 3), value);
    CHECK_EQUAL(ASK(b, 3, 0, 0, 0, 1, 0), value);
    CHECK_EQUAL(ASK(b, 6, 1, KEY, 0), value);
    CHECK_EQUAL(ASK(b, 6, 1, KEY, 0, 0, 0), value);
    CHECK_EQUAL(ASK(b, 16, 1, ARGUMENT, 0, 0, 0), value);
    CHECK_EQUAL(ASK(b, 16, 1, ARGUMENT, 0, 1, 4, 0, 0), value);    /* byte count of two registers */
    CHECK_EQUAL(ASK(b, 16, 1, ARGUMENT, 0, 2, 4, 0, 0), value);    /* values of one */
    CHECK_EQUAL(ASK(b, 16, 1, ARGUMENT, 0, 1, 2, 0, 0, 0), value); /* a byte too many */
    CHECK_EQUAL(ASK(b, 16, 1, ARGUMENT, 1, 1, 2, 0, 0),
                value); /* 257 registers: 2 x 257 is 2 mod 256 */
    CHECK_EQUAL(ASK(b, 23, 0, 0, 0, 1, 1, ARGUMENT, 0, 1, 2, 0), value);
    CHECK_EQUAL(ASK(b, 23, 0, 0, 0, 126, 1, ARGUMENT, 0, 1, 2, 0, 0), value);
    for (uint32_t function = 0; function < 128; function++) {
        const bool known =
            function == 3 || function == 4 || function == 6 || function == 16 || function == 23;
        CHECK_EQUAL(ASK(b, (uint8_t)function, 0, 0, 0, 1),
                    (!known)                           ? AXT_MODBUS_ILLEGAL_FUNCTION
                    : (function == 3 || function == 4) ? AXT_MODBUS_OK
                    : (function == 6)                  ? AXT_MODBUS_ILLEGAL_ADDRESS
                                                       : value);
    }
    bench_end(b);
}

CASE(an_answer_shows_one_moment) {
    bench *b = bench_new();
    rig_enable(b->r);
    CHECK_EQUAL(rig_tell(b->r, AXT_CONTRACT_COMMAND_CODE_EXCITATION_ON_CHOICE, 0), 0);
    rig_run(b->r, 1234);
    CHECK_EQUAL(ASK(b, 3, 0, AXT_REGISTER_SEQUENCE, 0, 52), AXT_MODBUS_OK);
    CHECK_EQUAL(b->registers[AXT_REGISTER_SEQUENCE], b->registers[AXT_REGISTER_SEQUENCE_END]);
    /* the axis kept a log of what it saw at every control period */
    const uint32_t n = (uint32_t)b->registers[AXT_REGISTER_SAMPLE_COUNTER] << 16 |
                       b->registers[AXT_REGISTER_SAMPLE_COUNTER + 1];
    const uint32_t motor = (uint32_t)b->registers[AXT_REGISTER_MOTOR_POSITION] << 16 |
                           b->registers[AXT_REGISTER_MOTOR_POSITION + 1];
    CHECK_EQUAL(n % 10, 0); /* the decimation of the stream, until told otherwise */
    CHECK(b->r->log_count - n <= 10);
    CHECK_EQUAL((int32_t)motor, b->r->log[n].position[0]);
    CHECK_NEAR((int16_t)b->registers[AXT_REGISTER_TORQUE] * 0.64e-4, (double)b->r->log[n].torque,
               1e-7);
    const double turn = 2.0 * 3.14159265358979 / 1048576;
    const double speed =
        (b->r->log[n].position[0] - b->r->log[n - 10].position[0]) * turn / (10 * rig_period);
    float shown;
    const uint32_t bits = (uint32_t)b->registers[AXT_REGISTER_MOTOR_SPEED] << 16 |
                          b->registers[AXT_REGISTER_MOTOR_SPEED + 1];
    memcpy(&shown, &bits, sizeof shown);
    CHECK(fabs(speed) > 0);
    CHECK_NEAR((double)shown, speed, 1e-5 * fabs(speed));
    bench_end(b);
}

static uint32_t uint32_in(const uint16_t *registers, uint32_t address) {
    return (uint32_t)registers[address] << 16 | registers[address + 1];
}

static float float_in(const uint16_t *registers, uint32_t address) {
    const uint32_t bits = uint32_in(registers, address);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void read_state(bench *b) {
    CHECK_EQUAL(ASK(b, 3, 0, AXT_REGISTER_SEQUENCE, 0,
                    AXT_REGISTER_SEQUENCE_END + 1 - AXT_REGISTER_SEQUENCE),
                AXT_MODBUS_OK);
}

/* A node that looks for friction, on an axis that has it, so much at the motor [N m s/rad]. */
static bench *bench_with_friction(double viscous) {
    bench *b = bench_new();
    const axt_effects effects = {
        .friction = {{.viscous = (axt_real)viscous}},
        .load_change = {.ratio = (axt_real)0.02, .time = (axt_real)9},
    };
    b->r->config.form = AXT_IDENT_5X4;
    CHECK_EQUAL(rig_start(b->r), AXT_OK);
    CHECK_EQUAL(axt_emulated_axis_set_effects(&b->r->axis, &effects), AXT_OK);
    rig_enable(b->r);
    CHECK_EQUAL(rig_tell(b->r, AXT_CONTRACT_COMMAND_CODE_EXCITATION_ON_CHOICE, 0), 0);
    return b;
}

CASE(friction_and_spring_are_shown_as_on_can) {
    bench *b = bench_with_friction(1e-3);
    read_state(b);
    CHECK_EQUAL(b->registers[AXT_REGISTER_ESTIMATE_VALID], 0);
    rig_run(b->r, 30100);
    read_state(b);
    const uint16_t *r = b->registers;
    CHECK_EQUAL(r[AXT_REGISTER_ESTIMATE_VALID], 0x1F);
    CHECK_NEAR((double)float_in(r, AXT_REGISTER_ESTIMATE_FRICTION), 1e-3, 1e-4);
    CHECK(fabsf(float_in(r, AXT_REGISTER_ESTIMATE_SPRING)) <
          5 * float_in(r, AXT_REGISTER_ERROR_SPRING));
    CHECK_EQUAL(r[AXT_REGISTER_ESTIMATE_SEQUENCE], rig_report(b->r, 46).sequence);
    CHECK_EQUAL(uint32_in(r, AXT_REGISTER_ESTIMATE_FRICTION),
                bits_of(rig_report(b->r, 46).estimate_friction));
    CHECK_EQUAL(uint32_in(r, AXT_REGISTER_ERROR_FRICTION),
                bits_of(rig_report(b->r, 47).error_friction));
    CHECK_EQUAL(uint32_in(r, AXT_REGISTER_ESTIMATE_SPRING),
                bits_of(rig_report(b->r, 48).estimate_spring));
    CHECK_EQUAL(uint32_in(r, AXT_REGISTER_ERROR_SPRING),
                bits_of(rig_report(b->r, 49).error_spring));
    bench_end(b);
}

CASE(refused_samples_are_counted_by_their_reason) {
    bench *b = bench_with_friction(0);
    rig_run(b->r, 5000);
    for (uint32_t i = 0; i < 7; i++) {
        b->r->glitch = 500000;
        rig_run(b->r, 500);
    }
    rig_run(b->r, 3000);
    read_state(b);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_REJECTED_SAMPLES), 7);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_JUMPED_SAMPLES), 7);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_SAMPLE_GAPS), 7);
    /* each where it belongs */
    b->r->node.ident_counters = (axt_ident_counters){
        .not_finite = 0x10001, .range = 2, .repeated = 3, .jumped = 4, .gaps = 5};
    read_state(b);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_NOT_FINITE_SAMPLES), 0x10001);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_OUT_OF_RANGE_SAMPLES), 2);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_REPEATED_SAMPLES), 3);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_JUMPED_SAMPLES), 4);
    CHECK_EQUAL(uint32_in(b->registers, AXT_REGISTER_SAMPLE_GAPS), 5);
    bench_end(b);
}

static void check_drift(bench *b, axt_monitor_state state, uint16_t alarms) {
    read_state(b);
    const uint16_t drift = b->registers[AXT_REGISTER_DRIFT];
    CHECK_EQUAL(drift & 0xFF, state);
    CHECK_EQUAL(drift >> 8 != 0, state == AXT_MONITOR_ALARM);
    CHECK_EQUAL(drift >> 8, rig_report(b->r, 50).drift);
    CHECK_EQUAL(b->registers[AXT_REGISTER_DRIFT_ALARMS], alarms);
}

/* The load grows by 2 % after 9 s; what is normal is known after 7. */
CASE(the_drift_alarm_is_started_and_read) {
    bench *b = bench_with_friction(0);
    const uint16_t watch = AXT_CONTRACT_COMMAND_CODE_DRIFT_WATCH_CHOICE;
    CHECK_EQUAL(command(b, watch, 1), AXT_MODBUS_ILLEGAL_ADDRESS);
    unlock(b);
    CHECK_EQUAL(command(b, watch, 1), AXT_MODBUS_REFUSED); /* nothing is known yet */
    CHECK_EQUAL(command(b, watch, 2), AXT_MODBUS_ILLEGAL_VALUE);
    rig_run(b->r, 15000);
    check_drift(b, AXT_MONITOR_OFF, 0);
    CHECK_EQUAL(command(b, watch, 1), AXT_MODBUS_OK);
    rig_run(b->r, 10000);
    check_drift(b, AXT_MONITOR_LEARNING, 0);
    rig_run(b->r, 60000);
    check_drift(b, AXT_MONITOR_WATCHING, 0);
    rig_run(b->r, 30000);
    check_drift(b, AXT_MONITOR_ALARM, 1);
    CHECK_EQUAL(command(b, watch, 0), AXT_MODBUS_OK);
    rig_run(b->r, 3000);
    check_drift(b, AXT_MONITOR_OFF, 1);
    bench_end(b);
}

/* Are these the samples that the axis has logged, `decimation` apart? */
static void check_history(const bench *b, uint32_t count, uint32_t decimation) {
    const uint16_t *r = b->registers;
    CHECK_EQUAL(r[AXT_REGISTER_HISTORY_COUNT], count);
    CHECK_EQUAL(uint32_in(r, AXT_REGISTER_HISTORY_DECIMATION), decimation);
    const uint32_t first = uint32_in(r, AXT_REGISTER_HISTORY_COUNTER);
    for (uint32_t i = 0; i < count; i++) {
        const rig_period_log *was = &b->r->log[first + decimation * i];
        CHECK_EQUAL((int32_t)uint32_in(r, AXT_REGISTER_HISTORY_MOTOR_POSITION + 2 * i),
                    was->position[0]);
        CHECK_EQUAL((int32_t)uint32_in(r, AXT_REGISTER_HISTORY_TABLE_POSITION + 2 * i),
                    was->position[1]);
        CHECK_NEAR((int16_t)r[AXT_REGISTER_HISTORY_TORQUE + i] * 0.64e-4, (double)was->torque,
                   1e-7);
    }
}

/* Writes HistoryFrom and reads the block, with one request: control period of the first sample. */
static uint32_t read_history(bench *b, uint32_t from) {
    CHECK_EQUAL(ASK(b, 23, 0, AXT_REGISTER_HISTORY_COUNT, 0, 119, 1, 0, 0, 2, 4,
                    (uint8_t)(from >> 24), (uint8_t)(from >> 16), (uint8_t)(from >> 8),
                    (uint8_t)from),
                AXT_MODBUS_OK);
    return uint32_in(b->registers, AXT_REGISTER_HISTORY_COUNTER);
}

CASE(the_history_has_every_sample_for_whoever_reads_it_in_time) {
    bench *b = bench_new();
    unlock(b);
    rig_enable(b->r);
    CHECK_EQUAL(rig_tell(b->r, AXT_CONTRACT_COMMAND_CODE_EXCITATION_ON_CHOICE, 0), 0);
    CHECK_EQUAL(command(b, AXT_REGISTERS_HISTORY_COMMAND, 3), AXT_MODBUS_OK);
    rig_run(b->r, 3 * RIG_HISTORY);
    uint32_t first = read_history(b, 0); /* the newest */
    check_history(b, 19, 3);
    CHECK(b->r->log_count - (first + 3 * 18) <= 3);
    for (uint32_t read = 0; read < 100; read++) { /* now more come, now fewer, than are read */
        rig_run(b->r, (read % 10 < 5) ? 3 * 25 : 3 * 13);
        const uint32_t next = read_history(b, first + 3 * 19);
        CHECK_EQUAL(next, first + 3 * 19);
        check_history(b, 19, 3);
        first = next;
    }
    /* not there yet, and not there any more: the counter says so */
    (void)read_history(b, first + 3 * 100);
    check_history(b, 0, 3);
    rig_run(b->r, 3 * 2 * RIG_HISTORY);
    const uint32_t newest = read_history(b, 0) + 3 * 18;
    CHECK_EQUAL(read_history(b, first), newest - 3 * (RIG_HISTORY - 2));
    check_history(b, 19, 3);
    bench_end(b);
}

CASE(the_history_goes_on_at_another_distance) {
    bench *b = bench_new();
    unlock(b);
    rig_run(b->r, 10 * 30);
    CHECK_EQUAL(command(b, AXT_REGISTERS_HISTORY_COMMAND, 4), AXT_MODBUS_OK);
    rig_run(b->r, 4 * 5);
    (void)read_history(b, 0);
    check_history(b, b->registers[AXT_REGISTER_HISTORY_COUNT], 4);
    CHECK(b->registers[AXT_REGISTER_HISTORY_COUNT] >= 5);
    const uint32_t first = read_history(b, 10 * 25); /* from before the change: up to it */
    CHECK_EQUAL(first, 10 * 25);
    check_history(b, b->registers[AXT_REGISTER_HISTORY_COUNT], 10);
    CHECK_EQUAL(command(b, AXT_REGISTERS_HISTORY_COMMAND, 0), AXT_MODBUS_ILLEGAL_VALUE);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_RESULT), AXT_NODE_OUT_OF_RANGE);
    /* half of HistoryFrom, or more than it: nothing */
    CHECK_EQUAL(write_one(b, AXT_REGISTER_HISTORY_FROM, 1), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK_EQUAL(ASK(b, 16, 1, 0, 0, 3, 6, 0, 0, 0, 0, 0, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    bench_end(b);
}

CASE(a_node_that_keeps_no_history_shows_none) {
    bench *b = bench_new();
    free(b->r);
    b->r = rig_new();
    b->r->config.history_size = 0;
    CHECK_EQUAL(rig_start(b->r), AXT_OK);
    b->port = axt_registers_node_port(&b->view, &b->r->node);
    rig_run(b->r, 100);
    (void)read_history(b, 0);
    check_history(b, 0, 10);
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_SAMPLE_COUNTER), 0);
    bench_end(b);
}

CASE(nothing_is_commanded_before_both_keys_or_after_ten_seconds) {
    bench *b = bench_new();
    const uint16_t on = AXT_CONTRACT_COMMAND_CODE_STREAM_START_CHOICE;
    const uint16_t key = AXT_REGISTER_WRITE_KEY;
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK_EQUAL(write_one(b, key, 0x5457), AXT_MODBUS_OK); /* the second one first */
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK_EQUAL(write_one(b, key, 0x4158), AXT_MODBUS_OK);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_WRITE_ENABLED), 0); /* something in between */
    CHECK_EQUAL(write_one(b, key, 0x5457), AXT_MODBUS_OK);
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    /* both at once, key and command at once: neither */
    CHECK_EQUAL(ASK(b, 16, 1, KEY, 0, 2, 4, 0x41, 0x58, 0x54, 0x57), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK(!b->r->node.streaming);
    unlock(b);
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_OK);
    CHECK(b->r->node.streaming);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_RESULT), 0);
    b->now += AXT_REGISTERS_ENABLED_US;
    CHECK_EQUAL(command(b, AXT_CONTRACT_COMMAND_CODE_STREAM_STOP_CHOICE, 0), AXT_MODBUS_OK);
    b->now += AXT_REGISTERS_ENABLED_US + 1;
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    CHECK(!b->r->node.streaming);
    unlock(b);
    CHECK_EQUAL(write_one(b, key, 0), AXT_MODBUS_OK); /* given back */
    CHECK_EQUAL(command(b, on, 0), AXT_MODBUS_ILLEGAL_ADDRESS);
    bench_end(b);
}

CASE(a_command_that_is_refused_says_why) {
    bench *b = bench_new();
    unlock(b);
    CHECK_EQUAL(command(b, 200, 0), AXT_MODBUS_ILLEGAL_VALUE);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_RESULT), AXT_NODE_UNKNOWN_COMMAND);
    CHECK_EQUAL(command(b, 0x101, 0), AXT_MODBUS_ILLEGAL_VALUE); /* not Identify */
    CHECK_EQUAL(command(b, AXT_CONTRACT_COMMAND_CODE_TRACE_UPLOAD_CHOICE, 0), AXT_MODBUS_REFUSED);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_RESULT), AXT_NODE_NOT_NOW);
    CHECK_EQUAL(command(b, AXT_CONTRACT_COMMAND_CODE_EXCITATION_RMS_CHOICE, bits_of(0.25f)),
                AXT_MODBUS_OK);
    CHECK_NEAR(b->r->node.excitation.rms, 0.25, 0);
    CHECK_EQUAL(command(b, AXT_CONTRACT_COMMAND_CODE_EXCITATION_RMS_CHOICE, bits_of(NAN)),
                AXT_MODBUS_ILLEGAL_VALUE);
    CHECK_NEAR(b->r->node.excitation.rms, 0.25, 0);
    /* while the tick has yet to take an order */
    CHECK_EQUAL(command(b, AXT_CONTRACT_COMMAND_CODE_STREAM_START_CHOICE, 0), AXT_MODBUS_OK);
    CHECK_EQUAL(write_one(b, AXT_REGISTER_CODE, AXT_CONTRACT_COMMAND_CODE_STREAM_STOP_CHOICE),
                AXT_MODBUS_BUSY);
    CHECK(b->r->node.streaming);
    bench_end(b);
}

CASE(function_23_writes_first_and_reads_what_came_of_it) {
    bench *b = bench_new();
    unlock(b);
    rig_run(b->r, 2);
    /* argument 7, code ExcitationSeed; back come these, no control, result and enabled */
    CHECK_EQUAL(ASK(b, 23, 1, ARGUMENT, 0, 7, 1, ARGUMENT, 0, 3, 6, 0, 0, 0, 7, 0,
                    AXT_CONTRACT_COMMAND_CODE_EXCITATION_SEED_CHOICE),
                AXT_MODBUS_OK);
    const uint8_t expected[] = {
        23, 14, 0, 0, 0, 7, 0, AXT_CONTRACT_COMMAND_CODE_EXCITATION_SEED_CHOICE,
        0,  0,  0, 0, 0, 0, 0, 1};
    CHECK_EQUAL(b->length, sizeof expected);
    CHECK(memcmp(b->answer, expected, sizeof expected) == 0);
    CHECK_EQUAL(b->r->node.excitation.seed, 7);
    bench_end(b);
}

/* A control word and a set-point in one request of function 16. */
static void control(bench *b, uint16_t word, int16_t torque) {
    const uint16_t raw = (uint16_t)torque;
    CHECK_EQUAL(ASK(b, 16, 1, AXT_REGISTER_CONTROL_WORD & 0xFF, 0, 2, 4, (uint8_t)(word >> 8),
                    (uint8_t)word, (uint8_t)(raw >> 8), (uint8_t)raw),
                AXT_MODBUS_OK);
    rig_run(b->r, 3);
}

CASE(a_client_with_the_keys_has_the_drive_under_its_control_while_it_is_heard) {
    bench *b = bench_new();
    b->r->config.stream_decimation = 1;
    unlock(b);
    control(b, AXT_CONTRACT_CONTROL_CONTROL_WORD_SHUTDOWN_CHOICE, 0);
    control(b, AXT_CONTRACT_CONTROL_CONTROL_WORD_SWITCH_ON_CHOICE, 0);
    control(b, AXT_CONTRACT_CONTROL_CONTROL_WORD_ENABLE_OPERATION_CHOICE, 50);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_STATUS_WORD) & AXT_CIA402_STATE_MASK,
                AXT_CIA402_OPERATION_ENABLED);
    CHECK_EQUAL(b->r->node.target_torque, 50);
    /* one register alone goes with the other as last written */
    CHECK_EQUAL(write_one(b, AXT_REGISTER_TARGET_TORQUE, (uint16_t)-70), AXT_MODBUS_OK);
    rig_run(b->r, 20);
    CHECK_EQUAL(b->r->node.target_torque, -70);
    CHECK_EQUAL((int16_t)read_uint16(b, AXT_REGISTER_TORQUE), -70);
    /* reading is being heard; silence is not: 400 ms of 0.1 ms periods */
    for (uint32_t i = 0; i < 10; i++) {
        rig_run(b->r, 3900);
        (void)read_uint16(b, AXT_REGISTER_STATUS_WORD);
        CHECK_EQUAL(b->r->node.target_torque, -70);
    }
    rig_run(b->r, 4100);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_STATUS_WORD) & AXT_CIA402_STATE_MASK, AXT_CIA402_FAULT);
    CHECK_EQUAL(read_uint16(b, AXT_REGISTER_ERROR_CODE),
                AXT_CONTRACT_EMERGENCY_ERROR_CODE_HOST_HEARTBEAT_LOST_CHOICE);
    CHECK_EQUAL(read_uint32(b, AXT_REGISTER_FAULTS), 1);
    CHECK_NEAR(b->r->log[b->r->log_count - 1].torque, 0, 0);
    bench_end(b);
}

CASE(a_client_without_the_keys_is_no_host) {
    bench *b = bench_new();
    rig_enable(b->r);
    b->r->host = false; /* that host dies; somebody goes on reading */
    for (uint32_t i = 0; i < 10; i++) {
        rig_run(b->r, 500);
        (void)read_uint16(b, AXT_REGISTER_STATUS_WORD);
    }
    CHECK_EQUAL(rig_state(b->r), AXT_CIA402_FAULT);
    CHECK_EQUAL(ASK(b, 16, 1, AXT_REGISTER_CONTROL_WORD & 0xFF, 0, 2, 4, 0, 128, 0, 0),
                AXT_MODBUS_ILLEGAL_ADDRESS);
    bench_end(b);
}

/* ---- The serial line ---- */

static void hear(bench *b, const uint8_t *bytes, uint32_t length) {
    for (uint32_t i = 0; i < length; i++) {
        axt_modbus_rtu_receive(&b->rtu, bytes[i], b->now);
        b->now += 96; /* a character at 115200 bit/s */
    }
}

/* Looks for a request until silence must have ended it. */
static uint32_t look(bench *b) {
    uint32_t length = 0;
    for (uint32_t i = 0; i < SILENCE / 500 && length == 0; i++) {
        b->now += 500;
        length = axt_modbus_rtu_poll(&b->rtu, b->now, b->answer);
    }
    return length;
}

/* Reading MotorPosition, as docs/registers.md has it; CRC by that page's generator. */
static const uint8_t request_of_the_page[] = {1, 3, 0, 0x24, 0, 2, 0x84, 0x00};

CASE(a_request_on_the_line_is_answered_after_the_silence_and_no_sooner) {
    bench *b = bench_new();
    b->rtu.unit = 1;
    rig_run(b->r, 100);
    hear(b, request_of_the_page, sizeof request_of_the_page);
    CHECK_EQUAL(axt_modbus_rtu_poll(&b->rtu, b->now, b->answer), 0);
    const uint32_t length = look(b);
    CHECK_EQUAL(length, 9);
    CHECK_EQUAL(b->answer[0], 1);
    CHECK_EQUAL(b->answer[1], 3);
    CHECK_EQUAL(b->answer[2], 4);
    uint8_t sealed[9];
    memcpy(sealed, b->answer, 7);
    CHECK_EQUAL(axt_modbus_line_seal(sealed, 7), 9);
    CHECK(memcmp(sealed, b->answer, 9) == 0);
    CHECK_EQUAL(look(b), 0);
    bench_end(b);
}

CASE(any_single_bit_error_is_silence) {
    bench *b = bench_new();
    b->rtu.unit = 1;
    for (uint32_t bit = 0; bit < 8 * sizeof request_of_the_page; bit++) {
        uint8_t broken[sizeof request_of_the_page];
        memcpy(broken, request_of_the_page, sizeof broken);
        broken[bit / 8] ^= (uint8_t)(1 << bit % 8);
        hear(b, broken, sizeof broken);
        CHECK_EQUAL(look(b), 0);
    }
    hear(b, request_of_the_page, sizeof request_of_the_page);
    CHECK_EQUAL(look(b), 9);
    bench_end(b);
}

CASE(silence_parts_frames_and_nothing_else_does) {
    bench *b = bench_new();
    b->rtu.unit = 1;
    /* its CRC does not end in 00: such a frame is right without its last byte, too */
    uint8_t request[8] = {1, 3, 0, 0x20, 0, 2};
    const uint32_t whole = axt_modbus_line_seal(request, 6);
    CHECK(request[7] != 0);
    for (uint32_t cut = 1; cut < whole; cut++) {
        hear(b, request, cut);
        b->now += SILENCE; /* nobody looks meanwhile: the interrupt itself saw the silence */
        hear(b, request + cut, whole - cut);
        CHECK_EQUAL(look(b), 0);
        hear(b, request, cut);
        b->now += 1000; /* less than 3.5 characters */
        CHECK_EQUAL(axt_modbus_rtu_poll(&b->rtu, b->now, b->answer), 0);
        hear(b, request + cut, whole - cut);
        CHECK_EQUAL(look(b), 9);
    }
    /* two requests, silence between them, before anybody looks */
    hear(b, request, whole);
    b->now += SILENCE;
    hear(b, request, whole);
    CHECK_EQUAL(axt_modbus_rtu_poll(&b->rtu, b->now, b->answer), 9);
    CHECK_EQUAL(look(b), 9);
    CHECK_EQUAL(look(b), 0);
    bench_end(b);
}

CASE(noise_longer_than_a_frame_or_the_ring_ends_with_the_silence) {
    bench *b = bench_new();
    b->rtu.unit = 1;
    for (uint32_t length = 1; length < 2000; length += 37) {
        for (uint32_t i = 0; i < length; i++) {
            hear(b, (const uint8_t[]){(uint8_t)(i * i + length)}, 1);
        }
        CHECK_EQUAL(look(b), 0);
        hear(b, request_of_the_page, sizeof request_of_the_page);
        CHECK_EQUAL(look(b), 9);
    }
    bench_end(b);
}

static uint32_t tell(bench *b, uint8_t unit, const uint8_t *pdu, uint32_t length) {
    uint8_t frame[AXT_MODBUS_LINE_FRAME_MAX];
    frame[0] = unit;
    memcpy(frame + 1, pdu, length);
    hear(b, frame, axt_modbus_line_seal(frame, length + 1));
    rig_run(b->r, 2);
    return look(b);
}

CASE(other_units_and_answers_are_passed_over_and_broadcasts_not_answered) {
    bench *b = bench_new();
    const uint8_t first[] = {6, 1, KEY, 0x41, 0x58};
    const uint8_t second[] = {6, 1, KEY, 0x54, 0x57};
    const uint8_t start[] = {6, 1, AXT_REGISTER_CODE & 0xFF, 0,
                             AXT_CONTRACT_COMMAND_CODE_STREAM_START_CHOICE};
    CHECK_EQUAL(tell(b, RIG_ID + 1, first, 5), 0);
    CHECK_EQUAL(b->rtu.client.lock, AXT_REGISTERS_LOCKED);
    CHECK_EQUAL(tell(b, RIG_ID, (const uint8_t[]){0x83, 2}, 2), 0);
    CHECK_EQUAL(tell(b, AXT_MODBUS_BROADCAST, first, 5), 0);
    CHECK_EQUAL(tell(b, AXT_MODBUS_BROADCAST, second, 5), 0);
    CHECK_EQUAL(b->rtu.client.lock, AXT_REGISTERS_ENABLED);
    CHECK_EQUAL(tell(b, AXT_MODBUS_BROADCAST, start, 5), 0);
    CHECK(b->r->node.streaming);
    bench_end(b);
}

CASE(an_eager_line_needs_no_silence) {
    bench *b = bench_new();
    axt_modbus_rtu_init(&b->rtu, &b->port, 1, 115200, true);
    const uint32_t whole = sizeof request_of_the_page;
    for (uint32_t i = 0; i < 3; i++) {
        hear(b, request_of_the_page, whole - 1);
        b->now += 30000; /* a lump of bytes that was held back */
        CHECK_EQUAL(axt_modbus_rtu_poll(&b->rtu, b->now, b->answer), 0);
        hear(b, request_of_the_page + whole - 1, 1);
        CHECK_EQUAL(axt_modbus_rtu_poll(&b->rtu, b->now, b->answer), 9);
    }
    bench_end(b);
}

int main(void) {
    RUN(the_identity_is_that_of_the_node_the_more_significant_register_first);
    RUN(only_what_is_listed_can_be_read);
    RUN(counts_and_lengths_that_cannot_be_are_refused);
    RUN(an_answer_shows_one_moment);
    RUN(friction_and_spring_are_shown_as_on_can);
    RUN(refused_samples_are_counted_by_their_reason);
    RUN(the_drift_alarm_is_started_and_read);
    RUN(the_history_has_every_sample_for_whoever_reads_it_in_time);
    RUN(the_history_goes_on_at_another_distance);
    RUN(a_node_that_keeps_no_history_shows_none);
    RUN(nothing_is_commanded_before_both_keys_or_after_ten_seconds);
    RUN(a_command_that_is_refused_says_why);
    RUN(function_23_writes_first_and_reads_what_came_of_it);
    RUN(a_client_with_the_keys_has_the_drive_under_its_control_while_it_is_heard);
    RUN(a_client_without_the_keys_is_no_host);
    RUN(a_request_on_the_line_is_answered_after_the_silence_and_no_sooner);
    RUN(any_single_bit_error_is_silence);
    RUN(silence_parts_frames_and_nothing_else_does);
    RUN(noise_longer_than_a_frame_or_the_ring_ends_with_the_silence);
    RUN(other_units_and_answers_are_passed_over_and_broadcasts_not_answered);
    RUN(an_eager_line_needs_no_silence);
    return REPORT();
}
