/* The node as a drive: its state, its host's heartbeat, its limits, and what it refuses. */
#include "axt_node.h"

#include <math.h>

#include "node_rig.h"
#include "reference.h"

enum { EXCITATION_RMS = 21, EXCITATION_ON = 22, EXCITATION_OFF = 23 };
enum { TRACE_ARM = 32, TRACE_UPLOAD, TRACE_ABORT, TRACE_TRIGGER, TRACE_SOURCE, TRACE_LEVEL };
enum { TRACE_PRETRIGGER = 38, TRACE_DECIMATION };
enum { TORQUE_LIMIT = 48, SPEED_LIMIT, TRAVEL_MIN, TRAVEL_MAX, HOST_HEARTBEAT };
enum { DISABLE_VOLTAGE = 0x00, QUICK_STOP = 0x02, SHUTDOWN = 0x06, SWITCH_ON = 0x07 };
enum { ENABLE_OPERATION = 0x0F, FAULT_RESET = 0x80 };
enum { HEARTBEAT_LOST = 0x8130, BUS_OFF_RECOVERED = 0x8140, TOO_FAST = 0x8400, TOO_FAR = 0x8600 };

static const axt_cia402_state states[] = {
    AXT_CIA402_SWITCH_ON_DISABLED, AXT_CIA402_READY,
    AXT_CIA402_SWITCHED_ON,        AXT_CIA402_OPERATION_ENABLED,
    AXT_CIA402_QUICK_STOP_ACTIVE,  AXT_CIA402_FAULT};

/* A rig with a host, in a state. Fault is that of a speed limit which any speed is beyond. */
static rig *rig_in(axt_cia402_state state) {
    rig *r = rig_new();
    if (state == AXT_CIA402_FAULT) {
        r->config.limits.speed = 1;
    }
    CHECK_EQUAL(rig_start(r), AXT_OK);
    r->host = true;
    rig_beat(r, AXT_CONTRACT_HOST_ID);
    rig_run(r, 2);
    if (state != AXT_CIA402_SWITCH_ON_DISABLED) {
        rig_control(r, SHUTDOWN, 0);
    }
    if (state != AXT_CIA402_SWITCH_ON_DISABLED && state != AXT_CIA402_READY) {
        rig_control(r, SWITCH_ON, 0);
    }
    if (state == AXT_CIA402_OPERATION_ENABLED || state == AXT_CIA402_QUICK_STOP_ACTIVE) {
        rig_control(r, ENABLE_OPERATION, 0);
    }
    if (state == AXT_CIA402_QUICK_STOP_ACTIVE) {
        rig_control(r, QUICK_STOP, 0);
    }
    if (state == AXT_CIA402_FAULT) {
        rig_control(r, ENABLE_OPERATION, 1000);
        rig_run(r, 100);
    }
    CHECK_EQUAL(rig_state(r), state);
    rig_forget_sent(r);
    return r;
}

/* The error codes of the emergencies sent, newest first; -1 where there are no more. */
static int emergency(const rig *r, uint32_t newest) {
    for (uint32_t i = r->sent_count; i > 0; i--) {
        if (r->sent[i - 1].id == 0x080 + RIG_ID) {
            if (newest == 0) {
                return r->sent[i - 1].data[0] | r->sent[i - 1].data[1] << 8;
            }
            newest--;
        }
    }
    return -1;
}

static int32_t cause(const rig *r) {
    struct axt_contract_emergency_t found = {0};
    for (uint32_t i = r->sent_count; i > 0; i--) {
        if (r->sent[i - 1].id == 0x080 + RIG_ID) {
            (void)axt_contract_emergency_unpack(&found, r->sent[i - 1].data, 8);
            break;
        }
    }
    return found.cause;
}

static axt_real torque_of_last_period(const rig *r) {
    return r->log[r->log_count - 1].torque;
}

/* ---- States ---------------------------------------------------------------------------------- */

/* Each control word from each state: where axt_cia402_next() leads, else a refusal with the frame
 * as it was sent. */
