/* The portable parts of the firmware: a UART's two ends, SLCAN over it when bytes are lost or
 * damaged, settings, and what outlives a restart. */
#include "axt_crc32.h"
#include "axt_record.h"
#include "axt_settings.h"
#include "axt_slcan_uart.h"

#include "check.h"
#include "reference.h"

enum { ROOM = 8 };

/* A UART with its bytes in memory. */
typedef struct {
    axt_uart uart;
    uint8_t output[ROOM];
    uint8_t received[64];
    uint32_t received_count;
    uint32_t begun; /* times that there was something to send */
} line;

static bool receive(void *context, uint8_t byte) {
    line *l = context;
    if (l->received_count == sizeof l->received) {
        return false;
    }
    l->received[l->received_count] = byte;
    l->received_count++;
    return true;
}

static void begin_to_send(axt_uart *uart) {
    ((line *)uart)->begun++;
}

static void connect(line *l) {
    memset(l, 0, sizeof *l);
    l->uart = (axt_uart){.received = receive,
                         .context = l,
                         .begin_to_send = begin_to_send,
                         .output = {.bytes = l->output, .size = ROOM}};
}

/* ---- The UART ---------------------------------------------------------------------------------
 */

CASE(bytes_leave_in_order_and_none_is_taken_that_finds_no_room) {
    uint64_t seed = 1;
    line l;
    connect(&l);
    uint32_t written = 0;
    uint32_t sent = 0;
    for (int i = 0; i < 10000; i++) {
        uint8_t bytes[ROOM + 2];
        const uint32_t size = (uint32_t)(random_bits(&seed) % sizeof bytes);
        for (uint32_t k = 0; k < size; k++) {
            bytes[k] = (uint8_t)(written + k);
        }
        const uint32_t room = ROOM - (written - sent);
        const uint32_t begun = l.begun;
        const uint32_t taken = axt_uart_write(&l.uart, bytes, size);
        CHECK_EQUAL(taken, (size < room) ? size : room);
        CHECK_EQUAL(l.begun - begun, (taken > 0) ? 1 : 0);
        written += taken;
        for (uint64_t k = random_bits(&seed) % (ROOM + 2); k > 0; k--) {
            uint8_t byte = 0;
            const bool there = axt_uart_next(&l.uart, &byte);
            CHECK_EQUAL(there, sent < written);
            CHECK(!there || byte == (uint8_t)sent);
            sent += there ? 1 : 0;
        }
    }
    CHECK(written > 10000);
}

CASE(damaged_bytes_are_left_out_and_lost_ones_counted) {
    line l;
    connect(&l);
    axt_uart_take(&l.uart, 'a', 0);
    axt_uart_take(&l.uart, 'x', AXT_UART_DAMAGED);
    axt_uart_take(&l.uart, 'b', AXT_UART_OVERRUN); /* the one before it was lost */
    axt_uart_take(&l.uart, 'y', AXT_UART_DAMAGED | AXT_UART_OVERRUN);
    CHECK_EQUAL(l.received_count, 2);
    CHECK(memcmp(l.received, "ab", 2) == 0);
    CHECK_EQUAL(l.uart.damaged, 2);
    CHECK_EQUAL(l.uart.overruns, 2);
    l.received_count = sizeof l.received;
    axt_uart_take(&l.uart, 'c', 0);
    CHECK_EQUAL(l.uart.overruns, 3);
}

/* ---- SLCAN over it ----------------------------------------------------------------------------
 */

static uint32_t clock_of_line(void) {
    return 0;
}

static void take_text(line *l, const char *text, uint32_t errors_of_last) {
    for (; *text != '\0'; text++) {
        axt_uart_take(&l->uart, (uint8_t)*text, (text[1] == '\0') ? errors_of_last : 0);
    }
}

/* How many frames come. */
static uint32_t frames(axt_slcan_uart *slcan, axt_can_frame *last) {
    uint32_t count = 0;
    while (slcan->link.can.receive(&slcan->link.can, last) == AXT_CAN_OK) {
        count++;
    }
    return count;
}

