/* The SLCAN codec against LAWICEL's command set, and against anything else a line can bring. */
#include "axt_slcan.h"

#include "check.h"
#include "reference.h"

/* Feeds a text; the reply of its last line. */
static axt_slcan_reply feed(axt_slcan *slcan, const char *text) {
    axt_slcan_reply reply = {0};
    for (; *text != '\0'; text++) {
        (void)axt_slcan_input(slcan, *text, &reply);
    }
    return reply;
}

static bool answers(axt_slcan *slcan, const char *text, const char *answer) {
    const axt_slcan_reply reply = feed(slcan, text);
    const bool same =
        reply.answer_length == strlen(answer) && memcmp(reply.answer, answer, strlen(answer)) == 0;
    if (!same) {
        (void)fprintf(stderr, "'%s' is answered by '%.*s'\n", text, reply.answer_length,
                      reply.answer);
    }
    return same;
}

static axt_slcan plugged_in(const char *commands) {
    axt_slcan slcan;
    axt_slcan_init(&slcan);
    (void)feed(&slcan, commands);
    return slcan;
}

static bool same_frame(const axt_can_frame *a, const axt_can_frame *b) {
    return a->id == b->id && a->length == b->length && a->fd == b->fd &&
           memcmp(a->data, b->data, a->length) == 0;
}

CASE(the_channel_opens_and_closes) {
    axt_slcan slcan = plugged_in("");
    CHECK(answers(&slcan, "C\r", "\a"));
    CHECK(answers(&slcan, "O\r", "\r"));
    CHECK_EQUAL(slcan.channel, AXT_SLCAN_OPEN);
    CHECK(answers(&slcan, "O\r", "\a"));
    CHECK(answers(&slcan, "L\r", "\a"));
    CHECK(answers(&slcan, "C\r", "\r"));
    CHECK(answers(&slcan, "L\r", "\r"));
    CHECK_EQUAL(slcan.channel, AXT_SLCAN_LISTEN_ONLY);
    CHECK(answers(&slcan, "C\r", "\r"));
    CHECK_EQUAL(slcan.channel, AXT_SLCAN_CLOSED);
    CHECK(answers(&slcan, "O1\r", "\a"));
    CHECK(answers(&slcan, "\r", "\r"));
}

CASE(settings_are_for_a_closed_channel) {
    static const char *const settings[] = {"S0\r", "S8\r",        "s031C\r",     "Z1\r",
                                           "Z0\r", "M12345678\r", "mFFFFFFFF\r", "Y5\r"};
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++) {
        axt_slcan slcan = plugged_in("");
        CHECK(answers(&slcan, settings[i], "\r"));
        slcan = plugged_in("O\r");
        CHECK(answers(&slcan, settings[i], "\a"));
    }
    axt_slcan slcan = plugged_in("S6\r");
    CHECK_EQUAL(slcan.timing, 6);
    (void)feed(&slcan, "s031c\r");
    CHECK_EQUAL(slcan.timing, 0x031C);
    (void)feed(&slcan, "Y2\r");
    CHECK_EQUAL(slcan.data_rate, 2);
    (void)feed(&slcan, "M0000ABCD\rm1234FFFF\r");
    CHECK_EQUAL(slcan.acceptance_code, 0x0000ABCD);
    CHECK_EQUAL(slcan.acceptance_mask, 0x1234FFFF);
}