CASE(the_drive_follows_its_control_words_and_says_what_it_refuses) {
    static const uint16_t words[] = {DISABLE_VOLTAGE,  QUICK_STOP,  SHUTDOWN, SWITCH_ON,
                                     ENABLE_OPERATION, FAULT_RESET, 0x000A,   0x0010};
    for (size_t s = 0; s < COUNT_OF(states); s++) {
        for (size_t w = 0; w < COUNT_OF(words); w++) {
            rig *r = rig_in(states[s]);
            axt_cia402_state expected = states[s];
            const bool follows = axt_cia402_next(states[s], 0, words[w], &expected);
            const uint32_t before = r->node.status;
            rig_control(r, words[w], 0);
            CHECK_EQUAL(rig_state(r), expected);
            const struct axt_contract_report_t refusal = rig_report(r, 254);
            CHECK_EQUAL(refusal.page == 254, !follows);
            if (!follows) {
                CHECK_EQUAL(refusal.sequence, AXT_NODE_NO_TRANSITION);
                CHECK_EQUAL(refusal.control_refused, words[w]);
            }
            CHECK_EQUAL(r->node.refused, follows ? 0 : 1);
            rig_run(r, 3);
            const struct axt_contract_report_t status = rig_report(r, 14);
            CHECK_EQUAL(status.page == 14, r->node.status != before);
            CHECK(status.page != 14 || status.status == (r->node.status & 0xFFFF));
            free(r);
        }
    }
}

CASE(not_ready_is_what_the_drive_is_before_its_first_sample) {
    rig *r = rig_running();
    CHECK_EQUAL(rig_state(r), AXT_CIA402_NOT_READY);
    axt_node_tick(&r->node);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_SWITCH_ON_DISABLED);
    free(r);
}

CASE(a_fault_is_reset_by_a_step_and_by_nothing_else) {
    rig *r = rig_in(AXT_CIA402_FAULT);
    rig_control(r, FAULT_RESET, 0);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_SWITCH_ON_DISABLED);
    CHECK_EQUAL(emergency(r, 0), 0); /* no error any more */
    rig_run(r, 3);
    CHECK_EQUAL(rig_report(r, 15).error, 0);
    CHECK_EQUAL(rig_report(r, 15).flags, 0);

    /* into fault again, with the bit still set: it has to fall first */
    rig_control(r, SHUTDOWN | FAULT_RESET, 0);
    rig_control(r, ENABLE_OPERATION | FAULT_RESET, 1000);
    rig_run(r, 100);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    rig_control(r, FAULT_RESET, 0);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    rig_control(r, DISABLE_VOLTAGE, 0);
    rig_control(r, FAULT_RESET, 0);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_SWITCH_ON_DISABLED);
    free(r);
}

/* Whatever control words come, in whatever state: torque acts in operation enabled alone, and the
 * state that a sample shows is the one it was applied in. */
CASE(no_torque_acts_unless_operation_is_enabled) {
    static const uint16_t words[] = {DISABLE_VOLTAGE, QUICK_STOP,       SHUTDOWN,
                                     SWITCH_ON,       ENABLE_OPERATION, FAULT_RESET};
    rig *r = rig_new();
    r->config.limits.speed = 3000;
    r->config.streaming = true;
    r->config.stream_decimation = 1;
    CHECK_EQUAL(rig_start(r), AXT_OK);
    r->host = true;
    rig_beat(r, AXT_CONTRACT_HOST_ID);
    uint64_t seed = 5;
    uint32_t acted = 0;
    uint32_t enabled = 0;
    for (uint32_t i = 0; i < 6000; i++) {
        const uint16_t word = words[random_bits(&seed) % COUNT_OF(words)];
        const int16_t torque = (int16_t)((int32_t)(random_bits(&seed) % 20001) - 10000);
        rig_control(r, word, torque);
        if (random_bits(&seed) % 4 == 0) {
            (void)rig_tell(r, EXCITATION_ON, 0);
        }
        rig_run(r, (uint32_t)(random_bits(&seed) % 5));
    }
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_table_t table;
        if (r->sent[i].id != 0x280 + RIG_ID) {
            continue;
        }
        (void)axt_contract_table_unpack(&table, r->sent[i].data, 8);
        const bool may = (table.status_word & 0x6F) == AXT_CIA402_OPERATION_ENABLED;
        const bool acts = r->log[table.counter].torque != 0;
        CHECK(may || !acts);
        CHECK(may || (table.status_word & AXT_NODE_EXCITED) == 0);
        enabled += may ? 1 : 0;
        acted += acts ? 1 : 0;
    }
    CHECK(enabled > 1000 && acted > 1000);
    free(r);
}

/* ---- Set-point and excitation ---------------------------------------------------------------- */

