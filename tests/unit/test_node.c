/* The node on a bench: what it streams, captures and counts, what it answers. */
#include "axt_node.h"

#include <math.h>

#include "axt_crc32.h"
#include "node_rig.h"
#include "reference.h"

enum { IDENTIFY = 1, STREAM_START, STREAM_STOP, ESTIMATOR_RESET, STREAM_START_FD, DRIFT_WATCH };
enum { LENGTH = 16, FIRST, STRIDE, LINES, SEED, RMS, EXCITATION_ON, EXCITATION_OFF };
enum { TRACE_ARM = 32, TRACE_UPLOAD, TRACE_ABORT };

/* A rig whose host has switched its excitation on. */
static rig *rig_excited(void) {
    rig *r = rig_running();
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 1000);
    return r;
}

/* ---- Wire ------------------------------------------------------------------------------------ */

CASE(torque_is_rounded_to_the_wire_and_limited_to_it) {
    static const struct {
        double torque;
        int raw;
        bool limited;
    } examples[] = {{0, 0, false},           {0.049, 0, false},         {0.051, 1, false},
                    {-0.049, 0, false},      {-0.051, -1, false},       {12.3, 123, false},
                    {3276.7, 32767, false},  {-3276.7, -32767, false},  {3277, 32767, true},
                    {-3277, -32767, true},   {1e30, 32767, true},       {-1e30, -32767, true},
                    {HUGE_VAL, 32767, true}, {-HUGE_VAL, -32767, true}, {(double)NAN, 0, false}};
    for (size_t i = 0; i < COUNT_OF(examples); i++) {
        bool limited = false;
        const int raw =
            axt_node_quantise_torque((axt_real)examples[i].torque, (axt_real)0.1, &limited);
        CHECK_EQUAL(raw, examples[i].raw);
        CHECK_EQUAL(limited, examples[i].limited);
    }
}

CASE(quantising_what_is_on_the_grid_changes_nothing) {
    const axt_real unit = (axt_real)6.4e-5;
    for (int raw = -32767; raw <= 32767; raw++) {
        bool limited = true;
        CHECK_EQUAL(axt_node_quantise_torque((axt_real)raw * unit, unit, &limited), raw);
        CHECK(!limited);
    }
}

/* Bit by bit from the polynomial, reflected: 0xEDB88320. */
static uint32_t crc32_by_definition(const uint8_t *bytes, size_t size) {
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < 8 * size; i++) {
        const uint32_t bit = (uint32_t)(bytes[i / 8] >> (i % 8)) & 1;
        crc = (crc >> 1) ^ ((((crc ^ bit) & 1) != 0) ? UINT32_C(0xEDB88320) : 0);
    }
    return ~crc;
}

CASE(the_checksum_is_that_of_ieee_802_3) {
    CHECK_EQUAL(axt_crc32(0, (const uint8_t *)"123456789", 9), 0xCBF43926); /* its check value */
    uint8_t bytes[64];
    uint64_t seed = 3;
    for (uint32_t size = 0; size <= sizeof bytes; size++) {
        for (uint32_t i = 0; i < size; i++) {
            bytes[i] = (uint8_t)random_bits(&seed);
        }
        const uint32_t half = axt_crc32(0, bytes, size / 2);
        CHECK_EQUAL(axt_crc32(half, bytes + size / 2, size - size / 2),
                    crc32_by_definition(bytes, size));
    }
}

/* ---- States ---------------------------------------------------------------------------------- */

CASE(a_node_boots_up_and_beats_ten_times_a_second) {
    rig *r = rig_running();
    rig_run(r, 50000);
    uint32_t beats = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        if (r->sent[i].id == 0x700 + RIG_ID) {
            CHECK_EQUAL(r->sent[i].length, 1);
            CHECK_EQUAL(r->sent[i].data[0], (beats == 0) ? 0 : 127);
            beats++;
        }
    }
    CHECK(beats >= 50 && beats <= 51);
    free(r);
}

CASE(streaming_is_the_operational_state) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_tell(r, STREAM_START, 0), 0);
    rig_forget_sent(r);
    rig_run(r, 1500);
    CHECK_EQUAL(rig_find(r, 0x700, 0)->data[0], 5);
    CHECK_EQUAL(rig_tell(r, STREAM_STOP, 0), 0);
    rig_run(r, 10);
    rig_forget_sent(r);
    rig_run(r, 1500);
    CHECK_EQUAL(rig_find(r, 0x700, 0)->data[0], 127);
    CHECK_EQUAL(rig_count(r, 0x180), 0);
    free(r);
}

CASE(a_stopped_node_leaves_the_axis_without_torque_and_says_so) {
    rig *r = rig_excited();
    CHECK(r->log[r->log_count - 1].torque != 0);
    rig_forget_sent(r);
    axt_node_stop(&r->node);
    CHECK(r->log[r->log_count].torque == 0);
    CHECK_EQUAL(r->sent_count, 1);
    CHECK_EQUAL(r->sent[0].id, 0x700 + RIG_ID);
    CHECK_EQUAL(r->sent[0].data[0], 4);
    free(r);
}

CASE(a_broken_bus_is_reported_and_does_not_stop_the_axis) {
    rig *r = rig_running();
    rig_run(r, 10);
    r->broken = AXT_CAN_ERROR_DOWN;
    rig_run(r, 1000);
    axt_node_tick(&r->node);
    CHECK_EQUAL(axt_node_background(&r->node), AXT_CAN_ERROR_DOWN);
    CHECK_EQUAL(r->log_count, 1011);
    r->broken = AXT_CAN_OK;
    CHECK_EQUAL(axt_node_background(&r->node), AXT_CAN_OK);
    CHECK_EQUAL(rig_tell(r, IDENTIFY, 0), 0);
    free(r);
}

CASE(settings_that_make_no_sense_are_refused) {
    for (int i = 0; i < 14; i++) {
        rig *r = rig_new();
        axt_node_config *c = &r->config;
        axt_status expected = AXT_ERROR_RANGE;
        switch (i) {
        case 0:
            c->id = 0;
            break;
        case 1:
            c->id = 127;
            break;
        case 2:
            c->stream_decimation = 0;
            break;
        case 3:
            c->rated_torque = 0;
            break;
        case 4:
            c->ring_size = 63;
            expected = AXT_ERROR_SIZE;
            break;
        case 5:
            c->ring_size = 1;
            expected = AXT_ERROR_SIZE;
            break;
        case 6:
            c->trace_size = 0;
            expected = AXT_ERROR_SIZE;
            break;
        case 7:
            c->trace_size = AXT_NODE_TRACE_MAX + 1;
            expected = AXT_ERROR_SIZE;
            break;
        case 8:
            c->excitation.length = RIG_TABLE + 1;
            expected = AXT_ERROR_SIZE;
            break;
        case 9:
            c->excitation.lines = 128;
            break;
        case 10:
            c->forgetting = (axt_real)1.5;
            break;
        case 11:
            c->control_period = 0;
            break;
        case 12:
            c->expected.K = -1;
            break;
        default:
            c->counts_per_turn[0] = 0;
            break;
        }
        CHECK_EQUAL(rig_start(r), expected);
        free(r);
    }
}

