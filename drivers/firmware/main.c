/* A drive's firmware: the control interrupt, and everything else in the background.
 *
 * Both are the portable node's (axt_node.h); here they are given a CAN bus (SLCAN on one UART), a
 * Modbus RTU server (on the other), an axis (axt_hardware.h) and a board (axt_board.h).
 */
#include "axt_board.h"
#include "axt_hardware.h"
#include "axt_modbus_rtu.h"
#include "axt_node.h"
#include "axt_registers_node.h"
#include "axt_slcan_uart.h"

enum {
    TABLE_SIZE = 4096, /* samples of an excitation's period */
    TRACE_SIZE = 8192,
    RING_SIZE = 1024, /* 1 s of live stream at 1 kHz while the bus is busy */
    HISTORY_SIZE = 512,
    CAN_OUTPUT = 2048, /* bytes on their way out of a UART; powers of two */
    MODBUS_OUTPUT = 256,
    EXCITATION_LENGTH = 2048,
    EXCITATION_LINES = 271 /* to twice the resonance of the axis that is emulated */
};

static axt_node node;

/* ---- CAN --------------------------------------------------------------------------------------
 */

static uint8_t can_output[CAN_OUTPUT];
static axt_uart can_uart = {.output = {.bytes = can_output, .size = CAN_OUTPUT}};
static axt_slcan_uart can;

/* Goes on when the microseconds come round, every 71 minutes. */
static uint32_t milliseconds(void) {
    static uint32_t counted;
    static uint32_t last;
    const uint32_t more = (axt_board_microseconds() - last) / 1000;
    last += more * 1000;
    counted += more;
    return counted;
}

/* The host of a drive that has restarted has sent half a line, and got half of one. */
static void open_can(void) {
    const axt_record *record = axt_board_record();
    axt_slcan_uart_open(&can, &can_uart, milliseconds);
    axt_record_restore_adapter(record, &can.link.slcan);
    if (record->restarts > 0) {
        (void)axt_byte_ring_put(&can_uart.output, '\r');
    }
}

/* ---- Modbus -----------------------------------------------------------------------------------
 */

static uint8_t modbus_output[MODBUS_OUTPUT];
static axt_modbus_rtu modbus;
static axt_registers_node node_registers;
static axt_registers_port node_port;

static bool take_modbus_byte(void *context, uint8_t byte) {
    axt_modbus_rtu_receive(context, byte, axt_board_microseconds());
    return true; /* it is the server that sees what is missing */
}

static axt_uart modbus_uart = {.received = take_modbus_byte,
                               .context = &modbus,
                               .output = {.bytes = modbus_output, .size = MODBUS_OUTPUT}};

/* What the node shows, and what only the firmware knows. */
static void snapshot(void *context, uint16_t registers[AXT_REGISTER_END]) {
    node_port.snapshot(context, registers);
    registers[AXT_REGISTER_STACK_SIZE] = (uint16_t)axt_board_stack_size();
    registers[AXT_REGISTER_STACK_USED] = (uint16_t)axt_board_stack_used();
    registers[AXT_REGISTER_CONTROL_LOAD] = (uint16_t)axt_board_load();
    registers[AXT_REGISTER_RESTARTS] = (uint16_t)axt_board_record()->restarts;
}

static void open_modbus(uint32_t unit) {
    node_port = axt_registers_node_port(&node_registers, &node);
    axt_registers_port port = node_port;
    port.snapshot = snapshot;
    axt_modbus_rtu_init(&modbus, &port, (uint8_t)unit, AXT_BOARD_MODBUS_BIT_RATE,
                        axt_board_in_lumps);
}

static void serve_modbus(void) {
    uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX];
    const uint32_t length = axt_modbus_rtu_poll(&modbus, axt_board_microseconds(), answer);
    (void)axt_uart_write(&modbus_uart, answer, length);
}

/* ---- The drive --------------------------------------------------------------------------------
 */

static axt_status open_node(const axt_settings *settings, const axt_fault *fault) {
    static axt_real table[TABLE_SIZE];
    static axt_node_sample trace[TRACE_SIZE];
    static axt_node_stream_sample ring[RING_SIZE];
    static axt_history_slot history[HISTORY_SIZE];
    const axt_hardware *hardware = &axt_hardware_here;
    const axt_hardware_traits *traits = hardware->traits;
    const axt_node_config config = {
        .id = (uint8_t)settings->node,
        .control_period = traits->control_period,
        .stream_decimation = settings->stream_decimation,
        .rated_torque = traits->rated_torque,
        .counts_per_turn = {traits->counts_per_turn[0], traits->counts_per_turn[1]},
        .form = AXT_IDENT_3X2,
        .hold = traits->hold,
        .expected = traits->expected,
        .forgetting = (axt_real)0.99995,
        .excitation = {.length = EXCITATION_LENGTH,
                       .first = 1,
                       .stride = 1,
                       .lines = EXCITATION_LINES,
                       .rms = (axt_real)0.2},
        .limits = {.torque = INT16_MAX,
                   .speed = 6000,
                   .travel_min = INT32_MIN,
                   .travel_max = INT32_MAX},
        .host_timeout = (uint16_t)settings->host_timeout,
        .error_code = fault->error_code,
        .error_cause = (int32_t)fault->pc,
        .excited = (settings->flags & AXT_SETTINGS_EXCITED) != 0,
        .streaming = (settings->flags & AXT_SETTINGS_STREAMING) != 0,
        .table = table,
        .table_size = TABLE_SIZE,
        .trace = trace,
        .trace_size = TRACE_SIZE,
        .ring = ring,
        .ring_size = RING_SIZE,
        .history = history,
        .history_size = HISTORY_SIZE,
    };
    const axt_node_port port = {
        .can = &can.link.can,
        .axis = hardware->axis,
        .apply_torque = hardware->apply_torque,
        .read_encoders = hardware->read_encoders,
        .axis_command = hardware->axis_command,
        .restart_axis = hardware->restart_axis,
    };
    const axt_status status = hardware->start(hardware->axis);
    return (status == AXT_OK) ? axt_node_init(&node, &config, &port) : status;
}

void axt_control_interrupt(void) {
    axt_node_tick(&node);
}

/* Late control interrupts are counted by the board, where they are seen. */
static void tell_late(void) {
    static uint32_t told;
    const uint32_t late = axt_board_late();
    axt_node_overrun(&node, late - told);
    told = late;
}

int main(void) {
    const axt_settings settings = axt_settings_read(axt_board_settings());
    axt_record_begin(axt_board_record());
    const axt_fault fault = axt_record_take_fault(axt_board_record());
    open_can();
    if (open_node(&settings, &fault) != AXT_OK) {
        return 1; /* a drive whose constants make no sense */
    }
    open_modbus(settings.node);
    const axt_real period = axt_hardware_here.traits->control_period * (axt_real)1e6;
    axt_board_start(&can_uart, &modbus_uart, (uint32_t)(period + (axt_real)0.5));
    uint32_t fed = 0;
    for (;;) {
        (void)axt_node_background(&node); /* a UART does not fail */
        serve_modbus();
        axt_record_keep_adapter(axt_board_record(), &can.link.slcan);
        tell_late();
        const uint32_t now = node.now;
        if (now != fed) { /* both run: the background, and the control interrupt */
            axt_board_feed_watchdog();
            fed = now;
        }
    }
}