static double mean_torque(rig *r, uint32_t periods) {
    const uint32_t first = r->log_count;
    double sum = 0;
    rig_run(r, periods);
    for (uint32_t n = first; n < r->log_count; n++) {
        sum += (double)(r->log[n].torque / r->node.torque_unit);
    }
    return sum / periods;
}

CASE(the_torque_is_set_point_plus_excitation) {
    rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
    rig_control(r, ENABLE_OPERATION, -1234);
    CHECK(torque_of_last_period(r) == (axt_real)-1234 * r->node.torque_unit);
    rig_control(r, ENABLE_OPERATION, 100);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_DONE);
    rig_run(r, 200);
    CHECK((r->node.status & AXT_NODE_EXCITED) != 0);
    CHECK_NEAR(mean_torque(r, 256), 100, 0.5); /* the excitation itself has none over its period */
    CHECK_EQUAL(rig_tell(r, EXCITATION_OFF, 0), AXT_NODE_DONE);
    rig_run(r, 3);
    CHECK((r->node.status & AXT_NODE_EXCITED) == 0);
    CHECK(torque_of_last_period(r) == (axt_real)100 * r->node.torque_unit);
    free(r);
}

CASE(torque_and_excitation_are_refused_unless_operation_is_enabled) {
    for (size_t s = 0; s < COUNT_OF(states); s++) {
        if (states[s] == AXT_CIA402_OPERATION_ENABLED) {
            continue;
        }
        rig *r = rig_in(states[s]);
        CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_NOT_ENABLED);
        rig_control(r, DISABLE_VOLTAGE, 500); /* followed, but not its set-point */
        CHECK_EQUAL(rig_report(r, 254).sequence, AXT_NODE_NOT_ENABLED);
        CHECK_EQUAL(rig_report(r, 254).control_refused, 500 << 16);
        rig_run(r, 500);
        CHECK(torque_of_last_period(r) == 0);
        CHECK_EQUAL(rig_tell(r, EXCITATION_OFF, 0), AXT_NODE_DONE); /* is always safe */
        free(r);
    }
}

/* Whatever ends operation enabled ends the excitation and the set-point, at once and for good. */
CASE(set_point_and_excitation_end_with_operation) {
    static const uint16_t words[] = {DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON};
    for (size_t w = 0; w < COUNT_OF(words); w++) {
        rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
        rig_control(r, ENABLE_OPERATION, 300);
        CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_DONE);
        rig_run(r, 200);
        CHECK(torque_of_last_period(r) != 0);
        rig_control(r, words[w], 0);
        CHECK(torque_of_last_period(r) == 0);
        rig_enable(r);
        rig_run(r, 1000);
        CHECK(torque_of_last_period(r) == 0);
        CHECK((r->node.status & AXT_NODE_EXCITED) == 0);
        free(r);
    }
}

/* A table that is still being filled in when operation ends is not played when it is enabled again.
 */
CASE(an_excitation_that_was_being_prepared_is_dropped) {
    rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_DONE);
    rig_run(r, 5);
    rig_control(r, SHUTDOWN, 0);
    rig_enable(r);
    rig_run(r, 1000);
    CHECK(torque_of_last_period(r) == 0);
    free(r);
}

CASE(a_drive_that_was_enabled_where_it_stands_is_no_hosts_until_one_takes_over) {
    rig *r = rig_new();
    r->config.excited = true;
    CHECK_EQUAL(rig_start(r), AXT_OK);
    rig_run(r, 20000); /* 2 s without any host */
    CHECK_EQUAL(r->node.status, 0x0137);
    CHECK(torque_of_last_period(r) != 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_NOT_ENABLED);
    rig_control(r, ENABLE_OPERATION, 0); /* a host, without a heartbeat */
    rig_run(r, 3);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    CHECK_EQUAL(emergency(r, 0), HEARTBEAT_LOST);
    CHECK(torque_of_last_period(r) == 0);
    free(r);
}

/* ---- The host's heartbeat -------------------------------------------------------------------- */

CASE(operation_is_not_enabled_for_a_host_that_is_not_heard) {
    static const axt_cia402_state from[] = {AXT_CIA402_READY, AXT_CIA402_SWITCHED_ON,
                                            AXT_CIA402_QUICK_STOP_ACTIVE};
    for (size_t s = 0; s < COUNT_OF(from); s++) {
        rig *r = rig_in(from[s]);
        r->host = false;
        rig_run(r, 4001);
        rig_control(r, ENABLE_OPERATION, 0);
        CHECK_EQUAL(rig_state(r), from[s]);
        CHECK_EQUAL(rig_report(r, 254).sequence, AXT_NODE_NO_HOST_HEARTBEAT);
        rig_beat(r, AXT_CONTRACT_HOST_ID);
        rig_control(r, ENABLE_OPERATION, 0);
        CHECK_EQUAL(rig_state(r), AXT_CIA402_OPERATION_ENABLED);
        free(r);
    }
}