/* ---- Live stream ------------------------------------------------------------------------------
 */

/* Do the streamed frames say what the axis saw? Returns the number of samples. */
static uint32_t check_stream(const rig *r, uint32_t decimation) {
    uint32_t samples = 0;
    const axt_real unit = r->node.torque_unit;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_motor_t motor;
        struct axt_contract_table_t table;
        if (r->sent[i].id != 0x180 + RIG_ID) {
            continue;
        }
        const axt_can_frame *half = rig_find(r, 0x280, i);
        CHECK(half != NULL);
        if (half == NULL) {
            break;
        }
        (void)axt_contract_motor_unpack(&motor, r->sent[i].data, 8);
        (void)axt_contract_table_unpack(&table, half->data, 8);
        CHECK_EQUAL(motor.counter, table.counter);
        const rig_period_log *saw = &r->log[(size_t)motor.counter * decimation];
        CHECK_EQUAL(motor.position, saw->position[0]);
        CHECK_EQUAL(table.position, saw->position[1]);
        CHECK((axt_real)motor.torque * unit == saw->torque);
        CHECK((table.status_word & AXT_NODE_EXCITED) != 0 || motor.torque == 0);
        samples++;
    }
    return samples;
}

CASE(the_stream_is_what_the_axis_saw_with_no_gap) {
    static const uint32_t decimations[] = {1, 3, 10, 97};
    for (size_t k = 0; k < COUNT_OF(decimations); k++) {
        rig *r = rig_running();
        rig_run(r, 123);
        CHECK_EQUAL(rig_tell(r, STREAM_START, decimations[k]), 0);
        const uint32_t begun = r->log_count;
        rig_run(r, 10000);
        const uint32_t samples = check_stream(r, decimations[k]);
        CHECK_NEAR(samples, (double)(r->log_count - begun) / decimations[k], 2);
        uint32_t expected = 0;
        for (uint32_t i = 0; i < r->sent_count; i++) {
            if (r->sent[i].id == 0x180 + RIG_ID) {
                const uint32_t counter = r->sent[i].data[0] | (uint32_t)r->sent[i].data[1] << 8;
                CHECK(expected == 0 || counter == expected);
                expected = counter + 1;
            }
        }
        CHECK_EQUAL(rig_report(r, 6).stream_decimation, decimations[k]);
        CHECK_EQUAL(rig_report(r, 17).lost_samples, 0);
        free(r);
    }
}

CASE(the_stream_shows_torque_and_status_of_the_excitation) {
    rig *r = rig_running();
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 2000);
    CHECK_EQUAL(rig_tell(r, EXCITATION_OFF, 0), 0);
    rig_run(r, 100);
    CHECK(check_stream(r, 1) > 2000);
    CHECK(r->log[r->log_count - 1].torque == 0);
    free(r);
}

/* The counter is n / decimation modulo 2^16, however often the stream is stopped and started. */
CASE(the_counter_follows_the_control_period) {
    rig *r = rig_running();
    static const uint32_t decimations[] = {1, 7, 1, 3};
    rig_run(r, 65000);
    for (size_t k = 0; k < COUNT_OF(decimations); k++) {
        CHECK_EQUAL(rig_tell(r, STREAM_START, decimations[k]), 0);
        rig_run(r, 10);
        rig_forget_sent(r);
        rig_run(r, 1000);
        const uint32_t now = r->log_count; /* no more than a decimation from the last sample */
        uint32_t counter = 0;
        for (uint32_t i = 0; i < r->sent_count; i++) {
            if (r->sent[i].id == 0x180 + RIG_ID) {
                counter = r->sent[i].data[0] | (uint32_t)r->sent[i].data[1] << 8;
            }
        }
        CHECK_EQUAL(counter, ((now - 1) / decimations[k]) & 0xFFFF);
        CHECK_EQUAL(rig_tell(r, STREAM_STOP, 0), 0);
    }
    free(r);
}

CASE(what_finds_no_room_is_counted_and_shows_in_the_counter) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    rig_run(r, 50);
    rig_forget_sent(r);
    r->room = 7;
    rig_run(r, 1000);
    r->room = UINT32_MAX;
    rig_run(r, 10000);
    uint32_t expected = 0;
    uint32_t missing = 0;
    uint32_t gaps = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        if (r->sent[i].id == 0x180 + RIG_ID) {
            const uint32_t counter = r->sent[i].data[0] | (uint32_t)r->sent[i].data[1] << 8;
            if (expected > 0 && counter != expected) {
                missing += counter - expected;
                gaps++;
            }
            expected = counter + 1;
        }
    }
    CHECK_EQUAL(gaps, 1);
    CHECK(missing > 800);
    CHECK_EQUAL(rig_report(r, 17).lost_samples, missing);
    CHECK_EQUAL(rig_count(r, 0x180), rig_count(r, 0x280));
    free(r);
}

CASE(nobody_listening_is_no_loss) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    rig_run(r, 10);
    r->closed = true;
    rig_run(r, 5000);
    r->closed = false;
    rig_forget_sent(r);
    rig_run(r, 10000);
    CHECK_EQUAL(rig_report(r, 17).lost_samples, 0);
    CHECK(check_stream(r, 1) > 9990);
    free(r);
}

/* Frame by frame through a bus that is almost always full: halves stay together and in order. */
CASE(a_sample_split_by_a_full_bus_is_not_torn) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_tell(r, STREAM_START, 5), 0);
    for (int i = 0; i < 5000; i++) {
        r->room = 1;
        rig_run(r, 1);
    }
    bool table_next = false;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        const uint32_t base = r->sent[i].id - RIG_ID;
        if (base == 0x180 || base == 0x280) {
            CHECK_EQUAL(base, table_next ? 0x280 : 0x180);
            table_next = !table_next;
        }
    }
    CHECK(check_stream(r, 5) > 900);
    free(r);
}

CASE(room_tells_whether_the_next_sample_would_be_lost) {
    rig *r = rig_new();
    r->config.streaming = true;
    r->config.stream_decimation = 1;
    CHECK_EQUAL(rig_start(r), AXT_OK);
    uint32_t ticks = 0;
    while (axt_node_has_room(&r->node)) {
        axt_node_tick(&r->node);
        ticks++;
    }
    CHECK_EQUAL(ticks, RIG_RING);
    CHECK_EQUAL(r->node.lost, 0);
    axt_node_tick(&r->node);
    CHECK_EQUAL(r->node.lost, 1);
    (void)axt_node_background(&r->node);
    CHECK(axt_node_has_room(&r->node));
    free(r);
}

