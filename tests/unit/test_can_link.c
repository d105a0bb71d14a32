/* A bus of SLCAN lines over a carrier of bytes: splits, back-pressure, hosts that come and go. And
 * the pace of a virtual bus. */
#include "axt_can.h"
#include "axt_can_pace.h"
#include "axt_slcan_link.h"

#include "check.h"

/* A carrier whose two directions are buffers in memory. */
typedef struct {
    char to_node[4096];
    uint32_t to_node_length;
    uint32_t taken;   /* of to_node */
    uint32_t portion; /* bytes a read or write moves at most */
    char to_host[8192];
    uint32_t to_host_length;
    uint32_t room; /* in to_host */
    bool unplugged;
} wire;

static int32_t wire_read(void *context, char *bytes, uint32_t size) {
    wire *w = context;
    if (w->unplugged) {
        return AXT_CAN_CLOSED;
    }
    uint32_t count = w->to_node_length - w->taken;
    count = (count < size) ? count : size;
    count = (count < w->portion) ? count : w->portion;
    memcpy(bytes, w->to_node + w->taken, count);
    w->taken += count;
    return (int32_t)count;
}

static int32_t wire_write(void *context, const char *bytes, uint32_t size) {
    wire *w = context;
    if (w->unplugged) {
        return AXT_CAN_CLOSED;
    }
    uint32_t count = (size < w->room) ? size : w->room;
    count = (count < w->portion) ? count : w->portion;
    memcpy(w->to_host + w->to_host_length, bytes, count);
    w->to_host_length += count;
    w->room -= count;
    return (int32_t)count;
}

static uint32_t wire_milliseconds(void *context) {
    (void)context;
    return 0;
}

static void connect(axt_slcan_link *link, wire *w, uint32_t portion) {
    memset(w, 0, sizeof *w);
    w->portion = portion;
    w->room = sizeof w->to_host;
    const axt_slcan_carrier carrier = {
        .read = wire_read, .write = wire_write, .milliseconds = wire_milliseconds, .context = w};
    axt_slcan_link_init(link, &carrier);
}

static void host_writes(wire *w, const char *text) {
    memcpy(w->to_node + w->to_node_length, text, strlen(text));
    w->to_node_length += (uint32_t)strlen(text);
}

static bool host_has(const wire *w, const char *text) {
    return w->to_host_length == strlen(text) && memcmp(w->to_host, text, strlen(text)) == 0;
}

CASE(lines_may_be_split_anywhere) {
    static const char session[] = "\r\rC\rS8\rO\rt2018010203040506AABB\rr1230\rT000000011FF\rV\r";
    for (uint32_t portion = 1; portion <= sizeof session; portion++) {
        axt_slcan_link link;
        wire w;
        connect(&link, &w, portion);
        host_writes(&w, session);
        axt_can_frame frames[4] = {0};
        uint32_t count = 0;
        for (int i = 0; i < 300; i++) {
            axt_can_frame frame;
            if (link.can.receive(&link.can, &frame) == AXT_CAN_OK && count < 4) {
                frames[count] = frame;
                count++;
            }
        }
        CHECK_EQUAL(count, 3);
        CHECK_EQUAL(frames[0].id, 0x201);
        CHECK_EQUAL(frames[0].length, 8);
        CHECK_EQUAL(frames[0].data[7], 0xBB);
        CHECK_EQUAL(frames[1].id, 0x123 | AXT_CAN_REMOTE);
        CHECK_EQUAL(frames[2].id, 1 | AXT_CAN_EXTENDED);
        CHECK(host_has(&w, "\r\r\a\r\rz\rz\rZ\rV1010\r"));
    }
}

CASE(frames_find_nobody_until_the_channel_is_open) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 100);
    const axt_can_frame frame = {.id = 0x181, .length = 2, .data = {0x12, 0x34}};
    axt_can_frame received;
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_CLOSED);
    host_writes(&w, "O\r");
    CHECK_EQUAL(link.can.receive(&link.can, &received), AXT_CAN_WOULD_BLOCK);
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_OK);
    CHECK_EQUAL(link.can.receive(&link.can, &received), AXT_CAN_WOULD_BLOCK);
    CHECK(host_has(&w, "\rt18121234\r"));
    const axt_can_frame too_long = {.length = 9};
    CHECK_EQUAL(link.can.send(&link.can, &too_long), AXT_CAN_ERROR_FRAME);
}