/* With the last heartbeat heard at the end of period n, torque acts for 400 ms and no longer. */
CASE(torque_stops_when_the_host_falls_silent) {
    static const uint32_t timeouts[] = {1, 50, 400};
    for (size_t i = 0; i < COUNT_OF(timeouts); i++) {
        rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
        rig_control(r, SWITCH_ON, 0);
        CHECK_EQUAL(rig_tell(r, HOST_HEARTBEAT, 127u << 16 | timeouts[i]), AXT_NODE_DONE);
        r->host = false;
        rig_beat(r, AXT_CONTRACT_HOST_ID);
        rig_control(r, ENABLE_OPERATION, 1000);
        rig_beat(r, AXT_CONTRACT_HOST_ID);
        rig_run(r, 1);
        const uint32_t heard = r->log_count;
        rig_run(r, 10000);
        uint32_t last = 0;
        for (uint32_t n = heard; n < r->log_count; n++) {
            last = (r->log[n].torque != 0) ? n : last;
        }
        CHECK_EQUAL(last - heard + 1, 10 * timeouts[i]);
        CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
        CHECK_EQUAL(emergency(r, 0), HEARTBEAT_LOST);
        CHECK_EQUAL(cause(r), timeouts[i]);
        CHECK_EQUAL(rig_report(r, 15).error, HEARTBEAT_LOST);
        CHECK_EQUAL(rig_report(r, 15).flags, 0x11); /* CiA 301 0x1001: generic, communication */
        CHECK_EQUAL(r->node.faults, 1);
        free(r);
    }
}

CASE(the_heartbeat_that_counts_is_that_of_the_host) {
    rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
    r->host = false;
    rig_control(r, ENABLE_OPERATION, 1000);
    for (int i = 0; i < 50; i++) { /* other nodes of the bus, and this one's own */
        rig_beat(r, 126);
        rig_beat(r, RIG_ID);
        rig_run(r, 100);
    }
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);

    /* unless it is told to listen to another */
    CHECK_EQUAL(rig_tell(r, HOST_HEARTBEAT, 126u << 16 | 400), AXT_NODE_DONE);
    rig_run(r, 2);
    CHECK_EQUAL(rig_report(r, 60).host_heartbeat, 126u << 16 | 400);
    rig_control(r, FAULT_RESET, 0);
    rig_control(r, SHUTDOWN, 0);
    rig_beat(r, 126);
    rig_control(r, ENABLE_OPERATION, 1000);
    for (int i = 0; i < 50; i++) {
        rig_beat(r, 126);
        rig_run(r, 100);
    }
    CHECK_EQUAL(rig_state(r), AXT_CIA402_OPERATION_ENABLED);
    free(r);
}

CASE(a_heartbeat_setting_is_one_that_can_be_kept) {
    static const struct {
        uint32_t consumer;
        int result;
    } settings[] = {{127u << 16 | 400, AXT_NODE_DONE},
                    {1u << 16 | 1, AXT_NODE_DONE},
                    {127u << 16 | 401, AXT_NODE_OUT_OF_RANGE},
                    {127u << 16, AXT_NODE_OUT_OF_RANGE},
                    {400, AXT_NODE_OUT_OF_RANGE},
                    {128u << 16 | 400, AXT_NODE_OUT_OF_RANGE},
                    {RIG_ID << 16 | 400, AXT_NODE_OUT_OF_RANGE}};
    rig *r = rig_in(AXT_CIA402_READY);
    for (size_t i = 0; i < COUNT_OF(settings); i++) {
        CHECK_EQUAL(rig_tell(r, HOST_HEARTBEAT, settings[i].consumer), settings[i].result);
        rig_forget_sent(r);
    }
    free(r);
}

/* ---- Limits ---------------------------------------------------------------------------------- */