/* ---- Live stream on CAN FD --------------------------------------------------------------------
 */

static rig *rig_fd(void) {
    rig *r = rig_running();
    r->can.fd = true;
    return r;
}

/* Do the Samples frames say what the axis saw? Returns the number of samples; `missing` are those
 * that the counter left out. */
static uint32_t check_samples(const rig *r, uint32_t decimation, uint32_t *missing) {
    uint32_t samples = 0;
    uint32_t expected = 0;
    *missing = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_samples_t s;
        if (r->sent[i].id != 0x400 + RIG_ID) {
            continue;
        }
        CHECK(r->sent[i].fd);
        CHECK_EQUAL(axt_contract_samples_unpack(&s, r->sent[i].data, r->sent[i].length), 0);
        const int32_t motor[] = {s.motor_position0, s.motor_position1, s.motor_position2,
                                 s.motor_position3, s.motor_position4, s.motor_position5};
        const int32_t table[] = {s.table_position0, s.table_position1, s.table_position2,
                                 s.table_position3, s.table_position4, s.table_position5};
        const int16_t torque[] = {s.torque0, s.torque1, s.torque2, s.torque3, s.torque4, s.torque5};
        *missing += (samples > 0) ? (uint16_t)(s.counter - expected) : 0;
        expected = s.counter + UINT32_C(6);
        for (uint32_t k = 0; k < 6; k++) {
            const rig_period_log *saw = &r->log[(size_t)(s.counter + k) * decimation];
            CHECK_EQUAL(motor[k], saw->position[0]);
            CHECK_EQUAL(table[k], saw->position[1]);
            CHECK((axt_real)torque[k] * r->node.torque_unit == saw->torque);
            samples++;
        }
    }
    return samples;
}

CASE(a_classical_bus_refuses_the_fd_stream) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_tell(r, STREAM_START_FD, 0), AXT_NODE_NO_FD);
    rig_run(r, 100);
    CHECK_EQUAL(rig_count(r, 0x400), 0);
    free(r);
}

CASE(an_fd_bus_carries_every_control_period) {
    static const uint32_t decimations[] = {0, 1, 3, 10};
    for (size_t k = 0; k < COUNT_OF(decimations); k++) {
        const uint32_t decimation = (decimations[k] > 0) ? decimations[k] : 1;
        rig *r = rig_fd();
        rig_enable(r);
        CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
        rig_run(r, 123);
        CHECK_EQUAL(rig_tell(r, 1, 0), 0);
        CHECK_EQUAL(rig_tell(r, STREAM_START_FD, decimations[k]), 0);
        const uint32_t begun = r->log_count;
        rig_run(r, 10000);
        uint32_t missing;
        const uint32_t samples = check_samples(r, decimation, &missing);
        CHECK_NEAR(samples, (double)(r->log_count - begun) / decimation, 7);
        CHECK_EQUAL(missing, 0);
        CHECK_EQUAL(r->node.lost, 0);
        CHECK_EQUAL(rig_count(r, 0x180), 0);
        CHECK_EQUAL(rig_report(r, 13).features, 1);
        CHECK_EQUAL(rig_report(r, 6).stream_decimation, decimation);
        CHECK_EQUAL(rig_tell(r, STREAM_STOP, 0), 0);
        rig_forget_sent(r);
        rig_run(r, 100);
        CHECK_EQUAL(rig_count(r, 0x400), 0);
        free(r);
    }
}

/* A bus that takes a frame now and then: whole frames of samples are lost, and counted. */
CASE(what_finds_no_room_on_an_fd_bus_is_whole_frames_and_counted) {
    rig *r = rig_fd();
    CHECK_EQUAL(rig_tell(r, STREAM_START_FD, 1), 0);
    for (int i = 0; i < 10000; i++) {
        r->room = (i % 9 == 0) ? 1 : 0;
        rig_run(r, 1);
    }
    r->room = UINT32_MAX;
    rig_run(r, 10000);
    uint32_t missing;
    (void)check_samples(r, 1, &missing);
    CHECK(missing > 1000);
    CHECK_EQUAL(missing % 6, 0);
    CHECK_EQUAL(r->node.lost, missing);
    CHECK_EQUAL(rig_report(r, 17).lost_samples, missing);
    free(r);
}

/* From one kind of stream to the other and back, in the middle of a frame and with the bus full:
 * each sample is in the one or the other, or counted as lost. */
CASE(changing_the_kind_of_stream_loses_nothing_silently) {
    rig *r = rig_fd();
    uint64_t seed = 3;
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    for (int i = 0; i < 300; i++) {
        r->room = (uint32_t)(random_bits(&seed) % 30);
        rig_run(r, (uint32_t)(random_bits(&seed) % 40));
        if (r->command_next == r->command_count) {
            rig_offer(r, rig_command((i % 2 == 0) ? STREAM_START_FD : STREAM_START, 1));
        }
    }
    r->room = UINT32_MAX;
    rig_run(r, 500);
    uint32_t missing;
    const uint32_t samples = check_samples(r, 1, &missing) + check_stream(r, 1);
    const axt_can_frame *first = rig_find(r, 0x180, 0);
    const uint32_t begun = first->data[0] | (uint32_t)first->data[1] << 8;
    CHECK_EQUAL(samples + r->node.lost + r->node.grouped, r->node.counter - begun);
    CHECK(rig_count(r, 0x400) > 100 && rig_count(r, 0x180) > 100);
    free(r);
}

CASE(the_status_of_a_frame_is_that_of_its_last_sample_and_any_limit) {
    rig *r = rig_fd();
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of(1.9F)), 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    CHECK_EQUAL(rig_tell(r, STREAM_START_FD, 1), 0);
    rig_run(r, 2000);
    uint32_t limited = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_samples_t s;
        if (r->sent[i].id != 0x400 + RIG_ID) {
            continue;
        }
        (void)axt_contract_samples_unpack(&s, r->sent[i].data, r->sent[i].length);
        const int16_t torque[] = {s.torque0, s.torque1, s.torque2, s.torque3, s.torque4, s.torque5};
        bool any = false;
        for (size_t k = 0; k < COUNT_OF(torque); k++) {
            any = any || torque[k] == 32767 || torque[k] == -32767;
        }
        CHECK_EQUAL((s.status_word & AXT_NODE_LIMITED) != 0, any);
        CHECK_EQUAL(s.status_word & 0x6F, AXT_CIA402_OPERATION_ENABLED);
        limited += any ? 1 : 0;
    }
    CHECK(limited > 10);
    free(r);
}