CASE(malformed_commands_are_refused_and_change_nothing) {
    static const char *const lines[] = {"S\r",
                                        "S9\r",
                                        "S10\r",
                                        "s031\r",
                                        "s03G1\r",
                                        "Z\r",
                                        "Z2\r",
                                        "M1234567\r",
                                        "m123456789\r",
                                        "M1234567x\r",
                                        "X\r",
                                        "o\r",
                                        "t\r",
                                        "t12\r",
                                        "t123\r",
                                        "t1239\r",
                                        "t800\r",
                                        "t8000\r",
                                        "t12311\r",
                                        "t1231123\r",
                                        "t123111 \r",
                                        "T20000000\r",
                                        "T200000000\r",
                                        "T123456781\r",
                                        "r12\r",
                                        "r123\r",
                                        "r123112\r",
                                        "R123456\r",
                                        "R1234567811\r",
                                        "t123A\r",
                                        "Y9\r",
                                        "Y\r",
                                        "d12\r",
                                        "d8000\r",
                                        "d123G\r",
                                        "d123900112233445566778899AA\r", /* 9 means 12 bytes */
                                        "d1232112\r",
                                        "B1234567\r",
                                        "B200000000\r",
                                        "b12310\r",
                                        "V1\r",
                                        "N0\r",
                                        "v \r",
                                        "F0\r",
                                        "hello\r",
                                        "t1239112233445566778899\r",
                                        "T0000000AA00112233445566778899\r",
                                        "r1239\r",
                                        "\n\r",
                                        "t12380011223344556677FF\r",
                                        "\x01\x7F\x80\xFF\r"};
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++) {
        for (int open = 0; open < 2; open++) {
            axt_slcan slcan = plugged_in((open == 1) ? "O\r" : "");
            axt_slcan before = slcan;
            CHECK(answers(&slcan, lines[i], "\a"));
            memcpy(before.line, slcan.line, sizeof before.line);
            CHECK(UNCHANGED(slcan, before));
        }
    }
}

CASE(versions_serial_number_and_flags_are_told) {
    axt_slcan slcan = plugged_in("");
    CHECK(answers(&slcan, "V\r", "V1010\r"));
    CHECK(answers(&slcan, "v\r", "v1010\r"));
    CHECK(answers(&slcan, "N\r", "NAXTW\r"));
    CHECK(answers(&slcan, "F\r", "\a"));
    (void)feed(&slcan, "O\r");
    slcan.flags = AXT_SLCAN_QUEUE_FULL;
    CHECK(answers(&slcan, "F\r", "F01\r"));
    CHECK(answers(&slcan, "F\r", "F00\r"));
}

CASE(frames_of_the_host_are_understood) {
    static const struct {
        const char *line;
        const char *answer;
        axt_can_frame frame;
    } examples[] = {
        {"t0000\r", "z\r", {.id = 0, .length = 0}},
        {"t7FF3112233\r", "z\r", {.id = 0x7FF, .length = 3, .data = {0x11, 0x22, 0x33}}},
        {"t2018abCDef0123456789\r",
         "z\r",
         {.id = 0x201, .length = 8, .data = {0xAB, 0xCD, 0xEF, 0x01, 0x23, 0x45, 0x67, 0x89}}},
        {"T1FFFFFFF1FF\r",
         "Z\r",
         {.id = 0x1FFFFFFF | AXT_CAN_EXTENDED, .length = 1, .data = {255}}},
        {"r1238\r", "z\r", {.id = 0x123 | AXT_CAN_REMOTE, .length = 8}},
        {"d12311F\r", "z\r", {.id = 0x123, .length = 1, .fd = true, .data = {0x1F}}},
        {"b4019000102030405060708090A0b\r",
         "z\r",
         {.id = 0x401, .length = 12, .fd = true, .data = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}}},
        {"D1FFFFFFF0\r", "Z\r", {.id = 0x1FFFFFFF | AXT_CAN_EXTENDED, .fd = true}},
        {"B00000001155\r",
         "Z\r",
         {.id = 1 | AXT_CAN_EXTENDED, .length = 1, .fd = true, .data = {0x55}}},
        {"R000000010\r", "Z\r", {.id = 1 | AXT_CAN_REMOTE | AXT_CAN_EXTENDED, .length = 0}},
    };
    for (size_t i = 0; i < sizeof examples / sizeof *examples; i++) {
        axt_slcan slcan = plugged_in("O\r");
        const axt_slcan_reply reply = feed(&slcan, examples[i].line);
        CHECK(reply.has_frame);
        CHECK(same_frame(&reply.frame, &examples[i].frame));
        CHECK(answers(&slcan, examples[i].line, examples[i].answer));
        slcan = plugged_in("");
        CHECK(answers(&slcan, examples[i].line, "\a"));
        CHECK(!feed(&slcan, examples[i].line).has_frame);
        slcan = plugged_in("L\r");
        CHECK(answers(&slcan, examples[i].line, "\a"));
        CHECK(!feed(&slcan, examples[i].line).has_frame);
    }
}