CASE(torque_is_limited_whatever_is_asked_for) {
    rig *r = rig_in(AXT_CIA402_SWITCHED_ON);
    CHECK_EQUAL(rig_tell(r, TORQUE_LIMIT, 700), AXT_NODE_DONE);
    rig_control(r, ENABLE_OPERATION, 700);
    CHECK(torque_of_last_period(r) == (axt_real)700 * r->node.torque_unit);
    CHECK_EQUAL(r->node.limited, 0);
    rig_control(r, ENABLE_OPERATION, -32768);
    CHECK(torque_of_last_period(r) == (axt_real)-700 * r->node.torque_unit);
    CHECK(r->node.limited > 0);
    CHECK_EQUAL(rig_tell(r, EXCITATION_RMS, bits_of(2.0F)), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, EXCITATION_ON, 0), AXT_NODE_DONE);
    rig_run(r, 1000);
    const double most = (double)((axt_real)700 * r->node.torque_unit);
    for (uint32_t n = 0; n < r->log_count; n++) {
        CHECK(fabs((double)r->log[n].torque) <= most);
    }
    rig_control(r, DISABLE_VOLTAGE, 0);
    rig_run(r, 10000);
    CHECK_EQUAL(rig_report(r, 25).limited_samples, r->node.limited);
    free(r);
}

CASE(an_axis_that_is_too_fast_loses_its_torque) {
    rig *r = rig_in(AXT_CIA402_SWITCHED_ON);
    CHECK_EQUAL(rig_tell(r, SPEED_LIMIT, 300), AXT_NODE_DONE);
    rig_control(r, ENABLE_OPERATION, 500); /* 32 mN m on 35 mg m2: 300/min after 34 ms */
    rig_run(r, 2000);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    CHECK_EQUAL(emergency(r, 0), TOO_FAST);
    CHECK_EQUAL(rig_report(r, 15).flags, 0x21); /* generic, device profile */
    CHECK_NEAR(cause(r), 300, 20);
    CHECK(torque_of_last_period(r) == 0);
    double fastest = 0;
    for (uint32_t n = 1; n < r->log_count; n++) {
        const double turns = (r->log[n].position[0] - r->log[n - 1].position[0]) / 1048576.0;
        fastest = fmax(fastest, turns / rig_period * 60);
    }
    CHECK_NEAR(fastest, 300, 30); /* the shaft swings a little more than the mean */
    free(r);
}

CASE(an_axis_that_leaves_its_range_loses_its_torque_and_finds_back) {
    rig *r = rig_in(AXT_CIA402_SWITCHED_ON);
    CHECK_EQUAL(rig_tell(r, TRAVEL_MAX, 100000), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRAVEL_MIN, (uint32_t)-100000), AXT_NODE_DONE);
    rig_control(r, ENABLE_OPERATION, 500);
    rig_run(r, 1500);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    CHECK_EQUAL(emergency(r, 0), TOO_FAR);
    CHECK(cause(r) > 100000 && cause(r) < 110000);
    CHECK(torque_of_last_period(r) == 0);

    rig_control(r, FAULT_RESET, 0);
    rig_enable(r);
    rig_control(r, ENABLE_OPERATION, 500);
    CHECK(torque_of_last_period(r) == 0); /* outwards */
    CHECK_EQUAL(rig_state(r), AXT_CIA402_OPERATION_ENABLED);
    const uint32_t before = r->log_count;
    rig_control(r, ENABLE_OPERATION, -500);
    CHECK(torque_of_last_period(r) == (axt_real)-500 * r->node.torque_unit);
    while (r->log[r->log_count - 1].position[0] > 90000 && r->log_count < before + 20000) {
        rig_run(r, 1);
    }
    CHECK_EQUAL(rig_state(r), AXT_CIA402_OPERATION_ENABLED);
    CHECK(r->log[r->log_count - 1].position[0] <= 90000);
    free(r);
}