/* ---- Commands ---------------------------------------------------------------------------------
 */

CASE(every_code_is_answered_and_only_known_ones_are_done) {
    static const uint8_t known[] = {1,  2,  3,  4,  5,  6,  16, 17, 18, 19, 20, 21,
                                    22, 23, 32, 33, 34, 35, 36, 37, 38, 39, 48, 49,
                                    50, 51, 52, 64, 65, 66, 67, 68, 69, 70, 71};
    rig *r = rig_running();
    for (uint32_t code = 0; code < 256; code++) {
        const bool is_known = memchr(known, (int)code, sizeof known) != NULL;
        const int result = rig_tell(r, (uint8_t)code, 0xFFFFFFFF);
        CHECK(result >= 0);
        CHECK_EQUAL(result == AXT_NODE_UNKNOWN_COMMAND, !is_known);
        rig_forget_sent(r);
    }
    free(r);
}

CASE(arguments_out_of_range_are_refused) {
    rig *r = rig_running();
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, LENGTH, 3), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, LENGTH, RIG_TABLE + 1), AXT_NODE_NO_ROOM);
    CHECK_EQUAL(rig_tell(r, FIRST, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, STRIDE, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, LINES, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of(-1.0F)), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of(NAN)), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of(INFINITY)), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of(2.2F)), AXT_NODE_OUT_OF_RANGE); /* 3.4 times rated */
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, RIG_TRACE + 1), AXT_NODE_NO_ROOM);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), AXT_NODE_NOT_NOW);
    CHECK_EQUAL(rig_tell(r, LINES, 128), AXT_NODE_DONE); /* too many for 256, but not yet used */
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, LENGTH, 257), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_DONE);
    free(r);
}

CASE(a_short_command_is_out_of_range_and_an_empty_one_nothing) {
    rig *r = rig_running();
    for (uint8_t length = 1; length < 8; length++) {
        axt_can_frame command = rig_command(STREAM_START, 0);
        command.length = length;
        CHECK_EQUAL(rig_ask(r, command), AXT_NODE_OUT_OF_RANGE);
        rig_forget_sent(r);
    }
    axt_can_frame empty = rig_command(STREAM_START, 0);
    empty.length = 0;
    CHECK_EQUAL(rig_ask(r, empty), -1);
    rig_run(r, 2000);
    CHECK_EQUAL(rig_count(r, 0x180), 0);
    free(r);
}

CASE(commands_for_others_are_not_heard) {
    static const uint32_t ids[] = {0x200, 0x200 + RIG_ID + 1, 0x180 + RIG_ID,
                                   (0x200 + RIG_ID) | AXT_CAN_EXTENDED,
                                   (0x200 + RIG_ID) | AXT_CAN_REMOTE};
    rig *r = rig_running();
    for (size_t i = 0; i < COUNT_OF(ids); i++) {
        axt_can_frame command = rig_command(STREAM_START, 0);
        command.id = ids[i];
        CHECK_EQUAL(rig_ask(r, command), -1);
    }
    CHECK_EQUAL(rig_count(r, 0x180), 0);
    free(r);
}

/* Forty commands at once, through a bus that is often full: each is answered, in order. */
CASE(commands_in_a_row_are_all_answered_in_order) {
    rig *r = rig_running();
    rig_run(r, 100);
    rig_forget_sent(r);
    for (uint32_t i = 0; i < 40; i++) {
        rig_offer(r, rig_command((i % 3 == 0) ? EXCITATION_OFF : SEED, i));
    }
    for (int i = 0; i < 500; i++) {
        r->room = (i % 4 == 0) ? 1 : 0;
        rig_run(r, 1);
    }
    uint32_t answered = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_report_t report;
        (void)axt_contract_report_unpack(&report, r->sent[i].data, 8);
        if (r->sent[i].id == 0x380 + RIG_ID && report.page == 255) {
            CHECK_EQUAL(report.answer, answered);
            answered++;
        }
    }
    CHECK_EQUAL(answered, 40);
    free(r);
}

CASE(identify_tells_what_the_node_is) {
    rig *r = rig_running();
    rig_run(r, 100);
    rig_forget_sent(r);
    CHECK_EQUAL(rig_tell(r, IDENTIFY, 0), 0);
    rig_run(r, 10);
    CHECK_EQUAL(rig_report(r, 0).contract, AXT_CONTRACT_VERSION);
    CHECK_EQUAL(rig_report(r, 1).firmware, AXT_NODE_FIRMWARE);
    CHECK(rig_report(r, 2).control_period == (float)rig_period);
    CHECK_EQUAL(rig_report(r, 3).rated_torque, rig_rated);
    CHECK_EQUAL(rig_report(r, 4).motor_resolution, 1048576);
    CHECK_EQUAL(rig_report(r, 5).table_resolution, 1048576);
    CHECK_EQUAL(rig_report(r, 6).stream_decimation, 10);
    CHECK_EQUAL(rig_report(r, 7).trace_capacity, RIG_TRACE);
    CHECK_EQUAL(rig_report(r, 8).trace_captured, 0);
    CHECK_EQUAL(rig_report(r, 9).trace_checksum, 0);
    CHECK_EQUAL(rig_report(r, 13).features, 0);
    CHECK_EQUAL(rig_report(r, 14).status, 0x0050); /* switch on disabled, local */
    CHECK_EQUAL(rig_report(r, 19).periods, 102);   /* heard at the 101st, told after it */
    CHECK_EQUAL(rig_report(r, 56).torque_limit, 32767);
    CHECK_EQUAL(rig_report(r, 57).speed_limit, 100000);
    CHECK_EQUAL(rig_report(r, 58).travel_min, INT32_MIN);
    CHECK_EQUAL(rig_report(r, 59).travel_max, INT32_MAX);
    CHECK_EQUAL(rig_report(r, 60).host_heartbeat, 127 << 16 | 400);
    const uint16_t sequence = rig_report(r, 0).sequence;
    for (uint8_t page = 0; page <= 60; page++) {
        if (page < 32 || page > 55) {
            CHECK_EQUAL(rig_report(r, page).page, page);
            CHECK_EQUAL(rig_report(r, page).sequence, sequence);
            CHECK_EQUAL(rig_report(r, page).flags, 0);
        }
    }
    free(r);
}