CASE(a_damaged_byte_costs_its_line_and_no_other) {
    line l;
    axt_slcan_uart slcan;
    axt_can_frame frame = {0};
    connect(&l);
    axt_slcan_uart_open(&slcan, &l.uart, clock_of_line);
    take_text(&l, "O\rt1232AABB\r", 0);
    CHECK_EQUAL(frames(&slcan, &frame), 1);
    take_text(&l, "t1232AAB", AXT_UART_DAMAGED); /* and its last digit is missing */
    take_text(&l, "B\rt3211CC\r", 0);
    CHECK_EQUAL(frames(&slcan, &frame), 1);
    CHECK_EQUAL(frame.id, 0x321);
    CHECK_EQUAL(slcan.link.can.health.error_frames, 2); /* the byte, and the line */
    CHECK_EQUAL(slcan.link.can.health.overflows, 0);
}

CASE(bytes_that_find_no_room_are_counted_as_lost_and_the_next_line_is_understood) {
    line l;
    axt_slcan_uart slcan;
    axt_can_frame frame = {0};
    connect(&l);
    axt_slcan_uart_open(&slcan, &l.uart, clock_of_line);
    take_text(&l, "O\r", 0);
    (void)frames(&slcan, &frame);
    for (uint32_t i = 0; i < AXT_SLCAN_UART_INPUT + 3; i++) {
        axt_uart_take(&l.uart, 'x', 0);
    }
    CHECK_EQUAL(frames(&slcan, &frame), 0);
    CHECK_EQUAL(slcan.link.can.health.overflows, 3);
    take_text(&l, "\rt3211CC\r", 0);
    CHECK_EQUAL(frames(&slcan, &frame), 1);
    CHECK_EQUAL(slcan.link.can.health.overflows, 3);
}

CASE(frames_leave_through_the_uart) {
    line l;
    axt_slcan_uart slcan;
    axt_can_frame none = {0};
    const axt_can_frame frame = {.id = 0x123, .length = 1, .data = {0xAB}};
    char sent[16] = {0};
    connect(&l);
    axt_slcan_uart_open(&slcan, &l.uart, clock_of_line);
    CHECK_EQUAL(slcan.link.can.send(&slcan.link.can, &frame), AXT_CAN_CLOSED);
    take_text(&l, "O\r", 0);
    CHECK_EQUAL(frames(&slcan, &none), 0);
    CHECK_EQUAL(slcan.link.can.send(&slcan.link.can, &frame), AXT_CAN_OK);
    for (uint32_t i = 0; i + 1 < sizeof sent;) {
        (void)frames(&slcan, &none); /* flushes as much as the UART has room for */
        uint8_t byte;
        if (!axt_uart_next(&l.uart, &byte)) {
            break;
        }
        sent[i] = (char)byte;
        i++;
    }
    CHECK(strcmp(sent, "\rt1231AB\r") == 0);
    slcan.link.can.close(&slcan.link.can);
}

/* ---- Settings ---------------------------------------------------------------------------------
 */

static axt_settings sealed(axt_settings page) {
    page.signature = AXT_SETTINGS_SIGNATURE;
    page.checksum = axt_crc32(0, (const uint8_t *)&page, sizeof page - sizeof page.checksum);
    return page;
}

static const axt_settings commissioned = {
    .node = 7, .stream_decimation = 5, .host_timeout = 1000, .flags = AXT_SETTINGS_STREAMING};

static bool is_default(const axt_settings *settings) {
    return settings->node == 1 && settings->stream_decimation == 10 &&
           settings->host_timeout == 400 && settings->flags == 0;
}