/* A host that stops reading blocks the bus, loses nothing that was accepted, and sees the flag. */
CASE(a_full_carrier_blocks_and_loses_nothing) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 1000);
    host_writes(&w, "O\r");
    axt_can_frame received;
    (void)link.can.receive(&link.can, &received);
    (void)link.can.receive(&link.can, &received);
    CHECK(host_has(&w, "\r"));
    w.to_host_length = 0;
    w.room = 0;
    uint32_t accepted = 0;
    axt_can_frame frame = {.id = 0x181, .length = 1};
    while (link.can.send(&link.can, &frame) == AXT_CAN_OK && accepted < 1000) {
        accepted++;
        frame.data[0]++;
    }
    CHECK(accepted > 10 && accepted < 1000);
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_WOULD_BLOCK);
    w.room = sizeof w.to_host;
    (void)link.can.receive(&link.can, &received);
    (void)link.can.receive(&link.can, &received);
    CHECK_EQUAL(w.to_host_length, 8 * accepted);
    for (uint32_t i = 0; i < accepted; i++) {
        char expected[16];
        (void)snprintf(expected, sizeof expected, "t1811%02X\r", i);
        CHECK(memcmp(w.to_host + (size_t)8 * i, expected, 8) == 0);
    }
    w.to_host_length = 0;
    host_writes(&w, "F\r");
    (void)link.can.receive(&link.can, &received);
    (void)link.can.receive(&link.can, &received);
    CHECK(host_has(&w, "F01\r"));
}

CASE(a_line_that_is_garbled_is_counted_and_the_next_one_understood) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 1000);
    host_writes(&w, "O\rt20180102\x80\r\x01\x02t2011\rt2011AA\r");
    axt_can_frame received = {0};
    CHECK_EQUAL(link.can.receive(&link.can, &received), AXT_CAN_OK);
    CHECK_EQUAL(received.data[0], 0xAA);
    CHECK_EQUAL(link.can.health.error_frames, 2);
}

CASE(fd_frames_go_both_ways) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 1000);
    CHECK(link.can.fd);
    host_writes(&w, "O\rb2019000102030405060708090A0B\r");
    axt_can_frame frame = {0};
    CHECK_EQUAL(link.can.receive(&link.can, &frame), AXT_CAN_OK);
    CHECK(frame.fd);
    CHECK_EQUAL(frame.length, 12);
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_OK);
    (void)link.can.receive(&link.can, &frame);
    CHECK(host_has(&w, "\rz\rb2019000102030405060708090A0B\r"));
    frame.length = 13;
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_ERROR_FRAME);
}

/* A host that asks and does not read the answers has to wait; nothing overflows. */
CASE(answers_wait_for_room) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 1000);
    w.room = 0;
    axt_can_frame received;
    for (int i = 0; i < 1000; i++) {
        host_writes(&w, "V\r");
    }
    for (int i = 0; i < 100; i++) {
        CHECK_EQUAL(link.can.receive(&link.can, &received), AXT_CAN_WOULD_BLOCK);
    }
    CHECK(w.taken < w.to_node_length);
    w.room = sizeof w.to_host;
    for (int i = 0; i < 100; i++) {
        (void)link.can.receive(&link.can, &received);
    }
    CHECK_EQUAL(w.to_host_length, 6000);
}

CASE(the_next_host_finds_an_adapter_just_plugged_in) {
    axt_slcan_link link;
    wire w;
    connect(&link, &w, 100);
    const axt_can_frame frame = {.id = 0x181};
    axt_can_frame received;
    host_writes(&w, "Z1\rO\rt12");
    (void)link.can.receive(&link.can, &received);
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_OK);
    w.unplugged = true;
    CHECK_EQUAL(link.can.receive(&link.can, &received), AXT_CAN_CLOSED);
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_CLOSED);
    w.unplugged = false;
    w.to_host_length = 0;
    host_writes(&w, "O\r");
    (void)link.can.receive(&link.can, &received);
    (void)link.can.receive(&link.can, &received);
    CHECK(host_has(&w, "\r")); /* neither the frame nor the rest of a line is left over */
    CHECK_EQUAL(link.can.send(&link.can, &frame), AXT_CAN_OK);
    (void)link.can.receive(&link.can, &received);
    CHECK(host_has(&w, "\rt1810\r"));
}

static const axt_can_bit_rates one_megabit = {.nominal = 1000000, .data = 5000000};

/* ISO 11898-1: 44 bits and 8 a byte from start to end of frame, 3 between frames, at most one stuff
 * bit for every four after the first of the 34 and 8 a byte that are stuffed. */