CASE(counters_come_every_second) {
    rig *r = rig_running();
    axt_node_overrun(&r->node, 3);
    axt_node_overrun(&r->node, 4);
    r->node.rejected = 9; /* no bus, torque or encoder makes the estimator refuse a sample */
    r->can.health = (axt_can_health){.error_frames = 5, .bus_off = 2, .outages = 3, .overflows = 8};
    rig_run(r, 50000);
    uint32_t reports = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        reports += (r->sent[i].id == 0x380 + RIG_ID && r->sent[i].data[0] == 16) ? 1 : 0;
    }
    CHECK(reports >= 5 && reports <= 6);
    CHECK_EQUAL(rig_report(r, 16).overruns, 7);
    CHECK_EQUAL(rig_report(r, 17).lost_samples, 0);
    CHECK_EQUAL(rig_report(r, 18).rejected_samples, 9);
    CHECK_EQUAL(rig_report(r, 28).lost_frames, 8);
    CHECK_EQUAL(rig_report(r, 29).bus_errors, 5);
    CHECK_EQUAL(rig_report(r, 30).bus_offs, 2);
    CHECK_EQUAL(rig_report(r, 31).bus_outages, 3);
    free(r);
}

/* An encoder that is wrong now and then: the samples are left out, counted, and do no harm. */
CASE(samples_that_the_estimator_refuses_are_counted_by_their_reason) {
    rig *r = rig_excited();
    rig_run(r, 10000);
    for (int i = 0; i < 20; i++) {
        r->glitch = 500000;
        rig_run(r, 500);
    }
    rig_run(r, 15000);
    CHECK_EQUAL(rig_report(r, 18).rejected_samples, 20);
    CHECK_EQUAL(rig_report(r, 20).not_finite_samples, 0);
    CHECK_EQUAL(rig_report(r, 21).out_of_range_samples, 0);
    CHECK_EQUAL(rig_report(r, 22).jumped_samples, 20);
    CHECK_EQUAL(rig_report(r, 23).repeated_samples, 0);
    CHECK_EQUAL(rig_report(r, 24).sample_gaps, 20);
    CHECK_EQUAL(rig_report(r, 38).flags, 1);
    CHECK_NEAR(rig_report(r, 38).estimate_k / 110, 1, 2e-3);
    free(r);
}

/* ---- Excitation -------------------------------------------------------------------------------
 */

/* The first control period whose torque comes from the table, from a stream of every period. */
static uint32_t first_driven(const rig *r) {
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_table_t table;
        (void)axt_contract_table_unpack(&table, r->sent[i].data, 8);
        if (r->sent[i].id == 0x280 + RIG_ID && (table.status_word & AXT_NODE_EXCITED) != 0) {
            return table.counter;
        }
    }
    CHECK(false);
    return 0;
}

/* Schroeder's sum itself, in double precision [N m]. */
static double schroeder(const axt_schroeder *s, uint32_t n) {
    double sum = 0;
    for (uint32_t i = 1; i <= s->lines; i++) {
        const double harmonic = s->first + (double)s->stride * (i - 1);
        const double phase = -M_PI * i * (i - 1.0) / s->lines;
        sum += cos(2 * M_PI * harmonic * n / s->length + phase);
    }
    return sum * (double)s->rms * sqrt(2.0 / s->lines);
}

CASE(the_excitation_is_the_one_that_was_set) {
    const axt_schroeder wanted = {
        .length = 200, .first = 3, .stride = 2, .lines = 30, .rms = (axt_real)0.1};
    rig *r = rig_running();
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, LENGTH, wanted.length), 0);
    CHECK_EQUAL(rig_tell(r, FIRST, wanted.first), 0);
    CHECK_EQUAL(rig_tell(r, STRIDE, wanted.stride), 0);
    CHECK_EQUAL(rig_tell(r, LINES, wanted.lines), 0);
    CHECK_EQUAL(rig_tell(r, RMS, bits_of((float)wanted.rms)), 0);
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 1000);
    const uint32_t first = first_driven(r);
    const double quantum = 1e-7 * rig_rated;
    double square = 0;
    for (uint32_t n = 0; n < 2 * wanted.length; n++) {
        const double torque = (double)r->log[first + n].torque;
        CHECK_NEAR(torque, schroeder(&wanted, n), 0.5 * quantum + 1e-6);
        square += torque * torque;
    }
    CHECK_NEAR(sqrt(square / (2 * wanted.length)), 0.1, 1e-4);
    free(r);
}

/* Another excitation while one plays: torque 0 in between, and no sample of a half filled table. */
CASE(changing_the_excitation_never_plays_an_unfinished_table) {
    rig *r = rig_excited();
    CHECK_EQUAL(rig_tell(r, LINES, 100), 0);
    CHECK_EQUAL(rig_tell(r, SEED, 9), 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    const uint32_t stopped = r->log_count;
    rig_run(r, 50);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0); /* once more, in the middle of filling */
    rig_run(r, 90);
    for (uint32_t n = stopped; n < r->log_count; n++) {
        CHECK(r->log[n].torque == 0);
    }
    rig_forget_sent(r);
    CHECK_EQUAL(rig_tell(r, STREAM_START, 1), 0);
    rig_run(r, 2000);
    axt_real table[RIG_TABLE];
    const axt_schroeder wanted = {
        .length = 256, .first = 1, .stride = 1, .lines = 100, .seed = 9, .rms = (axt_real)0.2};
    CHECK_EQUAL(axt_schroeder_fill(&wanted, table, RIG_TABLE), AXT_OK);
    const uint32_t first = first_driven(r);
    for (uint32_t n = 0; n < 1000; n++) {
        CHECK_NEAR(r->log[first + n].torque, table[n % 256], 1e-7 * rig_rated);
    }
    free(r);
}

/* A background that runs many times between two ticks, as on a drive with little to do, waits for
 * the tick to let go of the table before it writes to it. */
CASE(the_table_is_not_written_while_the_tick_may_play_it) {
    rig *r = rig_excited();
    axt_real playing[RIG_TABLE];
    memcpy(playing, r->table, sizeof playing);
    CHECK_EQUAL(rig_tell(r, LINES, 30), 0);
    rig_offer(r, rig_command(EXCITATION_ON, 0));
    for (int i = 0; i < 300; i++) {
        (void)axt_node_background(&r->node);
    }
    CHECK(UNCHANGED(r->table, playing));
    axt_node_tick(&r->node);
    CHECK(r->log[r->log_count - 1].torque == 0);
    free(r);
}

CASE(torque_beyond_the_wire_is_limited_and_flagged) {
    rig *r = rig_new();
    r->config.excited = true;
    r->config.streaming = true;
    r->config.stream_decimation = 1;
    r->config.excitation.rms = (axt_real)1.9; /* a crest factor of 1.7 goes beyond 2.097 N m */
    CHECK_EQUAL(rig_start(r), AXT_OK);
    rig_run(r, 1000);
    uint32_t limited = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_motor_t motor;
        struct axt_contract_table_t table;
        const axt_can_frame *half = rig_find(r, 0x280, i);
        if (r->sent[i].id != 0x180 + RIG_ID || half == NULL) {
            continue;
        }
        (void)axt_contract_motor_unpack(&motor, r->sent[i].data, 8);
        (void)axt_contract_table_unpack(&table, half->data, 8);
        const bool at_limit = motor.torque == 32767 || motor.torque == -32767;
        CHECK_EQUAL((table.status_word & 0x0800) != 0, at_limit);
        limited += at_limit ? 1 : 0;
    }
    CHECK(limited > 10);
    free(r);
}