static axt_can_frame random_frame(uint64_t *seed) {
    axt_can_frame frame = {0};
    const uint32_t kind = (uint32_t)random_bits(seed);
    frame.id = (uint32_t)random_bits(seed) & (((kind & 1) != 0) ? 0x1FFFFFFF : 0x7FF);
    frame.id |= ((kind & 1) != 0) ? AXT_CAN_EXTENDED : 0;
    frame.fd = (kind & 4) != 0;
    const bool remote = (kind & 2) != 0 && !frame.fd;
    frame.id |= remote ? AXT_CAN_REMOTE : 0;
    frame.length = frame.fd ? axt_can_fd_length((uint8_t)(random_bits(seed) % 16))
                            : (uint8_t)(random_bits(seed) % 9);
    for (uint32_t i = 0; i < frame.length && !remote; i++) {
        frame.data[i] = (uint8_t)random_bits(seed);
    }
    return frame;
}

/* What the adapter writes for the host is what it reads from it: LAWICEL uses one form for both. */
CASE(a_frame_written_and_read_again_is_the_same) {
    axt_slcan slcan = plugged_in("O\r");
    uint64_t seed = 1;
    for (int n = 0; n < 10000; n++) {
        const axt_can_frame frame = random_frame(&seed);
        char line[AXT_SLCAN_LINE_MAX + 1] = {0};
        const uint32_t length = axt_slcan_output(&slcan, &frame, 0, line);
        CHECK_EQUAL(length, strlen(line));
        CHECK_EQUAL(strcspn(line, "\r"), length - 1);
        const axt_slcan_reply reply = feed(&slcan, line);
        CHECK(reply.has_frame);
        CHECK(same_frame(&reply.frame, &frame));
    }
}

CASE(nothing_is_sent_to_a_closed_channel) {
    const axt_can_frame frame = {.id = 0x181, .length = 1, .data = {7}};
    char line[AXT_SLCAN_LINE_MAX];
    axt_slcan slcan = plugged_in("");
    CHECK_EQUAL(axt_slcan_output(&slcan, &frame, 0, line), 0);
    (void)feed(&slcan, "L\r");
    CHECK_EQUAL(axt_slcan_output(&slcan, &frame, 0, line), 7 + 1);
    const axt_can_frame too_long = {.id = 0x181, .length = 9};
    CHECK_EQUAL(axt_slcan_output(&slcan, &too_long, 0, line), 0);
}

CASE(timestamps_are_milliseconds_of_the_minute) {
    const axt_can_frame frame = {.id = 0x181, .length = 1, .data = {7}};
    axt_slcan slcan = plugged_in("Z1\rO\r");
    char line[AXT_SLCAN_LINE_MAX + 1] = {0};
    CHECK_EQUAL(axt_slcan_output(&slcan, &frame, 59999, line), 12);
    CHECK(memcmp(line, "t181107EA5F\r", 12) == 0);
    CHECK_EQUAL(axt_slcan_output(&slcan, &frame, 60001, line), 12);
    CHECK(memcmp(line, "t1811070001\r", 12) == 0);
    const axt_can_frame longest = {.id = 0x1FFFFFFF | AXT_CAN_EXTENDED, .length = 64, .fd = true};
    CHECK_EQUAL(axt_slcan_output(&slcan, &longest, 0, line), AXT_SLCAN_LINE_MAX);
}

static bool passes(axt_slcan *slcan, uint32_t id, uint8_t data) {
    const axt_can_frame frame = {.id = id, .length = 1, .data = {data}};
    char line[AXT_SLCAN_LINE_MAX];
    return axt_slcan_output(slcan, &frame, 0, line) > 0;
}