CASE(a_frame_takes_its_longest_time) {
    const axt_can_frame longest = {.id = 0x181, .length = 8};
    const axt_can_frame empty = {.id = 0x181, .length = 0};
    const axt_can_frame remote = {.id = 0x181 | AXT_CAN_REMOTE, .length = 8};
    const axt_can_frame extended = {.id = 0x181 | AXT_CAN_EXTENDED, .length = 8};
    const uint64_t bit = 1000; /* [ns] */
    CHECK_EQUAL(axt_can_frame_time(&longest, &one_megabit), (44 + 64 + 3 + 24) * bit);
    CHECK_EQUAL(axt_can_frame_time(&empty, &one_megabit), (44 + 3 + 8) * bit);
    CHECK_EQUAL(axt_can_frame_time(&remote, &one_megabit), (44 + 3 + 8) * bit);
    CHECK_EQUAL(axt_can_frame_time(&extended, &one_megabit), (64 + 64 + 3 + 29) * bit);
}

/* The same of FD frames, field by field: SOF 1, identifier 11, RRS, IDE, FDF, res, BRS; at the data
 * rate ESI, code 4, data, stuff count 4 and CRC with a fixed stuff bit before every four,
 * delimiter; acknowledge 2, end 7, intermission 3. */
CASE(an_fd_frame_takes_its_longest_time_at_two_rates) {
    const axt_can_frame longest = {.id = 0x401, .length = 64, .fd = true};
    const axt_can_frame empty = {.id = 0x401, .length = 0, .fd = true};
    const axt_can_frame extended = {.id = 0x401 | AXT_CAN_EXTENDED, .length = 16, .fd = true};
    const uint64_t bit = 1000;
    const uint64_t fast = 200;
    CHECK_EQUAL(axt_can_frame_time(&longest, &one_megabit),
                (17 + 4 + 12) * bit + (5 + 512 + 129 + 4 + 21 + 7 + 1) * fast);
    CHECK_EQUAL(axt_can_frame_time(&empty, &one_megabit),
                (17 + 4 + 12) * bit + (5 + 1 + 4 + 17 + 6 + 1) * fast);
    CHECK_EQUAL(axt_can_frame_time(&extended, &one_megabit),
                (36 + 8 + 12) * bit + (5 + 128 + 34 + 4 + 17 + 6 + 1) * fast);
}

static uint32_t sent_in(axt_can_pace *pace, wire *w, uint32_t steps, uint64_t nanoseconds) {
    const axt_can_frame frame = {.id = 0x181, .length = 8};
    axt_can_frame received;
    uint32_t sent = 0;
    for (uint32_t i = 0; i < steps; i++) {
        axt_can_pace_elapse(pace, nanoseconds);
        while (pace->can.send(&pace->can, &frame) == AXT_CAN_OK) {
            sent++;
        }
        (void)pace->can.receive(&pace->can, &received);
        w->to_host_length = 0;
        w->room = sizeof w->to_host;
    }
    return sent;
}

CASE(a_paced_bus_carries_what_its_bit_rate_allows) {
    static const uint32_t bit_rates[] = {1000, 125000, 1000000};
    for (int i = 0; i < 3; i++) {
        axt_slcan_link link;
        axt_can_pace pace;
        wire w;
        connect(&link, &w, 4096);
        host_writes(&w, "O\r");
        axt_can_frame received;
        (void)link.can.receive(&link.can, &received);
        const axt_can_bit_rates rates = {.nominal = bit_rates[i], .data = bit_rates[i]};
        axt_can_pace_init(&pace, &link.can, &rates);
        CHECK_NEAR(sent_in(&pace, &w, 10000, 1000000), 10.0 * bit_rates[i] / 135, 1);
        /* a pause is not made up for by more than 10 ms of the bus, or its longest frame */
        const axt_can_frame longest = {.id = AXT_CAN_EXTENDED, .length = 64, .fd = true};
        const axt_can_frame usual = {.id = 0x181, .length = 8};
        const double saved = fmax(1e7, (double)axt_can_frame_time(&longest, &rates));
        axt_can_pace_elapse(&pace, UINT64_MAX);
        CHECK(sent_in(&pace, &w, 1, 1) <= 1 + saved / (double)axt_can_frame_time(&usual, &rates));
    }
}

CASE(a_closed_bus_takes_no_time) {
    axt_slcan_link link;
    axt_can_pace pace;
    wire w;
    connect(&link, &w, 4096);
    axt_can_pace_init(&pace, &link.can, &one_megabit);
    axt_can_pace_elapse(&pace, 1000000);
    const axt_can_frame frame = {.id = 0x181, .length = 8};
    for (int i = 0; i < 100; i++) {
        CHECK_EQUAL(pace.can.send(&pace.can, &frame), AXT_CAN_CLOSED);
    }
}