/* ---- Trace ------------------------------------------------------------------------------------
 */

/* Runs until the trace is in the state; false when that takes too long. */
static bool run_until(rig *r, axt_node_trace_state state) {
    for (int i = 0; i < 20000; i++) {
        if (rig_report(r, 8).page == 8 && rig_report(r, 8).flags == (int)state) {
            return true;
        }
        rig_run(r, 1);
    }
    return false;
}

/* Are the trace frames sent the samples index .. length - 1 of what the axis saw from `first` on?
 */
static void check_trace(const rig *r, uint32_t first, uint32_t index, uint32_t length) {
    uint32_t number = 2 * index;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_trace_t trace;
        if (r->sent[i].id != 0x480 + RIG_ID) {
            continue;
        }
        (void)axt_contract_trace_unpack(&trace, r->sent[i].data, 8);
        const rig_period_log *saw = &r->log[first + number / 2];
        CHECK_EQUAL(trace.index, number / 2);
        CHECK_EQUAL(trace.channel, number % 2);
        if (trace.channel == 0) {
            CHECK_EQUAL(trace.motor_position, saw->position[0]);
            CHECK((axt_real)trace.torque * r->node.torque_unit == saw->torque);
        } else {
            CHECK_EQUAL(trace.table_position, saw->position[1]);
            CHECK_EQUAL(trace.status_word, 0x0337); /* enabled by a host, excitation */
        }
        number++;
    }
    CHECK_EQUAL(number, 2 * length);
}

static uint32_t checksum_of_trace(const rig *r) {
    static uint8_t bytes[(size_t)RIG_TRACE * 16];
    size_t size = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        if (r->sent[i].id == 0x480 + RIG_ID) {
            memcpy(bytes + size, r->sent[i].data, 8);
            size += 8;
        }
    }
    return crc32_by_definition(bytes, size);
}

CASE(a_trace_is_what_the_axis_saw_bit_for_bit) {
    static const uint32_t lengths[] = {1, 2, 31, 32, 33, RIG_TRACE};
    rig *r = rig_excited();
    for (size_t k = 0; k < COUNT_OF(lengths); k++) {
        rig_forget_sent(r);
        rig_offer(r, rig_command(TRACE_ARM, lengths[k]));
        rig_run(r, 1);
        const uint32_t first = r->log_count; /* the tick after the command begins */
        CHECK(run_until(r, AXT_NODE_TRACE_READY));
        CHECK_EQUAL(rig_report(r, 8).trace_captured, lengths[k]);
        rig_run(r, 2);
        const uint32_t checksum = rig_report(r, 9).trace_checksum;
        rig_forget_sent(r);
        CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), 0);
        rig_run(r, 2 * lengths[k]);
        CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_READY);
        check_trace(r, first, 0, lengths[k]);
        CHECK_EQUAL(checksum_of_trace(r), checksum);
    }
    free(r);
}

CASE(a_trace_survives_a_slow_bus_and_a_live_stream) {
    rig *r = rig_excited();
    CHECK_EQUAL(rig_tell(r, STREAM_START, 10), 0);
    rig_offer(r, rig_command(TRACE_ARM, 300));
    rig_run(r, 1);
    const uint32_t first = r->log_count;
    CHECK(run_until(r, AXT_NODE_TRACE_READY));
    rig_forget_sent(r);
    rig_offer(r, rig_command(TRACE_UPLOAD, 0));
    for (int i = 0; i < 10000; i++) {
        r->room = (i % 3 == 0) ? 1 : 0;
        rig_run(r, 1);
    }
    check_trace(r, first, 0, 300);
    CHECK_EQUAL(r->node.lost, 0);
    free(r);
}

CASE(an_upload_can_begin_anywhere_and_be_repeated) {
    rig *r = rig_excited();
    rig_offer(r, rig_command(TRACE_ARM, 100));
    rig_run(r, 1);
    const uint32_t first = r->log_count;
    CHECK(run_until(r, AXT_NODE_TRACE_READY));
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 100), AXT_NODE_OUT_OF_RANGE);
    for (uint32_t index = 0; index < 100; index += 33) {
        rig_forget_sent(r);
        CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, index), 0);
        rig_run(r, 300);
        check_trace(r, first, index, 100);
    }
    free(r);
}

static void begin_upload_and_get_stuck(rig *r) {
    rig_forget_sent(r);
    r->room = 12;
    rig_offer(r, rig_command(TRACE_UPLOAD, 0));
    rig_run(r, 3);
    CHECK(rig_count(r, 0x480) > 0);
    CHECK_EQUAL(r->room, 0);
}

CASE(a_trace_can_be_given_up) {
    rig *r = rig_excited();
    CHECK_EQUAL(rig_tell(r, TRACE_ABORT, 0), 0);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, RIG_TRACE), 0);
    rig_run(r, 20);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), AXT_NODE_NOT_NOW);
    CHECK_EQUAL(rig_tell(r, TRACE_ABORT, 0), 0);
    rig_run(r, 2);
    CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_IDLE);
    CHECK_EQUAL(rig_report(r, 8).trace_captured, 0);
    rig_run(r, 1000);
    CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_IDLE);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), AXT_NODE_NOT_NOW);

    /* giving up an upload keeps the trace */
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 500), 0);
    CHECK(run_until(r, AXT_NODE_TRACE_READY));
    begin_upload_and_get_stuck(r);
    rig_offer(r, rig_command(TRACE_ABORT, 0));
    rig_run(r, 1);
    r->room = UINT32_MAX;
    rig_run(r, 10);
    CHECK(rig_count(r, 0x480) < 10);
    CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_READY);
    CHECK_EQUAL(rig_report(r, 8).trace_captured, 500);

    /* and a new trace may begin in the middle of an upload */
    begin_upload_and_get_stuck(r);
    rig_offer(r, rig_command(TRACE_ARM, 50));
    rig_run(r, 1);
    const uint32_t first = r->log_count;
    r->room = UINT32_MAX;
    CHECK(run_until(r, AXT_NODE_TRACE_CAPTURING));
    CHECK(run_until(r, AXT_NODE_TRACE_READY));
    rig_forget_sent(r);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), 0);
    rig_run(r, 200);
    check_trace(r, first, 0, 50);
    free(r);
}