CASE(limits_are_those_built_in_or_closer_ones) {
    rig *r = rig_new();
    r->config.limits =
        (axt_limits){.torque = 10000, .speed = 3000, .travel_min = -5000, .travel_max = 5000};
    CHECK_EQUAL(rig_start(r), AXT_OK);
    static const struct {
        uint8_t code;
        int32_t value;
        int result;
    } settings[] = {
        {TORQUE_LIMIT, 10001, AXT_NODE_OUT_OF_RANGE},
        {TORQUE_LIMIT, 10000, AXT_NODE_DONE},
        {TORQUE_LIMIT, 0, AXT_NODE_DONE},
        {SPEED_LIMIT, 3001, AXT_NODE_OUT_OF_RANGE},
        {SPEED_LIMIT, 0, AXT_NODE_OUT_OF_RANGE},
        {SPEED_LIMIT, 1, AXT_NODE_DONE},
        {TRAVEL_MIN, -5001, AXT_NODE_OUT_OF_RANGE},
        {TRAVEL_MIN, 5001, AXT_NODE_OUT_OF_RANGE},
        {TRAVEL_MAX, 5001, AXT_NODE_OUT_OF_RANGE},
        {TRAVEL_MIN, 100, AXT_NODE_DONE},
        {TRAVEL_MAX, 99, AXT_NODE_OUT_OF_RANGE},
        {TRAVEL_MAX, 100, AXT_NODE_DONE},
    };
    for (size_t i = 0; i < COUNT_OF(settings); i++) {
        CHECK_EQUAL(rig_tell(r, settings[i].code, (uint32_t)settings[i].value), settings[i].result);
        rig_forget_sent(r);
    }
    CHECK_EQUAL(rig_tell(r, 1, 0), AXT_NODE_DONE);
    rig_run(r, 3);
    CHECK_EQUAL(rig_report(r, 56).torque_limit, 0);
    CHECK_EQUAL(rig_report(r, 57).speed_limit, 1);
    CHECK_EQUAL(rig_report(r, 58).travel_min, 100);
    CHECK_EQUAL(rig_report(r, 59).travel_max, 100);
    free(r);

    r = rig_in(AXT_CIA402_OPERATION_ENABLED);
    for (uint32_t code = TORQUE_LIMIT; code <= HOST_HEARTBEAT; code++) {
        CHECK_EQUAL(rig_tell(r, (uint8_t)code, 0), AXT_NODE_NOT_WHILE_ENABLED);
        rig_forget_sent(r);
    }
    free(r);
}

/* ---- Bus ------------------------------------------------------------------------------------- */

CASE(control_frames_that_are_not_whole_are_refused) {
    rig *r = rig_in(AXT_CIA402_READY);
    for (uint8_t length = 1; length < 4; length++) {
        rig_offer(r, (axt_can_frame){.id = AXT_CONTRACT_CONTROL_FRAME_ID + RIG_ID,
                                     .length = length,
                                     .data = {SWITCH_ON}});
        rig_run(r, 3);
        CHECK_EQUAL(rig_report(r, 254).sequence, AXT_NODE_OUT_OF_RANGE);
        CHECK_EQUAL(rig_state(r), AXT_CIA402_READY);
        rig_forget_sent(r);
    }
    free(r);
}

/* Ten control words at once, the bus full: each is carried out, and each refusal is said. */
CASE(control_words_in_a_row_are_all_followed_or_refused) {
    static const uint16_t words[] = {SHUTDOWN,  SWITCH_ON,  0x000A,    ENABLE_OPERATION, SHUTDOWN,
                                     SWITCH_ON, QUICK_STOP, SWITCH_ON, QUICK_STOP,       SHUTDOWN};
    rig *r = rig_in(AXT_CIA402_SWITCH_ON_DISABLED);
    for (size_t i = 0; i < COUNT_OF(words); i++) {
        rig_offer(r, (axt_can_frame){.id = AXT_CONTRACT_CONTROL_FRAME_ID + RIG_ID,
                                     .length = 4,
                                     .data = {(uint8_t)words[i], 0, 0, 0}});
    }
    for (int i = 0; i < 300; i++) {
        r->room = (i % 4 == 0) ? 1 : 0;
        rig_run(r, 1);
    }
    CHECK_EQUAL(rig_state(r), AXT_CIA402_READY);
    uint32_t refused = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        refused += (r->sent[i].id == 0x380 + RIG_ID && r->sent[i].data[0] == 254) ? 1 : 0;
    }
    CHECK_EQUAL(refused, 2); /* switch on after the quick stop that led to switch on disabled */
    CHECK_EQUAL(r->node.refused, 2);
    free(r);
}

CASE(a_node_that_was_off_the_bus_says_so_when_it_is_back) {
    rig *r = rig_in(AXT_CIA402_READY);
    r->can.health.bus_off = 1;
    r->can.health.state = AXT_CAN_STATE_BUS_OFF;
    rig_run(r, 100);
    CHECK_EQUAL(emergency(r, 0), -1);
    r->can.health.state = AXT_CAN_STATE_ACTIVE;
    rig_run(r, 100);
    CHECK_EQUAL(emergency(r, 0), BUS_OFF_RECOVERED);
    CHECK_EQUAL(cause(r), 1);
    CHECK_EQUAL(emergency(r, 1), -1);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_READY);
    free(r);
}