CASE(every_status_has_a_line_of_its_own) {
    for (int a = 0; a >= AXT_CAN_ERROR_PERMISSION; a--) {
        const char *line = axt_can_status_string((axt_can_status)a);
        CHECK(strlen(line) > 0 && strchr(line, '\n') == NULL);
        CHECK(strcmp(line, "unknown status") != 0);
        for (int b = 0; b > a; b--) {
            CHECK(strcmp(line, axt_can_status_string((axt_can_status)b)) != 0);
        }
    }
    CHECK(strcmp(axt_can_status_string((axt_can_status)-100), "unknown status") == 0);
}

CASE(every_state_has_a_name_of_its_own) {
    for (int a = 0; a <= AXT_CAN_STATE_DOWN; a++) {
        CHECK(strcmp(axt_can_state_string((axt_can_state)a), "unknown state") != 0);
        for (int b = 0; b < a; b++) {
            CHECK(strcmp(axt_can_state_string((axt_can_state)a),
                         axt_can_state_string((axt_can_state)b)) != 0);
        }
    }
    CHECK(strcmp(axt_can_state_string((axt_can_state)100), "unknown state") == 0);
}

CASE(a_paced_bus_is_as_well_as_the_bus_behind_it) {
    axt_slcan_link link;
    axt_can_pace pace;
    wire w;
    axt_can_frame frame = {.id = 0x181};
    connect(&link, &w, 4096);
    axt_can_pace_init(&pace, &link.can, &one_megabit);
    link.can.health = (axt_can_health){.state = AXT_CAN_STATE_PASSIVE, .error_frames = 3};
    (void)pace.can.receive(&pace.can, &frame);
    CHECK_EQUAL(pace.can.health.state, AXT_CAN_STATE_PASSIVE);
    CHECK_EQUAL(pace.can.health.error_frames, 3);
    link.can.health.bus_off = 1;
    axt_can_pace_elapse(&pace, 1000000);
    (void)pace.can.send(&pace.can, &frame);
    CHECK_EQUAL(pace.can.health.bus_off, 1);
}

/* ISO 11898-1: codes 9 to 15 are 12, 16, 20, 24, 32, 48 and 64 bytes. */
CASE(data_lengths_have_codes) {
    static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    for (uint8_t code = 0; code < 16; code++) {
        CHECK_EQUAL(axt_can_fd_length(code), lengths[code]);
        CHECK_EQUAL(axt_can_fd_code(lengths[code]), code);
    }
    CHECK_EQUAL(axt_can_fd_code(9), 9);
    CHECK_EQUAL(axt_can_fd_code(63), 15);
    CHECK_EQUAL(axt_can_fd_code(255), 15);
}

CASE(frames_are_valid_or_not) {
    static const struct {
        axt_can_frame frame;
        bool on_classical;
        bool on_fd;
    } examples[] = {
        {{.id = 0x7FF, .length = 8}, true, true},
        {{.id = 0x800, .length = 8}, false, false},
        {{.id = 0x1FFFFFFF | AXT_CAN_EXTENDED}, true, true},
        {{.id = 0x20000000 | AXT_CAN_EXTENDED}, false, false},
        {{.id = 0x7FF | AXT_CAN_REMOTE, .length = 8}, true, true},
        {{.id = 1, .length = 9}, false, false},
        {{.id = 1, .length = 64, .fd = true}, false, true},
        {{.id = 1, .length = 12, .fd = true}, false, true},
        {{.id = 1, .length = 13, .fd = true}, false, false},
        {{.id = 1, .length = 65, .fd = true}, false, false},
        {{.id = 1 | AXT_CAN_REMOTE, .fd = true}, false, false},
    };
    for (size_t i = 0; i < sizeof examples / sizeof *examples; i++) {
        CHECK_EQUAL(axt_can_frame_valid(&examples[i].frame, false), examples[i].on_classical);
        CHECK_EQUAL(axt_can_frame_valid(&examples[i].frame, true), examples[i].on_fd);
    }
}

int main(void) {
    RUN(lines_may_be_split_anywhere);
    RUN(frames_find_nobody_until_the_channel_is_open);
    RUN(a_full_carrier_blocks_and_loses_nothing);
    RUN(a_line_that_is_garbled_is_counted_and_the_next_one_understood);
    RUN(fd_frames_go_both_ways);
    RUN(answers_wait_for_room);
    RUN(the_next_host_finds_an_adapter_just_plugged_in);
    RUN(a_frame_takes_its_longest_time);
    RUN(an_fd_frame_takes_its_longest_time_at_two_rates);
    RUN(a_paced_bus_carries_what_its_bit_rate_allows);
    RUN(a_closed_bus_takes_no_time);
    RUN(data_lengths_have_codes);
    RUN(frames_are_valid_or_not);
    RUN(every_status_has_a_line_of_its_own);
    RUN(every_state_has_a_name_of_its_own);
    RUN(a_paced_bus_is_as_well_as_the_bus_behind_it);
    return REPORT();
}