CASE(settings_are_those_of_the_page_or_the_defaults) {
    const axt_settings page = sealed(commissioned);
    const axt_settings read = axt_settings_read(&page);
    CHECK(memcmp(&read, &page, sizeof page) == 0);
    for (uint32_t bit = 0; bit < 8 * sizeof page; bit++) {
        axt_settings damaged = page;
        ((uint8_t *)&damaged)[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        const axt_settings instead = axt_settings_read(&damaged);
        CHECK(is_default(&instead));
    }
    axt_settings erased;
    memset(&erased, 0xFF, sizeof erased);
    const axt_settings instead = axt_settings_read(&erased);
    CHECK(is_default(&instead));
}

CASE(settings_that_make_no_sense_are_not_taken) {
    const struct {
        uint32_t node;
        uint32_t decimation;
        uint32_t timeout;
        bool taken;
    } cases[] = {{1, 1, 1, true},     {126, UINT32_MAX, 65535, true},
                 {0, 1, 1, false},    {127, 1, 1, false},
                 {1, 0, 1, false},    {1, 1, 0, false},
                 {1, 1, 65536, false}};
    for (size_t i = 0; i < COUNT_OF(cases); i++) {
        axt_settings page = commissioned;
        page.node = cases[i].node;
        page.stream_decimation = cases[i].decimation;
        page.host_timeout = cases[i].timeout;
        page = sealed(page);
        const axt_settings read = axt_settings_read(&page);
        CHECK_EQUAL(!is_default(&read), cases[i].taken);
    }
}

/* ---- What outlives a restart ------------------------------------------------------------------
 */

CASE(memory_that_was_without_power_is_no_record) {
    uint64_t seed = 1;
    for (int i = 0; i < 100; i++) {
        axt_record record;
        for (uint32_t k = 0; k < sizeof record; k++) {
            ((uint8_t *)&record)[k] = (i == 0) ? 0 : (uint8_t)random_bits(&seed);
        }
        axt_record_begin(&record);
        CHECK_EQUAL(record.restarts, 0);
        CHECK_EQUAL(axt_record_take_fault(&record).error_code, 0);
    }
}

CASE(a_fault_is_told_once_by_the_run_after_it) {
    axt_record record = {0};
    const axt_fault fault = {.error_code = 0x6100, .pc = 0x1234};
    axt_record_begin(&record);
    axt_record_keep_fault(&record, &fault);
    axt_record_begin(&record);
    CHECK_EQUAL(record.restarts, 1);
    const axt_fault told = axt_record_take_fault(&record);
    CHECK_EQUAL(told.error_code, 0x6100);
    CHECK_EQUAL(told.pc, 0x1234);
    axt_record_begin(&record);
    CHECK_EQUAL(record.restarts, 2);
    CHECK_EQUAL(axt_record_take_fault(&record).error_code, 0);
}

CASE(the_adapter_is_after_a_restart_as_the_host_had_set_it) {
    axt_record record = {0};
    axt_slcan slcan;
    axt_slcan_init(&slcan);
    const axt_slcan plugged_in = slcan;
    axt_record_begin(&record);
    slcan.channel = AXT_SLCAN_OPEN; /* nothing is kept yet */
    slcan.timestamps = true;
    axt_record_restore_adapter(&record, &slcan);
    CHECK_EQUAL(slcan.channel, AXT_SLCAN_OPEN);

    slcan.acceptance_code = 1;
    slcan.acceptance_mask = 2;
    axt_record_keep_adapter(&record, &slcan);
    axt_record_begin(&record);
    axt_slcan after = plugged_in;
    axt_record_restore_adapter(&record, &after);
    CHECK_EQUAL(after.channel, AXT_SLCAN_OPEN);
    CHECK_EQUAL(after.timestamps, true);
    CHECK_EQUAL(after.acceptance_code, 1);
    CHECK_EQUAL(after.acceptance_mask, 2);
}

int main(void) {
    RUN(bytes_leave_in_order_and_none_is_taken_that_finds_no_room);
    RUN(damaged_bytes_are_left_out_and_lost_ones_counted);
    RUN(a_damaged_byte_costs_its_line_and_no_other);
    RUN(bytes_that_find_no_room_are_counted_as_lost_and_the_next_line_is_understood);
    RUN(frames_leave_through_the_uart);
    RUN(settings_are_those_of_the_page_or_the_defaults);
    RUN(settings_that_make_no_sense_are_not_taken);
    RUN(memory_that_was_without_power_is_no_record);
    RUN(a_fault_is_told_once_by_the_run_after_it);
    RUN(the_adapter_is_after_a_restart_as_the_host_had_set_it);
    return REPORT();
}