CASE(a_node_whose_last_run_ended_in_a_fault_starts_in_it) {
    rig *r = rig_new();
    r->config.error_code = AXT_CONTRACT_EMERGENCY_ERROR_CODE_INTERNAL_SOFTWARE_CHOICE;
    r->config.error_cause = 0x1234;
    r->config.excited = true; /* but not now */
    CHECK_EQUAL(rig_start(r), AXT_OK);
    rig_run(r, 1000);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_FAULT);
    CHECK_EQUAL(emergency(r, 0), AXT_CONTRACT_EMERGENCY_ERROR_CODE_INTERNAL_SOFTWARE_CHOICE);
    CHECK_EQUAL(emergency(r, 1), -1);
    CHECK_EQUAL(cause(r), 0x1234);
    CHECK_EQUAL(r->node.faults, 1);
    CHECK_EQUAL(torque_of_last_period(r), 0);
    rig_control(r, FAULT_RESET, 0);
    CHECK_EQUAL(rig_state(r), AXT_CIA402_SWITCH_ON_DISABLED);
    rig_enable(r);
    free(r);
}

/* What a carrier's filters must let through, and an example of what they need not. */
CASE(filters_let_through_what_the_node_listens_to) {
    axt_can_filter filters[AXT_NODE_FILTERS];
    for (uint32_t id = 1; id <= AXT_NODE_ID_MAX; id++) {
        axt_node_filters((uint8_t)id, filters);
        for (uint32_t frame = 0; frame < 0x800; frame++) {
            bool passes = false;
            for (size_t i = 0; i < COUNT_OF(filters); i++) {
                passes = passes || (frame & filters[i].mask) == (filters[i].id & filters[i].mask);
            }
            const bool heard =
                frame == 0x200 + id || frame == 0x300 + id || (frame >= 0x700 && frame <= 0x77F);
            CHECK_EQUAL(passes, heard);
        }
        CHECK((filters[0].mask & AXT_CAN_EXTENDED) != 0 && (filters[0].mask & AXT_CAN_REMOTE) != 0);
    }
}

/* ---- Trace ----------------------------------------------------------------------------------- */

/* Runs until the trace is ready and all of it has been sent. */
static void fetch(rig *r, uint32_t length) {
    for (int i = 0; i < 20000 && r->node.trace_state != AXT_NODE_TRACE_READY; i++) {
        rig_run(r, 1);
    }
    rig_run(r, 3);
    CHECK_EQUAL(r->node.trace_state, AXT_NODE_TRACE_READY);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), AXT_NODE_DONE);
    rig_run(r, 2 * length);
}

CASE(a_trace_shows_what_led_to_a_fault) {
    rig *r = rig_in(AXT_CIA402_SWITCHED_ON);
    CHECK_EQUAL(rig_tell(r, SPEED_LIMIT, 300), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_TRIGGER, 5), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_PRETRIGGER, 150), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_DECIMATION, 2), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 150), AXT_NODE_OUT_OF_RANGE); /* none left after it */
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 200), AXT_NODE_DONE);
    rig_run(r, 1000);
    CHECK_EQUAL(rig_report(r, 8).flags, AXT_NODE_TRACE_ARMED);
    CHECK_EQUAL(rig_tell(r, TRACE_UPLOAD, 0), AXT_NODE_NOT_NOW);
    rig_control(r, ENABLE_OPERATION, 500);
    fetch(r, 200);
    CHECK_EQUAL(rig_report(r, 10).trace_triggered, 150);
    CHECK_EQUAL(rig_report(r, 11).trace_decimation, 2);
    const uint32_t start = rig_report(r, 12).trace_start;
    uint32_t frames = 0;
    for (uint32_t i = 0; i < r->sent_count; i++) {
        struct axt_contract_trace_t trace;
        if (r->sent[i].id != 0x480 + RIG_ID) {
            continue;
        }
        (void)axt_contract_trace_unpack(&trace, r->sent[i].data, 8);
        CHECK_EQUAL(trace.index, frames / 2);
        const rig_period_log *saw = &r->log[start + 2 * trace.index];
        if (trace.channel == 0) {
            CHECK_EQUAL(trace.motor_position, saw->position[0]);
            CHECK((axt_real)trace.torque * r->node.torque_unit == saw->torque);
        } else {
            CHECK_EQUAL(trace.table_position, saw->position[1]);
            CHECK_EQUAL((trace.status_word & 0x08) != 0, trace.index >= 150);
        }
        frames++;
    }
    CHECK_EQUAL(frames, 400);
    free(r);
}