CASE(a_new_trace_is_not_taken_for_the_last_one) {
    rig *r = rig_excited();
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 50), 0);
    CHECK(run_until(r, AXT_NODE_TRACE_READY));
    rig_offer(r, rig_command(TRACE_ARM, 50));
    for (int i = 0; i < 10; i++) { /* before the tick has heard of it */
        (void)axt_node_background(&r->node);
    }
    CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_CAPTURING);
    CHECK_EQUAL(rig_report(r, 8).trace_captured, 0);
    free(r);
}

/* ---- Estimate ---------------------------------------------------------------------------------
 */

/* An axis whose torque stays from one sample to the next: steps short enough not to matter. */
static axt_real held_torque;
enum { SHORT_STEPS = 64 };

static void hold_torque(void *axis, axt_real torque) {
    rig *r = axis;
    for (int i = 0; i < SHORT_STEPS; i++) {
        CHECK_EQUAL(axt_machine_step(&r->axis.machine, held_torque), AXT_OK);
    }
    held_torque = torque;
}

/* I1 as a node finds it that is told how the torque is held, or wrongly so. */
static double inertia_of_held_axis(axt_hold hold) {
    static const axt_effects ideal = {0};
    rig *r = rig_new();
    const axt_real step = r->config.control_period / (axt_real)SHORT_STEPS;
    r->config.hold = hold;
    CHECK_EQUAL(rig_start(r), AXT_OK);
    held_torque = 0;
    r->node.port.apply_torque = hold_torque;
    CHECK_EQUAL(
        axt_machine_init(&r->axis.machine, &axt_axis_paper, step, AXT_TORQUE_LINEAR, &ideal),
        AXT_OK);
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 20000);
    const double found = (double)rig_report(r, 32).estimate_i1;
    free(r);
    return found;
}

CASE(the_estimate_knows_how_the_torque_is_held) {
    CHECK_NEAR(inertia_of_held_axis(AXT_HOLD_ZERO) / 2.7e-5, 1, 2e-3);
    CHECK(fabs(inertia_of_held_axis(AXT_HOLD_LINEAR) / 2.7e-5 - 1) > 1e-2);
}

CASE(the_estimate_is_that_of_the_axis_and_says_how_sure_it_is) {
    rig *r = rig_excited();
    rig_run(r, 20000);
    const struct axt_contract_report_t wn = rig_report(r, 40);
    CHECK_NEAR(rig_report(r, 32).estimate_i1 / 2.7e-5F, 1, 2e-3);
    CHECK_NEAR(rig_report(r, 34).estimate_i2 / 8.3e-6F, 1, 2e-3);
    CHECK_NEAR(rig_report(r, 36).estimate_b / 2.1e-3F, 1, 2e-2);
    CHECK_NEAR(rig_report(r, 38).estimate_k / 110, 1, 2e-3);
    const double i1 = (double)rig_report(r, 32).estimate_i1;
    const double i2 = (double)rig_report(r, 34).estimate_i2;
    const double b = (double)rig_report(r, 36).estimate_b;
    const double k = (double)rig_report(r, 38).estimate_k;
    const double w = sqrt(k * (1 / i1 + 1 / i2));
    const double zeta = b * w / (2 * k);
    CHECK_NEAR((double)wn.estimate_wn / w, 1, 1e-5);
    CHECK_NEAR((double)rig_report(r, 44).estimate_zeta / zeta, 1, 1e-5);
    CHECK_NEAR((double)rig_report(r, 42).estimate_wd / (w * sqrt(1 - zeta * zeta)), 1, 1e-5);
    for (uint8_t page = 32; page <= 45; page++) {
        CHECK_EQUAL(rig_report(r, page).page, page);
        CHECK_EQUAL(rig_report(r, page).flags, 1);
    }
    CHECK(rig_report(r, 33).error_i1 > 0 && rig_report(r, 33).error_i1 < 2.7e-7F);
    CHECK(rig_report(r, 41).error_wn > 0 && rig_report(r, 41).error_wn < 42);
    free(r);
}

/* Runs 5 s with a bus that takes a frame every `interval` control periods; counts the snapshots,
 * each of which must be whole. */
static uint32_t count_snapshots(uint32_t interval) {
    rig *r = rig_excited();
    rig_forget_sent(r);
    for (uint32_t i = 0; i < 50000; i++) {
        r->room = (i % interval == 0) ? 1 : 0;
        rig_run(r, 1);
    }
    uint32_t pages = 0;
    uint16_t sequence = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_report_t report;
        (void)axt_contract_report_unpack(&report, r->sent[i].data, 8);
        if (r->sent[i].id != 0x380 + RIG_ID || report.page < 32 || report.page > 45) {
            continue;
        }
        if (pages % 14 == 0) {
            CHECK(pages == 0 || report.sequence == (uint16_t)(sequence + 1));
            sequence = report.sequence;
        }
        CHECK_EQUAL(report.page, 32 + pages % 14);
        CHECK_EQUAL(report.sequence, sequence);
        pages++;
    }
    free(r);
    return pages / 14;
}

CASE(an_estimate_is_one_snapshot_of_fourteen_pages_five_times_a_second) {
    CHECK_NEAR(count_snapshots(5), 25, 1);
    CHECK_NEAR(count_snapshots(200), 8, 2); /* 50 frames a second less 10 heartbeats, 18 counters */
}

/* The t-value of what the ideal axis has not, of an estimator that looks for it while the axis has
 * so much viscous friction at the motor [N m s/rad]. */
static double t_of_friction(double viscous, double *found) {
    rig *r = rig_new();
    r->config.form = AXT_IDENT_5X4;
    CHECK_EQUAL(rig_start(r), AXT_OK);
    const axt_effects effects = {.friction = {{.viscous = (axt_real)viscous}}};
    CHECK_EQUAL(axt_emulated_axis_set_effects(&r->axis, &effects), AXT_OK);
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 30000);
    for (uint8_t page = 46; page <= 49; page++) {
        CHECK_EQUAL(rig_report(r, page).page, page);
        CHECK_EQUAL(rig_report(r, page).flags, 1);
        CHECK_EQUAL(rig_report(r, page).sequence, rig_report(r, 38).sequence);
    }
    CHECK(fabsf(rig_report(r, 48).estimate_spring) < 5 * rig_report(r, 49).error_spring);
    *found = (double)rig_report(r, 46).estimate_friction;
    const double error = (double)rig_report(r, 47).error_friction;
    free(r);
    return *found / error;
}

CASE(friction_is_told_from_none_by_its_t_value) {
    double found;
    CHECK(fabs(t_of_friction(0, &found)) < 5);
    CHECK(t_of_friction(1e-3, &found) > 20);
    CHECK_NEAR(found, 1e-3, 1e-4);
}