/* NXP, SJA1000 data sheet, dual filter: ID.10 to ID.3 in the first code byte, ID.2 to ID.0 and RTR
 * at the top of the second; for filter 2 likewise in the third and fourth. */
CASE(the_acceptance_filter_is_that_of_the_sja1000) {
    axt_slcan all = plugged_in("O\r");
    CHECK(passes(&all, 0x123, 0) && passes(&all, 0x12345678 | AXT_CAN_EXTENDED, 0));

    /* filter 1: 0x181 with any data; filter 2: 0x281 */
    axt_slcan two = plugged_in("M30205020\rm000F000F\rO\r");
    CHECK(passes(&two, 0x181, 0));
    CHECK(passes(&two, 0x281, 0xFF));
    CHECK(!passes(&two, 0x180, 0));
    CHECK(!passes(&two, 0x381, 0));
    CHECK(!passes(&two, 0x181 | AXT_CAN_REMOTE, 0));

    /* filter 1: any identifier with 0x5A as first byte; filter 2: nothing but remote 0x7FF */
    axt_slcan data = plugged_in("M0005FFFA\rmFFF00000\rO\r");
    CHECK(passes(&data, 0x001, 0x5A));
    CHECK(!passes(&data, 0x001, 0x5B));
    CHECK(!passes(&data, 0x001, 0x4A));
    CHECK(passes(&data, 0x7FF | AXT_CAN_REMOTE, 0));

    /* extended: upper 16 bits */
    axt_slcan extended = plugged_in("M91A20000\rm0000FFFF\rO\r"); /* 0x12345678 >> 13 is 0x91A2 */
    CHECK(passes(&extended, 0x12345678 | AXT_CAN_EXTENDED, 0));
    CHECK(passes(&extended, 0x12344000 | AXT_CAN_EXTENDED, 0));
    extended = plugged_in("M91A2FFFF\rm00000000\rO\r");
    CHECK(passes(&extended, 0x12345678 | AXT_CAN_EXTENDED, 0));
    CHECK(!passes(&extended, 0x02345678 | AXT_CAN_EXTENDED, 0));
}

/* Whatever came before, the line after a carriage return is understood. */
CASE(garbage_ends_with_the_line) {
    uint64_t seed = 7;
    for (int n = 0; n < 2000; n++) {
        axt_slcan slcan = plugged_in("O\r");
        const uint32_t size = (uint32_t)random_bits(&seed) % 100;
        axt_slcan_reply reply;
        for (uint32_t i = 0; i < size; i++) {
            const char byte = (char)random_bits(&seed);
            if (byte != 'C') { /* which could close the channel */
                (void)axt_slcan_input(&slcan, byte, &reply);
            }
        }
        (void)axt_slcan_input(&slcan, '\r', &reply);
        CHECK(feed(&slcan, "t1231AB\r").has_frame);
    }
}

CASE(a_line_of_any_length_is_one_line) {
    for (uint32_t length = 27; length < 1000; length++) { /* over and beyond the longest */
        axt_slcan slcan = plugged_in("O\r");
        axt_slcan_reply reply;
        bool ended = false;
        for (uint32_t i = 0; i < length; i++) {
            ended = ended || axt_slcan_input(&slcan, (i == 0) ? 't' : '1', &reply);
        }
        CHECK(!ended);
        CHECK(answers(&slcan, "\r", "\a"));
        CHECK(feed(&slcan, "t1231AB\r").has_frame);
    }
}

int main(void) {
    RUN(the_channel_opens_and_closes);
    RUN(settings_are_for_a_closed_channel);
    RUN(malformed_commands_are_refused_and_change_nothing);
    RUN(versions_serial_number_and_flags_are_told);
    RUN(frames_of_the_host_are_understood);
    RUN(a_frame_written_and_read_again_is_the_same);
    RUN(nothing_is_sent_to_a_closed_channel);
    RUN(timestamps_are_milliseconds_of_the_minute);
    RUN(the_acceptance_filter_is_that_of_the_sja1000);
    RUN(garbage_ends_with_the_line);
    RUN(a_line_of_any_length_is_one_line);
    return REPORT();
}