CASE(a_trace_waits_for_its_trigger_and_can_be_given_up) {
    rig *r = rig_in(AXT_CIA402_OPERATION_ENABLED);
    CHECK_EQUAL(rig_tell(r, TRACE_TRIGGER, 1), AXT_NODE_DONE); /* rising */
    CHECK_EQUAL(rig_tell(r, TRACE_SOURCE, 0), AXT_NODE_DONE);  /* torque */
    CHECK_EQUAL(rig_tell(r, TRACE_LEVEL, 400), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_PRETRIGGER, 10), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 30), AXT_NODE_DONE);
    rig_control(r, ENABLE_OPERATION, 399);
    rig_run(r, 500);
    CHECK_EQUAL(r->node.trace_state, AXT_NODE_TRACE_ARMED);
    CHECK_EQUAL(rig_tell(r, TRACE_ABORT, 0), AXT_NODE_DONE);
    rig_control(r, ENABLE_OPERATION, 0);
    rig_control(r, ENABLE_OPERATION, 500);
    rig_run(r, 100);
    CHECK_EQUAL(r->node.trace_state, AXT_NODE_TRACE_IDLE);

    rig_control(r, ENABLE_OPERATION, 0);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, 30), AXT_NODE_DONE);
    rig_run(r, 50);
    rig_control(r, ENABLE_OPERATION, 400);
    fetch(r, 30);
    CHECK_EQUAL(rig_report(r, 10).trace_triggered, 10);
    const uint32_t start = rig_report(r, 12).trace_start;
    CHECK(r->log[start + 9].torque == 0);
    CHECK(r->log[start + 10].torque == (axt_real)400 * r->node.torque_unit);
    free(r);
}

CASE(trace_settings_that_make_no_sense_are_refused) {
    rig *r = rig_in(AXT_CIA402_READY);
    CHECK_EQUAL(rig_tell(r, TRACE_TRIGGER, 6), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, TRACE_SOURCE, 3), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, TRACE_DECIMATION, 0), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, TRACE_PRETRIGGER, RIG_TRACE), AXT_NODE_NO_ROOM);
    CHECK_EQUAL(rig_tell(r, TRACE_PRETRIGGER, RIG_TRACE - 1), AXT_NODE_DONE);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, RIG_TRACE - 1), AXT_NODE_OUT_OF_RANGE);
    CHECK_EQUAL(rig_tell(r, TRACE_ARM, RIG_TRACE), AXT_NODE_DONE);
    free(r);
}

int main(void) {
    RUN(the_drive_follows_its_control_words_and_says_what_it_refuses);
    RUN(not_ready_is_what_the_drive_is_before_its_first_sample);
    RUN(a_fault_is_reset_by_a_step_and_by_nothing_else);
    RUN(no_torque_acts_unless_operation_is_enabled);
    RUN(the_torque_is_set_point_plus_excitation);
    RUN(torque_and_excitation_are_refused_unless_operation_is_enabled);
    RUN(set_point_and_excitation_end_with_operation);
    RUN(an_excitation_that_was_being_prepared_is_dropped);
    RUN(a_drive_that_was_enabled_where_it_stands_is_no_hosts_until_one_takes_over);
    RUN(operation_is_not_enabled_for_a_host_that_is_not_heard);
    RUN(torque_stops_when_the_host_falls_silent);
    RUN(the_heartbeat_that_counts_is_that_of_the_host);
    RUN(a_heartbeat_setting_is_one_that_can_be_kept);
    RUN(torque_is_limited_whatever_is_asked_for);
    RUN(an_axis_that_is_too_fast_loses_its_torque);
    RUN(an_axis_that_leaves_its_range_loses_its_torque_and_finds_back);
    RUN(limits_are_those_built_in_or_closer_ones);
    RUN(control_frames_that_are_not_whole_are_refused);
    RUN(control_words_in_a_row_are_all_followed_or_refused);
    RUN(a_node_that_was_off_the_bus_says_so_when_it_is_back);
    RUN(a_node_whose_last_run_ended_in_a_fault_starts_in_it);
    RUN(filters_let_through_what_the_node_listens_to);
    RUN(a_trace_shows_what_led_to_a_fault);
    RUN(a_trace_waits_for_its_trigger_and_can_be_given_up);
    RUN(trace_settings_that_make_no_sense_are_refused);
    return REPORT();
}