/* The load grows by 2 % after 9 s; what is normal is known after 7. */
CASE(a_load_that_changes_rings_the_drift_alarm) {
    static const axt_effects effects = {
        .load_change = {.ratio = (axt_real)0.02, .time = (axt_real)9}};
    rig *r = rig_running();
    CHECK_EQUAL(axt_emulated_axis_set_effects(&r->axis, &effects), AXT_OK);
    rig_enable(r);
    CHECK_EQUAL(rig_tell(r, DRIFT_WATCH, 1), AXT_NODE_NOT_NOW);
    CHECK_EQUAL(rig_tell(r, DRIFT_WATCH, 2), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 15000);
    CHECK_EQUAL(rig_report(r, 50).flags, AXT_MONITOR_OFF);
    CHECK_EQUAL(rig_tell(r, DRIFT_WATCH, 1), AXT_NODE_DONE);
    rig_run(r, 10000);
    CHECK_EQUAL(rig_report(r, 50).flags, AXT_MONITOR_LEARNING);
    rig_run(r, 60000);
    CHECK_EQUAL(rig_report(r, 50).flags, AXT_MONITOR_WATCHING);
    CHECK_EQUAL(rig_report(r, 51).drift_alarms, 0);
    CHECK((r->node.status & AXT_NODE_WARNING) == 0);
    rig_run(r, 30000);
    CHECK_EQUAL(rig_report(r, 50).flags, AXT_MONITOR_ALARM);
    CHECK(rig_report(r, 50).drift != 0);
    CHECK_EQUAL(rig_report(r, 51).drift_alarms, 1);
    CHECK((r->node.status & AXT_NODE_WARNING) != 0);
    CHECK_EQUAL(rig_tell(r, DRIFT_WATCH, 0), AXT_NODE_DONE);
    rig_run(r, 3000);
    CHECK_EQUAL(rig_report(r, 50).flags, AXT_MONITOR_OFF);
    CHECK_EQUAL(rig_report(r, 51).drift_alarms, 1);
    CHECK((r->node.status & AXT_NODE_WARNING) == 0);
    free(r);
}

CASE(without_excitation_there_is_no_estimate) {
    rig *r = rig_running();
    rig_run(r, 20000);
    for (uint8_t page = 32; page <= 45; page++) {
        const struct axt_contract_report_t report = rig_report(r, page);
        CHECK_EQUAL(report.page, page);
        CHECK_EQUAL(report.flags, 0);
    }
    CHECK(rig_report(r, 32).estimate_i1 == 0);
    free(r);
}

CASE(the_estimate_outlives_the_excitation_until_it_is_reset) {
    rig *r = rig_excited();
    rig_run(r, 10000);
    CHECK_EQUAL(rig_tell(r, EXCITATION_OFF, 0), 0);
    rig_run(r, 5000);
    const struct axt_contract_report_t k = rig_report(r, 38);
    const struct axt_contract_report_t error = rig_report(r, 39);
    rig_run(r, 30000);
    CHECK_EQUAL(rig_report(r, 38).flags, 1);
    CHECK(rig_report(r, 38).sequence != k.sequence);
    CHECK(rig_report(r, 38).estimate_k == k.estimate_k);
    CHECK(rig_report(r, 39).error_k == error.error_k); /* standing still does not make it surer */
    CHECK_EQUAL(rig_tell(r, ESTIMATOR_RESET, 0), 0);
    rig_run(r, 5000);
    CHECK_EQUAL(rig_report(r, 38).flags, 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), 0);
    rig_run(r, 10000);
    CHECK_EQUAL(rig_report(r, 38).flags, 1);
    CHECK_NEAR(rig_report(r, 38).estimate_k / 110, 1, 2e-3);
    free(r);
}

int main(void) {
    RUN(torque_is_rounded_to_the_wire_and_limited_to_it);
    RUN(quantising_what_is_on_the_grid_changes_nothing);
    RUN(the_checksum_is_that_of_ieee_802_3);
    RUN(a_node_boots_up_and_beats_ten_times_a_second);
    RUN(streaming_is_the_operational_state);
    RUN(a_stopped_node_leaves_the_axis_without_torque_and_says_so);
    RUN(a_broken_bus_is_reported_and_does_not_stop_the_axis);
    RUN(settings_that_make_no_sense_are_refused);
    RUN(the_stream_is_what_the_axis_saw_with_no_gap);
    RUN(the_stream_shows_torque_and_status_of_the_excitation);
    RUN(the_counter_follows_the_control_period);
    RUN(what_finds_no_room_is_counted_and_shows_in_the_counter);
    RUN(nobody_listening_is_no_loss);
    RUN(a_sample_split_by_a_full_bus_is_not_torn);
    RUN(room_tells_whether_the_next_sample_would_be_lost);
    RUN(a_classical_bus_refuses_the_fd_stream);
    RUN(an_fd_bus_carries_every_control_period);
    RUN(what_finds_no_room_on_an_fd_bus_is_whole_frames_and_counted);
    RUN(changing_the_kind_of_stream_loses_nothing_silently);
    RUN(the_status_of_a_frame_is_that_of_its_last_sample_and_any_limit);
    RUN(every_code_is_answered_and_only_known_ones_are_done);
    RUN(arguments_out_of_range_are_refused);
    RUN(a_short_command_is_out_of_range_and_an_empty_one_nothing);
    RUN(commands_for_others_are_not_heard);
    RUN(commands_in_a_row_are_all_answered_in_order);
    RUN(identify_tells_what_the_node_is);
    RUN(counters_come_every_second);
    RUN(samples_that_the_estimator_refuses_are_counted_by_their_reason);
    RUN(the_excitation_is_the_one_that_was_set);
    RUN(changing_the_excitation_never_plays_an_unfinished_table);
    RUN(the_table_is_not_written_while_the_tick_may_play_it);
    RUN(torque_beyond_the_wire_is_limited_and_flagged);
    RUN(a_trace_is_what_the_axis_saw_bit_for_bit);
    RUN(a_trace_survives_a_slow_bus_and_a_live_stream);
    RUN(an_upload_can_begin_anywhere_and_be_repeated);
    RUN(a_trace_can_be_given_up);
    RUN(a_new_trace_is_not_taken_for_the_last_one);
    RUN(the_estimate_knows_how_the_torque_is_held);
    RUN(the_estimate_is_that_of_the_axis_and_says_how_sure_it_is);
    RUN(an_estimate_is_one_snapshot_of_fourteen_pages_five_times_a_second);
    RUN(friction_is_told_from_none_by_its_t_value);
    RUN(a_load_that_changes_rings_the_drift_alarm);
    RUN(without_excitation_there_is_no_estimate);
    RUN(the_estimate_outlives_the_excitation_until_it_is_reset);
    return REPORT();
}
