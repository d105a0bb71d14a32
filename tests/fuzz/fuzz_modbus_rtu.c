/* Anything at all on the serial line of the portable Modbus RTU server, before a node that runs.
 *
 * The input is a sequence of lumps, silence after each: a byte with the length (0 to 127; bit 7:
 * the CRC is put right, which no fuzzer would find by itself) and so many bytes. What must hold:
 * answers are proper frames of our unit, and a line that has not turned the key changes nothing. */
#include "axt_modbus_rtu.h"
#include "axt_registers_node.h"
#include "node_rig.h"

enum { SEAL = 0x80, CHARACTER_US = 96, SILENCE_US = 2000 };

typedef struct {
    uint32_t history;
    uint32_t order; /* of the background to the tick: every command that does something gives one */
    axt_schroeder excitation;
} settings;

static settings settings_of(const axt_node *node) {
    return (settings){.history = axt_history_decimation(&node->history),
                      .order = atomic_load(&node->order_given),
                      .excitation = node->excitation};
}

static bool same(const settings *a, const settings *b) {
    const axt_schroeder *x = &a->excitation;
    const axt_schroeder *y = &b->excitation;
    return a->history == b->history && a->order == b->order && x->length == y->length &&
           x->first == y->first && x->stride == y->stride && x->lines == y->lines &&
           x->seed == y->seed && memcmp(&x->rms, &y->rms, sizeof x->rms) == 0;
}

static void expect(bool holds) {
    if (!holds) {
        abort();
    }
}

static void expect_proper(const uint8_t *answer, uint32_t length) {
    uint8_t again[AXT_MODBUS_LINE_FRAME_MAX];
    expect(length >= 5 && length <= AXT_MODBUS_LINE_FRAME_MAX && answer[0] == RIG_ID);
    memcpy(again, answer, length);
    expect(axt_modbus_line_seal(again, length - 2) == length);
    expect(memcmp(again, answer, length) == 0);
}

static void send_lump(axt_modbus_rtu *rtu, const uint8_t *bytes, uint32_t length, uint32_t *now) {
    for (uint32_t i = 0; i < length; i++) {
        axt_modbus_rtu_receive(rtu, bytes[i], *now);
        *now += CHARACTER_US;
    }
    *now += SILENCE_US;
}

static void try_lump(rig *r, axt_modbus_rtu *rtu, const uint8_t *bytes, uint32_t length,
                     uint32_t *now) {
    const bool locked = rtu->client.lock != AXT_REGISTERS_ENABLED;
    const settings before = settings_of(&r->node);
    send_lump(rtu, bytes, length, now);
    for (uint32_t i = 0; i < 3; i++) {
        uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX];
        const uint32_t answered = axt_modbus_rtu_poll(rtu, *now, answer);
        if (answered > 0) {
            expect_proper(answer, answered);
        }
    }
    if (locked) {
        const settings after = settings_of(&r->node);
        expect(same(&before, &after));
    }
    rig_run(r, 2);
    rig_forget_sent(r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static rig *r;
    static axt_registers_node view;
    static axt_modbus_rtu rtu;
    if (r == NULL) {
        r = rig_running();
    }
    const axt_registers_port port = axt_registers_node_port(&view, &r->node);
    const bool eager = size > 0 && (data[0] & 1) != 0;
    axt_modbus_rtu_init(&rtu, &port, RIG_ID, 115200, eager);
    uint32_t now = SILENCE_US;
    size_t at = 1;
    while (at < size) {
        uint8_t lump[(SEAL - 1) + 2];
        uint32_t length = data[at] & (SEAL - 1);
        const bool seal = (data[at] & SEAL) != 0;
        at++;
        if (length > size - at) {
            length = (uint32_t)(size - at);
        }
        memcpy(lump, data + at, length);
        at += length;
        try_lump(r, &rtu, lump, seal ? axt_modbus_line_seal(lump, length) : length, &now);
    }
    return 0;
}
